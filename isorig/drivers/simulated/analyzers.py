"""Simulated analyzers: they answer the commands used by the drivers of the SR785 and the 35670A, and no others."""

from collections.abc import Mapping

import numpy as np

from isorig.drivers.block import FloatArray
from isorig.drivers.simulated.commanded import Commanded, Simulation

#: x and values of a trace.
Curve = tuple[FloatArray, FloatArray]
#: Number of status queries that a measurement takes.
POLLS = 2


class SimulatedSr785(Commanded):
    """Two displays with given curves; a measurement takes `POLLS` status queries."""

    FAULTS, NAME = frozenset({"overload"}), "an sr785"

    def __init__(self, displays: Mapping[int, Curve], asked: Simulation, *, order: str = "<") -> None:
        super().__init__(asked)
        self._displays, self._order = displays, order
        self._left, self._events = 0, 0
        self.sourcing, self._level = False, 0

    def answer(self, command: str) -> bytes:
        head, _, rest = command.partition("?")
        words = rest.split(",") if rest else []
        if command in ("OUTX0", "OUTX1", "STRT", "SRCO 0", "SRCO 1") or head.startswith("NAMP "):
            self._left = POLLS if command == "STRT" else self._left
            self.sourcing = command == "SRCO 1" if head.startswith("SRCO") else self.sourcing
            self._level = int(head.split()[1]) if head.startswith("NAMP ") else self._level
            return b""
        if head in ("DSPN", "DBIN", "DSPB", "DSPY") and words and int(words[0]) in self._displays:
            return self._display(head, words)
        numbers = {
            "STYP?": 2,
            "NAMP?": self._level,
            "SRCO?": int(self.sourcing),
            "*ESR?": self._events,
            "DSPS?1": int(self._left <= 1),
            "NAVG?0": 10,
            "INPS?": int(self._faults.overload > 0.0),
        }
        if command not in numbers:
            self._events |= 1 << 5
            return b""
        if command == "DSPS?1":
            self._left -= 1
        if command == "*ESR?":
            self._events = 0
        return b"%d\n" % numbers[command]

    def _display(self, head: str, words: list[str]) -> bytes:
        x, values = self._displays[int(words[0])]
        if head == "DSPN":
            return b"%d\n" % len(values)
        if head == "DSPB":
            return values.astype(f"{self._order}f4").tobytes()
        chosen = x if head == "DBIN" else values.astype(np.float32)
        return b"%.9g\n" % chosen[int(words[1])]


class Simulated35670a(Commanded):
    """Traces by feed; a measurement takes `POLLS` status queries."""

    NAME = "a 35670a"

    def __init__(self, feeds: Mapping[str, Curve], asked: Simulation) -> None:
        super().__init__(asked)
        self._feeds = feeds
        self._left, self._measuring, self._complete, self._enabled = 0, False, False, False
        self._traces: dict[str, Curve] = {}
        self._errors: list[str] = []
        self.sourcing, self._level = False, 0.0

    def answer(self, command: str) -> bytes:
        trace, _, about = command.partition(":")
        if command == "ABOR;INIT:IMM;*OPC":
            self._left, self._measuring = POLLS, True
        elif command == "*STB?":
            return b"+%d\n" % self.status_byte()
        elif command in ("*CLS", "*ESE 1;*SRE 32"):
            self._complete = self._complete and command != "*CLS"
            self._enabled = self._enabled or command != "*CLS"
        elif command in ("OUTP ON", "OUTP OFF"):
            self.sourcing = command == "OUTP ON"
        elif command == "OUTP?":
            return b"%d\n" % self.sourcing
        elif command.startswith("SOUR:VOLT "):
            self._level = float(command.split()[1])
        elif command == "SOUR:VOLT?":
            return b"%.6E\n" % self._level
        elif command == "SYST:ERR?":
            return (self._errors.pop(0) if self._errors else '+0,"No Error"').encode() + b"\n"
        elif trace.startswith("CALC") and about.startswith("FEED '") and about[6:-1] in self._feeds:
            self._traces[trace] = self._feeds[about[6:-1]]
        elif about in ("DATA?", "X:DATA?") and trace in self._traces:
            return self._block(self._traces[trace][0 if about.startswith("X") else 1])
        elif command != "FORM:DATA REAL,32":
            self._errors.append('-113,"Undefined header"')
        return b""

    def status_byte(self) -> int:
        """The status byte; operation complete stays set until it is cleared, and is passed on if it is enabled (IEEE 488.2)."""
        self._left = max(self._left - 1, 0)
        if self._measuring and self._left == 0:
            self._measuring, self._complete = False, True
        return 32 * (self._complete and self._enabled)

    @staticmethod
    def _block(values: FloatArray) -> bytes:
        data = values.astype(">f4").tobytes()
        length = str(len(data)).encode()
        return b"#" + str(len(length)).encode() + length + data + b"\n"
