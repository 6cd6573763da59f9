"""Simulated streams with vendor protocols: a DI-1100, and an MTi-600 on a serial CAN adapter."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from isorig.drivers.block import FloatArray, Raw
from isorig.drivers.mti600_messages import ACCELERATION, CLIPPED, GROUP_COUNTER, PER_COUNT, SAMPLE_TIME, STATUS_WORD, WRAP
from isorig.drivers.simulated.faults import Faults, Mishaps

#: Given a number of samples and a rate in Hz: int16 counts, shape (n, inputs).
Source = Callable[[int, float], Raw]


#: The bits of a word used by a 12-bit converter, and the digital inputs.
LEFT, DIGITAL = ~15, 3
#: Maximum number of samples in a signal that is repeated.
MOST = 100_000


#: Full scale of a DI-1100's inputs, V; rate of a simulated MTi-600, Hz.
RANGE, MTI_RATE = 10.0, 400.0


def words(volts: FloatArray) -> Raw:
    """16-bit counts of all inputs at +-10 V, shape (samples, inputs)."""
    return np.clip(np.round(volts / RANGE * 32768), -32768, 32767).astype(np.int16)


def axes(acceleration: FloatArray) -> Raw:
    """Counts of an accelerometer with its y axis along an acceleration in m/s^2, z upwards, shape (samples, 3)."""
    flat = np.zeros_like(acceleration)
    return np.round(np.stack([flat, acceleration, flat + 9.81], axis=1) / PER_COUNT).astype(np.int16)


class _Paced:
    """Number of samples due at a speed relative to real time."""

    def __init__(self, speed: float, faults: Faults) -> None:
        self._speed = speed * (1.0 + 1e-6 * faults.ppm)
        self._unplug_after = faults.unplug_after
        self.sent = 0
        self._began = 0.0

    def begin(self) -> None:
        self.sent, self._began = 0, time.monotonic()

    def due(self, rate: float, most: int) -> int:
        whole = int((time.monotonic() - self._began) * self._speed * rate)
        return min(max(whole - self.sent, 0), most)

    def over(self, rate: float) -> bool:
        """Whether the connection is to be cut."""
        return self._unplug_after is not None and self.sent > self._unplug_after * rate


class SimulatedDataq:
    """Echoes commands and streams the signal of a source.

    Parameters
    ----------
    source
        Returns the counts of all inputs.
    seconds
        Length of the repeated signal, seconds of signal.
    speed
        Speed relative to real time.
    faults
        Injected faults; `drop` is the probability per second of signal that half of its scans are acquired and not sent.
    """

    FAULTS = frozenset({"drop", "stall", "unplug_after", "ppm"})

    def __init__(self, source: Source, *, seconds: float = 60.0, speed: float = 1.0, faults: Faults | None = None) -> None:
        faults = (faults or Faults()).only(self.FAULTS, "a DI-1100")
        self._source, self._seconds = source, seconds
        self.mishaps = Mishaps(faults)
        self._pace = _Paced(speed, faults)
        self.dropped = 0
        self._waiting = b""
        self._inputs, self._rate = 1, 1000.0
        self._signal: Raw = np.zeros((0, 1), np.int16)
        self.scanning = False
        self.heard: list[str] = []

    @property
    def unplugged(self) -> bool:
        """Whether the connection is to be cut."""
        return self._pace.over(self._rate)

    def step(self, data: bytes) -> bytes:
        """Bytes received, bytes to send."""
        *lines, self._waiting = (self._waiting + data).split(b"\r")
        answer = b""
        for line in lines:
            answer += self._command(line.decode("ascii", "replace").strip())
        return answer + self._scans() if self.scanning and not self.mishaps.late else answer

    def _scans(self) -> bytes:
        # Up to the end of a half second of signal, which is sent or dropped as a whole.
        half = int(self._rate / 2.0)
        first = self._pace.sent
        count = self._pace.due(self._rate, min(4096, half - first % half))
        if count and first % half == 0:
            self._losing = first % (2 * half) != 0 and self.mishaps.occurs("drop")
        self._pace.sent += count
        if self._losing:
            self.dropped += count
            return b""
        ticks = np.arange(first, first + count)
        words = self._signal.take(ticks, axis=0, mode="wrap")[:, : self._inputs].astype("<i2") & LEFT
        # The digital inputs are open and pulled up.
        words[:, 0] |= DIGITAL
        data = words.tobytes()
        if count:
            self.mishaps.stalls()
        return data

    def _command(self, command: str) -> bytes:
        self.heard.append(command)
        echo = b"" if self.scanning else command.encode() + b"\r"
        words = command.split()
        match words:
            case ["stop"]:
                self.scanning = False
            case ["start"]:
                self._signal = self._source(min(round(self._seconds * self._rate), MOST), self._rate)
                self.scanning, self._losing, self.dropped = True, False, 0
                self._pace.begin()
                return b""
            case ["slist", place, _]:
                self._inputs = int(place) + 1
            case ["srate", divider]:
                self._rate = 60e6 / int(divider)
        return echo


def groups(
    samples: Raw, *, rate: float, first: int = 0, counter: int = 0, clip: int = 32767
) -> Iterator[list[tuple[int, bytes]]]:
    """The frames of each sample: counter, time, acceleration (counts, shape (n, 3)) and status."""
    for k, row in enumerate(samples):
        tick = first + k
        flags = CLIPPED & 0x100 if (np.abs(row.astype(int)) >= clip).any() else 0
        yield [
            (GROUP_COUNTER, ((counter + tick) % WRAP).to_bytes(2, "big")),
            (SAMPLE_TIME, (round(1e6 * tick / rate) % 2**32).to_bytes(4, "big")),
            (ACCELERATION, row.astype(">i2").tobytes()),
            (STATUS_WORD, flags.to_bytes(4, "big")),
        ]


def slcan(frame: tuple[int, bytes]) -> bytes:
    """A frame in the text format of serial CAN adapters."""
    identifier, data = frame
    return f"t{identifier:03X}{len(data)}{data.hex().upper()}\r".encode()


class SimulatedSlcan:
    """A serial CAN adapter with an MTi-600 on its bus.

    Parameters
    ----------
    source
        Returns the counts of three axes.
    rate
        Hz.
    seconds
        Length of the repeated signal, seconds of signal.
    speed
        Speed relative to real time.
    faults
        Injected faults of the adapter's frames.
    """

    FAULTS = frozenset({"drop", "duplicate", "corrupt", "stall", "overload", "unplug_after", "first_tick", "ppm"})

    def __init__(
        self, source: Source, *, rate: float = 100.0, seconds: float = 60.0, speed: float = 1.0, faults: Faults | None = None
    ) -> None:
        faults = (faults or Faults()).only(self.FAULTS, "an MTi-600")
        self._signal = source(round(seconds * rate), rate)
        self._rate, self._counter, self._ppm = rate, faults.first_tick, faults.ppm
        self.mishaps = Mishaps(faults)
        self._pace = _Paced(speed, faults)
        self._waiting = b""
        self._opened = False
        self.heard: list[str] = []

    @property
    def unplugged(self) -> bool:
        """Whether the connection is to be cut."""
        return self._pace.over(self._rate)

    def step(self, data: bytes) -> bytes:
        """Bytes received, bytes to send."""
        *lines, self._waiting = (self._waiting + data).split(b"\r")
        answer = b""
        for line in lines:
            command = line.decode("ascii", "replace")
            self.heard.append(command)
            # An adapter with an open bus refuses to open it again.
            answer += b"\a" if command == "O" and self._opened else b"\r"
            if command == "O" and not self._opened:
                self._opened = True
                self._pace.begin()
            elif command == "C":
                self._opened = False
        return answer + self._frames() if self._opened and not self.mishaps.late else answer

    def _frames(self) -> bytes:
        count = self._pace.due(self._rate, 256)
        first, self._pace.sent = self._pace.sent, self._pace.sent + count
        part = self._signal.take(np.arange(first, first + count), axis=0, mode="wrap")
        rate = self._rate * (1.0 + 1e-6 * self._ppm)
        frames: list[bytes] = []
        for group in groups(part, rate=rate, first=first, counter=self._counter):
            for identifier, data in group:
                flags = (0x100).to_bytes(4, "big")
                clipped = identifier == STATUS_WORD and self.mishaps.occurs("overload")
                frames += self.mishaps.sent(slcan((identifier, flags if clipped else data)))
        return b"".join(frames)


class SimulatedLines:
    """A microcontroller that sends lines "count,milliseconds,volts..." between `go` and `halt`, with a counter of 16 bits.

    Parameters
    ----------
    volts
        Returns the voltages of all inputs.
    seconds
        Length of the repeated signal, seconds of signal.
    speed
        Speed relative to real time.
    faults
        Injected faults of its lines.
    """

    FAULTS = frozenset({"drop", "duplicate", "corrupt", "stall", "overload", "unplug_after", "first_tick", "ppm"})

    def __init__(
        self, volts: Callable[[int, float], FloatArray], *, rate: float = 100.0, seconds: float = 60.0, speed: float = 1.0,
        faults: Faults | None = None,
    ) -> None:  # fmt: skip
        faults = (faults or Faults()).only(self.FAULTS, "an instrument of lines")
        self._signal = volts(min(round(seconds * rate), MOST), rate)
        self._rate, self._first, self._ppm = rate, faults.first_tick, faults.ppm
        self.mishaps = Mishaps(faults)
        self._pace = _Paced(speed, faults)
        self._waiting = b""
        self.running = False
        self.heard: list[str] = []

    @property
    def unplugged(self) -> bool:
        """Whether the connection is to be cut."""
        return self._pace.over(self._rate)

    def step(self, data: bytes) -> bytes:
        """Bytes received, bytes to send."""
        *lines, self._waiting = (self._waiting + data).split(b"\n")
        for line in lines:
            command = line.decode("ascii", "replace").strip()
            self.heard.append(command)
            if command == "go":
                self._pace.begin()
            self.running = command == "go" or (self.running and command != "halt")
        return self._lines() if self.running and not self.mishaps.late else b""

    def _lines(self) -> bytes:
        count = self._pace.due(self._rate, 256)
        first, self._pace.sent = self._pace.sent, self._pace.sent + count
        lines: list[bytes] = []
        for tick in range(first, first + count):
            values = self._signal[tick % len(self._signal)]
            words = ["OL" if self.mishaps.occurs("overload") else f"{value:.6f}" for value in values]
            clock = round(1e3 * tick / self._rate / (1.0 + 1e-6 * self._ppm))
            text = ",".join([f"{(self._first + tick) % WRAP}", f"{clock}", *words])
            lines += self.mishaps.sent(text.encode() + b"\n")
        return b"".join(lines)
