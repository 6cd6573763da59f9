"""SRS SR785 dynamic signal analyzer over RS-232: finished records of its two displays.

What a display shows (spectrum, transfer function, time record) and every other setting is made on its panel; this driver starts
a measurement, waits for its average, reads the displays and tells overloads. Commands end in LF, 9600 baud, 8N1.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from drivers.block import FloatArray, Record, Status
from drivers.errors import InstrumentError, ProtocolError
from drivers.kinds import RecordsKind
from drivers.port import Port
from drivers.shows import Shows

#: Bits of the standard event register: syntax error, execution error, output overflow.
EVENTS = {5: "it does not know a command", 4: "it could not do a command", 2: "its output overflowed"}
POLL = 0.2


class Sr785Instrument:
    """An SR785 or SR780 at a serial port.

    Parameters
    ----------
    port
        Path or URL.
    shows
        What its displays 0 and 1 show, as set on the panel.
    """

    def __init__(self, port: str, shows: Sequence[Shows]) -> None:
        self._port = Port(port, baud_rate=9600)
        self._shows = tuple(shows)
        self.identity = "SRS SR785"
        self._send("OUTX1")
        self._events()

    def status(self) -> Status:
        """Whether an input is overloaded now."""
        return Status.OVERLOAD if int(self._ask("INPS?")) else Status.GOOD

    def measure(self, timeout: float) -> None:
        """Start a measurement and wait until display 1 reports its average done."""
        self._send("STRT")
        end = time.monotonic() + timeout
        while int(self._ask("DSPS?1")) == 0:
            if time.monotonic() > end:
                raise InstrumentError(f"{self._port.name} was not done within {timeout:g} s; give the run more seconds")
            time.sleep(POLL)
        self._averages = int(self._ask("NAVG?0"))
        self._status = self.status()
        self._events()

    def records(self) -> tuple[Record, ...]:
        """What its displays show."""
        return tuple(self._record(int(shown.trace), shown) for shown in self._shows)

    def close(self) -> None:
        """Let go of the wire."""
        self._port.close()

    def _record(self, display: int, shown: Shows) -> Record:
        points = int(self._ask(f"DSPN?{display}"))
        if not 2 <= points <= 1 << 20:
            raise ProtocolError(f"{self._port.name} tells of {points} points on display {display}; switch the display on")
        first, last = (float(self._ask(f"DBIN?{display},{j}")) for j in (0, points - 1))
        self._send(f"DSPB?{display}")
        data = self._port.exactly(4 * points)
        return Record(
            kind=shown.kind, x=np.linspace(first, last, points), values=self._floats(data, display), unit=shown.unit,
            source=f"display {display}", averages=self._averages, window=None,
            status=self._status,
        )  # fmt: skip

    def _floats(self, data: bytes, display: int) -> FloatArray:
        # Its order of bytes is not documented: one point read as text decides.
        little, big = np.frombuffer(data, "<f4"), np.frombuffer(data, ">f4")
        place = len(little) // 2
        told = float(self._ask(f"DSPY?{display},{place}"))
        for values in (little, big):
            if np.isfinite(values).all() and np.isclose(values[place], told, rtol=1e-4, atol=1e-30):
                return values.astype(np.float64)
        raise ProtocolError(
            f"{self._port.name} sent {little[place]:g} and {told:g} for one point of display {display}; measure again"
        )

    def _events(self) -> None:
        events = int(self._ask("*ESR?"))
        for bit, what in EVENTS.items():
            if events >> bit & 1:
                raise InstrumentError(f"{self._port.name} reports that {what}; check that the plan names the right instrument")

    def _send(self, command: str) -> None:
        self._port.write(command.encode() + b"\n")

    def _ask(self, command: str) -> str:
        self._send(command)
        return self._port.line(b"\n").strip().decode("ascii", "replace")


KIND = RecordsKind(name="sr785", open=Sr785Instrument, trace=(r"[01]", "a display, 0 or 1"))
