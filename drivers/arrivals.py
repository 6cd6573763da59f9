"""Loss seen against a clock, for instruments that number nothing."""

from __future__ import annotations


class Arrivals:
    """Compares samples that arrived with the time that passed.

    Samples arrive late, never early, so the least delay within a window says how far count and clock lie apart. A delay that
    jumps from one window to the next and stays is loss; one that creeps is two clocks that run differently, and no loss.

    Parameters
    ----------
    rate
        Samples per second that the instrument takes, Hz.
    window
        Seconds over which the least delay is taken: longer than the host ever stalls.
    jump
        Seconds by which it must grow to be loss: more than two clocks drift apart in a window.
    """

    def __init__(self, rate: float, *, window: float = 2.0, jump: float = 0.02) -> None:
        self._rate, self._window, self._jump = rate, window, jump
        self._began: float | None = None
        self._least = self._before = float("inf")
        self._until = 0.0

    def lost(self, count: int, now: float) -> int:
        """Samples newly found lost, when `count` (those told lost before included) had arrived at `now`, seconds."""
        if self._began is None:
            self._began, self._until = now - count / self._rate, now + self._window
        delay = now - self._began - count / self._rate
        if now < self._until:
            self._least = min(self._least, delay)
            return 0
        missing = 0
        if self._least - self._before > self._jump:
            missing = round((self._least - self._before) * self._rate)
            self._least = self._before
        self._before, self._least = self._least, delay - missing / self._rate
        self._until = now + self._window
        return missing
