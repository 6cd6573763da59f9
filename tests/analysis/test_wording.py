"""Sizes in words, at the bounds where per cent become multiples and factors."""

import doctest
import re
from pathlib import Path

import numpy as np
import pytest

from isorig.analysis import wording
from isorig.analysis.wording import SIZED, by_factor, of_signal, sized, with_std


def test_examples() -> None:
    assert doctest.testmod(wording).failed == 0


def test_an_error_of_ten_times_the_signal_is_given_as_a_multiple() -> None:
    assert of_signal(0.985) == "98 % of the signal"
    assert of_signal(1.024) == "100 % of the signal"
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
    # An exponent only from a million on.
    assert (sized(3.99e5, "N s/m"), sized(1.01e6, "N s/m")) == ("399000 N s/m", "1.01e+06 N s/m")


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (55.0, 12.0, "+55 ± 12"), (27.314, 0.0523, "+27.31 ± 0.05"), (27.314, 0.0123, "+27.314 ± 0.012"),
        (-1234.0, 223.0, "-1200 ± 200"), (0.5, 0.0, "+0.5 ± 0"), (0.01841, 0.006, "+0.018 ± 0.006"),
        (0.5, float("nan"), "+0.5 ± nan"),
    ],
)  # fmt: skip
def test_a_value_has_the_digits_of_its_uncertainty(value: float, std: float, text: str) -> None:
    assert with_std(value, std, sign=True) == text
    assert with_std(value, std) == text.removeprefix("+")


def test_no_sentence_rounds_an_uncertainty_otherwise() -> None:
    # One significant digit of 12 is 1e+01.
    package = Path(wording.__file__).parents[1]
    otherwise = re.compile(r"± (?:\"\s*f\")?\{[^}]*:\.\dg\}")
    found = [path.name for path in package.rglob("*.py") if otherwise.search(path.read_text(encoding="utf-8"))]
    assert found == ["wording.py"]
