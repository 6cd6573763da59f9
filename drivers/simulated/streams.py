"""Simulated streams without a protocol of ours: a DI-1100, and an MTi-600 behind a serial CAN adapter."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from drivers.block import Raw
from drivers.mti600 import ACCELERATION, CLIPPED, ERROR, GROUP_COUNTER, SAMPLE_TIME, STATUS_WORD, WRAP

#: Given a number of samples and a rate in Hz: int16 counts, shape (n, inputs).
Source = Callable[[int, float], Raw]


class _Paced:
    """How many samples are due at a speed."""

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self.sent = 0
        self._began = 0.0

    def begin(self) -> None:
        self.sent, self._began = 0, time.monotonic()

    def due(self, rate: float, most: int) -> int:
        whole = int((time.monotonic() - self._began) * self._speed * rate)
        return min(max(whole - self.sent, 0), most)


class SimulatedDataq:
    """Echoes commands and streams what a source plays.

    Parameters
    ----------
    source
        Plays the counts of all inputs.
    seconds
        Length of what is played again and again, signal seconds.
    speed
        Signal seconds per second.
    lose
        (after, count) in scans: so many are taken and not sent.
    """

    def __init__(self, source: Source, *, seconds: float = 60.0, speed: float = 1.0, lose: tuple[int, int] = (0, 0)) -> None:
        self._source, self._seconds, self._lose = source, seconds, lose
        self._pace = _Paced(speed)
        self._waiting = b""
        self._inputs, self._rate = 1, 1000.0
        self._signal: Raw = np.zeros((0, 1), np.int16)
        self.scanning = False
        self.heard: list[str] = []

    def step(self, data: bytes) -> bytes:
        """Bytes in, bytes out."""
        self._waiting += data
        answer = b""
        while b"\r" in self._waiting:
            line, _, self._waiting = self._waiting.partition(b"\r")
            answer += self._command(line.decode("ascii", "replace").strip())
        if self.scanning:
            count = self._pace.due(self._rate, 4096)
            first, self._pace.sent = self._pace.sent, self._pace.sent + count
            after, gone = self._lose
            ticks = np.arange(first, first + count)
            kept = ticks[(ticks < after) | (ticks >= after + gone)]
            answer += self._signal.take(kept, axis=0, mode="wrap")[:, : self._inputs].astype("<i2").tobytes()
        return answer

    def _command(self, command: str) -> bytes:
        self.heard.append(command)
        echo = b"" if self.scanning else command.encode() + b"\r"
        words = command.split()
        match words:
            case ["stop"]:
                self.scanning = False
            case ["start"]:
                self._signal = self._source(round(self._seconds * self._rate), self._rate)
                self.scanning = True
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


def lost_message() -> tuple[int, bytes]:
    """The frame that tells of a message that was dropped inside."""
    return ERROR, b"\x01"


def slcan(frame: tuple[int, bytes]) -> bytes:
    """A frame in the text that serial CAN adapters speak."""
    identifier, data = frame
    return f"t{identifier:03X}{len(data)}{data.hex().upper()}\r".encode()


class SimulatedSlcan:
    """A serial CAN adapter with an MTi-600 on its bus.

    Parameters
    ----------
    source
        Plays the counts of three axes.
    rate
        Hz.
    seconds
        Length of what is played again and again, signal seconds.
    speed
        Signal seconds per second.
    counter
        Of the first sample, to see it wrap.
    drop
        Probability per frame that it never comes.
    """

    def __init__(
        self, source: Source, *, rate: float = 100.0, seconds: float = 60.0, speed: float = 1.0, counter: int = 0,
        drop: float = 0.0, seed: int = 0,
    ) -> None:  # fmt: skip
        self._signal = source(round(seconds * rate), rate)
        self._rate, self._counter, self._drop = rate, counter, drop
        self._random = np.random.default_rng(seed)
        self._pace = _Paced(speed)
        self._waiting = b""
        self._opened = False
        self.heard: list[str] = []

    def step(self, data: bytes) -> bytes:
        """Bytes in, bytes out."""
        self._waiting += data
        answer = b""
        while b"\r" in self._waiting:
            line, _, self._waiting = self._waiting.partition(b"\r")
            command = line.decode("ascii", "replace")
            self.heard.append(command)
            # An adapter whose bus is open refuses to open it again.
            answer += b"\a" if command == "O" and self._opened else b"\r"
            if command == "O" and not self._opened:
                self._opened = True
                self._pace.begin()
            elif command == "C":
                self._opened = False
        if self._opened:
            count = self._pace.due(self._rate, 256)
            first, self._pace.sent = self._pace.sent, self._pace.sent + count
            part = self._signal.take(np.arange(first, first + count), axis=0, mode="wrap")
            for group in groups(part, rate=self._rate, first=first, counter=self._counter):
                answer += b"".join(slcan(frame) for frame in group if self._random.random() >= self._drop)
        return answer
