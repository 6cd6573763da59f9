"""Detects lost samples with the host's clock, for instruments that do not number their samples."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

T = TypeVar("T")
#: Width of a bin in seconds, and bins before and after the place that is tested for loss: two seconds exceed the host's delays.
BIN, BEFORE, BEHIND = 0.1, 20, 20
#: Minimum number of bins before a tested place, and number of bins used to estimate the drift between the clocks.
LEAST, SLOPE = 3, 10
#: Thresholds for a loss: minimum step of the delay in seconds, and in multiples of the scatter of the arrivals.
JUMP, SCATTER = 0.01, 8.0
#: Minimum number of bins after a place at the end of the run, and number of bins for which the limit above is derived.
LAST, SURE = 2, 5


@dataclass
class _Bin(Generic[T]):
    """Items that arrived within a bin, with counts and delays; the smallest delay and its time."""

    begin: float
    items: list[tuple[T, int, float]] = field(default_factory=list)
    least: float = np.inf
    at: float = 0.0

    def earlier(self, seconds: float) -> None:
        """Subtract seconds from all delays."""
        self.items = [(item, count, delay - seconds) for item, count, delay in self.items]
        self.least -= seconds


class Arrivals(Generic[T]):
    """Compares the number of samples received with the elapsed time, and locates missing samples; the rate is in Hz.

    Each item is handed to `place`, with the number of samples missing before it.

    Samples arrive late, never early, so the smallest delay in each tenth of a second measures the difference between sample count
    and clock. A smallest delay that steps up and remains there is a loss at that place; one that grows steadily is clock drift.
    To detect steps that remain, items are returned two seconds late. The smallest loss to search for is `least` seconds, if
    shorter ones are detected by other means.
    """

    def __init__(self, rate: float, place: Callable[[T, int], None], *, least: float = 0.0) -> None:
        self._rate, self._place, self._least = rate, place, least
        self._began: float | None = None
        self._count = 0
        self._before: deque[tuple[float, float]] = deque(maxlen=BEFORE)
        self._bins: list[_Bin[T]] = []
        self._scatter = 0.0
        self._owed = 0

    @property
    def held(self) -> int:
        """Number of samples received but not returned yet."""
        return sum(count for one in self._bins for _, count, _ in one.items)

    @property
    def unseen(self) -> float:
        """The longest undetectable loss, in seconds."""
        return max(JUMP, self._least, SCATTER * self._scatter)

    def add(self, item: T, count: int, now: float) -> None:
        """Add an item of `count` samples that arrived at `now` (s)."""
        self._began = now - count / self._rate if self._began is None else self._began
        if not self._bins or now >= self._bins[-1].begin + BIN:
            while len(self._bins) > BEHIND:
                self._release(BEHIND - 1)
            self._bins.append(_Bin(begin=now))
        self._count += count
        one, delay = self._bins[-1], now - self._began - self._count / self._rate
        one.items.append((item, count, delay))
        if delay < one.least:
            one.least, one.at = delay, now

    def finish(self) -> None:
        """Hand over the remaining items, at the end of the run."""
        while self._bins:
            self._release(LAST)

    def _release(self, behind: int) -> None:
        # Before the first bin is released: is everything from some place within it on later than what came before?
        one = self._bins[0]
        missing, first = 0, 0
        jump, height = self._jump() if len(self._bins) > behind else (0.0, 0.0)
        if jump > 0.0:
            missing = round(jump * self._rate)
            first = next((k for k in range(len(one.items), 0, -1) if one.items[k - 1][2] < height), 0)
            for later in self._bins[1:]:
                later.earlier(missing / self._rate)
            self._count += missing
        self._bins.pop(0)
        self._before.append((one.at, one.least))
        for k, (item, _, _) in enumerate(one.items):
            self._owed += missing if k == first else 0
            owed, self._owed = self._owed, 0
            self._place(item, owed)
        # If even its last item arrived in time, the loss is before the first item of the next bin.
        self._owed += missing if first == len(one.items) else 0

    def _jump(self) -> tuple[float, float]:
        # Permanent step of the smallest delay after the first bin in seconds, 0 if it is within the scatter; and the delay
        # halfway.
        left = np.array([*self._before, (self._bins[0].at, self._bins[0].least)])
        right = np.array([(one.at, one.least) for one in self._bins[1 : BEHIND + 1]])
        if len(left) < LEAST:
            return 0.0, 0.0
        slope = _slope(left) if len(left) >= SLOPE else _slope(right) if len(right) >= SLOPE else 0.0
        left, right = (side[:, 1] - slope * (side[:, 0] - self._bins[0].at) for side in (left, right))
        self._scatter = float(np.median(left) - left.min())
        jump = float(right.min() - left.min())
        # At the end of a run, a step confirmed by a few bins only must be larger.
        least = max(self.unseen, 2.0 / self._rate) * max(1.0, SURE / len(right))
        # If the delay steps up again after the next bin, that bin may only be late: one loss, after it, and so are two in a row.
        if len(right) > LAST and float(right[1:].min() - right[0]) > least:
            return 0.0, 0.0
        return (jump if jump > least else 0.0), float(left.min()) + jump / 2.0


def _slope(side: np.ndarray) -> float:
    # Slope of the lower envelope in seconds per second: from the minimum of the first half to the minimum of the second half.
    steepest = np.polyfit(side[:, 0], side[:, 1], 1)[0]
    flat = side[:, 1] - steepest * side[:, 0]
    half = len(side) // 2
    early, late = int(np.argmin(flat[:half])), half + int(np.argmin(flat[half:]))
    return float((side[late, 1] - side[early, 1]) / (side[late, 0] - side[early, 0]))
