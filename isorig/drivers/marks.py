"""Detects lost scans with a two-bit counter wired to the digital inputs: a square wave on 0, half its frequency on 1."""

import math

import numpy as np

from isorig.drivers.block import Raw

#: Values of the counter.
VALUES = 4
#: Tolerance of a counter step in scans, and as a share of a step.
SCANS, SHARE = 1.5, 0.02
#: Adaptation of the step length at each step, so that clock drift is not counted as a loss.
LEARN = 0.05
#: Number of steps that may be lost at once and still be counted: the counter wraps after four.
SEEN = 3.5


class CounterMarks:
    """Compares the number of scans between two counter steps with the expected number; scan rate and counting rate in Hz."""

    def __init__(self, rate: float, counter: float) -> None:
        self._step = rate / counter
        self._tick = 0
        self._value: int | None = None
        self._last: float | None = None

    @property
    def reach(self) -> float:
        """Number of scans that may be lost at once and still be counted."""
        return (SEEN - 0.5) * self._step

    def split(self, scans: Raw, lost: int) -> list[tuple[Raw, int]]:
        """The scans in parts, each with the scans lost before it; `lost` scans are known to be missing before the first."""
        values = scans[:, 0] & (VALUES - 1)
        previous = values[0] if self._value is None else self._value
        parts: list[tuple[Raw, int]] = []
        begin, before = 0, lost
        self._tick += lost
        for at in np.flatnonzero(np.diff(values, prepend=previous)):
            missing = self._missing(self._tick + int(at), int(values[at]) - int(values[at - 1] if at else previous))
            if missing:
                if at > begin:
                    parts.append((scans[begin:at], before))
                    before = 0
                begin, before = int(at), before + missing
                self._tick += missing
        self._value = int(values[-1])
        self._tick += len(scans)
        return [*parts, (scans[begin:], before)]

    def _missing(self, tick: int, rise: int) -> int:
        # Scans lost since the last counter step, given a step by `rise`.
        last, self._last = self._last, float(tick)
        if last is None:
            return 0
        steps = rise % VALUES
        short = steps * self._step - (tick - last)
        # The counter may have wrapped.
        short -= VALUES * self._step * math.floor((short + 0.5 * self._step) / (VALUES * self._step))
        if short > max(SCANS, SHARE * self._step):
            self._last = tick + round(short)
            return round(short)
        if steps == 1:
            self._step += LEARN * (tick - last - self._step) if abs(tick - last - self._step) < SCANS else 0.0
        return 0
