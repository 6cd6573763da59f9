"""The decisions of trends, right below and right above each threshold."""

from __future__ import annotations

import numpy as np
import pytest

from isorig.analysis.errors import DataError
from isorig.analysis.fitting.solve import Free
from isorig.analysis.trends.change import change_in, date_of_step, fitted_knee, follow, likelihood_of_steps
from isorig.analysis.trends.cusum import alarms, thresholds
from isorig.analysis.trends.difference import CauseOfChange, _deviation, _judged
from isorig.analysis.trends.series import Series, scatter_of, siblings

NEVER = (np.inf, np.inf)
AROUND = pytest.mark.parametrize("share", [0.98, 1.02])


def series(value: np.ndarray, std: float) -> Series:
    return Series(time=7.0 * np.arange(len(value)), value=value, std=np.full(len(value), std))


@pytest.mark.parametrize(("chart", "contributes"), [(0, 3.5), (1, 3.0)])
@AROUND
def test_one_bad_campaign_counts_as_four_standard_deviations(chart: int, contributes: float, share: float) -> None:
    """Minus the slack of each chart."""
    value = np.array([0.0, 0.0, 0.0, 100.0])
    limits = [np.inf, np.inf]
    limits[chart] = share * contributes
    assert bool(alarms(value, np.ones(4), limits).at) is (share < 1.0)


STEADY, KNOWN = np.array([0.0, 1.0, 1.0, 1.0]), np.array([1e-9, 1.0, 1.0, 1.0])


@pytest.mark.parametrize("way", [1.0, -1.0])
@AROUND
def test_charts_start_from_zero_in_both_directions(way: float, share: float) -> None:
    """Three campaigns one standard deviation from a level that is known exactly add 0.5 each, with a slack of 0.5."""
    found = alarms(way * STEADY, KNOWN, (share * 1.5, np.inf))
    assert (found.at, found.rising) == (((3,), (way > 0.0,)) if share < 1.0 else ((), ()))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_charts_start_from_zero_after_an_alarm(way: float) -> None:
    twice = alarms(way * np.tile(STEADY, 2), np.tile(KNOWN, 2), (0.98 * 1.5, np.inf))
    assert twice.at == (3, 7)


def test_an_alarm_needs_five_degrees_of_freedom() -> None:
    assert len(thresholds(1e-3, 5.0)) == 2
    with pytest.raises(DataError, match=r"4\.9 degrees of freedom, and an alarm needs 5"):
        thresholds(1e-3, 4.9)


@pytest.mark.parametrize("drifts", [True, False])
@AROUND
def test_drift_and_step_are_distinguished_from_twenty_to_one_on(drifts: bool, share: float) -> None:
    time = np.arange(12.0)
    value = np.maximum(time - 5.0, 0.0) if drifts else 1.0 * (time > 5.0)
    knee, variance = fitted_knee(time, value, np.ones(12)), np.ones(12)
    for _ in range(5):  # the date of a step in a drift depends on the variance
        first, _, _ = date_of_step(value, variance)
        variance = np.full(12, abs(knee.likelihood - likelihood_of_steps(value, np.ones(12), [first])) / (share * np.log(20.0)))
    found = change_in(time, value, variance, alarm=8)
    assert found.kind == ("step or drift" if share < 1.0 else "drift" if drifts else "step")


@AROUND
def test_a_difference_of_three_and_a_half_standard_deviations_is_no_scatter(share: float) -> None:
    value = np.zeros(30)
    value[15:] = share * 3.5 * np.sqrt(2.0)
    assert scatter_of([series(value, 1.0)]).freedom == pytest.approx(2.0 / 3.0 * (29 if share < 1.0 else 28))


@AROUND
def test_a_campaign_is_an_outlier_from_six_standard_deviations_on(share: float) -> None:
    value = np.zeros(12)
    value[6] = share * 6.0 * np.sqrt(1.0 + 1.0 / 6.0)
    assert follow(series(value, 1.0), 0.0, NEVER).outlying == (() if share < 1.0 else (6,))


def test_five_rigs_are_compared_and_a_fifth_of_them_may_be_outliers() -> None:
    levels = dict(zip("abcdefghij", [0.1, -0.2, 0.3, -0.1, 0.0, 0.2, -0.3, 0.15, 50.0, 1000.0], strict=True))

    def first(count: int) -> dict[str, float]:
        return dict(list(levels.items())[:count])

    assert np.isnan(list(siblings(first(4), 0.05).deviations.values())).all()
    assert np.isfinite(list(siblings(first(5), 0.05).deviations.values())).all()
    assert siblings(levels, 0.05).outliers == ("j", "i")
    levels.pop("a")
    assert siblings(levels, 0.05).outliers == ("j",)


def cause(name: str, misfit: float) -> CauseOfChange:
    return CauseOfChange(cause=name, location="a", parameter=name, unit="", old=0.0, new=1.0, std=0.1, share=0.0, misfit=misfit)


@AROUND
def test_a_cause_explains_more_than_scatter_from_twenty_to_one_on(share: float) -> None:
    """Twice the logarithm of the likelihood ratio is the difference of the misfits."""
    one = cause("one", 100.0 - share * 2.0 * np.log(20.0))
    assert bool(_judged([one], 100.0, 200, ())) is (share > 1.0)
    assert _judged([one], 100.0, 200, ("one",))


@pytest.mark.parametrize(
    ("best", "size", "apart"), [(150.0, 200, 2.0 * np.log(20.0)), (220.0, 200, 22.0), (200.0, 40, 10.0 * np.log(20.0))]
)
@AROUND
def test_causes_are_alike_up_to_twenty_to_one_or_a_tenth_of_the_misfit(
    best: float, size: int, apart: float, share: float
) -> None:
    """A misfit above the number of residuals is not only noise, and raises what counts."""
    found = _judged([cause("one", best), cause("two", best + share * apart)], 1e5, size, ())
    assert [each.alike for each in found] == [True, share < 1.0]


def test_a_parameter_with_unknown_scatter_may_differ_by_three_tenths() -> None:
    """Any other one by a hundred finite differences, and none by less than a thousandth of one."""
    mass = Free(path="bodies.m.mass", low=0.1, high=10.0)
    place = Free(path="bodies.m.place", low=-1.0, high=1.0, log=False)
    assert _deviation(mass, {}) == 0.3
    assert _deviation(place, {}) == 100.0 * place.step
    assert _deviation(mass, {mass.path: 0.02}) == 0.02
    assert _deviation(mass, {mass.path: 0.0}) == 1e-3 * mass.step
