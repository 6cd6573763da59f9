"""DATAQ DI-1100 family: a stream over a serial port, without header, counter or checksum.

Commands end in CR and are echoed while the instrument is not scanning. The stream is int16, little-endian, inputs in turn; the
two lowest bits of the first input are the digital inputs, and a 12-bit converter leaves the next bits at zero. These bits show
where bytes were lost (`alignment`). Whole scans are not numbered, so their loss is detected with the host's clock
(`isorig.drivers.arrivals`), or with a counter wired to the digital inputs (`isorig.drivers.marks`).
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Sequence

from isorig.drivers.alignment import DIGITAL, Alignment, Stretch
from isorig.drivers.arrivals import Arrivals
from isorig.drivers.block import Block, Input, Status
from isorig.drivers.errors import ProtocolError, SettingError
from isorig.drivers.kinds import CHANNELS, Settings, StreamKind
from isorig.drivers.marks import CounterMarks
from isorig.drivers.port import Port
from isorig.drivers.simulated.streams import SimulatedDataq, words
from isorig.drivers.waits import WAITS, Waits

CLOCK = 60e6
END = b"\r"
DIVIDER = 65535
#: Largest number of inputs in the family.
MOST = 16
#: Converter resolutions in the family, bits.
BITS = (12, 14, 16)
#: Maximum number of lines before the echo of a command.
STALE = 50


class DataqInstrument:
    """A DI-1100 at a serial port, by its path or URL."""

    def __init__(self, port: str, settings: DataqSettings, waits: Waits = WAITS) -> None:
        self._port = Port(port, baud_rate=115200, waits=waits)
        self._settings = settings
        self.identity = "DATAQ DI-1100"
        self.inputs: Sequence[Input] = ()
        self._rate = math.nan
        self._asked: list[str] = []
        self._scanning = False
        self._ready: deque[Block] = deque()
        self._tick = 0
        try:
            self._quiet()
        except BaseException:
            self._port.close()
            raise

    @property
    def held(self) -> int:
        return self._alignment.held + self._arrivals.held if self._scanning else 0

    def prepare(self, *, sample_rate: float, channels: Sequence[int]) -> float:
        """Set the nearest rate 60 MHz / n and scan the inputs from 0 to the last requested one; returns the actual rate."""
        divider = round(CLOCK / sample_rate)
        if not 1 <= divider <= DIVIDER:
            raise SettingError(
                f"{sample_rate:g} Hz is not a rate of this instrument; give {CLOCK / DIVIDER:.0f} Hz or more in the plan"
            )
        count = max(channels) + 1
        if count > MOST:
            raise SettingError(
                f"this instrument has no input {count - 1}; it has inputs 0 to {MOST - 1} at most, correct the plan"
            )
        self._asked = [f"slist {place} {place}" for place in range(count)]
        self._asked += [f"srate {divider}", "dec 1", "deca 1", "ps 0"]
        self._configure()
        full = self._settings.full_scale
        self.inputs = (Input(unit="V", per_count=full / 32768.0, full_scale=full, dtype="int16"),) * count
        self._rate = CLOCK / divider
        return self._rate

    def start(self) -> None:
        self._ready.clear()
        self._tick = 0
        self._began = time.monotonic()
        self._begin()

    def read(self, timeout: float) -> Block | None:
        """The confirmed scans, two seconds late, or None."""
        end = time.monotonic() + timeout
        while not self._ready and self._scanning:
            data = self._port.read()
            now = time.monotonic()
            for stretch in self._alignment.feed(data, now):
                self._arrived(stretch)
            if now >= end:
                break
        return self._ready.popleft() if self._ready else None

    def stop(self) -> int | None:
        """Stop the stream; this instrument does not count its samples."""
        self._port.write(b"stop" + END)
        self._port.clear()
        self._end()
        return None

    def rejoin(self) -> None:
        """Reopen the port after a lost connection and restart the scan; the host's clock shows how many scans were lost."""
        self._port.reopen()
        self._quiet()
        self._configure()
        self._end()
        self._begin()
        # The instrument does not play the drive, so it may be restarted; both times are taken when the command is sent.
        self._owed = max(round((time.monotonic() - self._began) * self._rate) - self._tick, 0)

    def close(self) -> None:
        self._port.close()

    def _begin(self) -> None:
        inputs = len(self.inputs)
        self._alignment = Alignment(inputs, self._settings.bits, self._port.name, counted=self._settings.counter is not None)
        self._marks = None if self._settings.counter is None else CounterMarks(self._rate, self._settings.counter)
        least = 0.0 if self._marks is None else self._marks.reach / self._rate
        self._arrivals: Arrivals[Stretch] = Arrivals(self._rate, self._place, least=least)
        self._owed = 0
        self._port.write(b"start" + END)
        self._scanning = True

    def _end(self) -> None:
        if not self._scanning:
            return
        self._scanning = False
        for stretch in self._alignment.finish():
            self._arrived(stretch)
        self._arrivals.finish()

    def _arrived(self, stretch: Stretch) -> None:
        self._arrivals.add(stretch, stretch.lost + len(stretch.scans), stretch.arrived)

    def _place(self, stretch: Stretch, missing: int) -> None:
        if missing and self._marks is not None:
            # The counter resolves to the scan what the host's clock leaves uncertain.
            missing = max(missing - round(self._arrivals.unseen * self._rate), 0)
        status = stretch.status | (Status.CLOCKED if missing or self._owed else Status.GOOD)
        if self._marks is not None:
            status |= Status.NUMBERED
        lost, self._owed = stretch.lost + missing + self._owed, 0
        parts = [(stretch.scans, lost)] if self._marks is None else self._marks.split(stretch.scans, lost)
        for scans, before in parts:
            samples = scans.copy()
            samples[:, 0] &= ~DIGITAL
            first = self._tick + before
            self._tick = first + len(samples)
            self._ready.append(Block(first_tick=first, samples=samples, host_time=stretch.arrived, status=status))
            status &= ~(Status.CLOCKED | Status.RESYNCED)

    def _quiet(self) -> None:
        self._port.write(b"stop" + END)
        self._port.clear()
        self._command("encode 0")

    def _configure(self) -> None:
        for command in self._asked:
            self._command(command)

    def _command(self, command: str) -> None:
        self._port.write(command.encode() + END)
        # Data that were still in transit when the scan was stopped arrive first.
        for _ in range(STALE):
            echo = self._port.line(END)
            if command.encode() in echo:
                return
        raise ProtocolError(f"{self._port.name} answered {command!r} with {echo[:40]!r}, not its echo; is it a DI-1100?")


class DataqSettings(Settings, frozen=True):
    """Range of the inputs in V, resolution of the converter in bits, counting rate of a counter at the digital inputs in Hz."""

    full_scale: float
    bits: int = 12
    counter: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.full_scale < math.inf:
            raise ValueError(f"full_scale is {self.full_scale:g}; give the inputs' range in V, e.g. 10.0")
        if self.bits not in BITS:
            raise ValueError(f"bits is {self.bits}; give the resolution of the converter, {', '.join(map(str, BITS))}")
        if self.counter is not None and not 0.0 < self.counter < math.inf:
            raise ValueError(f"counter is {self.counter:g}; give the counting rate of the counter at the digital inputs, Hz")


EXAMPLE = """
sample_rate = 2000.0
full_scale = 10.0
"""
KIND = StreamKind(
    name="di1100",
    open=DataqInstrument,
    example=EXAMPLE + CHANNELS,
    settings=DataqSettings,
    far_end=lambda rig, asked: SimulatedDataq(lambda samples, rate: words(rig.volts(samples, rate)), asked),
    recognized=r"\b0683:|DATAQ|DI-1100",
)
