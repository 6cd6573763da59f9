"""A simulated instrument: obeys commands, each ended by a byte, may stream samples between them, and has faults on request."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, fields

import numpy as np

from isorig.drivers.block import Raw
from isorig.drivers.errors import SettingError

#: Given a number of samples and a rate in Hz: a value for each sample and input, shape (n, inputs).
Source = Callable[[int, float], Raw]
#: Maximum number of samples in a signal that is repeated.
MOST = 100_000
#: Delay of a stalled frame in seconds, and relative change of a turned dial.
STALL = 0.2
TURN = 0.1


@dataclass(frozen=True, kw_only=True)
class Faults:
    """The faults, each a probability per frame unless stated otherwise."""

    #: A frame is not sent, sent twice, has a flipped bit, is 0.2 s late, reports an overload.
    drop: float = 0.0
    duplicate: float = 0.0
    corrupt: float = 0.0
    stall: float = 0.0
    overload: float = 0.0
    unplug_after: float | None = None  #: Seconds of signal after which the connection is cut; never if None.
    first_tick: int = 0  #: Initial value of the counter, to test its wrapping.
    ppm: float = 0.0  #: Rate error of the instrument's clock, parts per million.
    turn_after: float | None = None  #: Seconds of signal after which the gain is increased by a tenth; never if None.
    seed: int = 0

    def only(self, known: Collection[str], who: str) -> Faults:
        """These faults, if an instrument supports them. Raises SettingError if a requested fault is not supported."""
        asked = [f.name for f in fields(self) if f.name != "seed" and getattr(self, f.name) != f.default]
        unknown = next((name for name in asked if name not in known), None)
        if unknown is not None:
            raise SettingError(f"{who} has no fault {unknown!r}; it has {', '.join(sorted(known)) or 'none'}")
        return self


class RandomFaults:
    """Draws the faults of frames at random; `happened` counts them by kind."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._random = np.random.default_rng(faults.seed)
        self._until = 0.0
        self.happened: Counter[str] = Counter()

    def occurs(self, kind: str) -> bool:
        """Whether this fault occurs now."""
        chance = getattr(self._faults, kind)
        hit = bool(chance > 0.0 and self._random.random() < chance)
        self.happened[kind] += hit
        return hit

    @property
    def late(self) -> bool:
        """Whether a stall is in progress."""
        return time.monotonic() < self._until

    def stalls(self) -> None:
        """Stall, if that fault occurs now."""
        if self.occurs("stall"):
            self._until = time.monotonic() + STALL

    def sent(self, frame: bytes) -> list[bytes]:
        """The bytes of a frame that are sent."""
        if self.occurs("drop"):
            return []
        if self.occurs("corrupt"):
            hurt = bytearray(frame)
            hurt[int(self._random.integers(len(hurt)))] ^= 1 << int(self._random.integers(8))
            frame = bytes(hurt)
        self.stalls()
        return [frame, frame] if self.occurs("duplicate") else [frame]


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
    #: The faults that it has, and its name in a refusal of others.
    FAULTS: frozenset[str] = frozenset()
    NAME = ""

    def __init__(self, asked: Simulation) -> None:
        self._faults = asked.faults.only(self.FAULTS, self.NAME)
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

    FAULTS = frozenset({"drop", "duplicate", "corrupt", "stall", "overload", "unplug_after", "first_tick", "ppm"})

    def __init__(self, rate: float, asked: Simulation) -> None:
        super().__init__(asked)
        self._rate, self._asked = rate, asked
        self._speed = asked.speed * (1.0 + 1e-6 * self._faults.ppm)
        self.random_faults = RandomFaults(self._faults)
        self.running = False
        self.sent, self._began = 0, 0.0

    @property
    def unplugged(self) -> bool:
        return self._faults.unplug_after is not None and self.sent > self._faults.unplug_after * self._rate

    def step(self, data: bytes) -> bytes:
        answers = self.answers(data)
        return answers + self.samples() if self.running and not self.random_faults.late else answers

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
