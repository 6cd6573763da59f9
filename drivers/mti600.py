"""Xsens MTi-600 on CAN: an accelerometer on the bus, through whatever adapter python-can knows (slcan over a serial port).

Each sample is a group of frames that begins with its counter. Frames are kept as they come and decoded many at a time; the same
messages are described in `mti600.dbc`. Values are big-endian. A frame has a checksum on the bus and none between a serial adapter
and this machine: a byte hurt there is seen where it spoils a frame's form, its length or the counter.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from drivers.block import Block, Input, Raw, Status
from drivers.errors import ConnectionLostError
from drivers.kinds import Settings, StreamKind

DBC = Path(__file__).with_name("mti600.dbc")
BITRATE = 250_000
ERROR, SAMPLE_TIME, GROUP_COUNTER, STATUS_WORD, ACCELERATION = 0x001, 0x005, 0x006, 0x011, 0x034
#: Bytes of each message that is read.
LENGTHS = {ERROR: 1, SAMPLE_TIME: 4, GROUP_COUNTER: 2, STATUS_WORD: 4, ACCELERATION: 6}
PER_COUNT = 2.0**-8
CLIPPED = 0x700
WRAP = 1 << 16
#: Groups in a block, and frames that may have been waiting before a run.
GROUPS = 16
BACKLOG = 1000
#: Seconds that a serial adapter needs after its port was opened; many restart then.
SETTLE = 2.0


@dataclass(frozen=True, kw_only=True)
class Groups:
    """Decoded groups: counters as sent, accelerations as counts (shape (n, 3)), device time in seconds, clip flags."""

    counter: NDArray[np.int64]
    acceleration: Raw
    seconds: NDArray[np.float64]
    clipped: NDArray[np.bool_]


def decode(identifiers: NDArray[np.int64], data: NDArray[np.uint8], *, following: int | None) -> Groups:
    """Frames to groups: those whose counter and acceleration both arrived.

    Where the counter steps, the one that was lost may have stood anywhere behind the last that came, and the acceleration
    there may be that of a later sample: the group before a step is left out.

    Parameters
    ----------
    identifiers
        Arbitration identifiers in the order of arrival, shape (n,).
    data
        Their bytes, filled up with zeros, shape (n, 8).
    following
        The counter that came behind these frames; None where none did, so that the last group cannot be trusted.
    """
    # A frame that came twice stands beside itself.
    again = np.zeros(len(identifiers), bool)
    again[1:] = (identifiers[1:] == identifiers[:-1]) & (data[1:] == data[:-1]).all(axis=1)
    identifiers, data = identifiers[~again], data[~again]
    group = np.cumsum(identifiers == GROUP_COUNTER) - 1
    found = int(group[-1]) + 1 if len(group) else 0
    counter = _big(data[identifiers == GROUP_COUNTER], ">u2").astype(np.int64)
    acceleration = np.zeros((found, 3), np.int16)
    has = np.zeros(found, bool)
    seconds = np.full(found, np.nan)
    clipped = np.zeros(found, bool)
    for identifier in (ACCELERATION, SAMPLE_TIME, STATUS_WORD):
        here = np.flatnonzero((identifiers == identifier) & (group >= 0))
        own, first = np.unique(group[here], return_index=True)
        rows = data[here[first]]
        if identifier == ACCELERATION:
            acceleration[own] = np.ascontiguousarray(rows[:, :6]).view(">i2").astype(np.int16)
            has[own] = True
        elif identifier == SAMPLE_TIME:
            seconds[own] = _big(rows, ">u4") * 1e-6
        else:
            clipped[own] = (_big(rows, ">u4") & CLIPPED) != 0
    has[:-1] &= np.diff(counter) % WRAP == 1
    has[-1:] &= following is not None and (following - counter[-1:]) % WRAP == 1
    return Groups(counter=counter[has], acceleration=acceleration[has], seconds=seconds[has], clipped=clipped[has])


def _big(rows: NDArray[np.uint8], kind: str) -> NDArray[Any]:
    size = np.dtype(kind).itemsize
    return np.ascontiguousarray(rows[:, :size]).view(kind).ravel()


class MtiInstrument:
    """An MTi-600 that sends counter, time, acceleration and status; its rate is the one it was configured for.

    Parameters
    ----------
    port
        Of the adapter, or the channel of another interface.
    bus
        python-can's name of the adapter's interface: "slcan" over a serial port, "virtual" inside this process.
    """

    def __init__(self, port: str, *, bus: str = "slcan") -> None:
        self.identity = "Xsens MTi-600"
        one = Input(unit="m/s^2", per_count=PER_COUNT, full_scale=None, dtype="int16")
        self.inputs: Sequence[Input] = (one,) * 3
        self._name = port
        try:
            own: dict[str, Any] = {"sleep_after_open": SETTLE} if bus == "slcan" else {}
            self._bus = can.Bus(channel=port, interface=bus, bitrate=BITRATE, **own)
        except (can.CanError, OSError, ValueError) as error:
            raise ConnectionLostError(f"the CAN adapter at {port} cannot be opened ({error}); check the cable and name") from None
        self._frames: list[tuple[int, bytes]] = []
        self._first: int | None = None
        self._tick = 0
        self._time = 0.0
        self._lost_inside = False
        self._open = True
        self.damaged = 0

    def prepare(self, *, sample_rate: float, channels: Sequence[int]) -> float:
        """Nothing can be set over this bus; the look before a run compares the rate with the instrument's own clock."""
        return sample_rate

    def start(self) -> None:
        """Forget what was on its way; the first group from now on has tick 0."""
        for _ in range(BACKLOG):
            if not self._receive(0.0):
                break
        self._frames, self._first, self._tick, self._time = [], None, 0, 0.0
        self._open = True

    def read(self, timeout: float) -> Block | None:
        """The next block of whole groups, or None."""
        end = time.monotonic() + timeout
        groups = sum(identifier == GROUP_COUNTER for identifier, _ in self._frames)
        while self._open and groups <= GROUPS:
            messages = self._receive(max(end - time.monotonic(), 0.0))
            if not messages and time.monotonic() >= end:
                break
            for message in messages:
                groups += self._take(message)
        return self._block()

    def stop(self) -> int | None:
        """End reading; it goes on sending, and does not say how much it counted."""
        self._open = False
        return None

    def close(self) -> None:
        """Let go of the bus."""
        # An adapter that is gone cannot be told.
        with suppress(can.CanError, OSError):
            self._bus.shutdown()

    def _receive(self, timeout: float) -> list[can.Message]:
        try:
            message = self._bus.recv(timeout)
        except (can.CanError, OSError, TypeError) as error:
            if not isinstance(error.__cause__, UnicodeDecodeError):
                raise ConnectionLostError(f"{self._name} is gone ({error}); plug it in and resume") from None
            # The library keeps a line that is no text, and would stumble over it for ever.
            self._bus.flush()  # type: ignore[attr-defined]
            self.damaged += 1
            return []
        except (ValueError, IndexError):
            # What the adapter sent is no frame.
            self.damaged += 1
            return []
        return [] if message is None else [message]

    def _take(self, message: can.Message) -> bool:
        # Keep a frame that is one of ours; whether a group begins.
        identifier, payload = message.arbitration_id, bytes(message.data)
        if message.is_extended_id or identifier not in LENGTHS:
            return False
        if len(payload) != LENGTHS[identifier]:
            self.damaged += 1
            return False
        if identifier == ERROR:
            self._lost_inside = self._lost_inside or payload == b"\x01"
            return False
        self._frames.append((identifier, payload))
        return identifier == GROUP_COUNTER

    def _block(self) -> Block | None:
        # The last group may still miss frames; it stays until the next one begins. A block ends at a step of the counter.
        starts = [k for k, (identifier, _) in enumerate(self._frames) if identifier == GROUP_COUNTER]
        end = starts[-1] if self._open and starts else len(self._frames)
        whole = self._frames[:end]
        if not whole:
            return None
        identifiers = np.array([identifier for identifier, _ in whole], np.int64)
        data = np.frombuffer(b"".join(payload.ljust(8, b"\0") for _, payload in whole), np.uint8).reshape(-1, 8)
        following = int.from_bytes(self._frames[end][1][:2], "big") if end < len(self._frames) else None
        found = decode(identifiers, data, following=following)
        if not len(found.counter):
            self._frames = self._frames[end:]
            return None
        straight = int(np.argmax(np.append(np.diff(found.counter) % WRAP != 1, True))) + 1
        begins = [k for k, (identifier, _) in enumerate(whole) if identifier == GROUP_COUNTER]
        if straight < len(found.counter):
            wanted = int(found.counter[straight])
            cut = next(k for k in begins if int.from_bytes(whole[k][1][:2], "big") == wanted)
            self._frames = self._frames[cut:]
        else:
            self._frames = self._frames[end:]
        return self._straight(found, straight)

    def _straight(self, found: Groups, count: int) -> Block:
        first = int(found.counter[0])
        if self._first is None:
            self._first, self._tick = first, 0
        # The counter has 16 bits: the group lies within half a wrap of the last; what came twice lies behind it.
        tick = self._tick + (first - self._first - self._tick + WRAP // 2) % WRAP - WRAP // 2
        self._tick = tick + count
        seconds = float(found.seconds[0])
        if np.isfinite(seconds):
            wrap = 2.0**32 * 1e-6
            self._time += (seconds - self._time + wrap / 2.0) % wrap - wrap / 2.0
        status = Status.GOOD
        if found.clipped[:count].any():
            status |= Status.OVERLOAD
        if self._lost_inside:
            status |= Status.LOST
        self._lost_inside = False
        return Block(
            first_tick=tick, samples=found.acceleration[:count], host_time=time.monotonic(),
            device_time=self._time if np.isfinite(seconds) else None, status=status,
        )  # fmt: skip


class MtiSettings(Settings, frozen=True):
    """python-can's name of the adapter's interface."""

    bus: str = "slcan"


def _open(port: str, settings: MtiSettings) -> MtiInstrument:
    return MtiInstrument(port, bus=settings.bus)


KIND = StreamKind(name="mti600", open=_open, settings=MtiSettings)
