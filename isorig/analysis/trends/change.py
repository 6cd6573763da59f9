"""Changes of a parameter in its series: alarms, and the date and size of each change, and whether it is a step or a drift."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

import numpy as np
from scipy.stats import chi2

from isorig.analysis.campaign import FloatArray
from isorig.analysis.trends.cusum import alarms
from isorig.analysis.trends.policy import POLICY
from isorig.analysis.trends.series import Series

ChangeKind = Literal["step", "drift", "step or drift"]


@dataclass(frozen=True, kw_only=True)
class DatedChange:
    """A change of one parameter."""

    kind: ChangeKind  #: Whether it is a step or a drift; "step or drift" as long as the campaigns since do not decide.
    #: Index of the first campaign after it: the most likely one, and the ends of the 95 % interval.
    first: int
    earliest: int
    latest: int
    alarm: int  #: Index of the campaign that raised the alarm.
    #: Level before, and the latest level.
    before: float
    after: float
    std: float  #: Standard deviation of their difference.
    slope: float = 0.0  #: Change per day of a drift; 0 for a step.

    @property
    def size(self) -> float:
        """The change in standard deviations."""
        return (self.after - self.before) / max(self.std, 1e-300)


def date_of_step(value: FloatArray, variance: FloatArray) -> tuple[int, int, int]:
    """The first index after a single step, and the ends of its 95 % interval.

    The series has two values or more, and `variance` is that of each about its level, shape (n,).

    Notes
    -----
    The posterior of the date with a flat prior for the date and both levels: each part with levels integrated out has the weight
    exp(-chi^2/2) / sqrt(sum of its weights) (Smith 1975, Biometrika 62:407, with known variance). The interval contains the most
    likely dates that together reach 95 %.
    """
    weight = 1.0 / variance
    moment = weight * (value - np.average(value, weights=weight))
    evidence = np.zeros(len(value) - 1)
    # Of the parts before and after each date, by running sums from both ends; the common sum of squares is left out.
    for way in (slice(None), slice(None, None, -1)):
        total, first = (np.cumsum(part[way])[:-1][way] for part in (weight, moment))
        evidence += 0.5 * (first**2 / total - np.log(total))
    probability = np.exp(evidence - evidence.max())
    probability /= probability.sum()
    order = np.argsort(-probability, kind="stable")
    enough = int(np.searchsorted(np.cumsum(probability[order]), POLICY.date_confidence)) + 1
    inside = order[:enough] + 1
    return int(order[0]) + 1, int(inside.min()), int(inside.max())


def change_in(time: FloatArray, value: FloatArray, variance: FloatArray, *, alarm: int, begin: int = 0) -> DatedChange:
    """The change in a series that contains one, with its date, its size and its kind.

    The series is that from the change before it to the one after it, shape (n,), n at least 2. The campaign `alarm` raised the
    alarm; the first of these campaigns is `begin`.
    """
    weight = 1.0 / variance
    first, earliest, latest = date_of_step(value, variance)
    knee = fitted_knee(time, value, weight)
    difference = knee.likelihood - likelihood_of_steps(value, weight, [first])
    clear = np.log(POLICY.likelihood_ratio)
    if difference > clear:
        return drift_of(time, knee, alarm, begin)
    before, after = (float(np.average(value[part], weights=weight[part])) for part in (slice(first), slice(first, None)))
    return DatedChange(
        kind="step" if difference < -clear else "step or drift", first=begin + first, earliest=begin + earliest,
        latest=begin + latest, alarm=alarm, before=before, after=after,
        std=float(np.sqrt(1.0 / weight[:first].sum() + 1.0 / weight[first:].sum())),
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Knee:
    """A constant level followed by a straight line from a campaign on, and its log likelihood.

    `earliest` and `latest` are the ends of the 95 % interval of that campaign, `slope_std` the standard deviation of the slope.
    """

    at: int
    earliest: int
    latest: int
    level: float
    slope: float
    slope_std: float
    likelihood: float


def fitted_knee(time: FloatArray, value: FloatArray, weight: FloatArray) -> Knee:
    """The best constant level followed by a straight line from a campaign (except the last) on, by weighted least squares."""
    fits = [_line(np.maximum(time - time[k], 0.0), value, weight) for k in range(len(time) - 1)]
    likelihood = np.array([fit[-1] for fit in fits])
    best = int(likelihood.argmax())
    # Twice the decrease of the log likelihood is about chi-square with one degree of freedom.
    inside = np.flatnonzero(likelihood >= likelihood[best] - 0.5 * chi2.ppf(POLICY.date_confidence, 1))
    level, slope, slope_std, most = fits[best]
    return Knee(
        at=best, earliest=int(inside[0]), latest=int(inside[-1]), level=level, slope=slope, slope_std=slope_std, likelihood=most
    )


def _line(since: FloatArray, value: FloatArray, weight: FloatArray) -> tuple[float, float, float, float]:
    # Level, slope and its standard deviation, log likelihood.
    design = np.stack([np.ones_like(since), since], axis=1)
    normal = design.T @ (design * weight[:, None])
    if np.linalg.det(normal) <= 1e-12 * normal[0, 0] * max(normal[1, 1], 1e-300):
        return float(np.average(value, weights=weight)), 0.0, 0.0, -np.inf
    covariance = np.linalg.inv(normal)
    level, slope = covariance @ (design.T @ (weight * value))
    left = value - level - slope * since
    return float(level), float(slope), float(np.sqrt(covariance[1, 1])), float(-0.5 * (weight * left**2).sum())


def likelihood_of_steps(value: FloatArray, weight: FloatArray, firsts: list[int]) -> float:
    """Log likelihood of levels with a step before each of some indices."""
    parts = zip(np.split(value, firsts), np.split(weight, firsts), strict=True)
    return float(sum(-0.5 * (w * (x - np.average(x, weights=w)) ** 2).sum() for x, w in parts))


def drift_of(time: FloatArray, knee: Knee, alarm: int, begin: int) -> DatedChange:
    """A drift as a change, as `change_in`; `first` is the first campaign after its start."""
    run = float(time[-1] - time[knee.at])
    return DatedChange(
        kind="drift", first=begin + knee.at + 1, earliest=begin + knee.earliest + 1, latest=begin + knee.latest + 1,
        alarm=alarm, before=knee.level, after=knee.level + knee.slope * run, std=run * knee.slope_std, slope=knee.slope,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Followed:
    """Result for one parameter: its changes in order of time, its present level, and outlying campaigns between regular
    neighbours."""

    changes: tuple[DatedChange, ...]
    level: float
    std: float
    outlying: tuple[int, ...]


def follow(series: Series, between: float, limits: Sequence[float]) -> Followed:
    """Search for changes in a series of one campaign or more, with a campaign-to-campaign variance.

    The limits are the thresholds of the charts (`isorig.analysis.trends.cusum.thresholds`).
    """
    variance = series.variance(between)
    raised = alarms(series.value, variance, limits)
    changes = _changes(series, variance, raised.at, raised.rising)
    begun = changes[-1].first if changes else 0
    weight = 1.0 / variance[begun:]
    drifts = bool(changes) and changes[-1].kind == "drift"
    level = changes[-1].after if drifts else float(np.average(series.value[begun:], weights=weight))
    far = set(np.flatnonzero(np.abs(raised.z) > POLICY.outlying_campaign).tolist())
    touched = {k for change in changes for k in range(change.earliest, change.alarm + 1)}
    return Followed(
        changes=changes, level=level, std=float(1.0 / np.sqrt(weight.sum())),
        outlying=tuple(k for k in sorted(far - touched) if not {k - 1, k + 1} & far),
    )  # fmt: skip


def _changes(series: Series, variance: FloatArray, at: Sequence[int], rising: Sequence[bool]) -> tuple[DatedChange, ...]:
    # First the dates from the data up to each alarm; then each change from all data between its neighbours.
    firsts, begin = [], 0
    for alarm in at:
        firsts.append(begin + date_of_step(series.value[begin : alarm + 1], variance[begin : alarm + 1])[0])
        begin = firsts[-1]
    ends = [*firsts[1:], len(series)]
    found: list[DatedChange] = []
    for _, group in groupby(range(len(at)), key=rising.__getitem__):
        same = list(group)
        begin = found[-1].first if found else 0
        part = slice(begin, ends[same[-1]])
        drift = _one_drift(series, variance, part, [firsts[k] for k in same], at[same[0]])
        if drift is not None:
            found.append(drift)
            continue
        for k in same:
            begin = found[-1].first if found else 0
            part = slice(begin, ends[k])
            found.append(change_in(series.time[part], series.value[part], variance[part], alarm=at[k], begin=begin))
    return tuple(found)


def _one_drift(series: Series, variance: FloatArray, part: slice, firsts: Sequence[int], alarm: int) -> DatedChange | None:
    # Several steps in the same direction may be one drift: the model with fewer parameters per likelihood (Schwarz 1978) is kept.
    # A step has a date and a level, a drift a date and a slope.
    if len(firsts) < 2:
        return None
    time, value, weight = series.time[part], series.value[part], 1.0 / variance[part]
    knee = fitted_knee(time, value, weight)
    steps = likelihood_of_steps(value, weight, [first - part.start for first in firsts])
    drifts = knee.likelihood + (len(firsts) - 1) * np.log(len(time)) >= steps
    return drift_of(time, knee, alarm, part.start) if drifts else None
