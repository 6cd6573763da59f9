"""A simulated instrument that obeys commands, each ended by a byte, and may stream samples between them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from isorig.drivers.block import Raw
from isorig.drivers.simulated.faults import Faults, Mishaps

#: Given a number of samples and a rate in Hz: a value for each sample and input, shape (n, inputs).
Source = Callable[[int, float], Raw]
#: Maximum number of samples in a signal that is repeated.
MOST = 100_000


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """Options of a simulated instrument.

    Parameters
    ----------
    speed
        Speed relative to real time; of an instrument that plays a drive also infinite, as fast as the connection allows.
    seconds
        Length of the signal, which is repeated, seconds of signal.
    faults
        Injected faults; a simulated instrument refuses those that it does not have (`Faults.only`).
    """

    speed: float = 1.0
    seconds: float = 60.0
    faults: Faults = field(default_factory=Faults)


class Commanded:
    """Answers commands; `heard` are those that arrived."""

    END = b"\n"

    def __init__(self) -> None:
        self._waiting = b""
        self.heard: list[str] = []

    @property
    def unplugged(self) -> bool:
        """Whether the connection is to be cut."""
        return False

    def step(self, data: bytes) -> bytes:
        """Bytes received, bytes to send."""
        return self.answers(data)

    def answers(self, data: bytes) -> bytes:
        """The answers to the commands that these bytes complete."""
        *lines, self._waiting = (self._waiting + data).split(self.END)
        commands = [line.decode("ascii", "replace").strip() for line in lines]
        self.heard += commands
        return b"".join(map(self.answer, commands))

    def answer(self, command: str) -> bytes:
        """The answer to a command."""
        raise NotImplementedError


class Streaming(Commanded):
    """Streams samples at a rate in Hz while it is running, with faults on request; `sent` ticks were due so far."""

    #: The faults that it has, and its name in a refusal of others.
    FAULTS = frozenset({"drop", "duplicate", "corrupt", "stall", "overload", "unplug_after", "first_tick", "ppm"})
    NAME = ""

    def __init__(self, rate: float, asked: Simulation) -> None:
        super().__init__()
        self._rate, self._asked = rate, asked
        self._faults = asked.faults.only(self.FAULTS, self.NAME)
        self._speed = asked.speed * (1.0 + 1e-6 * self._faults.ppm)
        self.mishaps = Mishaps(self._faults)
        self.running = False
        self.sent, self._began = 0, 0.0

    @property
    def unplugged(self) -> bool:
        """Whether the connection is to be cut."""
        return self._faults.unplug_after is not None and self.sent > self._faults.unplug_after * self._rate

    def step(self, data: bytes) -> bytes:
        """Bytes received, bytes to send."""
        answers = self.answers(data)
        return answers + self.samples() if self.running and not self.mishaps.late else answers

    def begin(self) -> None:
        """Start streaming."""
        self.running, self.sent, self._began = True, 0, time.monotonic()

    def repeated(self, source: Source) -> Raw:
        """The signal of a source, as long as it is asked for."""
        return source(min(round(self._asked.seconds * self._rate), MOST), self._rate)

    def due(self, most: int) -> range:
        """The ticks that are due to be sent, at most so many; they count as sent."""
        whole = int((time.monotonic() - self._began) * self._speed * self._rate)
        ticks = range(self.sent, min(max(whole, self.sent), self.sent + most))
        self.sent = ticks.stop
        return ticks

    def samples(self) -> bytes:
        """The samples that are due, as they are sent."""
        raise NotImplementedError
