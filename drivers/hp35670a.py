"""HP/Agilent 35670A dynamic signal analyzer behind a serial bridge: finished records of its traces, binary and checked.

Each trace is fed with what the plan names ("XTIM:VOLT 1" a time record, "XFR:POW:COH 1,2" a coherence). Values come as
`#<digits><length>`, big-endian float32 and LF; below -1e37 they stand for nothing.
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

DONE = 1 << 5
BAD = -1e37
POLL = 0.2
#: Errors that are read at most before the instrument counts as broken.
ERRORS = 30


class Hp35670aInstrument:
    """A 35670A at a serial port.

    Parameters
    ----------
    port
        Path or URL of the bridge.
    shows
        What its traces are fed with; the first is trace 1.
    """

    def __init__(self, port: str, shows: Sequence[Shows]) -> None:
        self._port = Port(port, baud_rate=9600)
        self._shows = tuple(shows)
        self.identity = "HP 35670A"
        self._send("FORM:DATA REAL,32")
        for trace, shown in enumerate(self._shows, 1):
            self._send(f"CALC{trace}:FEED '{shown.trace}'")
        self._errors()

    def status(self) -> Status:
        """GOOD: no command that asks it for an overload is known here, so look at its panel."""
        return Status.GOOD

    def measure(self, timeout: float) -> None:
        """Take one measurement and wait until it says that the operation is complete."""
        self._send("ABOR;INIT:IMM;*OPC")
        end = time.monotonic() + timeout
        while not int(self._ask("*STB?")) & DONE:
            if time.monotonic() > end:
                raise InstrumentError(f"{self._port.name} was not done within {timeout:g} s; give the run more seconds")
            time.sleep(POLL)
        self._errors()

    def records(self) -> tuple[Record, ...]:
        """The traces' records."""
        return tuple(self._record(trace, shown) for trace, shown in enumerate(self._shows, 1))

    def close(self) -> None:
        """Let go of the wire."""
        self._port.close()

    def _record(self, trace: int, shown: Shows) -> Record:
        x, values = self._block(f"CALC{trace}:X:DATA?"), self._block(f"CALC{trace}:DATA?")
        if x.shape != values.shape:
            raise ProtocolError(
                f"{self._port.name} sent {len(values)} values at {len(x)} places for trace {trace}; "
                "show a real trace, complex ones cannot be read"
            )
        good = values > BAD
        if not good.any():
            raise InstrumentError(f"{self._port.name} has no valid value in trace {trace}; measure again")
        return Record(
            kind=shown.kind, x=x[good], values=values[good], unit=shown.unit, source=shown.trace,
            status=Status.GOOD if good.all() else Status.LOST,
        )  # fmt: skip

    def _block(self, command: str) -> FloatArray:
        self._send(command)
        head = self._port.exactly(2)
        if head[:1] != b"#" or not head[1:].isdigit() or head[1:] == b"0":
            raise ProtocolError(f"{self._port.name} answered {command} with {head!r}; a block begins with # and a digit")
        length = self._port.exactly(int(head[1:]))
        if not length.isdigit() or int(length) % 4 or int(length) > 1 << 24:
            raise ProtocolError(f"{self._port.name} tells of a block of {length!r} bytes; it has whole float32 values")
        data = self._port.exactly(int(length) + 1)
        if data[-1:] != b"\n":
            raise ProtocolError(f"{self._port.name} ended a block with {data[-1:]!r}, not LF; measure again")
        return np.frombuffer(data[:-1], ">f4").astype(np.float64)

    def _errors(self) -> None:
        first = self._ask("SYST:ERR?")
        for _ in range(ERRORS):
            if self._no_error(first):
                return
            told = self._ask("SYST:ERR?")
            if self._no_error(told):
                break
        raise InstrumentError(f"{self._port.name} reports {first}; correct the plan or its settings")

    @staticmethod
    def _no_error(told: str) -> bool:
        return told.replace(" ", "").lstrip("+").startswith("0,")

    def _send(self, command: str) -> None:
        self._port.write(command.encode() + b"\n")

    def _ask(self, command: str) -> str:
        self._send(command)
        return self._port.line(b"\n").strip().decode("ascii", "replace")


KIND = RecordsKind(name="35670a", open=Hp35670aInstrument, trace=(r"[A-Z0-9:]+( \d(,\d)?)?", "a feed such as XTIM:VOLT 1"))
