"""SRS SR785 dynamic signal analyzer over RS-232 or GPIB: reads finished records of its two displays.

The contents of a display (spectrum, transfer function, time record) and all other settings are made on the panel. This driver
sets the level of the source, starts a measurement, waits for its average, reads the displays and reports overloads. Commands end
in LF, 9600 baud, 8N1. There is no checksum, so data are read twice and must be identical. No command is known that requests
service at the end of an average, so the driver polls.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from isorig.drivers.answers import WordKind, number, parse, text, whole
from isorig.drivers.block import FloatArray, InstrumentRecord, Status
from isorig.drivers.errors import DriverError, InstrumentError, ProtocolError, SettingError
from isorig.drivers.kinds import CHANNELS, DrivenRig, RecordsKind, Simulation
from isorig.drivers.link import linked
from isorig.drivers.shows import Shows
from isorig.drivers.waits import WAITS, Waits

if TYPE_CHECKING:
    from isorig.drivers.simulated.served import Peer

#: Bits of the standard event register: syntax error, execution error, output overflow.
EVENTS = {5: "a command is unknown", 4: "a command could not be executed", 2: "its output overflowed"}
#: Valid answers to each query.
ANSWERS: dict[str, WordKind] = {
    "*ESR": whole(0, 255), "INPS": whole(0, 65535), "DSPS": whole(0, 1), "NAVG": whole(0, 32767), "DSPN": whole(2, 1 << 14),
    "DBIN": number(), "DSPY": number(), "STYP": whole(0, 3), "SRCO": whole(0, 1), "level": text(40),
}  # fmt: skip
#: The command for the source's amplitude by type: sine, chirp, noise. Unit: mV peak.
LEVELS = ("S1AM", "CAMP", "NAMP")
UNITS = {"": 1e-3, "mVpk": 1e-3, "Vpk": 1.0}
#: Maximum level of the source, V, and allowed relative difference of the level read back.
LARGEST, STEP = 5.0, 0.01
#: Allowed deviation of x values from equal steps, as a share of the x range.
EVEN = 1e-3


class Sr785Instrument:
    """An SR785 or SR780.

    Parameters
    ----------
    port
        A name as in `isorig.drivers.link.linked`.
    shows
        Contents of its displays 0 and 1, as set on the panel.
    waits
        Its timeouts.
    """

    def __init__(self, port: str, shows: Sequence[Shows], waits: Waits = WAITS) -> None:
        self._link, self._waits = linked(port, baud_rate=9600, waits=waits), waits
        self._shows = tuple(shows)
        self._sourcing = False
        self.identity = "SRS SR785"
        try:
            self._link.clear()
            # Answers go to the interface that this names: 0 is GPIB, 1 RS-232.
            self._send("OUTX0" if self._link.bus else "OUTX1")
            self._events()
        except BaseException:
            self._link.close()
            raise

    def status(self) -> Status:
        """Whether an input is overloaded now."""
        return Status.OVERLOAD if self._ask("INPS?") else Status.GOOD

    def set_source(self, level: float) -> None:
        """Set the level of its source (V, peak), switch it on, and read both back."""
        if not 0.0 < level <= LARGEST:
            raise SettingError(f"the source of {self._link.name} cannot play {level:g} V; give up to {LARGEST:g} V")
        kind = self._ask("STYP?")
        if kind >= len(LEVELS):
            raise SettingError(f"the source of {self._link.name} plays its memory; select sine, chirp or noise on its panel")
        self._sourcing = True
        self._send(f"{LEVELS[kind]} {1e3 * level:.6g} mVpk")
        self._send("SRCO 1")
        self._events()
        answer, _, unit = self._ask(f"{LEVELS[kind]}?", "level").partition(",")
        (value,) = parse((answer,), (number(),), who=self._link.name, command=LEVELS[kind])
        if unit not in UNITS or abs(value * UNITS[unit] - level) > STEP * level or not self._ask("SRCO?"):
            raise SettingError(
                f"the source of {self._link.name} was set to {level:g} V and answers {answer} {unit}; set it on its panel"
            )

    def measure(self, timeout: float) -> None:
        """Start a measurement and wait until display 1 reports that its average is done."""
        self._send("STRT")
        end = time.monotonic() + timeout
        while self._ask("DSPS?1") == 0:
            if time.monotonic() > end:
                raise InstrumentError(f"{self._link.name} did not finish within {timeout:g} s; give the run more seconds")
            self._link.wait(self._waits.poll)
        self._averages = int(self._twice("NAVG?0"))
        self._status = self.status()
        self._events()

    def records(self) -> tuple[InstrumentRecord, ...]:
        """The contents of its displays."""
        return tuple(self._record(int(shown.trace), shown) for shown in self._shows)

    def close(self) -> None:
        """Switch its source off if this driver switched it on, and close the port."""
        if self._sourcing:
            self._sourcing = False
            # The connection may be lost.
            with suppress(DriverError):
                self._link.send("SRCO 0")
        self._link.close()

    def _record(self, display: int, shown: Shows) -> InstrumentRecord:
        points = int(self._twice(f"DSPN?{display}"))
        first, middle, last = (self._ask(f"DBIN?{display},{j}") for j in (0, points // 2, points - 1))
        x = np.linspace(first, last, points)
        if not first < last or abs(x[points // 2] - middle) > EVEN * (last - first):
            raise ProtocolError(
                f"{self._link.name} reports x values {first:g}, {middle:g} and {last:g} for display {display}, not equal steps; "
                "measure again"
            )
        return InstrumentRecord(
            kind=shown.kind, x=x, values=self._floats(display, points), unit=shown.unit, source=f"display {display}",
            averages=self._averages, window=None, status=self._status,
        )  # fmt: skip

    def _floats(self, display: int, points: int) -> FloatArray:
        data, again = (self._dump(display, points) for _ in range(2))
        if data != again:
            raise ProtocolError(
                f"{self._link.name} sent two different records of display {display}; check the cable, measure again"
            )
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

    def _dump(self, display: int, points: int) -> bytes:
        self._send(f"DSPB?{display}")
        return self._link.exactly(4 * points)

    def _events(self) -> None:
        events = self._ask("*ESR?")
        for bit, what in EVENTS.items():
            if events >> bit & 1:
                raise InstrumentError(f"{self._link.name} reports that {what}; check that the plan names the right instrument")

    def _send(self, command: str) -> None:
        self._link.expect_nothing()
        self._link.send(command)

    def _twice(self, command: str) -> Any:
        first, second = self._ask(command), self._ask(command)
        if first != second:
            raise ProtocolError(f"{self._link.name} answered {command} with {first} and {second}; check the cable, measure again")
        return first

    def _ask(self, command: str, kind: str = "") -> Any:
        self._send(command)
        answer = self._link.line().strip().decode("ascii", "replace")
        word = command.partition("?")[0]
        return parse((answer,), (ANSWERS[kind or word],), who=self._link.name, command=command)[0]


def _far_end(rig: DrivenRig, asked: Simulation) -> Peer:
    from isorig.drivers.simulated.analyzers import SimulatedSr785, displayed

    faults = asked.faults.only(("overload",), "an sr785")
    coherence, time_record = displayed(rig)
    return SimulatedSr785({0: coherence, 1: time_record}, overload=faults.overload > 0.0)


EXAMPLE = """
sample_rate = 256.0
[[instrument.shows]]
trace = "0"
kind = "coherence"
channel = "motor"
reference = "head"
[[instrument.shows]]
trace = "1"
kind = "time"
channel = "motor"
unit = "V"
"""
KIND = RecordsKind(
    name="sr785",
    open=Sr785Instrument,
    trace=(r"[01]", "a display, 0 or 1"),
    example=EXAMPLE + CHANNELS,
    far_end=_far_end,
    recognized="SR78[05]",
)
