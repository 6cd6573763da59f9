"""CUSUM charts: their average run length without a change, and the thresholds for a given false-alarm rate.

One side of a CUSUM is S <- max(0, S + z - slack); it raises an alarm if S exceeds its threshold (Page 1954).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr
from scipy.stats import chi2

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import DataError
from isorig.analysis.trends.policy import POLICY

#: Points of the integral equation, and equally likely values of an uncertain standard deviation.
POINTS, LIKELY = 60, 25
#: Run lengths above this are lost in rounding.
LONGEST = 1e12


def run_length(threshold: float, slack: float, scale: FloatArray | float = 1.0) -> FloatArray:
    """Mean number of campaigns to a false alarm of one side, starting from zero; `LONGEST` if it is longer.

    Threshold and slack are in the standard deviations by which z was divided; `scale` is the true standard deviation of z (1 if
    it is known exactly), shape (n,) or scalar.

    Returns
    -------
    FloatArray
        Shape (n,).

    Notes
    -----
    The integral equation of Page (1954), solved with Gauss-Legendre points: L(u) = 1 + L(0) P(z <= slack - u) + the integral of
    L(y) p(y + slack - u) over 0 < y < threshold.
    """
    scales = np.atleast_1d(np.asarray(scale, dtype=np.float64))[:, None, None]
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    y = 0.5 * threshold * (points + 1.0)
    start = np.concatenate([[0.0], y])
    kernel = np.empty((len(scales), POINTS + 1, POINTS + 1))
    kernel[:, :, 0] = ndtr((slack - start) / scales[:, :, 0])
    density = np.exp(-0.5 * ((y[None, :] + slack - start[:, None]) / scales) ** 2) / (np.sqrt(2.0 * np.pi) * scales)
    kernel[:, :, 1:] = 0.5 * threshold * weights * density
    length = np.linalg.solve(np.eye(POINTS + 1) - kernel, np.ones(POINTS + 1))[:, 0]
    return np.where((length > 0.0) & (length < LONGEST), length, LONGEST)


def false_rate(threshold: float, slack: float, freedom: float = np.inf) -> float:
    """False alarms per campaign of both sides together.

    `freedom` is the number of degrees of freedom of the standard deviation by which z was divided; the rate is the mean over its
    possible true values.
    """
    if freedom >= POLICY.known_freedom:
        return float(2.0 / run_length(threshold, slack)[0])
    scales = np.sqrt(freedom / chi2.ppf((np.arange(LIKELY) + 0.5) / LIKELY, freedom))
    return float(np.mean(2.0 / run_length(threshold, slack, scales)))


@cache
def thresholds(rate: float, freedom: float = np.inf) -> tuple[float, ...]:
    """A threshold for each of `POLICY.slacks`, so that all together raise at most this many false alarms per campaign.

    Each chart gets an equal share. No threshold is so low that a single campaign could exceed it (`POLICY.clip`), so for a high
    allowed rate there are fewer alarms. Raises DataError if the rate is not between 0 and 1, or the standard deviation has fewer
    than `POLICY.fewest_freedom` degrees of freedom.
    """
    if not 0.0 < rate < 1.0:
        raise DataError(f"the rate is {rate:g} false alarms per campaign; give one above 0 and below 1")
    if freedom < POLICY.fewest_freedom:
        raise DataError(
            f"the scatter has {freedom:.2g} degrees of freedom, and an alarm needs {POLICY.fewest_freedom:g}; measure more "
            "campaigns"
        )
    share = rate / len(POLICY.slacks)
    found = []
    for slack in POLICY.slacks:
        low, high = POLICY.clip - slack, POLICY.clip - slack
        while false_rate(high, slack, freedom) > share:
            high *= 1.5
        found.append(low if high == low else float(brentq(_beyond, low, high, args=(slack, freedom, share), xtol=1e-2)))
    return tuple(found)


def _beyond(threshold: float, slack: float, freedom: float, share: float) -> float:
    return float(np.log(false_rate(threshold, slack, freedom) / share))


@dataclass(frozen=True, kw_only=True)
class Alarms:
    """Alarms of the charts for one series."""

    at: tuple[int, ...]  #: Index of each campaign that raised an alarm.
    rising: tuple[bool, ...]  #: Whether the parameter rose, for each.
    #: Each campaign's distance from the mean of those before it since the last alarm, in standard deviations, shape (n,); 0 for
    #: the first.
    z: FloatArray


def alarms(value: FloatArray, variance: FloatArray, limits: Sequence[float]) -> Alarms:
    """Apply the charts to a series.

    `variance` is that of each value about its level, shape (n,); the limits are in the order of `POLICY.slacks`.

    Notes
    -----
    Self-starting (Hawkins 1987): each value is compared with the weighted mean of those before it, including the mean's own
    variance, so that without a change the z are independent standard normal from the second campaign on, for any length of the
    history. After an alarm the level is estimated again from the following campaigns: those that raised the alarm were selected
    for their distance, so a level from them would make each false alarm raise another.
    """
    at, rising, z = [], [], np.zeros(len(value))
    mean = weight = 0.0
    up, down = [0.0] * len(POLICY.slacks), [0.0] * len(POLICY.slacks)
    for k, (x, v) in enumerate(zip(value.tolist(), variance.tolist(), strict=True)):
        if weight == 0.0:
            mean, weight = x, 1.0 / v
            continue
        z[k] = (x - mean) / (v + 1.0 / weight) ** 0.5
        clipped = min(max(z[k], -POLICY.clip), POLICY.clip)
        up = [max(0.0, s + clipped - slack) for s, slack in zip(up, POLICY.slacks, strict=True)]
        down = [max(0.0, s - clipped - slack) for s, slack in zip(down, POLICY.slacks, strict=True)]
        high = max(s / h for s, h in zip(up, limits, strict=True))
        low = max(s / h for s, h in zip(down, limits, strict=True))
        if max(high, low) > 1.0:
            at.append(k)
            rising.append(high > low)
            weight, up, down = 0.0, [0.0] * len(POLICY.slacks), [0.0] * len(POLICY.slacks)
            continue
        mean += clipped * (v + 1.0 / weight) ** 0.5 / (v * weight + 1.0)
        weight += 1.0 / v
    return Alarms(at=tuple(at), rising=tuple(rising), z=z)
