"""Outlying rigs of a fleet: comparison of their levels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from isorig.analysis.campaign import FloatArray
from isorig.analysis.trends.policy import POLICY


@dataclass(frozen=True, kw_only=True)
class Siblings:
    """One parameter over the rigs of a fleet.

    Parameters
    ----------
    middle, spread
        Mean and standard deviation of the rigs that are not outliers.
    away
        Each rig's distance from the middle in standard deviations, shape (rigs,); NaN if there are too few rigs to compare.
    odd
        Indices of the outlying rigs, farthest first.
    """

    middle: float
    spread: float
    away: FloatArray
    odd: tuple[int, ...]


def siblings(level: FloatArray, risk: float) -> Siblings:
    """Compare levels, shape (rigs,); `risk` is the probability that any rig of a fleet without outliers is called one.

    Notes
    -----
    The generalized extreme studentized deviate test (Rosner 1983, Technometrics 25:165), which finds several outliers if a test
    of one would be masked by the next. Fewer than `POLICY.fewest_rigs` are not compared.
    """
    n = len(level)
    left = np.arange(n)
    order: list[int] = []
    odd = 0
    for i in range(1, (int(POLICY.most_outlying * n) if n >= POLICY.fewest_rigs else 0) + 1):
        spread = level[left].std(ddof=1)
        if spread == 0.0:
            break
        distance = np.abs(level[left] - level[left].mean()) / spread
        worst = int(distance.argmax())
        order.append(int(left[worst]))
        left = np.delete(left, worst)
        if distance[worst] > _critical(n, i, risk):
            odd = i
    kept = np.delete(level, order[:odd])
    middle, spread = (float(kept.mean()), float(kept.std(ddof=1)) if len(kept) > 1 else 0.0) if n else (0.0, 0.0)
    away = np.full(n, np.nan) if n < POLICY.fewest_rigs else (level - middle) / spread if spread > 0.0 else np.zeros(n)
    return Siblings(middle=middle, spread=spread, away=away, odd=tuple(order[:odd]))


def _critical(n: int, i: int, risk: float) -> float:
    quantile = student.ppf(1.0 - risk / (2.0 * (n - i + 1)), n - i - 1)
    return float((n - i) * quantile / np.sqrt((n - i - 1 + quantile**2) * (n - i + 1)))
