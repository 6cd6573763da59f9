"""Places blocks in time: compares counter, sequence numbers and clock of an instrument with each other and with the host's clock.

A step of the counter is a loss only if the other indicators confirm it. The value on which two of the three agree is used; if all
differ, the one that is possible according to the host's clock; if none is, the run ends, because no position could be trusted.
"""

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
#: Seconds after a start within which frames of an earlier run may still arrive; limits for a frame after a gap in that time: the
#: factor by which an instrument's rate may be too high, and the resolution of the host's clock in seconds.
TRANSIT, FASTEST, GRAIN = 1.0, 1.02, 0.005
#: Number of frames, and of gaps, that are remembered to recognize duplicates and late frames.
REMEMBERED = 512


def wrapped(value: int, near: int, wrap: int) -> int:
    """The integer equal to `value` modulo `wrap` that is closest to `near`."""
    return near + (value - near + wrap // 2) % wrap - wrap // 2


@dataclass(frozen=True, kw_only=True)
class BlockHeader:
    """Data received with a block."""

    #: Transmitted count of its first sample, wrapping; number and checksum of its samples.
    counter: int
    rows: int
    mark: int = 0
    host: float  #: Host's clock, seconds.
    #: Instrument's clock at the first sample in microseconds, and number of the frame; both wrap, None if it has none.
    clock: int | None = None
    sequence: int | None = None


@dataclass(frozen=True, kw_only=True)
class Place:
    """Position of a block: first tick, instrument time there (s), DISAGREES if its indicators contradict each other."""

    tick: int
    seconds: float | None
    status: Status


@dataclass(frozen=True, kw_only=True)
class _Steps:
    """Step from the last block's first sample to this one's, by counter, by clock, and by the numbers of the frames.

    The last is known after the next frame, and after more if all frames had the same number of rows so far.
    """

    counter: int
    clock: float | None
    sequence: int | None
    frames: int | None


class Order:
    """Places the blocks of one run in sequence; the first has tick 0.

    Parameters
    ----------
    who
        The instrument's name, for messages.
    counter_wrap, first
        Modulus of the counter; the counter at tick 0, that of the first block if None.
    rate, began
        Sample rate, Hz, None if unknown; host's clock at tick 0, seconds.
    loose
        Allowed difference between counter and clock, in samples and in seconds.
    real_time
        Whether the instrument measures in real time from `began` on, and never faster.
    """

    WRAP = 1 << 32

    def __init__(
        self, *, who: str, began: float, counter_wrap: int = WRAP, first: int | None = None, rate: float | None = None,
        loose: tuple[float, float] = LOOSE, real_time: bool = False,
    ) -> None:  # fmt: skip
        self._who, self._wrap, self._rate, self._began, self._loose = who, counter_wrap, rate, began, loose
        self._real_time = real_time
        self._tick = 0
        self._counter = self._clock = self._sequence = 0
        self._rows = 0
        self._first = first
        self._last: BlockHeader | None = None
        self._clock_moved = False
        # Whether all frames had the same number of rows.
        self._even = True
        # Ticks and microseconds over stretches in which counter and clock agree, to estimate the clock's rate.
        self._agreed = [0.0, 0.0]
        self._seen: deque[tuple[int | None, ...]] = deque(maxlen=REMEMBERED)
        self._gaps: deque[tuple[int, int]] = deque(maxlen=REMEMBERED)
        self.noticed: list[str] = []

    @property
    def end(self) -> int:
        """The tick after the last block."""
        return self._tick + self._rows

    def place(self, reading: BlockHeader) -> Place | None:
        """Position of a block; None if it is a duplicate, of an earlier run, or so late that its ticks already count as lost.
        Raises InstrumentError if the instrument was restarted, or the position cannot be determined."""
        key = (reading.counter, reading.sequence, reading.clock, reading.rows, reading.mark)
        if key in self._seen or self._is_early(reading):
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
        self._even = self._even and (self._last is None or reading.rows == self._rows)
        self._last, self._rows = reading, reading.rows
        return place

    def possible(self, counted: int, host: float) -> bool:
        """Whether the instrument can have counted so many samples: at least those received, at most what the time allows."""
        return self.end <= counted and (self._last is None or self._is_possible(counted - self._tick, host))

    def _begin(self, reading: BlockHeader) -> Place:
        first = reading.counter if self._first is None else self._first
        self._counter = wrapped(reading.counter, first, self._wrap)
        self._clock, self._sequence = reading.clock or 0, reading.sequence or 0
        if self._counter < first or not self._is_possible(self._counter - first, reading.host):
            raise InstrumentError(
                f"{self._who} started counting at {reading.counter} but announced {first}; switch it off and on, then resume"
            )
        self._tick = self._counter - first
        return Place(tick=self._tick, seconds=self._seconds(reading), status=Status.GOOD)

    def _steps(self, reading: BlockHeader) -> _Steps:
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
        known = sequence is not None and sequence >= 1 and (sequence == 1 or self._even)
        return _Steps(
            counter=counter - self._counter, clock=clock, sequence=sequence,
            frames=self._rows * sequence if known and sequence is not None else None,
        )  # fmt: skip

    def _follow(self, reading: BlockHeader, steps: _Steps) -> Place:
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

    def _step(self, reading: BlockHeader, steps: _Steps) -> tuple[int, Status]:
        counter, clock = steps.counter, steps.clock
        forward = counter >= self._rows and self._is_possible(counter, reading.host)
        timed = clock is not None and self._near(counter, clock)
        numbered = steps.sequence is None or steps.sequence >= 1
        if forward and numbered and (clock is None or timed):
            return counter, Status.GOOD
        if forward and (timed or counter == steps.frames):
            return counter, Status.DISAGREES
        frames = steps.frames
        if clock is not None and frames is not None and self._near(frames, clock) and self._is_possible(frames, reading.host):
            return frames, Status.DISAGREES
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

    def _is_late(self, steps: _Steps, reading: BlockHeader) -> bool:
        first = self._tick + steps.counter
        return any(first >= begin and first + reading.rows <= end for begin, end in self._gaps) and (
            steps.clock is None or self._near(steps.counter, steps.clock)
        )

    def _is_early(self, reading: BlockHeader) -> bool:
        # Soon after the start, a block after a gap whose samples cannot have been taken yet: it is of an earlier run.
        passed = reading.host - self._began
        if not self._real_time or self._rate is None or self._first is None or passed > TRANSIT:
            return False
        tick = wrapped(reading.counter, self._first + self.end, self._wrap) - self._first
        return tick > self.end and tick + reading.rows > FASTEST * (passed + GRAIN) * self._rate

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

    def _seconds(self, reading: BlockHeader) -> float | None:
        return None if reading.clock is None else self._clock * 1e-6

    def _notice(self, steps: _Steps, step: int) -> None:
        said = [f"its counter {steps.counter}"]
        if steps.clock is not None:
            said.append(f"its clock {steps.clock:.0f}")
        if steps.frames is not None:
            said.append(f"its frame numbers {steps.frames}")
        elif steps.sequence is not None:
            said.append(f"its frame number went by {steps.sequence}")
        self.noticed.append(f"at tick {self._tick} {', '.join(said)} samples on; {step} was used")
