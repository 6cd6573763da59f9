"""SRS SR785 dynamic signal analyzer over RS-232 or GPIB: reads finished records of its two displays.

The contents of a display (spectrum, transfer function, time record) and all other settings are made on the panel. This driver
sets the level of the source, starts a measurement, waits for its average, reads the displays and reports overloads. Commands end
in LF, 9600 baud, 8N1. There is no checksum, so data are read twice and must be identical. No command is known that requests
service at the end of an average, so the driver polls.
"""

from typing import ClassVar

import numpy as np

from isorig.drivers.analyzer import Analyzer, displayed, example
from isorig.drivers.answers import number, parse, text, whole
from isorig.drivers.block import FloatArray, InstrumentRecord, Status
from isorig.drivers.errors import InstrumentError, ProtocolError, SettingError
from isorig.drivers.kinds import RecordsKind
from isorig.drivers.simulated.analyzers import SimulatedSr785

#: Bits of the standard event register: syntax error, execution error, output overflow.
EVENTS = {5: "a command is unknown", 4: "a command could not be executed", 2: "its output overflowed"}
#: The command for the source's amplitude by type: sine, chirp, noise. Unit: mV peak.
LEVELS = ("S1AM", "CAMP", "NAMP")
UNITS = {"": 1e-3, "mVpk": 1e-3, "Vpk": 1.0}
#: Allowed deviation of x values from equal steps, as a share of the x range.
EVEN = 1e-3


class Sr785Instrument(Analyzer):
    """An SR785 or SR780, with the contents of its displays 0 and 1 as set on the panel."""

    ANSWERS: ClassVar = {
        "*ESR": whole(0, 255), "INPS": whole(0, 65535), "DSPS": whole(0, 1), "NAVG": whole(0, 32767), "DSPN": whole(2, 1 << 14),
        "DBIN": number(), "DSPY": number(), "STYP": whole(0, 3), "SRCO": whole(0, 1), "level": text(40),
    }  # fmt: skip
    SOURCE_OFF = "SRCO 0"
    identity = "SRS SR785"

    def status(self) -> Status:
        """Whether an input is overloaded now."""
        return Status.OVERLOAD if self._ask("INPS?") else Status.GOOD

    def measure(self, timeout: float) -> None:
        """Start a measurement and wait until display 1 reports that its average is done."""
        self._send("STRT")
        self._wait_until(lambda: self._ask("DSPS?1") == 1, timeout)
        self._averages = int(self._twice("NAVG?0", self._ask))
        self._status = self.status()
        self._check()

    def records(self) -> tuple[InstrumentRecord, ...]:
        """The contents of its displays."""
        return tuple(self._record(int(display)) for display in self._traces)

    def _set_up(self) -> None:
        # Answers go to the interface that this names: 0 is GPIB, 1 RS-232.
        self._send("OUTX0" if self._link.bus else "OUTX1")

    def _play(self, level: float) -> tuple[float, bool]:
        kind = self._ask("STYP?")
        if kind >= len(LEVELS):
            raise SettingError(f"the source of {self._link.name} plays its memory; select sine, chirp or noise on its panel")
        self._sourcing = True
        self._send(f"{LEVELS[kind]} {1e3 * level:.6g} mVpk")
        self._send("SRCO 1")
        self._check()
        answer, _, unit = self._ask(f"{LEVELS[kind]}?", "level").partition(",")
        (value,) = parse((answer,), (number(),), who=self._link.name, command=LEVELS[kind])
        return value * UNITS.get(unit, np.nan), bool(self._ask("SRCO?"))

    def _record(self, display: int) -> InstrumentRecord:
        points = int(self._twice(f"DSPN?{display}", self._ask))
        first, middle, last = (self._ask(f"DBIN?{display},{j}") for j in (0, points // 2, points - 1))
        x = np.linspace(first, last, points)
        if not first < last or abs(x[points // 2] - middle) > EVEN * (last - first):
            raise ProtocolError(
                f"{self._link.name} reports x values {first:g}, {middle:g} and {last:g} for display {display}, not equal steps; "
                "measure again"
            )
        return InstrumentRecord(x=x, values=self._floats(display, points), averages=self._averages, status=self._status)

    def _floats(self, display: int, points: int) -> FloatArray:
        data = self._twice(f"DSPB?{display}", lambda command: self._dump(command, points))
        # The byte order is not documented: one point read as text decides.
        little, big = np.frombuffer(data, "<f4"), np.frombuffer(data, ">f4")
        place = points // 2
        answer = self._ask(f"DSPY?{display},{place}")
        for values in (little, big):
            if np.isfinite(values).all() and np.isclose(values[place], answer, rtol=1e-4, atol=1e-30):
                return values.astype(np.float64)
        raise ProtocolError(
            f"{self._link.name} sent {little[place]:g} and {answer:g} for one point of display {display}; measure again"
        )

    def _dump(self, command: str, points: int) -> bytes:
        self._send(command)
        return self._link.exactly(4 * points)

    def _check(self) -> None:
        events = self._ask("*ESR?")
        for bit, what in EVENTS.items():
            if events >> bit & 1:
                raise InstrumentError(f"{self._link.name} reports that {what}; check that the plan names the right instrument")


KIND = RecordsKind(
    name="sr785",
    open=Sr785Instrument,
    trace=(r"[01]", "a display, 0 or 1"),
    example=example("0", "1"),
    far_end=lambda rig, asked: SimulatedSr785(displayed(rig, 0, 1), asked),
    recognized="SR78[05]",
)
