"""Lost scans seen by a counter of two bits that is wired to the digital inputs: a square wave on 0, its half on 1."""

from __future__ import annotations

import math

import numpy as np

from isorig.drivers.block import Raw

#: Values of the counter.
VALUES = 4
#: Scans, and a share of a step, by which a step of the counter may come early or late.
SCANS, SHARE = 1.5, 0.02
#: How much of a step's length is learned from each, so that two clocks that run differently are no loss.
LEARN = 0.05
#: Steps that may be lost at once and be counted: the counter goes round after four.
SEEN = 3.5


class Marks:
    """Compares the scans between two steps of the counter with those that there must be.

    Parameters
    ----------
    rate
        Scans a second, Hz.
    counter
        Steps of the counter a second, Hz.
    """

    def __init__(self, rate: float, counter: float) -> None:
        self._step = rate / counter
        self._tick = 0
        self._value: int | None = None
        self._last: float | None = None

    @property
    def reach(self) -> float:
        """Scans that may be lost at once and still be counted."""
        return (SEEN - 0.5) * self._step

    def split(self, scans: Raw, lost: int) -> list[tuple[Raw, int]]:
        """The scans in parts, each with the scans lost before it; `lost` were known to be missing before the first."""
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
        # Scans lost since the last step, at a step of the counter by `rise`.
        last, self._last = self._last, float(tick)
        if last is None:
            return 0
        steps = rise % VALUES
        short = steps * self._step - (tick - last)
        # The counter may have gone round.
        short -= VALUES * self._step * math.floor((short + 0.5 * self._step) / (VALUES * self._step))
        if short > max(SCANS, SHARE * self._step):
            self._last = tick + round(short)
            return round(short)
        if steps == 1:
            self._step += LEARN * (tick - last - self._step) if abs(tick - last - self._step) < SCANS else 0.0
        return 0
