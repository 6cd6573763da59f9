"""An instrument with the framed protocol that returns a plant's response to the drive, with faults on request."""

from __future__ import annotations

import struct
import time
from collections import deque
from dataclasses import dataclass
from typing import Protocol
from zlib import crc32

import numpy as np

from isorig.drivers.block import FloatArray, Raw
from isorig.drivers.frames import encode_samples, encode_text
from isorig.drivers.simulated.faults import TURN, Faults, Mishaps
from isorig.drivers.simulated.wire import Wire

#: Speed relative to real time without a drive and without a given speed.
ENDLESS = 10.0


class Plant(Protocol):
    """The system connected to the instrument."""

    @property
    def identity(self) -> str:
        """Name of the plant."""
        ...

    @property
    def inputs(self) -> tuple[int, str, float, float]:
        """Number of inputs, their unit, unit per count, full scale in that unit."""
        ...

    def play(self, drive: FloatArray, *, sample_rate: float, gain: float, configuration: str) -> Raw:
        """Counts of all inputs for a drive given at gain 1, int32, shape (n, inputs)."""
        ...


@dataclass
class Count:
    """State of a run: its number since switch-on, ticks counted."""

    run: int = 0
    ticks: int = 0


class SimulatedFramed:
    """Answers commands and streams frames until its connection is closed.

    Parameters
    ----------
    wire
        The instrument's end of the connection.
    plant
        The simulated system.
    faults
        Injected faults.
    speed
        Speed relative to real time; as fast as the connection allows if None. The signal is as long as the drive; with a drive of
        a single sample, it continues until it is stopped.
    rows
        Samples per frame.
    """

    def __init__(
        self, wire: Wire, plant: Plant, *, faults: Faults | None = None, speed: float | None = None, rows: int = 256
    ) -> None:
        self._wire, self._plant, self._faults = wire, plant, faults or Faults()
        self._speed, self._rows = speed, rows
        self.mishaps = Mishaps(self._faults)
        self._commands = bytearray()
        self._needed = 0
        self._out: deque[bytes] = deque()
        self._rate, self._gain, self._configuration = 1024.0, 1.0, "unlocked"
        self._drive: FloatArray = np.zeros(0)
        self._signal: Raw = np.zeros((0, self._plant.inputs[0]), np.int32)
        self._sent = self._sequence = 0
        self._began = 0.0
        self.running = False
        self.count = Count()
        self.unplugged = False

    def serve(self, seconds: float = np.inf) -> None:
        """Serve until the connection is cut or the time has elapsed."""
        end = time.monotonic() + seconds
        while not self.unplugged and time.monotonic() < end:
            self.step()

    def step(self) -> None:
        """One iteration: read commands, create the next frame, send what the connection accepts."""
        busy = bool(self._out) or self._frame_due()
        self._commands += self._wire.read(0.0 if busy else 0.02)
        self._obey()
        if len(self._out) < 4 and self._frame_due():
            self._next_frame()
        if self._out:
            taken = self._wire.write(self._out[0], 0.02)
            rest = self._out.popleft()[taken:]
            if rest:
                self._out.appendleft(rest)

    def _frame_due(self) -> bool:
        if not self.running or self.mishaps.late:
            return False
        endless = len(self._drive) == 1
        if self._sent >= len(self._signal) and endless:
            self._play(np.zeros(2 * len(self._signal)))
        if self._sent >= len(self._signal):
            return False
        speed = ENDLESS if self._speed is None and endless else self._speed
        if speed is None:
            return True
        passed = (time.monotonic() - self._began) * speed * (1.0 + 1e-6 * self._faults.ppm)
        return self._sent + self._rows <= passed * self._rate

    def _next_frame(self) -> None:
        faults = self._faults
        part = self._signal[self._sent : self._sent + self._rows]
        seconds = self._sent / self._rate
        turned = faults.turn_after is not None and seconds >= faults.turn_after
        frame = encode_samples(
            part, sequence=self._sequence, tick=faults.first_tick + self._sent,
            time_us=round(1e6 * seconds / (1.0 + 1e-6 * faults.ppm)), gain=self._gain * (1.0 + TURN * turned),
            status=int(self.mishaps.occurs("overload")),
        )  # fmt: skip
        self._sent += len(part)
        self._sequence += 1
        self.count.ticks = self._sent
        if faults.unplug_after is not None and self._sent > faults.unplug_after * self._rate:
            self.unplugged = True
            self._wire.close()
            return
        self._out.extend(self.mishaps.sent(frame))

    def _obey(self) -> None:
        while len(self._commands) >= self._needed and b"\n" in self._commands:
            self._needed = 0
            line, _, rest = bytes(self._commands).partition(b"\n")
            words = line.decode("ascii", "replace").split()
            if words and words[0] == "DRIVE":
                size = self._drive_size(words)
                if size is not None and len(rest) < size:
                    # The rest of the drive is in transit.
                    self._needed = len(line) + 1 + size
                    return
                self._commands = bytearray(rest[size or 0 :])
                self._say(self._take_drive(rest[:size]) if size else f"ERR DRIVE {' '.join(words[1:])} is not a length")
                continue
            self._commands = bytearray(rest)
            if words:
                self._say(self._answer(words))

    @staticmethod
    def _drive_size(words: list[str]) -> int | None:
        if len(words) != 2 or not words[1].isdigit() or not 0 < int(words[1]) <= 1 << 26:
            return None
        return 4 * int(words[1]) + 4

    def _take_drive(self, data: bytes) -> str:
        (check,) = struct.unpack("<I", data[-4:])
        if check != crc32(data[:-4]):
            return "ERR DRIVE the drive arrived damaged"
        self._drive = np.frombuffer(data[:-4], "<f4").astype(np.float64)
        return f"DRIVE {len(self._drive)}"

    def _answer(self, words: list[str]) -> str:
        word = words[0].rstrip("?")
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
                case "START":
                    self._start()
                    answer = f"{self._faults.first_tick % 2**32}"
                case "STOP" | "COUNT":
                    self.running = self.running and word != "STOP"
                    word, answer = "COUNT", f"{self._sent}"
                case _:
                    word, answer = "ERR", f"{word} is not a command"
        except (IndexError, ValueError):
            word, answer = "ERR", f"{word} {' '.join(words[1:])} is not a value for it"
        return f"{word} {answer}"

    def _start(self) -> None:
        if self.running:
            return
        self._play(self._drive if len(self._drive) != 1 else np.zeros(round(self._rate)))
        self._sent = 0
        self.count = Count(run=self.count.run + 1)
        self.running, self._began = True, time.monotonic()

    def _play(self, drive: FloatArray) -> None:
        self._signal = self._plant.play(drive, sample_rate=self._rate, gain=self._gain, configuration=self._configuration)

    def _say(self, text: str) -> None:
        # An answer is a frame: it waits for a frame that is partly sent, and precedes frames that are not started.
        self._out.insert(1 if self._out else 0, encode_text(text))
