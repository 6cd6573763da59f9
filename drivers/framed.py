"""The driver of instruments that speak the framed serial protocol of `drivers.frames`."""

from __future__ import annotations

import struct
import time
from collections import deque
from collections.abc import Sequence
from types import TracebackType
from typing import Literal, cast
from zlib import crc32

import numpy as np

from drivers.block import Block, FloatArray, Input, Status
from drivers.errors import ConnectionLostError, InstrumentError, ProtocolError, SettingError
from drivers.frames import TEXT, Decoder, Frame, unwrap
from drivers.kinds import Settings, StreamKind
from drivers.port import PATIENCE, Port

PROTOCOL = "isorig-framed/1"
#: How often a command is repeated, and seconds that the instrument may need before it starts.
TRIES = 3
START_PATIENCE = 60.0
#: Seconds of silence after which the rest of a frame will not come.
HALF = 0.5


class FramedInstrument:
    """An instrument at the end of a serial line or of whatever pyserial can open (a path, `socket://127.0.0.1:port`).

    Parameters
    ----------
    port
        Path or URL.
    baud_rate
        Of a real serial line.

    Raises
    ------
    ConnectionLostError
        Where the port cannot be opened, or nothing answers there.
    """

    def __init__(self, port: str, *, baud_rate: int = 921600) -> None:
        self._port = Port(port, baud_rate=baud_rate)
        self._name = port
        self._decoder = Decoder()
        self._frames: deque[tuple[Frame, float]] = deque()
        self._texts: deque[str] = deque()
        self._tick = 0
        self._first = 0
        self._clock = 0
        self._heard = time.monotonic()
        protocol, *name = self._ask("STOP", "ID?")
        if protocol != PROTOCOL:
            raise ProtocolError(f"{port} speaks {protocol!r} and this program {PROTOCOL!r}; update the older of the two")
        self.identity = " ".join(name)
        self.inputs: Sequence[Input] = self._inputs()

    def __enter__(self) -> FramedInstrument:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    @property
    def damaged(self) -> int:
        """Frames that arrived damaged so far."""
        return self._decoder.damaged

    def prepare(self, *, sample_rate: float, channels: Sequence[int]) -> float:
        """Set the rate (Hz); the rate that the instrument really has. It scans all of its inputs."""
        if max(channels, default=0) >= len(self.inputs):
            raise SettingError(
                f"{self._name} has {len(self.inputs)} inputs; input {max(channels)} is not there, correct the plan"
            )
        return float(self._ask(f"RATE {sample_rate:.9g}")[0])

    def set_gain(self, gain: float) -> None:
        """Drive gain of the next run."""
        self._ask(f"GAIN {gain:.9g}")

    def set_configuration(self, name: str) -> bool:
        """Lock or unlock the rig; False where that is the operator's work."""
        return self._ask(f"CONF {name}")[0] != "manual"

    def load_drive(self, drive: FloatArray) -> bool:
        """Load the drive at gain 1 (m/s^2 of the head), one value per tick; False where the instrument plays none."""
        payload = np.asarray(drive, "<f4").tobytes()
        return self._ask(f"DRIVE {len(drive)}", data=payload + struct.pack("<I", crc32(payload)))[0] != "none"

    def start(self) -> None:
        """Begin to stream; the first sample has tick 0."""
        self._frames.clear()
        self._clock = 0
        self._first = self._tick = int(self._ask("START", patience=START_PATIENCE)[0])

    def read(self, timeout: float) -> Block | None:
        """The next block, or None where none came within `timeout` seconds."""
        end = time.monotonic() + timeout
        while not self._frames:
            self._receive()
            if not self._frames and time.monotonic() >= end:
                return None
        frame, host_time = self._frames.popleft()
        self._tick = unwrap(frame.tick, self._tick)
        self._clock = unwrap(frame.time_us, self._clock)
        return Block(
            first_tick=self._tick - self._first, samples=frame.samples, host_time=host_time, device_time=self._clock / 1e6,
            gain=frame.gain, status=Status(frame.status & 7),
        )  # fmt: skip

    def stop(self) -> int | None:
        """End the stream; the number of ticks that the instrument counted."""
        return int(self._ask("STOP")[0])

    def close(self) -> None:
        """Let go of the wire."""
        self._port.close()

    def _inputs(self) -> tuple[Input, ...]:
        count, kind, unit, per_count, full = self._ask("INPUTS?")[:5]
        if kind not in ("int16", "int32"):
            raise ProtocolError(
                f"{self._name} offers samples of {kind!r}; the protocol has int16 and int32, so update the instrument"
            )
        one = Input(
            unit=unit, per_count=float(per_count), full_scale=float(full), dtype=cast(Literal["int16", "int32"], kind)
        )  # fmt: skip
        return (one,) * int(count)

    def _ask(self, *commands: str, data: bytes = b"", patience: float = PATIENCE) -> list[str]:
        # The words of the last command's answer behind its first. Commands may come twice, so each is repeated until answered.
        words: list[str] = []
        for command in commands:
            word = command.split()[0].rstrip("?")
            for _ in range(TRIES):
                self._texts.clear()
                self._port.write(command.encode("ascii") + b"\n" + data)
                answer = self._answer(word, patience)
                if answer is not None:
                    break
            else:
                raise ConnectionLostError(
                    f"{self._name} does not answer {command.split()[0]}; check that the instrument is on and speaks isorig-framed"
                )
            words = answer.split()
            if words[0] == "ERR":
                raise InstrumentError(f"{self._name} refuses {command!r} ({' '.join(words[2:])}); correct the plan")
        return words[1:]

    def _answer(self, word: str, patience: float) -> str | None:
        accepted = {word, "COUNT"} if word == "STOP" else {word}
        end = time.monotonic() + patience
        while time.monotonic() < end:
            while self._texts:
                text = self._texts.popleft()
                head = text.split()[:2]
                if head and (head[0] in accepted or (head[0] == "ERR" and word in head[1:])):
                    return text
            self._receive()
        return None

    def _receive(self) -> None:
        data = self._port.read()
        now = time.monotonic()
        if data:
            self._heard = now
            self._sort(self._decoder.feed(data))
        elif now - self._heard > HALF:
            # Half a frame whose rest was lost holds up what came behind it.
            self._sort(self._decoder.give_up())

    def _sort(self, frames: list[Frame]) -> None:
        now = time.monotonic()
        for frame in frames:
            if frame.kind == TEXT:
                self._texts.append(frame.text)
            else:
                self._frames.append((frame, now))


class FramedSettings(Settings, frozen=True):
    """The baud rate of a real serial line."""

    baud_rate: int = 921600

    def __post_init__(self) -> None:
        if self.baud_rate < 1:
            raise ValueError(f"baud_rate is {self.baud_rate}; give the instrument's, e.g. 921600")


def _open(port: str, settings: FramedSettings) -> FramedInstrument:
    return FramedInstrument(port, baud_rate=settings.baud_rate)


KIND = StreamKind(name="framed", open=_open, settings=FramedSettings)
