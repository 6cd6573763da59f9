"""Any instrument that sends lines of numbers, described by the plan: a microcontroller, a force gauge, a scale, a SCPI meter.

The plan names the commands that arm, start and stop it, the command that asks for a line if it does not send lines unasked, and
the fields of a line. Text has no checksum: a damaged digit that leaves a number cannot be detected. Losses are counted by a field
that counts the samples, or by a field with the instrument's clock; without both, the host's clock shows them
(`isorig.drivers.arrivals`).
"""

import math
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from isorig.drivers.answers import WordKind, number, whole
from isorig.drivers.arrivals import Arrivals
from isorig.drivers.block import Block, Input, Status
from isorig.drivers.errors import ConnectionLostError, DriverError, ProtocolError, SettingError
from isorig.drivers.kinds import CHANNELS, Settings, StreamKind
from isorig.drivers.link import linked
from isorig.drivers.order import EXACT, LOOSE, BlockHeader, Order
from isorig.drivers.port import LONGEST, Port
from isorig.drivers.simulated.streams import SimulatedLines
from isorig.drivers.waits import WAITS, Waits

#: Fields of a line, commands of a list, characters of a command.
MOST_FIELDS, MOST_COMMANDS, LONGEST_COMMAND = 64, 32, 200
#: Smallest modulus of a count: a smaller one would wrap within a gap.
LEAST_WRAP = 256
#: Consecutive lines that are no scans, after which the instrument is another one.
HOPELESS = 20
#: Seconds of silence after a stop command, after which no line is in transit any more.
REST = 0.1
#: A clock that counts the samples must resolve this many steps in a sample.
STEPS = 4.0
#: Allowed difference between count and clock: the program that prints a line reads its clock late.
JITTER = (EXACT[0], LOOSE[1])
#: Microseconds of a clock's unit.
MICROSECONDS = {"s": 1e6, "ms": 1e3, "us": 1.0}


class Field(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A field of a line."""

    #: `value`: the next input, from 0; `count`: the number of the sample; `clock`: the instrument's clock; `skip`: not used.
    what: Literal["value", "count", "clock", "skip"] = "value"
    unit: str = ""  #: Unit of a value; s, ms or us for a clock.
    full_scale: float | None = None  #: Largest magnitude of a value, in its unit.
    wrap: int = 1 << 32  #: The count returns to 0 at this number.


class LinesSettings(Settings, frozen=True):
    """The instrument's commands and lines."""

    fields: tuple[Field, ...]  #: The fields of a line, in order.
    baud_rate: int = 115200  #: Of a real serial line.
    #: Commands before the first run, at the start and at the end of each run.
    arm: tuple[str, ...] = ()
    start: tuple[str, ...] = ()
    stop: tuple[str, ...] = ()
    read: str = ""  #: The command that asks for one line; empty if the instrument sends lines unasked.
    reply: str = ""  #: The beginning of its answer to each other command; empty if there is none.
    separator: str = ","  #: The character between two fields; blanks if empty.
    comment: str = "#"  #: Lines that begin with it are skipped.
    overload: tuple[str, ...] = ()  #: Words in place of a value that report an overload, e.g. OL or 9.9E37.

    def __post_init__(self) -> None:
        self._check_fields()
        if self.baud_rate < 1:
            raise ValueError(f"baud_rate is {self.baud_rate}; give that of the instrument, e.g. 115200")
        if len(self.separator) > 1 or len(self.comment) > 8:
            raise ValueError(f"separator is {self.separator!r} and comment {self.comment!r}; give one character, and 8 at most")
        for key in ("arm", "start", "stop"):
            if len(getattr(self, key)) > MOST_COMMANDS:
                raise ValueError(f"{key} has {len(getattr(self, key))} commands; give {MOST_COMMANDS} at most")
        for command in (*self.arm, *self.start, *self.stop, self.read, self.reply):
            if not (command.isascii() and (command.isprintable() or not command)) or len(command) > LONGEST_COMMAND:
                raise ValueError(
                    f"the command {command!r} cannot be sent; give up to {LONGEST_COMMAND} printable ASCII characters"
                )

    def _check_fields(self) -> None:
        kinds = [field.what for field in self.fields]
        if not 1 <= len(kinds) <= MOST_FIELDS or "value" not in kinds:
            raise ValueError(
                f"fields has {kinds.count('value')} values in {len(kinds)} fields; give 1 to {MOST_FIELDS} fields with a value"
            )
        for single in ("count", "clock"):
            if kinds.count(single) > 1:
                raise ValueError(f"fields has {kinds.count(single)} fields of {single}; give one at most")
        for place, field in enumerate(self.fields):
            if field.what == "clock" and field.unit not in MICROSECONDS:
                raise ValueError(f"fields[{place}].unit is {field.unit!r}; a clock counts in {', '.join(MICROSECONDS)}")
            if field.wrap < LEAST_WRAP:
                raise ValueError(f"fields[{place}].wrap is {field.wrap}; give {LEAST_WRAP} or more")
            if field.full_scale is not None and not 0.0 < field.full_scale < math.inf:
                raise ValueError(f"fields[{place}].full_scale is {field.full_scale:g}; give a finite value above zero")
        if self.overload and any(field.what == "value" and field.full_scale is None for field in self.fields):
            raise ValueError("overload needs the full_scale of every value, which is recorded in its place; give it")


@dataclass(frozen=True)
class _Line:
    """A received line: its values, count and clock as received (microseconds), arrival, and whether it reports an overload."""

    values: tuple[float, ...]
    count: int
    clock: int | None
    host: float
    overload: bool


class LinesInstrument:
    """An instrument that sends lines of numbers; without a command that asks for them, at a serial line or a socket. Raises
    SettingError if the port cannot send lines unasked."""

    def __init__(self, port: str, settings: LinesSettings, waits: Waits = WAITS) -> None:
        self._settings = settings
        self.identity = f"lines at {port}"
        self.inputs: Sequence[Input] = [
            Input(unit=field.unit or "V", per_count=1.0, full_scale=field.full_scale, dtype="float64")
            for field in settings.fields
            if field.what == "value"
        ]
        kinds = [field.what for field in settings.fields]
        self._counted, self._clocked = "count" in kinds, "clock" in kinds
        self._wrap = next((field.wrap for field in settings.fields if field.what == "count"), Order.WRAP)
        self._words: list[WordKind] = [whole(0, self._wrap - 1) if kind == "count" else number() for kind in kinds]
        self._rate = math.nan
        self._open = False
        self.damaged = 0
        self._link = linked(port, baud_rate=settings.baud_rate, waits=waits)
        self._reset()
        if not settings.read and not isinstance(self._link, Port):
            self._link.close()
            raise SettingError(f"{port} is asked for each answer; give the command that asks for a line as read in the plan")

    @property
    def noticed(self) -> Sequence[str]:
        return tuple(self._order.noticed)

    @property
    def held(self) -> int:
        """Lines received but held until later ones show whether any was lost."""
        return self._arrivals.held + (self._doubtful is not None)

    def prepare(self, *, sample_rate: float, channels: Sequence[int]) -> float:
        """Arm the instrument; its rate is part of its own configuration, and the pre-run check compares it with a clock."""
        if max(channels, default=0) >= len(self.inputs):
            raise SettingError(
                f"a line of {self._link.name} has {len(self.inputs)} values; there is no input {max(channels)}, correct the plan"
            )
        clock = next((field for field in self._settings.fields if field.what == "clock"), None)
        if clock is not None and clock.unit == "ms" and not self._counted and sample_rate > 1e3 / STEPS:
            raise SettingError(
                f"a clock in ms cannot show single lost samples at {sample_rate:g} Hz, only up to {1e3 / STEPS:g} Hz; let the "
                "instrument send a count, or its clock in us"
            )
        self._rate = sample_rate
        self._quiet()
        self._command(self._settings.arm)
        return sample_rate

    def start(self) -> None:
        self._quiet()
        self._command(self._settings.start)
        self._reset()
        # An instrument that is never stopped is in the middle of a line.
        self._partial = not self._settings.start and not self._settings.read
        self._open = True

    def read(self, timeout: float) -> Block | None:
        end = time.monotonic() + timeout
        while not self._ready and self._open:
            if not self._settings.read:
                self._receive()
            elif not self._ask(end):
                break
            if time.monotonic() >= end:
                break
        return self._ready.popleft() if self._ready else None

    def stop(self) -> int | None:
        """Stop the instrument, and read the lines in transit; it does not report its count."""
        was, self._open = self._open, False
        for command in self._settings.stop:
            self._link.send(command)
        if was and self._settings.stop and not self._settings.read:
            heard = time.monotonic()
            while time.monotonic() - heard < REST:
                heard = time.monotonic() if self._receive() else heard
        if was:
            self.damaged += self._doubtful is not None
            self._arrivals.finish()
        self._quiet()
        return None

    def rejoin(self) -> None:
        """Reopen a lost line; count, clock or the host's clock show how many lines were lost."""
        if not isinstance(self._link, Port):
            raise ConnectionLostError(f"{self._link.name} is lost; reconnect it and resume")
        self._link.reopen()
        self._rest, self._partial = b"", True

    def close(self) -> None:
        """Stop the instrument and close the port."""
        if self._open:
            self._open = False
            # The connection may be lost.
            with suppress(DriverError):
                for command in self._settings.stop:
                    self._link.send(command)
        self._link.close()

    def _reset(self) -> None:
        self._rest, self._partial = b"", False
        self._ready: deque[Block] = deque()
        self._doubtful: _Line | None = None
        self._expected: int | None = None
        self._clock = self._elapsed = 0
        self._tick = 0
        # Lines since the last one that was a scan.
        self._wrong = 0
        self._pending = Status.GOOD
        self._began = time.monotonic()
        self._arrivals: Arrivals[tuple[_Line, int, Status]] = Arrivals(self._rate, self._arrived)
        rate = None if math.isnan(self._rate) else self._rate
        self._order = Order(who=self._link.name, began=self._began, counter_wrap=self._wrap, rate=rate, loose=JITTER)

    def _quiet(self) -> None:
        # An instrument that sends lines all the time is never silent.
        if self._settings.start or self._settings.read:
            self._link.clear()

    def _command(self, commands: Sequence[str]) -> None:
        for command in commands:
            self._link.send(command)
            if self._settings.reply or command.endswith("?"):
                answer = self._link.line().strip().decode("ascii", "replace")
                if not answer.startswith(self._settings.reply):
                    raise ProtocolError(
                        f"{self._link.name} answered {command} with {answer[:60]!r}, not {self._settings.reply!r}; correct the "
                        "plan, or check that it is the right instrument"
                    )

    def _ask(self, end: float) -> bool:
        # One line at its time; a query that takes longer than a sample leaves a gap.
        late = time.monotonic() - self._began - self._tick / self._rate
        if late < 0.0:
            time.sleep(min(-late, max(end - time.monotonic(), 0.0)))
            if time.monotonic() - self._began < self._tick / self._rate:
                return False
        elif late > 1.0 / self._rate and not (self._counted or self._clocked):
            self._tick += int(late * self._rate)
            self._pending |= Status.CLOCKED
        self._link.expect_nothing()
        self._link.send(self._settings.read)
        self._accept(self._link.line(), time.monotonic())
        return True

    def _receive(self) -> bool:
        assert isinstance(self._link, Port)
        data = self._link.read()
        now = time.monotonic()
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST:
            self._rest, self._partial = b"", True
            self._bad()
        for line in lines:
            if self._partial:
                self._partial = False
            else:
                self._accept(line, now)
        return bool(data)

    def _accept(self, raw: bytes, now: float) -> None:
        text = raw.decode("ascii", "replace").strip()
        if not text or (self._settings.comment and text.startswith(self._settings.comment)):
            return
        line = self._parsed(text, now)
        if line is None:
            self._bad()
            return
        missing, self._wrong = self._wrong, 0
        if self._counted or self._clocked:
            self._counted_line(line)
        elif self._settings.read:
            self._put([line], self._tick, self._pending)
        else:
            self._arrivals.add((line, missing, self._pending), 1 + missing, now)
        self._pending = Status.GOOD

    def _arrived(self, item: tuple[_Line, int, Status], lost: int) -> None:
        line, missing, status = item
        self._put([line], self._tick + missing + lost, status | (Status.CLOCKED if lost else Status.GOOD))

    def _bad(self) -> None:
        # A line that is no scan is a lost sample.
        self.damaged += 1
        self._wrong += 1
        if self._wrong > HOPELESS:
            raise ProtocolError(
                f"{self._link.name} sends lines that are not the {len(self._words)} fields of the plan; correct fields and "
                "separator, or check the baud rate"
            )
        self._pending |= Status.RESYNCED
        if self._settings.read and not (self._counted or self._clocked):
            self._tick += 1

    def _parsed(self, text: str, now: float) -> _Line | None:
        words = [word.strip() for word in (text.split(self._settings.separator) if self._settings.separator else text.split())]
        if len(words) != len(self._words):
            return None
        values, count, clock, overload = [], 0, None, False
        for word, kind, field in zip(words, self._words, self._settings.fields, strict=True):
            if field.what == "skip":
                continue
            if field.what == "value" and word in self._settings.overload:
                overload = True
                values.append(float(field.full_scale or 0.0))
                continue
            value = kind.read(word)
            if value is None:
                return None
            if field.what == "value":
                values.append(value)
            elif field.what == "count":
                count = value
            else:
                clock = round(value * MICROSECONDS[field.unit]) % Order.WRAP
        return _Line(tuple(values), count, clock, now, overload)

    def _counted_line(self, line: _Line) -> None:
        # A count that does not follow is believed when the next line confirms it: one damaged digit is not a loss.
        count, doubtful = self._count_of(line), self._doubtful
        self._doubtful = None
        follows = self._expected is None or count == self._expected
        if doubtful is not None and not follows and count == (self._count_of(doubtful) + 1) % self._wrap:
            self._place([doubtful, line])
            return
        self.damaged += doubtful is not None
        if follows or (doubtful is not None and self._expected is not None and count == (self._expected + 1) % self._wrap):
            self._place([line])
        else:
            self._doubtful = line

    def _count_of(self, line: _Line) -> int:
        if self._counted:
            return line.count
        assert line.clock is not None
        if self._expected is None:
            return 0
        moved = (line.clock - self._clock) % Order.WRAP
        return (self._expected - 1 + max(round(moved * 1e-6 * self._rate), 1)) % self._wrap

    def _place(self, lines: Sequence[_Line]) -> None:
        count = self._count_of(lines[0])
        clock = lines[0].clock if self._counted else None
        place = self._order.place(
            BlockHeader(
                counter=count, rows=len(lines), host=lines[-1].host, clock=clock, mark=hash((lines[0].clock, lines[0].values))
            )
        )
        self._expected = (count + len(lines)) % self._wrap
        self._clock = lines[-1].clock or 0
        if place is None:
            return
        seconds = place.seconds if self._counted else self._seconds(lines[0])
        self._put(lines, place.tick, place.status | self._pending, seconds)

    def _seconds(self, line: _Line) -> float:
        # Time of a clock that also counts, without its wraps.
        assert line.clock is not None
        self._elapsed = line.clock if self._tick == 0 else self._elapsed + (line.clock - self._elapsed) % Order.WRAP
        return self._elapsed * 1e-6

    def _put(self, lines: Sequence[_Line], tick: int, status: Status, seconds: float | None = None) -> None:
        samples = np.array([line.values for line in lines], np.float64)
        status |= Status.OVERLOAD if any(line.overload for line in lines) else Status.GOOD
        status |= Status.NUMBERED if self._counted else Status.GOOD
        last = self._ready[-1] if self._ready else None
        self._tick = tick + len(lines)
        plain = status in (Status.GOOD, Status.NUMBERED)
        if last is not None and plain and last.status == status and last.end_tick == tick:
            joined = np.concatenate([last.samples, samples])
            self._ready[-1] = Block(
                first_tick=last.first_tick, samples=joined, host_time=lines[-1].host, device_time=last.device_time, status=status
            )
            return
        self._ready.append(Block(first_tick=tick, samples=samples, host_time=lines[-1].host, device_time=seconds, status=status))


EXAMPLE = """
sample_rate = 100.0
start = ["go"]
stop = ["halt"]
overload = ["OL"]
fields = [
    {what = "count", wrap = 65536},
    {what = "clock", unit = "ms"},
    {unit = "V", full_scale = 10.0},
    {unit = "V", full_scale = 10.0},
    {unit = "V", full_scale = 10.0},
    {unit = "V", full_scale = 10.0},
]
"""
KIND = StreamKind(
    name="lines",
    open=LinesInstrument,
    example=EXAMPLE + CHANNELS,
    settings=LinesSettings,
    far_end=lambda rig, asked: SimulatedLines(rig.volts, asked),
    buses=("serial", "visa"),
)
