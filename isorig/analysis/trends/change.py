"""Date and size of a parameter's change, and whether it is a step or a drift."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import chi2

from isorig.analysis.campaign import FloatArray
from isorig.analysis.trends.policy import POLICY

Kind = Literal["step", "drift", "step or drift"]


@dataclass(frozen=True, kw_only=True)
class DatedChange:
    """A change of one parameter.

    Parameters
    ----------
    kind
        Whether it is a step or a drift; "step or drift" as long as the campaigns since do not decide.
    first, earliest, latest
        Index of the first campaign after it: the most likely one, and the ends of the 95 % interval.
    alarm
        Index of the campaign that raised the alarm.
    before, after
        Level before, and the latest level.
    std
        Standard deviation of their difference.
    slope
        Change per day of a drift; 0 for a step.
    """

    kind: Kind
    first: int
    earliest: int
    latest: int
    alarm: int
    before: float
    after: float
    std: float
    slope: float = 0.0

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
