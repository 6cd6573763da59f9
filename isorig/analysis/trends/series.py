"""One parameter: of one rig over its campaigns, with its scatter beyond the fits' standard uncertainties, and over all rigs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm
from scipy.stats import t as student

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import DataError
from isorig.analysis.trends.policy import POLICY

#: Relative rounding error of a value.
ROUNDING = 1e-9
#: Information in successive differences relative to that in deviations from a known mean (von Neumann 1941: 2/3).
INFORMATION = 2.0 / 3.0
#: Limit of a difference, and the expected value of min(z^2, _LIMIT^2) of a standard normal z.
_LIMIT = POLICY.winsorized
_EXPECTED = 1.0 - 2.0 * (_LIMIT * norm.pdf(_LIMIT) + norm.sf(_LIMIT)) + 2.0 * _LIMIT**2 * norm.sf(_LIMIT)
#: Median of a chi-square variable with one degree of freedom.
_MEDIAN = 0.4549364


@dataclass(frozen=True, kw_only=True)
class Series:
    """Values of one parameter in order of time."""

    time: FloatArray  #: Date of each campaign, days, ascending, shape (n,).
    value: FloatArray  #: The parameter, or its logarithm if it is positive, shape (n,).
    std: FloatArray  #: Standard uncertainty of each fit, in the unit of `value`, shape (n,).

    def __post_init__(self) -> None:
        if not len(self.time) == len(self.value) == len(self.std):
            raise DataError(
                f"there are {len(self.time)} times, {len(self.value)} values and {len(self.std)} uncertainties; give one of each"
            )
        if not all(np.isfinite(part).all() for part in (self.time, self.value, self.std)):
            raise DataError("a series contains a value that is not finite; leave that campaign out")
        if (np.diff(self.time) < 0.0).any() or (self.std < 0.0).any():
            raise DataError(
                "a series goes back in time or has a negative uncertainty; sort it by time and correct the uncertainty"
            )

    def __len__(self) -> int:
        return len(self.value)

    def variance(self, between: float) -> FloatArray:
        """Variance of each value about its level: that of the fit plus that between campaigns, shape (n,)."""
        # Values without any uncertainty differ by rounding at least.
        rounding = ROUNDING * max(float(np.abs(self.value).max(initial=0.0)), 1.0)
        return np.asarray(np.maximum(self.std**2 + between, rounding**2))


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """Campaign-to-campaign variance of one parameter in addition to that of the fits, and its degrees of freedom."""

    variance: float
    freedom: float


def scatter_of(series: Sequence[Series]) -> Scatter:
    """The campaign-to-campaign variance, from differences of successive campaigns of all rigs together.

    A change affects one difference only and a drift hardly any, so rigs that change need not be known. Rigs of one kind are
    assumed to have the same scatter.
    """
    squares = np.concatenate([np.diff(s.value) ** 2 for s in series] or [np.zeros(0)])
    fitted = np.concatenate([s.std[1:] ** 2 + s.std[:-1] ** 2 for s in series] or [np.zeros(0)])
    if not len(squares):
        return Scatter(variance=0.0, freedom=0.0)
    rough = _root(squares, fitted, lambda ratio: float(np.median(ratio)) - _MEDIAN)
    kept = squares <= POLICY.outlying_difference**2 * (fitted + 2.0 * rough)
    if not kept.any():
        return Scatter(variance=rough, freedom=0.0)
    squares, fitted = squares[kept], fitted[kept]
    variance = _root(squares, fitted, lambda ratio: float(np.mean(np.minimum(ratio, _LIMIT**2))) - _EXPECTED)
    return Scatter(variance=variance, freedom=INFORMATION * len(squares))


def _root(squares: FloatArray, fitted: FloatArray, beyond: Callable[[FloatArray], float]) -> float:
    # The variance at which the squared differences, divided by their expected variance, have their expected size. Zero if the
    # fits' uncertainties alone explain the differences.
    floor = 1e-24

    def excess(variance: float) -> float:
        return beyond(squares / np.maximum(fitted + 2.0 * variance, floor))

    if excess(0.0) <= 0.0:
        return 0.0
    high = float(squares.max())
    while excess(high) > 0.0:
        high *= 4.0
    return float(brentq(excess, 0.0, high, xtol=1e-300))


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
