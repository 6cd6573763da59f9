"""Limits of processor time and of simulated samples, which long computations ask.

A limit of samples gives the same result on every computer; one of time does not.
"""

from __future__ import annotations

import time
from contextvars import ContextVar, Token
from math import inf

from isorig.analysis.errors import OutOfTimeError

_in_force: ContextVar[Deadline | None] = ContextVar("deadline", default=None)
_simulated: ContextVar[int] = ContextVar("simulated", default=0)


class Deadline:
    """A limit for what is computed within its `with` block: `seconds` of this process from now on, no limit if None.

    It is processor time: other work on the computer does not count. With `samples` it also ends after as many simulated samples
    (`count_samples`).
    """

    def __init__(self, seconds: float | None = None, *, samples: float = inf) -> None:
        self._start = time.process_time()
        self._limit = self._end = inf if seconds is None else self._start + seconds
        self._last = _simulated.get() + samples
        self._outer: Token[Deadline | None]

    def __enter__(self) -> Deadline:
        self._outer = _in_force.set(self)
        return self

    def __exit__(self, *_: object) -> None:
        _in_force.reset(self._outer)

    @property
    def over(self) -> bool:
        """Whether the time has ended, or the samples are spent."""
        return time.process_time() > self._end or _simulated.get() > self._last

    @property
    def spent(self) -> float:
        """Seconds so far."""
        return time.process_time() - self._start

    @property
    def left(self) -> float:
        """Seconds until the time ends, negative after it."""
        return self._end - time.process_time()

    def keep(self, seconds: float) -> None:
        """End the time these seconds before the limit: what follows takes them."""
        self._end = self._limit - seconds

    def end(self) -> None:
        """End the time now."""
        self._end = -inf


def out_of_time() -> bool:
    """Whether the time of the deadline in force, if there is one, has ended."""
    deadline = _in_force.get()
    return deadline is not None and deadline.over


def time_spent() -> float:
    """Seconds since the deadline in force began; zero without one."""
    deadline = _in_force.get()
    return 0.0 if deadline is None else deadline.spent


def time_left() -> float:
    """Seconds until the deadline in force ends, negative after it; infinite without one."""
    deadline = _in_force.get()
    return inf if deadline is None else deadline.left


def keep_time(seconds: float) -> None:
    """End the time of the deadline in force, if there is one, these seconds before its limit."""
    deadline = _in_force.get()
    if deadline is not None:
        deadline.keep(seconds)


def samples_simulated() -> int:
    """Number of samples that were simulated so far (`count_samples`)."""
    return _simulated.get()


def count_samples(number: int) -> None:
    """Count simulated samples: those of each record times the steps per sample."""
    _simulated.set(_simulated.get() + number)


def ask_time() -> None:
    """Begin nothing that takes long once the time has ended. Raises OutOfTimeError if it has."""
    if out_of_time():
        raise OutOfTimeError("the time limit is reached")
