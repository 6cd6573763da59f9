"""An instrument with the framed protocol that returns a plant's response to the drive, with faults on request."""

import math
import time
from typing import Protocol
from zlib import crc32

import numpy as np

from isorig.drivers.block import FloatArray, Raw
from isorig.drivers.frames import encode_samples, encode_text
from isorig.drivers.simulated.commanded import TURN, Simulation, Streaming

#: Speed relative to real time without a drive and without a given speed.
ENDLESS = 10.0
#: Largest drive in samples.
LONGEST = 1 << 26


class Plant(Protocol):
    """The system connected to the instrument."""

    @property
    def identity(self) -> str:
        """Name of the plant."""

    @property
    def inputs(self) -> tuple[int, str, float, float]:
        """Number of inputs, their unit, unit per count, full scale in that unit."""

    def play(self, drive: FloatArray, *, sample_rate: float, gain: float, configuration: str) -> Raw:
        """Counts of all inputs for a drive given at gain 1, int32, shape (n, inputs)."""


class SimulatedFramed(Streaming):
    """Answers commands and streams frames of `rows` samples; `runs` were started so far.

    The signal is as long as the drive; with a drive of a single sample, it continues until it is stopped.
    """

    FAULTS, NAME = Streaming.FAULTS | {"turn_after"}, "a framed instrument"

    def __init__(self, plant: Plant, asked: Simulation, *, rows: int = 256) -> None:
        super().__init__(1024.0, asked)
        self._plant, self._rows = plant, rows
        self._commands, self._needed = bytearray(), 0
        self._gain, self._configuration = 1.0, "unlocked"
        self._drive: FloatArray = np.zeros(0)
        self._signal: Raw = np.zeros((0, plant.inputs[0]), np.int32)
        self._sequence = self.runs = 0

    def answers(self, data: bytes) -> bytes:
        """The answers to the commands that these bytes complete; a drive follows its command."""
        self._commands += data
        answers = b""
        while len(self._commands) >= self._needed and b"\n" in self._commands:
            line, _, rest = bytes(self._commands).partition(b"\n")
            words = line.decode("ascii", "replace").split()
            size = _drive_size(words)
            self._needed = len(line) + 1 + size if len(rest) < size else 0
            if self._needed:
                # The rest of the drive is in transit.
                break
            self._commands = bytearray(rest[size:])
            if words:
                answers += encode_text(self._answered(words, rest[:size]))
        return answers

    def samples(self) -> bytes:
        """The next frame if it is due, as it is sent."""
        frame = self._next_frame() if self._frame_due() else b""
        # The frame in which the connection is cut does not arrive.
        return b"".join(self.random_faults.sent(frame)) if frame and not self.unplugged else b""

    def _frame_due(self) -> bool:
        endless = len(self._drive) == 1
        if self.sent >= len(self._signal) and endless:
            self._play(np.zeros(2 * len(self._signal)))
        if self.sent >= len(self._signal):
            return False
        speed = ENDLESS if endless and math.isinf(self._speed) else self._speed
        return self.sent + self._rows <= (time.monotonic() - self._began) * speed * self._rate

    def _next_frame(self) -> bytes:
        faults = self._faults
        part = self._signal[self.sent : self.sent + self._rows]
        seconds = self.sent / self._rate
        turned = faults.turn_after is not None and seconds >= faults.turn_after
        frame = encode_samples(
            part, sequence=self._sequence, tick=faults.first_tick + self.sent,
            time_us=round(1e6 * seconds / (1.0 + 1e-6 * faults.ppm)), gain=self._gain * (1.0 + TURN * turned),
            status=int(self.random_faults.occurs("overload")),
        )  # fmt: skip
        self.sent += len(part)
        self._sequence += 1
        return frame

    def _answered(self, words: list[str], drive: bytes) -> str:
        word, given = words[0].rstrip("?"), " ".join(words[1:])
        try:
            match word:
                case "ID":
                    answer = f"isorig-framed/1 {self._plant.identity}"
                case "INPUTS":
                    count, unit, per_count, full = self._plant.inputs
                    answer = f"{count} int32 {unit} {per_count:.9g} {full:.9g}"
                case "RATE":
                    self._rate = float(words[1])
                    answer = f"{self._rate:.9g}"
                case "GAIN":
                    self._gain = float(words[1])
                    answer = f"{self._gain:.9g}"
                case "CONF":
                    answer = self._configuration = words[1]
                case "DRIVE" if not drive:
                    word, answer = "ERR", f"DRIVE {given} is not a length"
                case "DRIVE" if crc32(drive[:-4]) != int.from_bytes(drive[-4:], "little"):
                    word, answer = "ERR", "DRIVE the drive arrived damaged"
                case "DRIVE":
                    self._drive = np.frombuffer(drive[:-4], "<f4").astype(np.float64)
                    answer = f"{len(self._drive)}"
                case "START":
                    self._start()
                    answer = f"{self._faults.first_tick % 2**32}"
                case "STOP" | "COUNT":
                    self.running = self.running and word != "STOP"
                    word, answer = "COUNT", f"{self.sent}"
                case _:
                    word, answer = "ERR", f"{word} is not a command"
        except (IndexError, ValueError):
            word, answer = "ERR", f"{word} {given} is not a value for it"
        return f"{word} {answer}"

    def _start(self) -> None:
        if not self.running:
            self._play(self._drive if len(self._drive) != 1 else np.zeros(round(self._rate)))
            self.runs += 1
            self.begin()

    def _play(self, drive: FloatArray) -> None:
        self._signal = self._plant.play(drive, sample_rate=self._rate, gain=self._gain, configuration=self._configuration)


def _drive_size(words: list[str]) -> int:
    # Bytes of the drive and its checksum, which follow a valid command.
    valid = len(words) == 2 and words[0] == "DRIVE" and words[1].isdigit() and 0 < int(words[1]) <= LONGEST
    return 4 * int(words[1]) + 4 if valid else 0
