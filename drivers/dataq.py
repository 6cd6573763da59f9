"""DATAQ DI-1100 family: a stream over a serial port, without header, counter or checksum.

Commands end in CR and are echoed while it does not scan. The stream is int16, little-endian, the inputs in turn; the two lowest
bits of the first input are the digital inputs. Nothing is numbered: loss shows only against a clock, within two seconds.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np

from drivers.arrivals import Arrivals
from drivers.block import Block, Input, Status
from drivers.errors import ProtocolError, SettingError
from drivers.kinds import Settings, StreamKind
from drivers.port import Port

CLOCK = 60e6
END = b"\r"
DIVIDER = 65535
DIGITAL = 3
#: Lines that may stand before the echo of a command.
STALE = 50


class DataqInstrument:
    """A DI-1100 at a serial port.

    Parameters
    ----------
    port
        Path or URL.
    full_scale
        Largest voltage of its inputs, V, from its data sheet.
    """

    def __init__(self, port: str, *, full_scale: float) -> None:
        self._port = Port(port, baud_rate=115200)
        self._full_scale = full_scale
        self.identity = "DATAQ DI-1100"
        self.inputs: Sequence[Input] = ()
        self._rest = b""
        self._tick = 0
        self._scanning = False
        self._port.write(b"stop" + END)
        self._port.drop_input()
        self._command("encode 0")

    def prepare(self, *, sample_rate: float, channels: Sequence[int]) -> float:
        """Set the rate to the nearest 60 MHz / n and scan the inputs from 0 to the last one wanted; the rate it really has."""
        divider = round(CLOCK / sample_rate)
        if not 1 <= divider <= DIVIDER:
            raise SettingError(
                f"{sample_rate:g} Hz is no rate of this instrument; give {CLOCK / DIVIDER:.0f} Hz or more in the plan"
            )
        count = max(channels) + 1
        for place in range(count):
            self._command(f"slist {place} {place}")
        self._command(f"srate {divider}")
        for command in ("dec 1", "deca 1", "ps 0"):
            self._command(command)
        one = Input(unit="V", per_count=self._full_scale / 32768.0, full_scale=self._full_scale, dtype="int16")
        self.inputs = (one,) * count
        self._rate = CLOCK / divider
        return self._rate

    def start(self) -> None:
        """Begin to scan; the first scan has tick 0."""
        self._rest, self._tick = b"", 0
        self._arrivals = Arrivals(self._rate)
        self._port.write(b"start" + END)
        self._scanning = True

    def read(self, timeout: float) -> Block | None:
        """The scans that arrived, or None."""
        end = time.monotonic() + timeout
        width = 2 * len(self.inputs)
        while self._scanning:
            data = self._rest + self._port.read()
            scans = len(data) // width
            if scans:
                now = time.monotonic()
                self._rest = data[scans * width :]
                samples = np.frombuffer(data[: scans * width], "<i2").reshape(scans, -1).copy()
                samples[:, 0] &= ~DIGITAL
                missing = self._arrivals.lost(self._tick + scans, now)
                first = self._tick + missing
                self._tick = first + scans
                return Block(
                    first_tick=first, samples=samples, host_time=now, status=Status.LOST if missing else Status.GOOD
                )  # fmt: skip
            self._rest = data
            if time.monotonic() >= end:
                break
        return None

    def stop(self) -> int | None:
        """End the stream; this instrument does not count."""
        self._port.write(b"stop" + END)
        self._port.drop_input()
        self._scanning = False
        return None

    def close(self) -> None:
        """Let go of the wire."""
        self._port.close()

    def _command(self, command: str) -> None:
        self._port.write(command.encode() + END)
        # What was still on its way when the scan was stopped comes first.
        for _ in range(STALE):
            echo = self._port.line(END)
            if command.encode() in echo:
                return
        raise ProtocolError(f"{self._port.name} answered {command!r} with {echo[:40]!r}, not its echo; is it a DI-1100?")


class DataqSettings(Settings, frozen=True):
    """The inputs' range in V."""

    full_scale: float

    def __post_init__(self) -> None:
        if not 0.0 < self.full_scale < math.inf:
            raise ValueError(f"full_scale is {self.full_scale:g}; give the inputs' range in V, e.g. 10.0")


def _open(port: str, settings: DataqSettings) -> DataqInstrument:
    return DataqInstrument(port, full_scale=settings.full_scale)


KIND = StreamKind(name="di1100", open=_open, settings=DataqSettings)
