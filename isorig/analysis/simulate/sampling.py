"""Conversion between samples and the fine grid: band-limited interpolation, differentiating decimation, delays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import DataError
from isorig.analysis.given import all_of_type, flag, number, numbers, positive, whole
from isorig.analysis.jit import fast_kernel
from isorig.analysis.lowpass import smoothed

#: Half the length of the filters, in samples.
TAPS = 20
#: Share of the sample rate up to which the filter of the simulation's samples is flat, and the width in which `within` falls off.
FLAT, FALL = 0.42, 0.06
#: Attenuation of that filter above it, dB.
ATTENUATION = 80.0
#: Number of values that are filtered at a time: those of eight phases fit into the processor's first cache.
PART = 512
#: Largest corner frequency of a high-pass, as a share of the sample rate: a digital filter has none from one half on.
HIGHEST_CORNER = 0.49
#: Samples, besides the delay, for which a delayed signal keeps its values beyond its ends: the interpolation has died away then.
HELD = 32
#: Time constants after which a first-order filter has forgotten. Derived: to a billionth.
SETTLED = 21.0
#: Most steps per sample. Chosen: at a thousandth of the sample interval, the engine's error is far below rounding of a record.
STEPS_MOST = 1024
#: Number of samples kept after the end of a shortened drive.
AFTER = 256
#: Linear interpolation between values attenuates a spectrum by sinc^2; this filter compensates it to fourth order in the step.
STRAIGHTENED = np.array([-1.0, 14.0, -1.0]) / 12.0
#: No compensation, for other kinds of interpolation.
AS_IT_IS = np.ones(1)
#: Central differences: of fourth order in the step, and of second order for use without a filter.
SLOPE = np.array([-1.0, 8.0, 0.0, -8.0, 1.0]) / 12.0
PLAIN = np.array([0.5, 0.0, -0.5])


def _windowed(half: int, share: float, beta: float) -> FloatArray:
    """Low-pass of 2 half + 1 taps by the Kaiser window; it falls to one half at `share` of half the sample rate."""
    taps = np.sinc(share * np.arange(-half, half + 1)) * np.kaiser(2 * half + 1, beta)
    return np.asarray(taps / taps.sum())


@lru_cache(maxsize=16)
def _lowpass(factor: int) -> FloatArray:
    return _windowed(TAPS * factor, 1.0 / factor, 10.0) if factor > 1 else np.ones(1)


@fast_kernel
def convolve(taps: FloatArray, x: FloatArray, out: FloatArray) -> None:
    """Add to out[k] the sum of taps[q] x[k + len(taps) - 1 - q]; four taps at a time, in parts that stay in the cache."""
    count = len(taps)
    for first in range(0, len(out), PART):
        part = out[first : first + PART]
        for q in range(0, count - 3, 4):
            a, b, c, d = taps[q], taps[q + 1], taps[q + 2], taps[q + 3]
            at = first + count - 4 - q
            seen, after, then, last = x[at:], x[at + 1 :], x[at + 2 :], x[at + 3 :]
            for k in range(len(part)):
                part[k] += a * last[k] + b * then[k] + c * after[k] + d * seen[k]
        for q in range(count - count % 4, count):
            a, seen = taps[q], x[first + count - 1 - q :]
            for k in range(len(part)):
                part[k] += a * seen[k]


def interpolate(x: FloatArray, factor: int, joined: FloatArray = STRAIGHTENED) -> FloatArray:
    """Band-limited interpolation by an integer factor, shape (n * factor,); by default compensated for linear interpolation."""
    if factor == 1:
        return x
    h = np.convolve(_lowpass(factor) * factor, joined)
    lead = TAPS * factor + len(joined) // 2
    padded, out = np.pad(x, 2 * TAPS + 2), np.zeros((factor, len(x)))
    for phase in range(factor):
        before, first = divmod(lead + phase, factor)
        taps = h[first::factor].copy()
        convolve(taps, padded[2 * TAPS + 3 + before - len(taps) :], out[phase])
    return out.T.ravel()


def as_held(x: FloatArray, factor: int) -> FloatArray:
    """A command held from each sample to the next, shape (n * factor,): each jump is linear, over the two steps around it."""
    fine = np.repeat(x, factor)
    fine[factor::factor] = 0.5 * (x[1:] + x[:-1])
    return fine


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """A drive prepared once for many simulations.

    Parameters
    ----------
    recorded
        The drive channel as recorded, in its unit, shape (n,).
    sample_rate
        Hz.
    oversample
        Fine steps per sample.
    fine
        The drive on the fine grid, shape (n * oversample,); with linear interpolation it has the drive's spectrum.
    others
        Further drives of the same rig, in the rig's order.
    held
        Whether the record is a command, which a converter holds from each sample to the next. All others are band-limited.
    corner
        Corner frequency in Hz of the low-pass that leaves out what is noise in a recorded position or velocity: its derivatives
        would be noise. Infinite for none.

    Examples
    --------
    >>> import numpy as np
    >>> import isorig as iso
    >>> drive = iso.Excitation.prepare(np.sin(2 * np.pi * 8.0 * np.arange(1024) / 1024), 1024.0)
    >>> drive.fine.shape
    (8192,)
    """

    recorded: FloatArray
    sample_rate: float
    oversample: int
    fine: FloatArray
    others: tuple[Excitation, ...] = ()
    held: bool = False
    corner: float = np.inf

    @property
    def step(self) -> float:
        """Duration of a fine step, s."""
        return 1.0 / (self.sample_rate * self.oversample)

    def __repr__(self) -> str:
        more = f", {len(self.others)} more drives" if self.others else ""
        return f"Excitation({len(self.recorded)} samples at {self.sample_rate:g} Hz, rms {np.std(self.recorded):.3g}{more})"

    @classmethod
    def prepare(
        cls, drive: FloatArray, sample_rate: float, *, oversample: int = 8, others: Sequence[FloatArray] = (), held: bool = False,
        corner: float = np.inf,
    ) -> Excitation:  # fmt: skip
        """Interpolate a drive with a band-limited filter, or as a command that is held.

        Raises
        ------
        ArgumentError
            The drive is not an array of numbers, or the rate not a number.
        DataError
            If the drive is shorter than two samples or not finite, or the rate is not positive.
        """
        recorded, sample_rate = numbers(drive, "the drive"), positive(sample_rate, "the sample rate", " Hz")
        oversample, held = whole(oversample, "the number of steps per sample", 1, STEPS_MOST), flag(held, "the argument held")
        if not (corner := number(corner, "the corner frequency")) > 0.0:
            raise DataError(f"the corner frequency is {corner:g} Hz, but must be positive; leave it out for no low-pass")
        all_of_type(others, object, "the argument others", "a sequence of arrays; give for example [VALUES]")
        if recorded.ndim != 1 or len(recorded) < 2:
            raise DataError(f"the drive has shape {recorded.shape}; give one record of at least two samples")
        if not np.isfinite(recorded).all():
            raise DataError("the drive holds values that are not finite; cut or measure it again")
        if np.isfinite(corner):
            recorded = smoothed(recorded, sample_rate, corner)
        fine = _on_grid(recorded, oversample, held=held)
        further = tuple(cls.prepare(other, sample_rate, oversample=oversample) for other in others)
        return cls(
            recorded=recorded, sample_rate=sample_rate, oversample=oversample, fine=fine, others=further, held=held, corner=corner
        )

    def resampled(self, oversample: int) -> Excitation:
        """The same drive on another grid.

        Raises
        ------
        ArgumentError
            The number of steps per sample is no whole number.
        DataError
            It is less than one, or more than `STEPS_MOST`.
        """
        oversample = whole(oversample, "the number of steps per sample", 1, STEPS_MOST)
        if oversample == self.oversample:
            return self
        others = tuple(other.resampled(oversample) for other in self.others)
        fine = _on_grid(self.recorded, oversample, held=self.held)
        return replace(self, oversample=oversample, fine=fine, others=others)

    def with_drive(self, recorded: FloatArray) -> Excitation:
        """Another record of the first drive on the same grid, shape (n,)."""
        fresh = Excitation.prepare(
            recorded, self.sample_rate, oversample=self.oversample, held=self.held, corner=self.corner
        )  # fmt: skip
        return replace(fresh, others=self.others)

    def beginning(self, samples: int) -> Excitation:
        """The first samples of the same drive, and the further ones that filters and delays need.

        Raises
        ------
        ArgumentError
            Their number is no whole number.
        DataError
            It is negative.
        """
        kept = whole(samples, "the number of samples", 0) + AFTER
        others = tuple(other.beginning(samples) for other in self.others)
        return replace(self, recorded=self.recorded[:kept], fine=self.fine[: kept * self.oversample], others=others)


def _on_grid(recorded: FloatArray, oversample: int, *, held: bool) -> FloatArray:
    return as_held(recorded, oversample) if held else interpolate(recorded, oversample)


@lru_cache(maxsize=16)
def _sampler(factor: int, differentiate: bool) -> FloatArray:
    # By phase: row p has every `factor`-th tap from the p-th on, shape (factor, taps).
    h = _lowpass(factor)
    g = np.convolve(h, SLOPE if factor > 1 else PLAIN) if differentiate else h
    # Leading zeros align the filter's centre with the decimated grid.
    aligned = np.concatenate([np.zeros(-(len(g) // 2) % factor), g])
    return np.pad(aligned, (0, -len(aligned) % factor)).reshape(-1, factor).T.copy()


@fast_kernel
def decimate(taps: FloatArray, fine: FloatArray, lead: int, phases: FloatArray, out: FloatArray) -> None:
    """Filter fine values by phase and decimate, in parts whose values stay in the cache.

    Parameters
    ----------
    taps
        By phase, shape (factor, taps).
    fine
        Shape (steps,); before its start it is taken as constant, after its end as linear.
    lead
        Number of samples by which the filter's output is advanced.
    phases
        Memory for a part's values by phase, shape (factor, `PART` + taps - 1).
    out
        The filtered values minus the first fine value; zero before, shape (n,).
    """
    factor, count = taps.shape
    begun, end, slope, steps = fine[0], fine[-1] - fine[0], fine[-1] - fine[-2], len(fine)
    for first in range(0, len(out), PART):
        part = out[first : first + PART]
        for phase in range(factor):
            at, line = (lead + first - count + 1) * factor - phase, phases[phase]
            for i in range(len(part) + count - 1):
                k = at + i * factor
                line[i] = 0.0 if k < 0 else fine[k] - begun if k < steps else end + (k - steps + 1) * slope
            convolve(taps[phase], line, part)


def sampled(fine: FloatArray, factor: int, n: int, h: float, *, differentiate: bool) -> FloatArray:
    """Low-pass (linear phase, -6 dB at half the sample rate) and decimate; with `differentiate` the derivative.

    Accelerations are differentiated from velocities: they jump where friction reverses, and a sampled jump aliases, while
    velocities are continuous. Before the record's start the motion is constant at its first value; after its end it is
    extrapolated linearly.
    """
    taps = _sampler(factor, differentiate)
    lead = TAPS + (1 if differentiate and factor > 1 else 0)
    if factor == 1:
        lead = 1 if differentiate else 0
    out = np.zeros(n)
    decimate(taps / h if differentiate else taps, fine, lead, np.empty((factor, PART + taps.shape[1] - 1)), out)
    return out if differentiate else out + float(fine[0])


@lru_cache(maxsize=16)
def _passing(share: float) -> FloatArray:
    # Kaiser's formulas for the width of the fall and the attenuation above it.
    half = int(np.ceil((ATTENUATION - 7.95) / (2.285 * np.pi * 2.0 * FALL) / 2.0))
    return _windowed(half, 2.0 * share + FALL, 0.1102 * (ATTENUATION - 8.7))


def within(x: FloatArray, highest: float, rate: float) -> FloatArray:
    """Signals without their content above a frequency in Hz, shape (..., n): linear phase, no delay, zero beyond the ends."""
    taps, out = _passing(highest / rate), np.zeros(x.shape)
    for signal, filtered in zip(x.reshape(-1, x.shape[-1]), out.reshape(-1, x.shape[-1]), strict=True):
        convolve(taps, np.pad(signal, len(taps) // 2), filtered)
    return out


def high_passed(x: FloatArray, corner: float, rate: float) -> FloatArray:
    """A signal behind a first-order high-pass of this corner frequency in Hz, shape (n,), charged by its first value."""
    from scipy.signal import butter, lfilter

    b, a = butter(1, min(corner, HIGHEST_CORNER * rate), "highpass", fs=rate)
    return np.asarray(lfilter(b, a, x - x[0]))


def recharged(x: FloatArray, corner: float, rate: float) -> FloatArray:
    """The inverse of `high_passed`, up to a straight line: what the high-pass takes away is the integral of what it passes."""
    passed = x - x.mean()
    return np.asarray(passed + 2.0 * np.tan(np.pi * min(corner / rate, HIGHEST_CORNER)) * (np.cumsum(passed) - 0.5 * passed))


def shift(x: FloatArray, delay: float, rate: float) -> FloatArray:
    """x(t - delay), band-limited, by a phase shift of the spectrum; beyond its ends x keeps its first and last value."""
    return x if delay == 0.0 else _passed(x, rate, abs(delay), lambda f: np.exp(-2j * np.pi * delay * f))


def lagging(x: FloatArray, cutoff: float, rate: float) -> FloatArray:
    """A band-limited signal behind an analog first-order low-pass of this corner frequency in Hz, shape (n,).

    Before its start x has its first value.
    """
    return _passed(x, rate, SETTLED / (2.0 * np.pi * cutoff), lambda f: 1.0 / (1.0 + 1j * f / cutoff))


def _passed(x: FloatArray, rate: float, reach: float, response: Callable[[FloatArray], Any]) -> FloatArray:
    # A signal through a filter that reaches so many seconds back or ahead, from its frequency response.
    n = len(x)
    held = int(np.ceil(reach * rate)) + HELD
    size = 1 << int(np.ceil(np.log2(n + 3 * held)))
    # Between the held values it changes without a jump, which would ring.
    fade = np.concatenate([np.zeros(held), 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, size - n - 2 * held)), np.ones(held)])
    whole = np.concatenate([x, x[-1] + (x[0] - x[-1]) * fade])
    f = np.asarray(np.fft.rfftfreq(size, 1.0 / rate), dtype=np.float64)
    return np.asarray(np.fft.irfft(np.fft.rfft(whole) * response(f), size)[:n])
