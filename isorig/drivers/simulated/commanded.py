"""A simulated instrument that obeys commands, each ended by a byte, and may stream samples between them."""

from __future__ import annotations

import time

from isorig.drivers.simulated.faults import Faults, Mishaps


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
        *lines, self._waiting = (self._waiting + data).split(self.END)
        answers = b""
        for line in lines:
            command = line.decode("ascii", "replace").strip()
            self.heard.append(command)
            answers += self.answer(command)
        return answers

    def answer(self, command: str) -> bytes:
        """The answer to a command."""
        raise NotImplementedError


class Streaming(Commanded):
    """Streams samples while it is running, in real time or at a given speed, with faults on request.

    Parameters
    ----------
    rate
        Hz.
    speed
        Speed relative to real time.
    faults
        Injected faults.
    """

    #: The faults that it has, and its name in a refusal of others.
    FAULTS = frozenset({"drop", "duplicate", "corrupt", "stall", "overload", "unplug_after", "first_tick", "ppm"})
    NAME = ""

    def __init__(self, rate: float, speed: float, faults: Faults | None) -> None:
        super().__init__()
        self._rate, self._faults = rate, (faults or Faults()).only(self.FAULTS, self.NAME)
        self._speed = speed * (1.0 + 1e-6 * self._faults.ppm)
        self.mishaps = Mishaps(self._faults)
        self.running = False
        self._sent, self._began = 0, 0.0

    @property
    def unplugged(self) -> bool:
        """Whether the connection is to be cut."""
        return self._faults.unplug_after is not None and self._sent > self._faults.unplug_after * self._rate

    def step(self, data: bytes) -> bytes:
        """Bytes received, bytes to send."""
        answers = super().step(data)
        return answers + self.samples() if self.running and not self.mishaps.late else answers

    def begin(self) -> None:
        """Start streaming."""
        self.running, self._sent, self._began = True, 0, time.monotonic()

    def due(self, most: int) -> range:
        """The ticks that are due to be sent, at most so many; they count as sent."""
        whole = int((time.monotonic() - self._began) * self._speed * self._rate)
        ticks = range(self._sent, min(max(whole, self._sent), self._sent + most))
        self._sent = ticks.stop
        return ticks

    def samples(self) -> bytes:
        """The samples that are due, as they are sent."""
        raise NotImplementedError
