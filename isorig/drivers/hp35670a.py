"""HP/Agilent 35670A dynamic signal analyzer on GPIB: reads finished records of its traces in binary form.

The plan names the feed of each trace ("XTIM:VOLT 1" a time record, "XFR:POW:COH 1,2" a coherence). Values are sent as
`#<digits><length>`, big-endian float32 and LF; a value below -1e37 means no value. There is no checksum, so data are read twice
and must be identical. At the end of a measurement the analyzer sets bit 5 of its status byte and requests service (IEEE 488.2:
`*OPC` sets bit 0 of the event register, which `*ESE 1` and `*SRE 32` pass on); the driver waits for the request where the link
reports it, and polls the status byte otherwise.
"""

from typing import ClassVar

import numpy as np

from isorig.drivers.analyzer import Analyzer, displayed, example
from isorig.drivers.answers import number, text, whole
from isorig.drivers.block import FloatArray, InstrumentRecord, Status
from isorig.drivers.errors import InstrumentError, ProtocolError
from isorig.drivers.kinds import RecordsKind
from isorig.drivers.simulated.analyzers import Simulated35670a

DONE = 1 << 5
BAD = -1e37
#: Maximum number of errors read before the instrument counts as defective.
ERRORS = 30
#: Maximum size of a block in bytes: the longest record has 4096 values.
LARGEST = 1 << 16


class Hp35670aInstrument(Analyzer):
    """A 35670A; the first of its feeds is trace 1. Its own serial port serves printers and plotters only."""

    ANSWERS: ClassVar = {"*STB": whole(0, 255), "SYST:ERR": text(200), "SOUR:VOLT": number(), "OUTP": whole(0, 1)}
    SOURCE_OFF = "OUTP OFF"
    identity = "HP 35670A"
    #: The number of points without a value in the last records.
    noticed: tuple[str, ...] = ()

    def status(self) -> Status:
        """Always GOOD: no command is known that queries overloads, so check the panel."""
        return Status.GOOD

    def measure(self, timeout: float) -> None:
        """Start one measurement and wait until the operation is complete."""
        self.noticed = ()
        # The event of the measurement before stays set until it is cleared.
        self._send("*CLS")
        self._send("ABOR;INIT:IMM;*OPC")
        self._wait_until(lambda: bool(self._status_byte() & DONE), timeout)
        self._check()

    def records(self) -> tuple[InstrumentRecord, ...]:
        """The records of the traces."""
        return tuple(self._record(trace) for trace in range(1, len(self._traces) + 1))

    def _set_up(self) -> None:
        self._send("*ESE 1;*SRE 32")
        self._send("FORM:DATA REAL,32")
        for trace, feed in enumerate(self._traces, 1):
            self._send(f"CALC{trace}:FEED '{feed}'")

    def _play(self, level: float) -> tuple[float, bool]:
        self._sourcing = True
        self._send(f"SOUR:VOLT {level:.6g} VPK")
        self._send("OUTP ON")
        self._check()
        return self._ask("SOUR:VOLT?"), bool(self._ask("OUTP?"))

    def _record(self, trace: int) -> InstrumentRecord:
        x, values = (self._values(f"CALC{trace}:{what}?") for what in ("X:DATA", "DATA"))
        if x.shape != values.shape:
            raise ProtocolError(
                f"{self._link.name} sent {len(values)} values and {len(x)} x values for trace {trace}; "
                "display a real trace, complex ones cannot be read"
            )
        if not (np.isfinite(x).all() and (np.diff(x) > 0.0).all()):
            raise ProtocolError(f"{self._link.name} sent x values for trace {trace} that do not increase; measure again")
        good = np.isfinite(values) & (np.abs(values) < -BAD)
        if not good.any():
            raise InstrumentError(f"{self._link.name} has no valid value in trace {trace}; measure again")
        if not good.all():
            bad = int((~good).sum())
            self.noticed += (f"trace {trace} has no value at {bad} of {len(good)} points, which are left out",)
        return InstrumentRecord(x=x[good], values=values[good], status=Status.GOOD if good.all() else Status.LOST)

    def _values(self, command: str) -> FloatArray:
        return np.frombuffer(self._twice(command, self._block), ">f4").astype(np.float64)

    def _block(self, command: str) -> bytes:
        self._send(command)
        head = self._link.exactly(2)
        if head[:1] != b"#" or not head[1:].isdigit() or head[1:] == b"0":
            raise ProtocolError(f"{self._link.name} answered {command} with {head!r}; a block begins with # and a digit")
        length = self._link.exactly(int(head[1:]))
        if not length.isdigit() or int(length) % 4 or not 8 <= int(length) <= LARGEST:
            raise ProtocolError(
                f"{self._link.name} announces a block of {length!r} bytes; allowed are float32 values, {LARGEST} bytes at most"
            )
        data = self._link.exactly(int(length) + 1)
        if data[-1:] != b"\n":
            raise ProtocolError(f"{self._link.name} ended a block with {data[-1:]!r}, not LF; measure again")
        return data[:-1]

    def _check(self) -> None:
        first = self._ask("SYST:ERR?")
        for _ in range(ERRORS):
            if self._no_error(first):
                return
            answer = self._ask("SYST:ERR?")
            if self._no_error(answer):
                break
        raise InstrumentError(f"{self._link.name} reports {first}; correct the plan or its settings")

    def _status_byte(self) -> int:
        byte = self._link.status_byte()
        return int(self._ask("*STB?")) if byte is None else byte

    @staticmethod
    def _no_error(answer: str) -> bool:
        return answer.replace(" ", "").lstrip("+").startswith("0,")


KIND = RecordsKind(
    name="35670a",
    open=Hp35670aInstrument,
    trace=(r"[A-Z0-9:]+( \d(,\d)?)?", "a feed, for example XTIM:VOLT 1"),
    example=example("XFR:POW:COH 1,2", "XTIM:VOLT 1"),
    far_end=lambda rig, asked: Simulated35670a(displayed(rig, "XFR:POW:COH 1,2", "XTIM:VOLT 1"), asked),
    recognized="35670A",
)
