"""A value or statement of the thesis, and the verdict that follows from a number and the tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["agrees", "same size", "differs"]

#: A number that differs by less than this factor has the same size.
SAME_SIZE = 2.0
#: Maximum distance of a figure in tolerances: a larger difference does not count more.
MOST = 5.0


@dataclass(frozen=True, kw_only=True)
class Stated:
    """A figure as the thesis gives it.

    Parameters
    ----------
    words
        As printed, or the statement about it.
    low, high
        The corresponding range; for a printed number both are equal.
    tolerance
        Relative: a value within the range, multiplied or divided by (1 + tolerance), agrees. It covers what the thesis does not
        give: window, resolution, level and rounding.
    """

    words: str
    low: float
    high: float
    tolerance: float

    def factor(self, value: float) -> float:
        """Ratio of a value to the nearest end of the range: 1 inside, below 1 if it is too low, above 1 if too high."""
        if not math.isfinite(value):
            return math.nan
        if value < self.low:
            return max(value, 0.0) / self.low
        return value / self.high if value > self.high else 1.0

    def tolerances(self, value: float) -> float:
        """Distance of a value from the range in tolerances, 0 inside and `MOST` at most."""
        factor = self.factor(value)
        if not factor > 0.0:
            return MOST
        return min(abs(math.log(factor)) / math.log1p(self.tolerance), MOST)

    def verdict(self, value: float) -> Verdict:
        """The verdict for a number; a statement without a number is met or not."""
        factor = self.factor(value)
        if self.tolerances(value) <= 1.0:
            return "agrees"
        number = self.low > 0.0 and math.isfinite(self.high)
        return "same size" if number and 1.0 / SAME_SIZE <= factor <= SAME_SIZE else "differs"

    def in_words(self, value: float) -> str:
        """The verdict in words."""
        factor = self.factor(value)
        if math.isnan(factor):
            return "differs: not available"
        if self.verdict(value) == "agrees":
            return "agrees"
        said = "same size" if self.verdict(value) == "same size" else "differs"
        return f"{said}: {_off(factor)}"

    @property
    def shown(self) -> str:
        """The words with the range and the tolerance."""
        within = f"±{100.0 * self.tolerance:.2g} %"
        if self.low == self.high:
            return f"{self.words} ({within})"
        if self.low <= 0.0:
            return f"{self.words} (below {self.high:.3g}, {within})"
        if math.isinf(self.high):
            return f"{self.words} (above {self.low:.3g}, {within})"
        return f"{self.words} ({self.low:.3g} to {self.high:.3g}, {within})"


def _off(factor: float) -> str:
    way = "low" if factor < 1.0 else "high"
    if factor <= 0.0:
        return "too low"
    if 1.0 / SAME_SIZE < factor < SAME_SIZE:
        return f"{100.0 * abs(factor - 1.0):.2g} % too {way}"
    return f"too {way} by a factor of {max(factor, 1.0 / factor):.2g}"


def printed(value: float, tolerance: float, unit: str = "") -> Stated:
    """A printed number."""
    return Stated(words=f"{value:g} {unit}".strip(), low=value, high=value, tolerance=tolerance)


def above(words: str, low: float, tolerance: float = 0.02) -> Stated:
    """A statement that holds above a value."""
    return Stated(words=words, low=low, high=math.inf, tolerance=tolerance)


def below(words: str, high: float, tolerance: float = 0.02) -> Stated:
    """A statement that holds up to a value."""
    return Stated(words=words, low=0.0, high=high, tolerance=tolerance)
