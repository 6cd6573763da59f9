"""Sizes in words, at the bounds where per cent become multiples and factors."""

import doctest

import numpy as np

from isorig.analysis import wording
from isorig.analysis.wording import SIZED, by_factor, of_signal, sized


def test_examples() -> None:
    assert doctest.testmod(wording).failed == 0


def test_an_error_of_ten_times_the_signal_is_given_as_a_multiple() -> None:
    assert of_signal(0.985) == "98 % of the signal"
    assert of_signal(1.024, 3) == "102 % of the signal"
    assert of_signal(9.87) == "990 % of the signal"
    assert of_signal(10.0) == "10 times the signal"


def test_nearly_twice_as_much_is_given_as_a_factor_in_both_directions() -> None:
    assert by_factor(np.log(1.89)) == "89 %"
    assert by_factor(np.log(2.0)) == by_factor(-np.log(2.0)) == "a factor of 2"


def test_zero_is_in_the_unit_itself() -> None:
    for unit in SIZED:
        assert sized(0.0, unit) == f"0 {unit.replace('^3', '³')}".removesuffix(" 1")


def test_a_value_below_its_uncertainty_is_not_rounded_to_zero() -> None:
    assert sized(1783.0, "N/m", 5e5) == "1.8 ± 500 kN/m"
    assert sized(0.06, "Hz", 1.0) == "0.060 ± 1.0 Hz"
    assert sized(-30.0, "Hz", 400.0) == "-30 ± 400 Hz"
    assert sized(3.0, "Hz", 4.0) == "3 ± 4 Hz"
