"""What goes wrong on a simulated instrument's wire, on request and by chance."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, fields

import numpy as np

from isorig.drivers.errors import SettingError

#: Seconds by which a stalled frame is late, and the share by which a dial is turned.
STALL = 0.2
TURN = 0.1


@dataclass(frozen=True, kw_only=True)
class Faults:
    """What goes wrong, each a probability per frame where not said otherwise.

    Parameters
    ----------
    drop, duplicate, corrupt, stall, overload
        A frame is not sent, sent twice, has a bit changed, comes a fifth of a second late, tells of an overload.
    unplug_after
        Seconds of signal after which the wire is cut; never where None.
    first_tick
        The counter's value at the start, to see it wrap.
    ppm
        How much faster than told the instrument's clock runs, parts per million.
    turn_after
        Seconds of signal after which somebody turns the gain up by a tenth; never where None.
    seed
        Of the draws.
    """

    drop: float = 0.0
    duplicate: float = 0.0
    corrupt: float = 0.0
    stall: float = 0.0
    overload: float = 0.0
    unplug_after: float | None = None
    first_tick: int = 0
    ppm: float = 0.0
    turn_after: float | None = None
    seed: int = 0

    def only(self, known: Collection[str], who: str) -> Faults:
        """These faults, where an instrument can have them.

        Raises
        ------
        SettingError
            Where one is asked for that it cannot have.
        """
        asked = [f.name for f in fields(self) if f.name != "seed" and getattr(self, f.name) != f.default]
        unknown = next((name for name in asked if name not in known), None)
        if unknown is not None:
            raise SettingError(f"{who} has no fault {unknown!r}; it knows {', '.join(sorted(known)) or 'none'}")
        return self


class Mishaps:
    """Draws the faults of frames; `happened` counts them by kind."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._random = np.random.default_rng(faults.seed)
        self._until = 0.0
        self.happened: Counter[str] = Counter()

    def met(self, kind: str) -> bool:
        """Whether this fault happens now."""
        chance = getattr(self._faults, kind)
        hit = bool(chance > 0.0 and self._random.random() < chance)
        self.happened[kind] += hit
        return hit

    @property
    def late(self) -> bool:
        """Whether a stall lasts."""
        return time.monotonic() < self._until

    def stalls(self) -> None:
        """Stall, if that happens now."""
        if self.met("stall"):
            self._until = time.monotonic() + STALL

    def sent(self, frame: bytes) -> list[bytes]:
        """What of a frame goes onto the wire."""
        if self.met("drop"):
            return []
        if self.met("corrupt"):
            hurt = bytearray(frame)
            hurt[int(self._random.integers(len(hurt)))] ^= 1 << int(self._random.integers(8))
            frame = bytes(hurt)
        self.stalls()
        return [frame, frame] if self.met("duplicate") else [frame]
