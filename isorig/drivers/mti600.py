"""Xsens MTi-600 on CAN: an accelerometer on the bus, with any adapter that python-can supports (slcan over a serial port).

Each sample is a group of frames that starts with its counter. Frames are stored as received and decoded in batches. Values are
big-endian. A frame has a checksum on the bus, but none between a serial adapter and the host: a byte damaged there is detected
only if it invalidates a frame's form, its length or the counter.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import can
import numpy as np
from numpy.typing import NDArray

from isorig.drivers.block import Block, Input, Raw, Status
from isorig.drivers.errors import ConnectionLostError, SettingError
from isorig.drivers.kinds import Settings, StreamKind
from isorig.drivers.mti600_messages import (
    ACCELERATION,
    CLIPPED,
    ERROR,
    GROUP_COUNTER,
    LENGTHS,
    PER_COUNT,
    SAMPLE_TIME,
    STATUS_WORD,
    WRAP,
)
from isorig.drivers.order import EXACT, BlockHeader, Order
from isorig.drivers.port import check_name
from isorig.drivers.simulated.streams import SimulatedSlcan, axes
from isorig.drivers.waits import WAITS, Waits

BITRATE = 250_000
#: The error message that reports messages dropped inside the instrument; any other one is a fault.
DROPPED = b"\x01"
#: Groups in a block, and maximum number of frames waiting before a run.
GROUPS = 16
BACKLOG = 1000
#: Maximum number of characters without an end of line from an adapter: a frame of eight bytes has 22.
LONGEST = 4096


@dataclass(frozen=True, kw_only=True)
class DecodedGroups:
    """Decoded groups: counters as sent, accelerations as counts (shape (n, 3)), device time in seconds, clip flags."""

    counter: NDArray[np.int64]
    acceleration: Raw
    seconds: NDArray[np.float64]
    clipped: NDArray[np.bool_]


def decode(identifiers: NDArray[np.int64], data: NDArray[np.uint8], *, following: int | None) -> DecodedGroups:
    """Converts frames to groups with both counter and acceleration.

    If the counter steps, the lost counter may have been anywhere after the last one received, and the acceleration there may
    belong to a later sample: the group before a step is discarded.

    Parameters
    ----------
    identifiers
        Arbitration identifiers in the order of arrival, shape (n,).
    data
        Their bytes, padded with zeros, shape (n, 8).
    following
        The counter received after these frames; None if there is none, so that the last group cannot be trusted.
    """
    # A frame received twice is adjacent to its copy.
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
    return DecodedGroups(counter=counter[has], acceleration=acceleration[has], seconds=seconds[has], clipped=clipped[has])


def _big(rows: NDArray[np.uint8], kind: str) -> NDArray[Any]:
    size = np.dtype(kind).itemsize
    return np.ascontiguousarray(rows[:, :size]).view(kind).ravel()


class MtiSettings(Settings, frozen=True):
    """python-can's name of the adapter's interface: slcan over a serial port, virtual inside this process."""

    bus: str = "slcan"


class MtiInstrument:
    """An MTi-600 configured to send counter, time, acceleration and status; its rate is part of its configuration.

    The port is that of the adapter, or the channel of another interface.
    """

    def __init__(self, port: str, settings: MtiSettings, waits: Waits = WAITS) -> None:
        self.identity = "Xsens MTi-600"
        one = Input(unit="m/s^2", per_count=PER_COUNT, full_scale=None, dtype="int16")
        self.inputs: Sequence[Input] = (one,) * 3
        self._name, self._interface, self._waits = port, settings.bus, waits
        check_name(port)
        self._bus = self._opened()
        self._frames: list[tuple[int, bytes]] = []
        self._rate: float | None = None
        self._status = Status.GOOD
        self._open = True
        self._order = self._begun()
        self.damaged = 0

    @property
    def noticed(self) -> Sequence[str]:
        return tuple(self._order.noticed)

    def prepare(self, *, sample_rate: float, channels: Sequence[int]) -> float:
        """Nothing can be set over this bus; the pre-run check compares the rate with the instrument's own clock."""
        if max(channels, default=0) >= len(self.inputs):
            raise SettingError(f"{self._name} has the inputs 0, 1 and 2; there is no input {max(channels)}, correct the plan")
        self._rate = sample_rate
        return sample_rate

    def start(self) -> None:
        """Discard data in transit; the first group from now on has tick 0."""
        for _ in range(BACKLOG):
            if not self._receive(0.0):
                break
        self._frames, self._order, self._status = [], self._begun(), Status.GOOD
        self._open = True

    def read(self, timeout: float) -> Block | None:
        """The next block of whole groups, or None."""
        end = time.monotonic() + timeout
        while True:
            groups = sum(identifier == GROUP_COUNTER for identifier, _ in self._frames)
            while self._open and groups <= GROUPS:
                messages = self._receive(max(end - time.monotonic(), 0.0))
                if not messages and time.monotonic() >= end:
                    break
                for message in messages:
                    groups += self._accept(message)
            before = len(self._frames)
            block = self._block()
            # A block received before is discarded; the data after it may be new.
            if block is not None or len(self._frames) == before or time.monotonic() >= end:
                return block

    def rejoin(self) -> None:
        """Reopen the adapter after a lost connection; the instrument keeps sending, and its counter and clock show the loss."""
        self.close()
        self._frames = []
        self._bus = self._opened()

    def stop(self) -> int | None:
        """Stop reading; the instrument keeps sending, and does not report its count."""
        self._open = False
        return None

    def close(self) -> None:
        # The adapter may be gone.
        with suppress(can.CanError, OSError, TypeError):
            self._bus.shutdown()

    def _opened(self) -> can.BusABC:
        try:
            own: dict[str, Any] = {"sleep_after_open": self._waits.adapter} if self._interface == "slcan" else {}
            bus = can.Bus(channel=self._name, interface=self._interface, bitrate=BITRATE, **own)
            if self._interface == "slcan":
                # Two programs that read one adapter would each get a part of its frames.
                bus.serialPortOrig.exclusive = True  # type: ignore[attr-defined]
            return bus
        except (can.CanError, OSError, ValueError, TypeError) as error:
            raise ConnectionLostError(
                f"the CAN adapter at {self._name} cannot be opened ({error}); check the cable and the name"
            ) from None

    def _begun(self) -> Order:
        return Order(who=self._name, began=time.monotonic(), counter_wrap=WRAP, rate=self._rate, loose=EXACT)

    def _receive(self, timeout: float) -> list[can.Message]:
        try:
            message = self._bus.recv(timeout)
            if len(getattr(self._bus, "_buffer", b"")) > LONGEST:
                # No end of line: the sender is not an adapter, or its baud rate differs.
                self._bus.flush()  # type: ignore[attr-defined]
                self.damaged += 1
        except (can.CanError, OSError, TypeError) as error:
            if not isinstance(error.__cause__, UnicodeDecodeError):
                raise ConnectionLostError(f"{self._name} is gone ({error}); reconnect it and resume") from None
            # The library keeps an undecodable line, and would fail on it forever.
            self._bus.flush()  # type: ignore[attr-defined]
            self.damaged += 1
            return []
        except (ValueError, IndexError):
            # The adapter sent an invalid frame.
            self.damaged += 1
            return []
        return [] if message is None else [message]

    def _accept(self, message: can.Message) -> bool:
        # Store a frame of this instrument; returns whether a group starts.
        identifier, payload = message.arbitration_id, bytes(message.data)
        if message.is_extended_id or identifier not in LENGTHS:
            return False
        if len(payload) != LENGTHS[identifier]:
            self.damaged += 1
            return False
        if identifier == ERROR:
            self._status |= Status.LOST if payload == DROPPED else Status.FAULT
            return False
        self._frames.append((identifier, payload))
        return identifier == GROUP_COUNTER

    def _block(self) -> Block | None:
        # The last group may still be incomplete; it stays until the next one starts. A block ends at a step of the counter.
        starts = [k for k, (identifier, _) in enumerate(self._frames) if identifier == GROUP_COUNTER]
        end = starts[-1] if self._open and starts else len(self._frames)
        whole = self._frames[:end]
        if not whole:
            return None
        identifiers = np.array([identifier for identifier, _ in whole], np.int64)
        data = np.frombuffer(b"".join(payload.ljust(8, b"\0") for _, payload in whole), np.uint8).reshape(-1, 8)
        following = int.from_bytes(self._frames[end][1][:2], "big") if end < len(self._frames) else None
        groups = decode(identifiers, data, following=following)
        straight = int(np.argmax(np.append(np.diff(groups.counter) % WRAP != 1, True))) + 1
        if straight < len(groups.counter):
            wanted = int(groups.counter[straight])
            end = next(k for k in starts if int.from_bytes(whole[k][1][:2], "big") == wanted)
        self._frames = self._frames[end:]
        return self._as_block(groups, straight) if len(groups.counter) else None

    def _as_block(self, groups: DecodedGroups, count: int) -> Block | None:
        acceleration = groups.acceleration[:count]
        now = time.monotonic()
        reading = BlockHeader(
            counter=int(groups.counter[0]), rows=count, host=now, clock=self._clock(groups.seconds[:count]),
            mark=crc32(acceleration.tobytes()),
        )  # fmt: skip
        place = self._order.place(reading)
        if place is None:
            return None
        status = self._status | place.status
        self._status = Status.GOOD
        if groups.clipped[:count].any():
            status |= Status.OVERLOAD
        return Block(first_tick=place.tick, samples=acceleration, host_time=now, device_time=place.seconds, status=status)

    def _clock(self, seconds: NDArray[np.float64]) -> int | None:
        # Time at the first group in microseconds, by majority of the groups: damaged digits are outvoted.
        known = np.flatnonzero(np.isfinite(seconds))
        if not len(known):
            return None
        wrap = Order.WRAP * 1e-6
        first = float(seconds[known[0]])
        steps = (seconds[known] - first + wrap / 2.0) % wrap - wrap / 2.0
        if self._rate is None:
            return round(first * 1e6) if known[0] == 0 else None
        steps = steps - known / self._rate
        return round((first + float(np.median(steps))) * 1e6) % Order.WRAP


EXAMPLE = """
sample_rate = 400.0
[channels.motor]
input = 1
sensitivity = 1.0
"""
KIND = StreamKind(
    name="mti600",
    open=MtiInstrument,
    example=EXAMPLE,
    settings=MtiSettings,
    far_end=lambda rig, asked: SimulatedSlcan(lambda samples, rate: axes(rig.channels(samples, rate)[rig.names[-1]]), asked),
    buses=("serial", "can"),
)
