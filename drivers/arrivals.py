"""Loss seen against this machine's clock, for instruments that number nothing."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

T = TypeVar("T")
#: Seconds of a bin, and bins before and behind a place at which loss is looked for: two seconds are longer than the host stalls.
BIN, BEFORE, BEHIND = 0.1, 20, 20
#: Bins before a place that must be there, and bins that tell how fast the clocks run against each other.
LEAST, SLOPE = 3, 10
#: Seconds, and how many times the scatter of the arrivals, by which they must be late from one moment on to be loss.
JUMP, SCATTER = 0.01, 8.0
#: Bins that must be behind a place at the end of the run, where no more come, and bins for which the limit above is meant.
LAST, SURE = 2, 5


@dataclass
class _Bin(Generic[T]):
    """What arrived within a bin: items with their counts and delays, and the least delay and when that was."""

    begin: float
    items: list[tuple[T, int, float]] = field(default_factory=list)
    least: float = np.inf
    at: float = 0.0

    def earlier(self, seconds: float) -> None:
        """Take seconds off all delays."""
        self.items = [(item, count, delay - seconds) for item, count, delay in self.items]
        self.least -= seconds


class Arrivals(Generic[T]):
    """Compares samples that arrived with the time that passed, and says before which of them some are missing.

    Samples arrive late, never early, so the least delay of each tenth of a second says how far count and clock lie apart. A least
    delay that jumps and stays is loss, and the jump's place is the loss's; one that grows evenly is two clocks that run
    differently. To see what stays, items are handed out two seconds late.

    Parameters
    ----------
    rate
        Samples a second that the instrument takes, Hz.
    least
        Seconds of loss that are looked for at least, where something else sees shorter ones.
    """

    def __init__(self, rate: float, *, least: float = 0.0) -> None:
        self._rate, self._least = rate, least
        self._began: float | None = None
        self._count = 0
        self._before: deque[tuple[float, float]] = deque(maxlen=BEFORE)
        self._bins: list[_Bin[T]] = []
        self._scatter = 0.0
        self._owed = 0

    @property
    def held(self) -> int:
        """Samples that have come and are not handed out."""
        return sum(count for one in self._bins for _, count, _ in one.items)

    @property
    def unseen(self) -> float:
        """Seconds of loss that would not be seen."""
        return max(JUMP, self._least, SCATTER * self._scatter)

    def add(self, item: T, count: int, now: float) -> Iterator[tuple[T, int]]:
        """Take an item of `count` samples that arrived at `now` (s); what can be handed out, with the samples missing before."""
        self._began = now - count / self._rate if self._began is None else self._began
        if not self._bins or now >= self._bins[-1].begin + BIN:
            while len(self._bins) > BEHIND:
                yield from self._release(BEHIND - 1)
            self._bins.append(_Bin(begin=now))
        self._count += count
        self._put(self._bins[-1], item, count, now)

    def finish(self) -> Iterator[tuple[T, int]]:
        """All the rest, at the end of the run."""
        while self._bins:
            yield from self._release(LAST)

    def _put(self, one: _Bin[T], item: T, count: int, now: float) -> None:
        assert self._began is not None
        delay = now - self._began - self._count / self._rate
        one.items.append((item, count, delay))
        if delay < one.least:
            one.least, one.at = delay, now

    def _release(self, behind: int) -> Iterator[tuple[T, int]]:
        # The first bin goes; before it goes, whether what arrives from somewhere in it on is later than what came before.
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
            yield item, self._owed
            self._owed = 0
        # Where the last of its items had still come in time, the loss stands before the next bin's first.
        self._owed += missing if first == len(one.items) else 0

    def _jump(self) -> tuple[float, float]:
        # Seconds by which the least delay jumps behind the first bin and stays, 0 where that is not more than scatter; and the
        # delay halfway.
        left = np.array([*self._before, (self._bins[0].at, self._bins[0].least)])
        right = np.array([(one.at, one.least) for one in self._bins[1 : BEHIND + 1]])
        if len(left) < LEAST:
            return 0.0, 0.0
        slope = _slope(left) if len(left) >= SLOPE else _slope(right) if len(right) >= SLOPE else 0.0
        left, right = (side[:, 1] - slope * (side[:, 0] - self._bins[0].at) for side in (left, right))
        self._scatter = float(np.median(left) - left.min())
        jump = float(right.min() - left.min())
        # What stays for a few bins only, at the end of a run, must be the larger.
        least = max(self.unseen, 2.0 / self._rate) * max(1.0, SURE / len(right))
        return (jump if jump > least else 0.0), float(left.min()) + jump / 2.0


def _slope(side: np.ndarray) -> float:
    # Seconds a second along the lower edge: from the least of the first half to the least of the second.
    steepest = np.polyfit(side[:, 0], side[:, 1], 1)[0]
    flat = side[:, 1] - steepest * side[:, 0]
    half = len(side) // 2
    early, late = int(np.argmin(flat[:half])), half + int(np.argmin(flat[half:]))
    return float((side[late, 1] - side[early, 1]) / (side[late, 0] - side[early, 0]))
