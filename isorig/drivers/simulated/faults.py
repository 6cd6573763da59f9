"""Faults on a simulated instrument's connection, on request and at random."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, fields

import numpy as np

from isorig.drivers.errors import SettingError

#: Delay of a stalled frame in seconds, and relative change of a turned dial.
STALL = 0.2
TURN = 0.1


@dataclass(frozen=True, kw_only=True)
class Faults:
    """The faults, each a probability per frame unless stated otherwise.

    Parameters
    ----------
    drop, duplicate, corrupt, stall, overload
        A frame is not sent, sent twice, has a flipped bit, is 0.2 s late, reports an overload.
    unplug_after
        Seconds of signal after which the connection is cut; never if None.
    first_tick
        Initial value of the counter, to test its wrapping.
    ppm
        Rate error of the instrument's clock, parts per million.
    turn_after
        Seconds of signal after which the gain is increased by a tenth; never if None.
    seed
        Random seed.
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
        """These faults, if an instrument supports them. Raises SettingError if a requested fault is not supported."""
        asked = [f.name for f in fields(self) if f.name != "seed" and getattr(self, f.name) != f.default]
        unknown = next((name for name in asked if name not in known), None)
        if unknown is not None:
            raise SettingError(f"{who} has no fault {unknown!r}; it has {', '.join(sorted(known)) or 'none'}")
        return self


class Mishaps:
    """Draws the faults of frames at random; `happened` counts them by kind."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._random = np.random.default_rng(faults.seed)
        self._until = 0.0
        self.happened: Counter[str] = Counter()

    def occurs(self, kind: str) -> bool:
        """Whether this fault occurs now."""
        chance = getattr(self._faults, kind)
        hit = bool(chance > 0.0 and self._random.random() < chance)
        self.happened[kind] += hit
        return hit

    @property
    def late(self) -> bool:
        """Whether a stall is in progress."""
        return time.monotonic() < self._until

    def stalls(self) -> None:
        """Stall, if that fault occurs now."""
        if self.occurs("stall"):
            self._until = time.monotonic() + STALL

    def sent(self, frame: bytes) -> list[bytes]:
        """The bytes of a frame that are sent."""
        if self.occurs("drop"):
            return []
        if self.occurs("corrupt"):
            hurt = bytearray(frame)
            hurt[int(self._random.integers(len(hurt)))] ^= 1 << int(self._random.integers(8))
            frame = bytes(hurt)
        self.stalls()
        return [frame, frame] if self.occurs("duplicate") else [frame]
