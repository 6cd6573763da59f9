"""Places blocks in time: compares counter, sequence numbers and clock of an instrument with each other and with the host's clock.

A step of the counter is a loss only if the other indicators confirm it. The value on which two of the three agree is used; if all
differ, the one that is possible according to the host's clock; if none is, the run ends, because no position could be trusted.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from isorig.drivers.block import Status
from isorig.drivers.errors import InstrumentError

#: Allowed difference between counter and clock over a step: a share of it, and samples or seconds if that is more. A clock that
#: the firmware reads when it builds a frame is late by its loop time; one that is latched with the sample is exact.
SHARE = 0.02
LOOSE, EXACT = (2.0, 0.005), (0.6, 0.0)
#: Maximum delay of samples at the host in seconds, and the factor by which they may have been acquired faster than before.
SLACK, FASTER = 1.0, 2.0
#: Seconds of signal after which the clock's estimated rate is more accurate than the requested one.
LEARNED = 0.5
#: Number of frames, and of gaps, that are remembered to recognize duplicates and late frames.
REMEMBERED = 512


def wrapped(value: int, near: int, wrap: int) -> int:
    """The integer equal to `value` modulo `wrap` that is closest to `near`."""
    return near + (value - near + wrap // 2) % wrap - wrap // 2


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Data received with a block.

    Parameters
    ----------
    counter
        Transmitted count of its first sample, wrapping.
    rows
        Number of its samples.
    host
        Host's clock, seconds.
    clock
        Instrument's clock at the first sample in microseconds, wrapping; None if it has none.
    sequence
        Number of the frame, wrapping; None if it has none.
    mark
        Checksum of its samples.
    """

    counter: int
    rows: int
    host: float
    clock: int | None = None
    sequence: int | None = None
    mark: int = 0


@dataclass(frozen=True, kw_only=True)
class Place:
    """Position of a block: first tick, instrument time there (s), DISAGREES if its indicators contradict each other."""

    tick: int
    seconds: float | None
    status: Status


@dataclass(frozen=True, kw_only=True)
class _Steps:
    """Step from the last block's first sample to this one's, by counter, by clock, and by rows if the sequence is unbroken."""

    counter: int
    clock: float | None
    sequence: int | None
    went_on: int | None


class Order:
    """Places the blocks of one run in sequence; the first has tick 0.

    Parameters
    ----------
    who
        The instrument's name, for messages.
    counter_wrap
        Modulus of the counter.
    first
        The counter at tick 0; that of the first block if None.
    rate
        Sample rate, Hz; None if unknown.
    began
        Host's clock at tick 0.
    loose
        Allowed difference between counter and clock, in samples and in seconds.
    """

    WRAP = 1 << 32

    def __init__(
        self, *, who: str, began: float, counter_wrap: int = WRAP, first: int | None = None, rate: float | None = None,
        loose: tuple[float, float] = LOOSE,
    ) -> None:  # fmt: skip
        self._who, self._wrap, self._rate, self._began, self._loose = who, counter_wrap, rate, began, loose
        self._tick = 0
        self._counter = self._clock = self._sequence = 0
        self._rows = 0
        self._first = first
        self._last: Reading | None = None
        self._clock_moved = False
        # Ticks and microseconds over stretches in which counter and clock agree, to estimate the clock's rate.
        self._agreed = [0.0, 0.0]
        self._seen: deque[tuple[int | None, ...]] = deque(maxlen=REMEMBERED)
        self._gaps: deque[tuple[int, int]] = deque(maxlen=REMEMBERED)
        self.noticed: list[str] = []

    @property
    def end(self) -> int:
        """The tick after the last block."""
        return self._tick + self._rows

    def place(self, reading: Reading) -> Place | None:
        """Position of a block; None if it is a duplicate, or so late that its ticks already count as lost.

        Raises
        ------
        InstrumentError
            The instrument was restarted, or the position cannot be determined.
        """
        key = (reading.counter, reading.sequence, reading.clock, reading.rows, reading.mark)
        if key in self._seen:
            return None
        before = self.end
        if self._last is None:
            place = self._begin(reading)
        else:
            steps = self._steps(reading)
            if self._is_late(steps, reading):
                return None
            place = self._follow(reading, steps)
        if place.tick > before:
            self._gaps.append((before, place.tick))
        self._seen.append(key)
        self._last, self._rows = reading, reading.rows
        return place

    def possible(self, counted: int, host: float) -> bool:
        """Whether the instrument can have counted so many samples: at least those received, at most what the time allows."""
        return self.end <= counted and (self._last is None or self._is_possible(counted - self._tick, host))

    def _begin(self, reading: Reading) -> Place:
        first = reading.counter if self._first is None else self._first
        self._counter = wrapped(reading.counter, first, self._wrap)
        self._clock, self._sequence = reading.clock or 0, reading.sequence or 0
        if self._counter < first or not self._is_possible(self._counter - first, reading.host):
            raise InstrumentError(
                f"{self._who} started counting at {reading.counter} but announced {first}; switch it off and on, then resume"
            )
        self._tick = self._counter - first
        return Place(tick=self._tick, seconds=self._seconds(reading), status=Status.GOOD)

    def _steps(self, reading: Reading) -> _Steps:
        clock = None
        if reading.clock is not None and self._last is not None and self._last.clock is not None:
            moved = wrapped(reading.clock, self._clock, self.WRAP) - self._clock
            self._clock_moved = self._clock_moved or moved != 0
            rate = self._own_rate()
            if self._clock_moved and rate is not None:
                clock = moved * 1e-6 * rate
        counter = wrapped(reading.counter, self._counter + self._rows, self._wrap)
        if clock is not None and not self._near(counter - self._counter, clock):
            # A counter with few bits may have wrapped in the gap.
            other = wrapped(reading.counter, self._counter + round(clock), self._wrap)
            counter = other if self._near(other - self._counter, clock) else counter
        sequence = None
        if reading.sequence is not None:
            sequence = wrapped(reading.sequence, self._sequence, self.WRAP) - self._sequence
        return _Steps(
            counter=counter - self._counter, clock=clock, sequence=sequence, went_on=self._rows if sequence == 1 else None
        )

    def _follow(self, reading: Reading, steps: _Steps) -> Place:
        step, status = self._step(reading, steps)
        self._tick += step
        if status == Status.GOOD and reading.clock is not None:
            self._agreed[0] += step
            self._agreed[1] += wrapped(reading.clock, self._clock, self.WRAP) - self._clock
        # Each indicator continues from its own last value, so that one that was reset is trusted again.
        self._counter = wrapped(reading.counter, self._counter + step, self._wrap)
        if reading.clock is not None:
            self._clock = wrapped(reading.clock, self._clock, self.WRAP)
        if reading.sequence is not None:
            self._sequence = reading.sequence
        if status != Status.GOOD:
            self._notice(steps, step)
        return Place(tick=self._tick, seconds=self._seconds(reading), status=status)

    def _step(self, reading: Reading, steps: _Steps) -> tuple[int, Status]:
        counter, clock = steps.counter, steps.clock
        forward = counter >= self._rows and self._is_possible(counter, reading.host)
        timed = clock is not None and self._near(counter, clock)
        numbered = steps.sequence is None or steps.sequence >= 1
        if forward and numbered and (clock is None or timed):
            return counter, Status.GOOD
        if forward and (timed or counter == steps.went_on):
            return counter, Status.DISAGREES
        went_on = steps.went_on
        if clock is not None and went_on is not None and self._near(went_on, clock):
            return went_on, Status.DISAGREES
        if forward and numbered:
            return counter, Status.DISAGREES
        by_clock = round(clock) if clock is not None else 0
        if clock is not None and self._near(self._rows, clock):
            # A clock is not exact to a sample: a difference this small is no step.
            by_clock = self._rows
        if by_clock >= self._rows and self._is_possible(by_clock, reading.host):
            return by_clock, Status.DISAGREES
        raise InstrumentError(
            f"{self._who} counts {counter} samples at tick {self.end}, where {self._rows} or more are expected, and neither its "
            "clock nor the host's shows how many were lost; it was restarted or is defective, so resume"
        )

    def _is_late(self, steps: _Steps, reading: Reading) -> bool:
        first = self._tick + steps.counter
        return any(first >= begin and first + reading.rows <= end for begin, end in self._gaps) and (
            steps.clock is None or self._near(steps.counter, steps.clock)
        )

    def _is_possible(self, step: int, host: float) -> bool:
        # Samples arrive late, never early; a simulated instrument may run faster than real time, which the received samples show.
        if self._rate is None:
            return True
        passed = host - self._began
        pace = max(1.0, self._tick / max(passed, SLACK) / self._rate)
        return self._tick + step <= FASTER * pace * (passed + SLACK) * self._rate

    def _own_rate(self) -> float | None:
        ticks, micros = self._agreed
        if micros > LEARNED * 1e6 and ticks > 0.0:
            return ticks / micros * 1e6
        return self._rate

    def _near(self, count: float, clock: float) -> bool:
        samples, seconds = self._loose
        return abs(count - clock) <= max(samples, SHARE * abs(clock), seconds * (self._rate or 0.0))

    def _seconds(self, reading: Reading) -> float | None:
        return None if reading.clock is None else self._clock * 1e-6

    def _notice(self, steps: _Steps, step: int) -> None:
        said = [f"its counter {steps.counter}"]
        if steps.clock is not None:
            said.append(f"its clock {steps.clock:.0f}")
        if steps.went_on is not None:
            said.append(f"its frame numbers {steps.went_on}")
        elif steps.sequence is not None:
            said.append(f"its frame number went by {steps.sequence}")
        self.noticed.append(f"at tick {self._tick} {', '.join(said)} samples on; {step} was used")
