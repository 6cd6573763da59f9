"""Aligns scans in an unframed stream of words, using bits that are always zero.

A 12-bit converter leaves the four lowest bits of a word at zero; in the first word of a scan the two lowest bits are the digital
inputs. Digital inputs that are open (pulled up) or tied to 5 V mark the first word, as long as they are constant. If a byte or a
word is lost or doubled, these bits differ, and the stream is realigned. Data that fit both the old and the new alignment are
discarded, so that no value ever combines bytes of two samples. Without a mark the inputs could be exchanged, so a loss then ends
the run.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isorig.drivers.block import Raw, Status
from isorig.drivers.errors import ProtocolError

#: Scans that must fit after a realignment; scans held back until that many have arrived after them.
PROOF = 16
HOLD = 64
#: Number of always-zero bits in the scans on either side of a damaged place that are discarded with it: bytes of a wrong
#: alignment fit by chance with a probability of 2 to the power of minus this number.
EVIDENCE = 24
#: Scans without any valid alignment after which the stream is rejected.
GARBAGE = 1024
DIGITAL = 3
#: Scans after which constant digital inputs are taken for the mark of the first word.
CONSTANT = 64
#: Advice where nothing marks the first word of a scan.
WIRE = "leave the digital inputs open, or tie one to 5 V"


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Consecutive scans, int16, shape (n, inputs), including digital inputs; number of scans lost before; arrival time (s)."""

    scans: Raw
    lost: int
    arrived: float
    status: Status


class Alignment:
    """Splits bytes into scans of so many inputs, 16-bit words; `bits` is the resolution of the converter, 12, 14 or 16.

    With 16 there are no zero bits to align by. Digital inputs mark nothing if a counter is wired to them.
    """

    def __init__(self, inputs: int, bits: int, who: str, *, counted: bool = False) -> None:
        self._width = 2 * inputs
        zero = (1 << (16 - bits)) - 1
        #: Bits of each byte of a scan that must be zero.
        self._mask = np.zeros(self._width, np.uint8)
        self._mask[::2] = zero
        self._mask[0] &= ~DIGITAL & 0xFF
        # The value that the digital inputs have in every scan; None before it is known, 0 if they mark nothing.
        self._mark: int | None = 0 if counted else None
        self._who = who
        self._buffer = bytearray()
        # Buffer position at which the bytes of each arrival end, and the arrival time in seconds.
        self._arrived: deque[tuple[int, float]] = deque()
        self._lost = 0
        self._resynced = False
        self._sure = self._checked or self._mark is None

    @property
    def _checked(self) -> bool:
        # Whether anything shows the alignment.
        return bool(self._mask.any() or self._mark)

    @property
    def _guard(self) -> int:
        known = int(np.unpackbits(self._mask).sum()) + (DIGITAL.bit_count() if self._mark else 0)
        return math.ceil(EVIDENCE / known) if known else 0

    @property
    def held(self) -> int:
        """Number of scans received but not returned yet."""
        return len(self._buffer) // self._width

    def feed(self, data: bytes, now: float) -> Iterator[Stretch]:
        """Scans whose alignment is certain so far; `data` arrived at `now`, seconds. Raises ProtocolError if no alignment fits
        for a long stretch."""
        self._buffer += data
        self._arrived.append((len(self._buffer), now))
        if self._mark is None:
            if self.held < CONSTANT:
                return
            self._find_mark()
        yield from self._cut(HOLD if self._checked else 0)

    def finish(self) -> Iterator[Stretch]:
        """The remaining scans, as far as they fit."""
        if self._mark is None:
            self._find_mark()
        yield from self._cut(0)

    def _find_mark(self) -> None:
        # A stream begins with its first word.
        first = np.frombuffer(bytes(self._buffer[: self.held * self._width]), np.uint8).reshape(-1, self._width)[:CONSTANT, 0]
        constant = len(first) > 0 and bool((first & DIGITAL == first[0] & DIGITAL).all())
        self._mark = int(first[0] & DIGITAL) if constant else 0

    def _cut(self, hold: int) -> Iterator[Stretch]:
        while (count := len(self._buffer) // self._width) > hold:
            good = self._fits(0, count)
            bad = count if good.all() else int(np.argmin(good))
            if bad == count:
                yield from self._release(count - hold)
                return
            # The scans after it must be known to decide whether it fits.
            if count - bad <= HOLD and hold:
                yield from self._release(max(bad - HOLD, 0))
                return
            start = self._realigned(bad)
            if start is None:
                # Too few bytes after the damage to realign yet.
                if not hold:
                    yield from self._release(max(bad - self._guard, 0))
                    self._drop(len(self._buffer))
                    return
                if count - bad > GARBAGE:
                    raise ProtocolError(
                        f"{self._who} sends bytes that are not scans of {self._width // 2} inputs; check that the plan names the "
                        "right instrument and the bits of its converter, that its digital inputs do not change, then resume"
                    )
                return
            if self._is_ambiguous(start):
                raise ProtocolError(
                    f"{self._who} lost bytes, and nothing shows to which input those after them belong; {WIRE}, then resume"
                )
            sure = max(self._certain(bad, start) - self._guard, 0)
            yield from self._release(sure)
            skipped = start - sure * self._width
            # An extra or missing single byte was doubled or lost; half scans are counted as lost.
            self._lost += (skipped + self._width // 2) // self._width
            self._resynced = True
            self._drop(skipped)

    def _realigned(self, bad: int) -> int | None:
        # Position of the first byte, at or after a scan that does not fit, from which enough scans fit; the next scan if only one
        # is damaged.
        origin = bad * self._width
        room = len(self._buffer) - origin
        skips = (self._width, *range(1, room - PROOF * self._width + 1))
        fitting = (skip for skip in skips if skip + PROOF * self._width <= room and self._fits(origin + skip, PROOF).all())
        skip = next(fitting, None)
        # The first of the matching scans may match by chance as well.
        return None if skip is None else origin + skip + self._guard * self._width

    def _is_ambiguous(self, start: int) -> bool:
        # Whether the scans from here on would also fit if they began at another byte.
        count = (len(self._buffer) - start) // self._width - 1
        return count > 0 and any(self._fits(start + shift, min(count, HOLD)).all() for shift in range(1, self._width))

    def _certain(self, bad: int, start: int) -> int:
        # Scans before the damage that fit only the old alignment: later ones are ambiguous.
        if (start - bad * self._width) % self._width == 0:
            return bad
        first = start % self._width
        against = np.flatnonzero(~self._fits(first, (start - first) // self._width))
        begin = first + (int(against[-1]) + 1 if len(against) else 0) * self._width
        return min(begin // self._width, bad)

    def _release(self, count: int) -> Iterator[Stretch]:
        if count <= 0:
            return
        whole = len(self._buffer) // self._width
        if whole >= HOLD:
            # Whether every other alignment would have been detected.
            self._sure = all(not self._fits(shift, whole - 1).all() for shift in range(1, self._width))
        status = (Status.RESYNCED if self._resynced else Status.GOOD) | (Status.GOOD if self._sure else Status.UNSURE)
        scans = np.frombuffer(bytes(self._buffer[: count * self._width]), "<i2").reshape(count, -1)
        done = 0
        for end, arrived in tuple(self._arrived):
            # Each arrival becomes one stretch; a scan that arrived in two parts belongs to the second.
            upto = min(end // self._width, count)
            if upto > done:
                yield Stretch(scans=scans[done:upto], lost=self._lost, arrived=arrived, status=status)
                done, self._lost, status = upto, 0, status & ~Status.RESYNCED
        self._resynced = False
        self._drop(count * self._width)

    def _drop(self, size: int) -> None:
        del self._buffer[:size]
        self._arrived = deque((end - size, arrived) for end, arrived in self._arrived if end > size)

    def _fits(self, at: int, count: int) -> NDArray[np.bool_]:
        data = np.frombuffer(bytes(self._buffer[at : at + count * self._width]), np.uint8).reshape(count, self._width)
        fitting = ~np.any(data & self._mask, axis=1)
        return np.asarray(fitting & (data[:, 0] & DIGITAL == self._mark) if self._mark else fitting)
