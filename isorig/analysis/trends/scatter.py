"""Campaign-to-campaign scatter of a parameter beyond the standard uncertainties of its fits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from isorig.analysis.campaign import FloatArray
from isorig.analysis.trends.policy import POLICY
from isorig.analysis.trends.series import Series

#: Information in successive differences relative to that in deviations from a known mean (von Neumann 1941: 2/3).
INFORMATION = 2.0 / 3.0
#: Limit of a difference, and the expected value of min(z^2, _LIMIT^2) of a standard normal z.
_LIMIT = POLICY.winsorized
_EXPECTED = 1.0 - 2.0 * (_LIMIT * norm.pdf(_LIMIT) + norm.sf(_LIMIT)) + 2.0 * _LIMIT**2 * norm.sf(_LIMIT)
#: Median of a chi-square variable with one degree of freedom.
_MEDIAN = 0.4549364


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """Campaign-to-campaign variance of one parameter, and its accuracy.

    Parameters
    ----------
    variance
        In addition to the fits' own, in the square of the series' unit.
    freedom
        Its degrees of freedom.
    """

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
