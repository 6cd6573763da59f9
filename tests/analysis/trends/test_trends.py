"""Trends against published figures, against another program, and counted on drawn series."""

from collections.abc import Iterable

import numpy as np
import pytest
import ruptures
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, kstest

from isorig.analysis.errors import DataError
from isorig.analysis.trends.change import change_in, date_of_step, follow
from isorig.analysis.trends.cusum import alarms, false_rate, run_length, thresholds
from isorig.analysis.trends.policy import POLICY
from isorig.analysis.trends.series import Series, scatter_of, siblings

#: Rosner (1983), Table: 54 values of which the last three are outliers (also in the NIST/SEMATECH handbook, 1.3.5.17.3).
ROSNER = np.array([
    -0.25, 0.68, 0.94, 1.15, 1.20, 1.26, 1.26, 1.34, 1.38, 1.43, 1.49, 1.49, 1.55, 1.56, 1.58, 1.65, 1.69, 1.70, 1.76, 1.77, 1.81,
    1.91, 1.94, 1.96, 1.99, 2.06, 2.09, 2.10, 2.14, 2.15, 2.23, 2.24, 2.26, 2.35, 2.37, 2.40, 2.47, 2.54, 2.62, 2.64, 2.90, 2.92,
    2.92, 2.93, 3.21, 3.26, 3.30, 3.59, 3.68, 4.30, 4.64, 5.34, 5.42, 6.01,
])  # fmt: skip
#: One false alarm a month of fifty rigs with eight parameters each, measured weekly.
LIMITS = thresholds(1.0 / 1740.0)


def series(value: np.ndarray, std: float = 0.0) -> Series:
    return Series(time=7.0 * np.arange(len(value)), value=value, std=np.full(len(value), std))


@pytest.mark.parametrize(("threshold", "both"), [(4.0, 168.0), (5.0, 465.0)])
def test_run_lengths_are_those_of_the_textbook(threshold: float, both: float) -> None:
    """Montgomery, Introduction to Statistical Quality Control, 6th ed., Table 9.3 (k = 1/2, no shift)."""
    assert run_length(threshold, 0.5)[0] / 2.0 == pytest.approx(both, rel=0.002)


def test_run_length_agrees_with_siegmund() -> None:
    """Siegmund (1985): (exp(2 k b) - 2 k b - 1) / (2 k^2) with b = h + 1.166, good to per cents."""
    for slack, threshold in ((0.5, 8.7), (0.5, 6.0), (1.0, 3.5)):
        b = threshold + 1.166
        assert run_length(threshold, slack)[0] == pytest.approx(
            (np.exp(2 * slack * b) - 2 * slack * b - 1) / (2 * slack**2), rel=0.06
        )


def test_thresholds_keep_the_stated_rate() -> None:
    for freedom in (np.inf, 40.0):
        limits = thresholds(1e-3, freedom)
        assert sum(false_rate(h, k, freedom) for h, k in zip(limits, POLICY.slacks, strict=True)) == pytest.approx(1e-3, rel=0.01)
    assert all(a > b for a, b in zip(thresholds(1e-3, 40.0), thresholds(1e-3), strict=True))
    with pytest.raises(DataError, match="false alarms per campaign"):
        thresholds(0.0)
    with pytest.raises(DataError, match="measure more campaigns"):
        thresholds(1e-3, 3.0)


def test_a_standard_deviation_counts_as_known_from_2000_degrees_of_freedom_on() -> None:
    assert false_rate(5.0, 0.5, 2000.0) == false_rate(5.0, 0.5)
    assert false_rate(5.0, 0.5) < false_rate(5.0, 0.5, 1999.0) < 1.02 * false_rate(5.0, 0.5)


def test_distances_are_standard_normal_however_short_the_history() -> None:
    draw = np.random.default_rng(1)
    variance = draw.uniform(0.5, 4.0, (4000, 8))
    value = 3.0 + np.sqrt(variance) * draw.normal(size=(4000, 8))
    z = np.array([alarms(x, v, (1e9, 1e9)).z for x, v in zip(value, variance, strict=True)])
    assert (z[:, 0] == 0.0).all()
    # Clipping at four deviations in the running mean touches one campaign in 16 000.
    assert all(kstest(z[:, k], "norm").pvalue > 1e-3 for k in range(1, 8))
    assert np.abs(np.corrcoef(z[:, 1:].T) - np.eye(7)).max() < 0.06


def test_false_alarms_are_at_most_as_stated() -> None:
    draw = np.random.default_rng(2)
    rigs, weeks = 2000, 40
    count = sum(len(alarms(draw.normal(size=weeks), np.ones(weeks), LIMITS).at) for _ in range(rigs))
    interval = binomtest(count, rigs * weeks).proportion_ci(0.95)
    assert interval.low <= 1.0 / 1740.0
    assert interval.high > 0.4 / 1740.0  # not bought with deafness


@pytest.mark.parametrize(("before", "size"), [(6, -4.0), (20, -3.5), (6, 4.0), (20, 3.5)])
def test_a_step_is_found_within_three_campaigns(before: int, size: float) -> None:
    draw = np.random.default_rng(3)
    found = 0
    for _ in range(600):
        value = draw.normal(size=before + 3)
        value[before:] += size
        seen = alarms(value, np.ones(len(value)), LIMITS)
        found += (size > 0.0) in [rising for at, rising in zip(seen.at, seen.rising, strict=True) if at >= before]
    assert binomtest(found, 600).proportion_ci(0.95).high > 0.95
    assert found / 600 > 0.93


def test_one_bad_campaign_is_no_change() -> None:
    value = np.random.default_rng(4).normal(size=20)
    value[9] += 30.0
    found = follow(series(value), 1.0, LIMITS)
    assert found.changes == ()
    assert found.outlying == (9,)
    value[10:] += 30.0
    assert [change.first for change in follow(series(value), 1.0, LIMITS).changes] == [9]


def test_dates_lie_in_their_intervals_and_agree_with_another_program() -> None:
    draw = np.random.default_rng(5)
    inside = same = 0
    for _ in range(300):
        first = int(draw.integers(4, 26))
        value = draw.normal(size=30)
        value[first:] += 2.0
        most_likely, earliest, latest = date_of_step(value, np.ones(30))
        inside += earliest <= first <= latest
        same += most_likely == ruptures.Dynp(model="l2", min_size=1, jump=1).fit(value).predict(n_bkps=1)[0]
    assert binomtest(inside, 300).proportion_ci(0.999).high >= 0.95
    assert inside / 300 > 0.93
    # Least squares gives no weight to how well each level is known, so near the ends the two may differ.
    assert same / 300 > 0.9


def test_dates_are_those_of_brute_force() -> None:
    """The posterior of the date with both levels integrated out numerically."""
    draw = np.random.default_rng(9)
    grid = np.linspace(-30.0, 30.0, 20001)
    for _ in range(40):
        n = int(draw.integers(3, 9))
        variance = draw.uniform(0.3, 3.0, n)
        value = np.sqrt(variance) * draw.normal(size=n) + 1.5 * (np.arange(n) >= n // 2)

        def mass(part: slice, value: np.ndarray = value, variance: np.ndarray = variance) -> float:
            return float(np.exp(-0.5 * ((value[part, None] - grid) ** 2 / variance[part, None]).sum(axis=0)).sum())

        odds = np.array([mass(slice(k)) * mass(slice(k, None)) for k in range(1, n)])
        order = np.argsort(-odds)
        held = order[: int(np.searchsorted(np.cumsum(odds[order]) / odds.sum(), 0.95)) + 1] + 1
        assert date_of_step(value, variance) == (order[0] + 1, held.min(), held.max())


def test_drift_and_step_are_distinguished_once_there_are_enough_campaigns() -> None:
    draw = np.random.default_rng(6)
    kinds: dict[str, list[str]] = {"step": [], "drift": [], "early": []}
    for _ in range(100):
        step, drift = draw.normal(size=40), draw.normal(size=40)
        step[20:] += 5.0
        drift[20:] += 0.5 * np.arange(1, 21)
        kinds["early"] += [c.kind for c in follow(series(step[:22]), 1.0, LIMITS).changes]
        kinds["step"] += [c.kind for c in follow(series(step), 1.0, LIMITS).changes]
        kinds["drift"] += [c.kind for c in follow(series(drift), 1.0, LIMITS).changes]
    assert kinds["step"].count("drift") <= 2
    assert kinds["step"].count("step") >= 90
    assert kinds["drift"].count("step") <= 2
    assert kinds["drift"].count("drift") >= 90
    assert kinds["early"].count("drift") == 0
    assert kinds["early"].count("step or drift") > kinds["early"].count("step")


def test_the_size_of_a_change() -> None:
    value = np.concatenate([np.zeros(10), np.full(5, 2.0)])
    change = change_in(np.arange(15.0), value, np.full(15, 0.04), alarm=11)
    assert (change.first, change.before, change.after) == (10, 0.0, 2.0)
    assert change.std == pytest.approx(0.2 * np.sqrt(1 / 10 + 1 / 5))


def test_scatter_is_seen_through_changes_and_bad_campaigns() -> None:
    draw = np.random.default_rng(7)
    found = []
    for _ in range(12):
        value = 10.0 * np.arange(50)[:, None] + np.hypot(0.5, 1.0) * draw.normal(size=(50, 12))
        value[:10, 8:] += 20.0
        value[10:15, 3] += 40.0
        found.append(scatter_of([series(row, std=0.5) for row in value]))
    assert np.mean([scatter.variance for scatter in found]) == pytest.approx(1.0, rel=0.07)
    assert all(300.0 < scatter.freedom < 400.0 for scatter in found)
    assert scatter_of([]).freedom == 0.0
    assert scatter_of([series(0.1 * draw.normal(size=300), std=0.2)]).variance == 0.0


def rigs(levels: Iterable[float]) -> dict[str, float]:
    return {f"{k}": level for k, level in enumerate(levels)}


def test_odd_rigs_are_those_of_the_textbook() -> None:
    assert sorted(siblings(rigs(ROSNER), 0.05).outliers) == ["51", "52", "53"]
    few = siblings(rigs([1.0, 2.0, 50.0]), 0.05)
    assert few.outliers == ()
    assert np.isnan(list(few.deviations.values())).all()


def test_a_sound_fleet_has_odd_rigs_as_seldom_as_stated() -> None:
    draw = np.random.default_rng(8)
    wrong = sum(bool(siblings(rigs(draw.normal(size=50)), 0.05).outliers) for _ in range(1000))
    assert binomtest(wrong, 1000).proportion_ci(0.999).low <= 0.05


@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(0.0, 1e3)), min_size=1, max_size=40), st.floats(0.0, 1e6))
def test_any_series_can_be_followed(points: list[tuple[float, float]], between: float) -> None:
    value, std = (np.array(column) for column in zip(*points, strict=True))
    found = follow(Series(time=np.arange(len(value)) // 2 * 1.0, value=value, std=std), between, LIMITS)
    assert np.isfinite([found.level, found.std]).all()
    for change in found.changes:
        assert 0 < change.earliest <= change.first <= change.latest < len(value)
        assert np.isfinite([change.before, change.after, change.std]).all()


@pytest.mark.parametrize(
    ("time", "value", "std", "says"),
    [
        ([0.0, 1.0], [1.0], [0.1], "2 times, 1 values"),
        ([0.0, 1.0], [1.0, np.nan], [0.1, 0.1], "not finite"),
        ([1.0, 0.0], [1.0, 1.0], [0.1, 0.1], "back in time"),
    ],
)
def test_bad_series_are_refused(time: list[float], value: list[float], std: list[float], says: str) -> None:
    with pytest.raises(DataError, match=says):
        Series(time=np.array(time), value=np.array(value), std=np.array(std))
