"""Driver for instruments with the framed serial protocol of `isorig.drivers.frames`."""

import struct
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal, cast
from zlib import crc32

import numpy as np

from isorig.drivers.answers import WordKind, number, one_of, parse, text, whole
from isorig.drivers.block import Block, Input, Status
from isorig.drivers.errors import ConnectionLostError, InstrumentError, ProtocolError, SettingError
from isorig.drivers.frames import TEXT, Decoder, Frame
from isorig.drivers.instrument import Values, in_real_time
from isorig.drivers.kinds import CHANNELS, Settings, StreamKind
from isorig.drivers.order import BlockHeader, Order
from isorig.drivers.port import Port
from isorig.drivers.simulated.framed import SimulatedFramed
from isorig.drivers.waits import WAITS, Waits

PROTOCOL = "isorig-framed/1"
#: Number of attempts for a command.
TRIES = 3
#: Seconds of silence after which the rest of a frame is no longer expected.
HALF = 0.5
#: Relative difference allowed between requested and answered gain, because of the instrument's gain steps.
GAIN_STEP = 1e-3
#: Maximum number of unread answers: far more than commands.
TEXTS = 64
#: Values of a drive sent at a time.
PART = 65536
#: The words of each answer after the first. GAIN, CONF and DRIVE repeat the request, or state that it is not possible.
ANSWERS: Mapping[str, tuple[WordKind, ...]] = {
    "INPUTS": (whole(1, 255), one_of("int16", "int32"), text(16), number(1e-30, 1e30), number(1e-30, 1e30)),
    "RATE": (number(1e-3, 1e9),),
    "GAIN": (number(-1e9, 1e9),),
    "START": (whole(0, 2**32 - 1),),
    "COUNT": (whole(0, 2**62),),
}
#: Maximum length of an instrument's name.
NAME = 200


class FramedSettings(Settings, frozen=True):
    """The baud rate of a real serial line."""

    baud_rate: int = 921600

    def __post_init__(self) -> None:
        if self.baud_rate < 1:
            raise ValueError(f"baud_rate is {self.baud_rate}; give that of the instrument, e.g. 921600")


class FramedInstrument:
    """An instrument on a serial line or any other port that pyserial can open (a path, `socket://127.0.0.1:port`). Raises
    ConnectionLostError if the port cannot be opened, or there is no answer; ProtocolError if the answer is from another protocol.
    """

    def __init__(self, port: str, settings: FramedSettings, waits: Waits = WAITS) -> None:
        self._port, self._waits = Port(port, baud_rate=settings.baud_rate, waits=waits), waits
        self._name = port
        self._decoder = Decoder()
        self._frames: deque[tuple[Frame, float]] = deque()
        self._texts: deque[str] = deque(maxlen=TEXTS)
        self._rate: float | None = None
        self._order = Order(who=port, began=time.monotonic())
        self._heard = time.monotonic()
        self._warnings: list[str] = []
        # Total count of the instrument; None before it stopped, or if the count is impossible.
        self._counted: int | None = None
        try:
            self._ask("STOP")
            words = self._exchange("ID?")
            (protocol,) = parse(words[:1], (text(40),), who=port, command="ID")
            if protocol != PROTOCOL:
                raise ProtocolError(
                    f"{port} uses the protocol {protocol!r} and this program {PROTOCOL!r}; update the older of the two"
                )
            (self.identity,) = parse((" ".join(words[1:]),), (text(NAME),), who=port, command="ID")
            self.inputs: Sequence[Input] = self._inputs()
        except BaseException:
            self._port.close()
            raise

    @property
    def damaged(self) -> int:
        """Number of damaged frames so far."""
        return self._decoder.damaged

    @property
    def noticed(self) -> Sequence[str]:
        return (*self._order.noticed, *self._warnings)

    def prepare(self, *, sample_rate: float, channels: Sequence[int]) -> float:
        """Set the rate (Hz); returns the actual rate. The instrument scans all of its inputs."""
        if max(channels, default=0) >= len(self.inputs):
            raise SettingError(f"{self._name} has {len(self.inputs)} inputs; there is no input {max(channels)}, correct the plan")
        (rate,) = self._ask(f"RATE {sample_rate:.9g}")
        self._rate = float(rate)
        return self._rate

    def set_gain(self, gain: float) -> None:
        """Set the drive gain of the next run. Raises SettingError if the instrument answers with another gain."""
        (reply,) = self._ask(f"GAIN {gain:.9g}")
        if abs(reply - gain) > GAIN_STEP * abs(gain):
            raise SettingError(
                f"{self._name} was set to gain {gain:g} and answers {reply:g}; give a gain that it has in the plan"
            )

    def set_configuration(self, name: str) -> bool:
        words = self._exchange(f"CONF {name}")
        (answer,) = parse((" ".join(words),), (one_of(name, "manual"),), who=self._name, command="CONF")
        return bool(answer != "manual")

    def load_drive(self, drive: Values) -> bool:
        """Load the drive at gain 1 (m/s^2 of the head), one value per tick; False if the instrument has no drive output."""
        words = self._exchange(f"DRIVE {len(drive)}", drive=drive)
        (answer,) = parse(words, (one_of(str(len(drive)), "none"),), who=self._name, command="DRIVE")
        return bool(answer != "none")

    def start(self) -> None:
        self._warnings, self._counted = [], None
        began = time.monotonic()
        (first,) = self._ask("START", patience=self._waits.start, tries=1)
        self._order = Order(who=self._name, began=began, first=first, rate=self._rate, real_time=in_real_time(self))

    def read(self, timeout: float) -> Block | None:
        end = time.monotonic() + timeout
        while True:
            if not self._frames:
                self._receive()
            block = self._block(*self._frames.popleft()) if self._frames else None
            if block is not None or time.monotonic() >= end:
                return block

    def stop(self) -> int | None:
        """Stop the stream; returns the number of ticks that the instrument counted, None if that number is impossible."""
        (counted,) = self._ask("STOP")
        self._counted = self._possible(counted)
        return self._counted

    def count(self) -> int | None:
        """Ticks counted by the instrument so far, None if that number is impossible."""
        (counted,) = self._ask("COUNT?", tries=1)
        return self._possible(counted)

    def rejoin(self) -> None:
        """Reopen the port after a lost connection and continue the current run."""
        self._port.reopen()
        self._decoder.forget()
        (counted,) = self._ask("COUNT?", tries=1)
        if counted < self._order.end:
            raise InstrumentError(
                f"{self._name} was restarted during the run: it counts {counted} samples but had sent {self._order.end}; repeat "
                "the run with --resume"
            )

    def close(self) -> None:
        self._port.close()

    def _inputs(self) -> tuple[Input, ...]:
        count, kind, unit, per_count, full = self._ask("INPUTS?")
        one = Input(unit=unit, per_count=per_count, full_scale=full, dtype=cast(Literal["int16", "int32"], kind))
        return (one,) * int(count)

    def _block(self, frame: Frame, host_time: float) -> Block | None:
        if frame.columns != len(self.inputs) or frame.dtype.name != self.inputs[0].dtype:
            raise InstrumentError(
                f"{self._name} announced {len(self.inputs)} inputs of {self.inputs[0].dtype} but sends {frame.columns} of "
                f"{frame.dtype.name}; switch it off and on, then resume"
            )
        reading = BlockHeader(
            counter=frame.tick, rows=frame.rows, host=host_time, clock=frame.time_us, sequence=frame.sequence,
            mark=crc32(frame.payload),
        )  # fmt: skip
        place = self._order.place(reading)
        if self._counted is not None and self._order.end > self._counted:
            # Frames in transit at the stop count too.
            self._doubt(self._counted)
            self._counted = None
        if place is None or frame.rows == 0:
            return None
        return Block(
            first_tick=place.tick, samples=frame.samples, host_time=host_time, device_time=place.seconds, gain=frame.gain,
            status=Status(frame.status & 7) | place.status,
        )  # fmt: skip

    def _possible(self, counted: int) -> int | None:
        if self._order.possible(counted, time.monotonic()):
            return counted
        self._doubt(counted)
        return None

    def _doubt(self, counted: int) -> None:
        self._warnings.append(
            f"it reports {counted} samples after {self._order.end} had arrived, which is impossible; the number of samples lost "
            "at the end is unknown"
        )

    def _ask(self, command: str, *, patience: float | None = None, tries: int = TRIES) -> tuple[Any, ...]:
        # The parsed values of the answer.
        word = _word(command)
        return parse(self._exchange(command, patience=patience, tries=tries), ANSWERS[word], who=self._name, command=word)

    def _exchange(
        self, command: str, *, drive: Values | None = None, patience: float | None = None, tries: int = TRIES
    ) -> list[str]:
        # The words of a command's answer after the first. Commands may be received twice, so each is repeated until answered.
        if not (command.isascii() and command.isprintable()):
            raise SettingError(f"{command!r} cannot be sent to {self._name}; use ASCII in the plan's names")
        for _ in range(tries):
            self._texts.clear()
            self._port.write(command.encode("ascii") + b"\n")
            for part in _payload(drive) if drive is not None else ():
                self._port.write(part)
            answer = self._answer(command, patience)
            if answer is not None:
                break
        else:
            raise ConnectionLostError(
                f"{self._name} does not answer {_asked(command)}; check that the instrument is on and speaks isorig-framed"
            )
        words = answer.split()
        if words[0] == "ERR":
            why = "".join(letter for letter in " ".join(words[2:]) if letter.isprintable())[:NAME]
            raise InstrumentError(f"{self._name} refuses {command!r} ({why}); correct the plan")
        return words[1:]

    def _answer(self, command: str, patience: float | None) -> str | None:
        asked, word = _asked(command), _word(command)
        end = time.monotonic() + (self._waits.answer if patience is None else patience)
        while True:
            while self._texts:
                answer = self._texts.popleft()
                head = answer.split()[:2]
                if head and (head[0] == word or (head[0] == "ERR" and head[1:] in ([asked], [word]))):
                    return answer
            if time.monotonic() >= end:
                return None
            self._receive()

    def _receive(self) -> None:
        data = self._port.read()
        now = time.monotonic()
        if data:
            self._heard = now
            self._sort(self._decoder.feed(data))
        elif now - self._heard > HALF:
            # An incomplete frame blocks the data after it.
            self._sort(self._decoder.give_up())

    def _sort(self, frames: list[Frame]) -> None:
        now = time.monotonic()
        for frame in frames:
            if frame.kind == TEXT:
                self._texts.append(frame.text)
                if frame.text.startswith("START"):
                    # The frames before it are of an earlier run.
                    self._frames.clear()
            else:
                self._frames.append((frame, now))


def _asked(command: str) -> str:
    return command.split(maxsplit=1)[0].rstrip("?")


def _word(command: str) -> str:
    # The first word of the answer.
    return "COUNT" if _asked(command) == "STOP" else _asked(command)


def _payload(drive: Values) -> Iterator[bytes]:
    check = 0
    for at in range(0, len(drive), PART):
        part = np.asarray(drive[at : at + PART], "<f4").tobytes()
        check = crc32(part, check)
        yield part
    yield struct.pack("<I", check)


EXAMPLE = """
sample_rate = 1000.0
"""
KIND = StreamKind(
    name="framed", open=FramedInstrument, example=EXAMPLE + CHANNELS, settings=FramedSettings, far_end=SimulatedFramed, plays=True
)
