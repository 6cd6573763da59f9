"""Simulated streams with vendor protocols: a DI-1100, and an MTi-600 on a serial CAN adapter."""

from collections.abc import Iterator

import numpy as np

from isorig.drivers.block import FloatArray, Raw
from isorig.drivers.mti600_messages import ACCELERATION, CLIPPED, GROUP_COUNTER, PER_COUNT, SAMPLE_TIME, STATUS_WORD, WRAP
from isorig.drivers.simulated.commanded import Simulation, Source, Streaming

#: The bits of a word used by a 12-bit converter, and the digital inputs.
LEFT, DIGITAL = ~15, 3
#: Full scale of a DI-1100's inputs, V; rates of a simulated MTi-600 and of simulated lines, Hz.
RANGE, MTI_RATE, LINES_RATE = 10.0, 400.0, 100.0


def words(volts: FloatArray) -> Raw:
    """16-bit counts of all inputs at +-10 V, shape (samples, inputs)."""
    return np.clip(np.round(volts / RANGE * 32768), -32768, 32767).astype(np.int16)


def axes(acceleration: FloatArray) -> Raw:
    """Counts of an accelerometer with its y axis along an acceleration in m/s^2, z upwards, shape (samples, 3)."""
    flat = np.zeros_like(acceleration)
    return np.round(np.stack([flat, acceleration, flat + 9.81], axis=1) / PER_COUNT).astype(np.int16)


class SimulatedDataq(Streaming):
    """A DI-1100: echoes commands and streams the signal of a source, int16 counts of all inputs.

    The fault `drop` is the probability per second of signal that half of its scans are acquired and not sent.
    """

    END, NAME = b"\r", "a DI-1100"
    FAULTS = frozenset({"drop", "stall", "unplug_after", "ppm"})

    def __init__(self, source: Source, asked: Simulation) -> None:
        super().__init__(1000.0, asked)
        self._source = source
        self.dropped, self._losing = 0, False
        self._inputs = 1
        self._signal: Raw = np.zeros((0, 1), np.int16)

    def samples(self) -> bytes:
        """The scans that are due, up to the end of a half second of signal, which is sent or dropped as a whole."""
        half = int(self._rate / 2.0)
        ticks = self.due(min(4096, half - self.sent % half))
        if len(ticks) and ticks.start % half == 0:
            self._losing = ticks.start % (2 * half) != 0 and self.random_faults.occurs("drop")
        if self._losing:
            self.dropped += len(ticks)
            return b""
        words = self._signal.take(ticks, axis=0, mode="wrap")[:, : self._inputs].astype("<i2") & LEFT
        # The digital inputs are open and pulled up.
        words[:, 0] |= DIGITAL
        if len(ticks):
            self.random_faults.stalls()
        return words.tobytes()

    def answer(self, command: str) -> bytes:
        """The echo of a command, as long as it is not scanning."""
        echo = b"" if self.running else command.encode() + self.END
        match command.split():
            case ["stop"]:
                self.running = False
            case ["start"]:
                self._signal = self.repeated(self._source)
                self.dropped, self._losing = 0, False
                self.begin()
                return b""
            case ["slist", place, _]:
                self._inputs = int(place) + 1
            case ["srate", divider]:
                self._rate = 60e6 / int(divider)
        return echo


def groups(samples: Raw, *, rate: float, first: int = 0, counter: int = 0) -> Iterator[list[tuple[int, bytes]]]:
    """The frames of each sample: counter, time, acceleration (counts, shape (n, 3)) and status."""
    for k, row in enumerate(samples):
        tick = first + k
        flags = CLIPPED & 0x100 if (np.abs(row.astype(int)) >= 32767).any() else 0
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


class SimulatedSlcan(Streaming):
    """A serial CAN adapter with an MTi-600 on its bus; faults are those of its frames, and the source returns counts of three
    axes."""

    END, NAME = b"\r", "an MTi-600"

    def __init__(self, source: Source, asked: Simulation) -> None:
        super().__init__(MTI_RATE, asked)
        self._signal = self.repeated(source)

    def answer(self, command: str) -> bytes:
        """An adapter with an open bus refuses to open it again."""
        refused = command == "O" and self.running
        if command == "O" and not self.running:
            self.begin()
        self.running = self.running and command != "C"
        return b"\a" if refused else b"\r"

    def samples(self) -> bytes:
        """The groups that are due."""
        ticks = self.due(256)
        part = self._signal.take(ticks, axis=0, mode="wrap")
        rate = self._rate * (1.0 + 1e-6 * self._faults.ppm)
        frames: list[bytes] = []
        for group in groups(part, rate=rate, first=ticks.start, counter=self._faults.first_tick):
            for identifier, data in group:
                flags = (0x100).to_bytes(4, "big")
                clipped = identifier == STATUS_WORD and self.random_faults.occurs("overload")
                frames += self.random_faults.sent(slcan((identifier, flags if clipped else data)))
        return b"".join(frames)


class SimulatedLines(Streaming):
    """A microcontroller that sends lines "count,milliseconds,volts..." between `go` and `halt`, with a counter of 16 bits.

    Faults are those of its lines.
    """

    NAME = "an instrument of lines"

    def __init__(self, source: Source, asked: Simulation) -> None:
        super().__init__(LINES_RATE, asked)
        self._signal = self.repeated(source)

    def answer(self, command: str) -> bytes:
        """It answers no command."""
        if command == "go":
            self.begin()
        self.running = self.running and command != "halt"
        return b""

    def samples(self) -> bytes:
        """The lines that are due."""
        lines: list[bytes] = []
        for tick in self.due(256):
            values = self._signal[tick % len(self._signal)]
            words = ["OL" if self.random_faults.occurs("overload") else f"{value:.6f}" for value in values]
            clock = round(1e3 * tick / self._rate / (1.0 + 1e-6 * self._faults.ppm))
            text = ",".join([f"{(self._faults.first_tick + tick) % WRAP}", f"{clock}", *words])
            lines += self.random_faults.sent(text.encode() + b"\n")
        return b"".join(lines)
