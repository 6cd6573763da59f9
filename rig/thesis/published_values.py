"""What the thesis states of a figure, and the verdict that follows from a number and the stated tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["agrees", "same size", "differs"]

#: A number that is off by less than this factor is of the same size.
SAME_SIZE = 2.0
#: Tolerances after which a figure counts as missed outright: further off is not worse.
MOST = 5.0


@dataclass(frozen=True, kw_only=True)
class Stated:
    """A figure as the thesis gives it.

    Parameters
    ----------
    words
        As it is printed, or what is said of it.
    low, high
        The range that this means; a printed number is both ends.
    tolerance
        Relative: a value within the range times or over (1 + tolerance) agrees. It covers what the thesis does not say:
        window, resolution, level and the rounding of what is printed.
    """

    words: str
    low: float
    high: float
    tolerance: float

    def factor(self, value: float) -> float:
        """How far a value lies outside the range, as a factor: 1 inside, below 1 where it is too low, above where too high."""
        if not math.isfinite(value):
            return math.nan
        if value < self.low:
            return max(value, 0.0) / self.low
        return value / self.high if value > self.high else 1.0

    def tolerances(self, value: float) -> float:
        """How many tolerances a value lies outside the range, 0 inside and `MOST` at most."""
        factor = self.factor(value)
        if not factor > 0.0:
            return MOST
        return min(abs(math.log(factor)) / math.log1p(self.tolerance), MOST)

    def verdict(self, value: float) -> Verdict:
        """What follows from the number; a statement that is not a number is met or it is not."""
        factor = self.factor(value)
        if self.tolerances(value) <= 1.0:
            return "agrees"
        number = self.low > 0.0 and math.isfinite(self.high)
        return "same size" if number and 1.0 / SAME_SIZE <= factor <= SAME_SIZE else "differs"

    def told(self, value: float) -> str:
        """The verdict in words."""
        factor = self.factor(value)
        if math.isnan(factor):
            return "differs: there is none"
        if self.verdict(value) == "agrees":
            return "agrees"
        said = "of the same size" if self.verdict(value) == "same size" else "differs"
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
    """A number as it is printed."""
    return Stated(words=f"{value:g} {unit}".strip(), low=value, high=value, tolerance=tolerance)


def above(words: str, low: float, tolerance: float = 0.02) -> Stated:
    """A statement that holds from a value on."""
    return Stated(words=words, low=low, high=math.inf, tolerance=tolerance)


def below(words: str, high: float, tolerance: float = 0.02) -> Stated:
    """A statement that holds up to a value."""
    return Stated(words=words, low=0.0, high=high, tolerance=tolerance)
