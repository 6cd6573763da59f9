"""Outlying rigs of a fleet: comparison of their levels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from isorig.analysis.trends.policy import POLICY


@dataclass(frozen=True, kw_only=True)
class Siblings:
    """One parameter over the rigs of a fleet."""

    mean: float  #: Mean of the rigs that are not outliers.
    #: Each rig's distance from the mean, by name, in standard deviations of those; NaN if there are too few rigs to compare.
    deviations: Mapping[str, float]
    outliers: tuple[str, ...]  #: Names of the outlying rigs, farthest first.


def siblings(levels: Mapping[str, float], risk: float) -> Siblings:
    """Compare levels of rigs by name; `risk` is the probability that any rig of a fleet without outliers is called one.

    Notes
    -----
    The generalized extreme studentized deviate test (Rosner 1983, Technometrics 25:165), which finds several outliers if a test
    of one would be masked by the next. Fewer than `POLICY.fewest_rigs` are not compared.
    """
    names, level, n = list(levels), np.array(list(levels.values()), dtype=np.float64), len(levels)
    left = np.arange(n)
    order: list[int] = []
    outliers = 0
    for i in range(1, (int(POLICY.most_outlying * n) if n >= POLICY.fewest_rigs else 0) + 1):
        spread = level[left].std(ddof=1)
        if spread == 0.0:
            break
        distance = np.abs(level[left] - level[left].mean()) / spread
        worst = int(distance.argmax())
        order.append(int(left[worst]))
        left = np.delete(left, worst)
        quantile = student.ppf(1.0 - risk / (2.0 * (n - i + 1)), n - i - 1)
        if distance[worst] > (n - i) * quantile / np.sqrt((n - i - 1 + quantile**2) * (n - i + 1)):
            outliers = i
    kept = np.delete(level, order[:outliers])
    mean, spread = (float(kept.mean()), float(kept.std(ddof=1)) if len(kept) > 1 else 0.0) if n else (0.0, 0.0)
    deviations = np.full(n, np.nan) if n < POLICY.fewest_rigs else (level - mean) / spread if spread > 0.0 else np.zeros(n)
    return Siblings(
        mean=mean,
        deviations=dict(zip(names, deviations.tolist(), strict=True)),
        outliers=tuple(names[k] for k in order[:outliers]),
    )
