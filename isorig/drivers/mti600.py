"""Xsens MTi-600 on CAN: an accelerometer on the bus, with any adapter that python-can supports (slcan over a serial port).

Each sample is a group of frames that starts with its counter. Values are big-endian. A frame has a checksum on the bus, but none
between a serial adapter and the host: a byte damaged there is detected only if it invalidates a frame's form, its length or the
counter.
"""

import struct
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import can
import numpy as np

from isorig.drivers.block import Block, Input, Status
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
from isorig.drivers.order import EXACT, BlockHeader, Order, wrapped
from isorig.drivers.port import check_name
from isorig.drivers.simulated.streams import SimulatedSlcan, axes
from isorig.drivers.waits import WAITS, Waits

BITRATE = 250_000
#: The error message that reports messages dropped inside the instrument; any other one is a fault.
DROPPED = b"\x01"
#: Groups in a block, at most, and maximum number of frames waiting before a run.
GROUPS = 16
BACKLOG = 1000
#: Maximum number of characters without an end of line from an adapter: a frame of eight bytes has 22.
LONGEST = 4096


@dataclass
class FrameGroup:
    """A sample as its frames give it: counter as sent, acceleration in counts, device time in microseconds, whether it clipped.

    What has not arrived is None; of frames of one kind, the first counts.
    """

    counter: int
    acceleration: tuple[int, ...] | None = None
    micros: int | None = None
    clipped: bool | None = None

    def add(self, identifier: int, payload: bytes) -> None:
        """Add a frame by its arbitration identifier."""
        if identifier == ACCELERATION and self.acceleration is None:
            self.acceleration = struct.unpack(">hhh", payload)
        elif identifier == SAMPLE_TIME and self.micros is None:
            self.micros = int.from_bytes(payload, "big")
        elif identifier == STATUS_WORD and self.clipped is None:
            self.clipped = bool(int.from_bytes(payload, "big") & CLIPPED)


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
        self._rate: float | None = None
        self._open = True
        self._begin()
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
            if self._receive(0.0) is None:
                break
        self._begin()
        self._open = True

    def read(self, timeout: float) -> Block | None:
        """The next block of whole groups, or None."""
        end = time.monotonic() + timeout
        while True:
            begun = 0
            while self._open and begun <= GROUPS and len(self._stretches) < 2:
                message = self._receive(max(end - time.monotonic(), 0.0))
                if message is None and time.monotonic() >= end:
                    break
                begun += message is not None and self._accept(message)
            block = self._block(self._stretches.popleft()) if self._stretches else None
            # A block received before is discarded; the data after it may be new.
            if block is not None or time.monotonic() >= end or not (self._open or self._stretches):
                return block

    def rejoin(self) -> None:
        """Reopen the adapter after a lost connection; the instrument keeps sending, and its counter and clock show the loss."""
        self.close()
        self._forget()
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

    def _begin(self) -> None:
        self._order = Order(who=self._name, began=time.monotonic(), counter_wrap=WRAP, rate=self._rate, loose=EXACT)
        self._status = Status.GOOD
        self._forget()

    def _forget(self) -> None:
        # Whole groups whose counters follow each other, the group that is received, and the last frame.
        self._stretches: deque[list[FrameGroup]] = deque()
        self._group: FrameGroup | None = None
        self._last: tuple[int, bytes] | None = None

    def _receive(self, timeout: float) -> can.Message | None:
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
            return None
        except (ValueError, IndexError):
            # The adapter sent an invalid frame.
            self.damaged += 1
            return None
        return message

    def _accept(self, message: can.Message) -> bool:
        # Sorts a frame of this instrument into the group of its sample; returns whether a group begins.
        identifier, payload = message.arbitration_id, bytes(message.data)
        if message.is_extended_id or identifier not in LENGTHS:
            return False
        if len(payload) != LENGTHS[identifier]:
            self.damaged += 1
        elif identifier == ERROR:
            self._status |= Status.LOST if payload == DROPPED else Status.FAULT
        elif (identifier, payload) != self._last:
            # A frame received twice is adjacent to its copy.
            self._last = identifier, payload
            if identifier == GROUP_COUNTER:
                self._next_group(int.from_bytes(payload, "big"))
                return True
            if self._group is not None:
                self._group.add(identifier, payload)
        return False

    def _next_group(self, counter: int) -> None:
        # If the counter steps, the lost counter may have been anywhere after the last one received, and the acceleration there
        # may belong to a later sample: the group before a step is discarded.
        group, self._group = self._group, FrameGroup(counter)
        if group is None or group.acceleration is None or (counter - group.counter) % WRAP != 1:
            return
        if not self._stretches or (group.counter - self._stretches[-1][-1].counter) % WRAP != 1:
            self._stretches.append([])
        self._stretches[-1].append(group)

    def _block(self, groups: Sequence[FrameGroup]) -> Block | None:
        acceleration, now = np.array([group.acceleration for group in groups], np.int16), time.monotonic()
        reading = BlockHeader(
            counter=groups[0].counter, rows=len(groups), host=now, clock=self._clock(groups), mark=crc32(acceleration.tobytes()),
        )  # fmt: skip
        place = self._order.place(reading)
        if place is None:
            return None
        status = self._status | place.status | (Status.OVERLOAD if any(group.clipped for group in groups) else Status.GOOD)
        self._status = Status.GOOD
        return Block(first_tick=place.tick, samples=acceleration, host_time=now, device_time=place.seconds, status=status)

    def _clock(self, groups: Sequence[FrameGroup]) -> int | None:
        # Time at the first group in microseconds, by majority of the groups: damaged digits are outvoted.
        known = [(k, group.micros) for k, group in enumerate(groups) if group.micros is not None]
        if not known:
            return None
        place, first = known[0]
        if self._rate is None:
            return first if place == 0 else None
        steps = [wrapped(micros, first, Order.WRAP) - first - 1e6 * k / self._rate for k, micros in known]
        return round(first + float(np.median(steps))) % Order.WRAP


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
