"""The drive of a planned run at gain 1, computed in parts as the instrument requests them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.model.limits import Limits
from isorig.analysis.simulate.excitation import moves, multisine, random, sine, steps, sweep
from isorig.drivers.errors import SettingError
from isorig.drivers.instrument import Exciter, Stream, Values
from isorig.rig.acquire.plan import RunPlan
from isorig.rig.errors import PlanError
from isorig.rig.virtual.levels import HEAD_PER_GAIN, MOVE_PER_GAIN

#: Samples of a random drive computed at once; a longer drive consists of parts, cross-faded over this number of samples.
PART, FADE = 1 << 20, 1 << 14
#: Peak of a sine or sweep per unit of gain, m/s^2: as strong as a random drive.
SINE_PER_GAIN = 2.0**0.5 * HEAD_PER_GAIN


@dataclass(frozen=True)
class RunDrive:
    """The head's acceleration at gain 1, m/s^2, computed on demand, so that memory does not grow with the length of a run.

    `make` returns the samples from one index up to another; a periodic drive has a `period` in samples.
    """

    length: int
    make: Callable[[int, int], FloatArray]
    period: int | None = None

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, part: slice, /) -> FloatArray:
        start, stop, _ = part.indices(self.length)
        return self.make(start, max(stop, start))


def drive_of(run: RunPlan, repeat: int, sample_rate: float) -> RunDrive:
    """The drive of a run; each repeat is another realization.

    Runs that are driven by other means have one sample of value 0: an instrument outputs 0 after the end of its drive.
    """
    n = run.ticks(sample_rate)
    if not run.played:
        return RunDrive(1, lambda start, stop: np.zeros(stop - start))

    def shaped(shape: Callable[..., FloatArray], begin: float = 0.0, **values: Any) -> RunDrive:
        # A shape in time that starts at `begin`, s.
        def make(start: int, stop: int) -> FloatArray:
            return shape(samples=stop - start, sample_rate=sample_rate, start=begin - start / sample_rate, **values)

        return RunDrive(n, make)

    if run.excitation in ("moves", "steps"):
        return shaped(moves if run.excitation == "moves" else steps, 0.25, peak=MOVE_PER_GAIN)
    if run.frequency is not None:
        return shaped(sine, peak=SINE_PER_GAIN, frequency=run.frequency)
    assert run.band is not None  # the plan was checked
    if run.excitation == "sweep":
        whole = partial(sweep, sample_rate=sample_rate, peak=SINE_PER_GAIN, band=run.band, of=n)
        return RunDrive(n, lambda start, stop: whole(samples=stop - start, first=start))
    if run.excitation == "random":
        return RunDrive(n, _random(n, sample_rate, run.band, run.seed + repeat))
    period = round(run.period * sample_rate)
    values, _ = multisine(
        period=period, periods=1, sample_rate=sample_rate, rms=HEAD_PER_GAIN, band=run.band, seed=run.seed + repeat
    )
    return RunDrive(n, lambda start, stop: values[np.arange(start, stop) % period], period)


def check_limits(run: RunPlan, drive: Values, limits: Limits) -> None:
    """Compare the drive of a run with the limits that follow from the drive alone: gain, band, duration, magnitude. Raises
    PlanError if the run exceeds a limit."""
    for name, limit, found in (("gains", limits.gains, (run.gain, run.gain)), ("band", limits.band, run.band)):
        if limit is not None and found is not None and not limit[0] <= found[0] <= found[1] <= limit[1]:
            raise PlanError(
                f"run {run.id!r} has the {name.rstrip('s')} {found[0] if name == 'gains' else list(found)}; limits.{name} allows "
                f"{limit[0]:g} to {limit[1]:g}, so change the run"
            )
    if limits.seconds is not None and run.seconds > limits.seconds:
        raise PlanError(f"run {run.id!r} lasts {run.seconds:g} s; limits.seconds allows {limits.seconds:g}, so shorten it")
    if limits.drive is None or not run.played:
        return
    highest = max(float(np.abs(drive[at : at + PART]).max()) for at in range(0, len(drive), PART))
    if run.gain * highest > limits.drive:
        raise PlanError(
            f"run {run.id!r} drives the rig with up to {run.gain * highest:.3g} m/s^2; limits.drive allows {limits.drive:g}, so "
            "lower its gain"
        )


def load(instrument: Stream, run: RunPlan, drive: Values, limits: Limits) -> None:
    """Load the drive and gain of a run into an instrument that plays them. Raises SettingError if the run needs a drive and the
    instrument has no drive output; PlanError if the run exceeds a limit of the rig."""
    check_limits(run, drive, limits)
    if isinstance(instrument, Exciter):
        instrument.set_gain(run.gain)
        if instrument.load_drive(drive):
            return
    if run.played:
        raise SettingError(
            f"run {run.id!r} needs a drive and {instrument.identity} plays none; drive the rig by other means and call the "
            'excitation "other"'
        )


def _random(n: int, rate: float, band: tuple[float, float], seed: int) -> Callable[[int, int], FloatArray]:
    @lru_cache(maxsize=2)
    def part(k: int, length: int) -> FloatArray:
        own = seed if k == 0 else int(np.random.SeedSequence([seed, k]).generate_state(1)[0])
        return random(samples=length, sample_rate=rate, rms=HEAD_PER_GAIN, band=band, seed=own)

    if n <= PART:
        return lambda start, stop: part(0, n)[start:stop]

    # The two signals of a cross-fade are independent, so weights whose squares sum to one keep the power.
    rise = np.sin(0.5 * np.pi * (np.arange(FADE) + 0.5) / FADE)

    def make(start: int, stop: int) -> FloatArray:
        values = np.zeros(stop - start)
        for k in range(max(start - FADE, 0) // PART, (stop - 1) // PART + 1 if stop > start else 0):
            whole = part(k, PART + FADE).copy()
            if k:
                whole[:FADE] *= rise
            whole[PART:] *= rise[::-1]
            low, high = max(start, k * PART), min(stop, (k + 1) * PART + FADE)
            values[low - start : high - start] += whole[low - k * PART : high - k * PART]
        return values

    return make
