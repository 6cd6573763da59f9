"""Zero-phase low-pass for records, and the frequency above which a record is only noise."""

from collections.abc import Sequence
from functools import lru_cache
from math import sqrt

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.rounding import rounding

#: Ratio of power to that of the noise above which a frequency bin belongs to the signal; number of bins averaged for it; share of
#: the spectrum from which on all belongs to it. Chosen: the second derivative of such a record has a few per cent of noise.
SIGNAL, AVERAGED, NEARLY_ALL = 30.0, 16, 0.9
#: Number of corner frequencies that are compared for a derivative, and the lowest as a share of the highest.
EDGES, LEAST_OF_EDGE = 40, 0.05
#: Largest share of the noise in the power of a derivative. Chosen: it makes a mass that is solved for a tenth too small.
NOISE_OF_DERIVATIVE = 0.1
#: Noise of a velocity as a share of its rms that a low-pass may pass. Chosen: less than the accuracy of a simulation.
SLOPE_NOISE = 0.003
#: The low-pass passes everything up to this share of its corner frequency, and nothing above `STOPS` times it.
PASSES, STOPS = 0.75, 1.25


def lowpass_gain(frequency: FloatArray, corner: float) -> FloatArray:
    """Gain of a zero-phase low-pass: half at `corner` Hz, with a raised-cosine edge around it; 1 if it is infinite."""
    if not np.isfinite(corner):
        return np.ones(len(frequency))
    place = np.clip((frequency / corner - PASSES) / (STOPS - PASSES), 0.0, 1.0)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * place))


def low_passed(values: FloatArray, rate: float, corner: float) -> FloatArray:
    """Records, shape (n, ...), through the low-pass of `lowpass_gain`, mirrored about their ends."""
    if not np.isfinite(corner):
        return values
    n = len(values)
    whole = mirrored(values)
    gain = _gain(len(whole), rate, corner)
    return np.fft.irfft(np.fft.rfft(whole, axis=0) * gain.reshape(-1, *([1] * (values.ndim - 1))), len(whole), axis=0)[:n]


@lru_cache(maxsize=8)
def _gain(n: int, rate: float, corner: float) -> FloatArray:
    # `lowpass_gain` in the bins of a record of n samples.
    return lowpass_gain(np.asarray(np.fft.rfftfreq(n, 1.0 / rate), dtype=np.float64), corner)


def smoothed(values: FloatArray, rate: float, corner: float) -> FloatArray:
    """A record of positions or velocities, shape (n,), through the same low-pass; it continues beyond its ends without a kink."""
    whole, line = about_line(values)
    gain = lowpass_gain(np.asarray(np.fft.rfftfreq(len(whole), 1.0 / rate), dtype=np.float64), corner)
    return np.asarray(np.fft.irfft(np.fft.rfft(whole) * gain, len(whole))[: len(values)] + line)


def about_line(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A record, shape (n,), minus the line between its ends, with its odd mirror image (`mirrored`), and that line."""
    line = np.linspace(values[0], values[-1], len(values))
    odd = values - line
    return mirrored(odd, -1.0), line


def mirrored(values: FloatArray, sign: float = 1.0) -> FloatArray:
    """Records, shape (n, ...), that continue as their mirror images, times `sign`, beyond both ends of a period.

    The period is the next length above 2 n - 3 with a fast Fourier transform; a large prime factor takes several times the time.
    What is mirrored about the two ends meets half a record away from both.
    """
    from scipy.fft import next_fast_len

    n = len(values)
    if n < 3:
        return values
    beyond = next_fast_len(2 * n - 2, real=True) - n
    after = beyond // 2
    return np.concatenate([values, sign * values[n - 1 - after : n - 1][::-1], sign * values[1 : beyond - after + 1][::-1]])


def fast_length(samples: int) -> int:
    """The next smaller number of samples with a fast Fourier transform; a large prime factor takes several times the time."""
    from scipy.fft import prev_fast_len

    return prev_fast_len(samples) if samples > 0 else 0


def signal_edge(values: FloatArray, rate: float) -> float:
    """Highest frequency in Hz at which a record, shape (n,), exceeds its noise; infinite if it does everywhere.

    The noise is assumed white; its level is the median power in the highest sixth of the spectrum (ln 2 times its mean). That of
    rounding to counts is not: at a steady speed the counts follow each other regularly, at a frequency far above the motion.
    """
    power, noise, first = _with_noise(values, rate)
    return max(first, _edge(power, noise, rate))


def derivative_edge(records: Sequence[FloatArray], rate: float, derivatives: int) -> float:
    """The same for records, each shape (n,), of which `derivatives` are taken.

    At most the highest of them, and so low that noise is at most `NOISE_OF_DERIVATIVE` of the derivatives' power in all together:
    a resonance may exceed the noise where a record is noise between it and a slow motion.
    """
    spectra = [_with_noise(values, rate) for values in records]
    edges = [max(first, _edge(power, noise, rate)) for power, noise, first in spectra]
    edge = max((each for each in edges if np.isfinite(each)), default=np.inf)
    if not np.isfinite(edge):
        return edge
    candidates = np.geomspace(edge, LEAST_OF_EDGE * edge, EDGES)
    powers = np.zeros((2, EDGES))
    for values, (power, noise, _) in zip(records, spectra, strict=True):
        frequency = np.arange(len(power)) * rate / 2.0 / (len(power) - 1)
        gains = np.stack([lowpass_gain(frequency, each) for each in candidates])
        weight = gains**2 * frequency ** (2 * derivatives) / len(values)
        powers += weight @ power, weight @ np.broadcast_to(noise, power.shape)
    clean = np.flatnonzero(powers[1] <= NOISE_OF_DERIVATIVE * powers[0])
    return float(candidates[clean[0]]) if len(clean) else edge


def _with_noise(values: FloatArray, rate: float) -> tuple[FloatArray, FloatArray | float, float]:
    # Power of a record and of its noise in the bins of numpy's rfft, and for counts a frequency in Hz that surely exceeds it.
    power, noise = _spectrum(values)
    averaged, step = _averaged(power), sqrt(12.0) * rounding(values)
    strongest = int(np.argmax(averaged))
    below = averaged[strongest:] <= SIGNAL * noise
    if step == 0.0 or not below.any():
        return power, noise, 0.0
    first = float(strongest + np.argmax(below)) / (len(power) - 1) * rate / 2.0
    motion = low_passed(values, rate, first / PASSES) - values[0]
    of_counts, _ = _spectrum(step * np.round(motion / step) - motion)
    return power, np.maximum(noise, _averaged(of_counts)), first


def force_edge(force: FloatArray, motion: FloatArray, rate: float, mass: float, derivatives: int) -> float:
    """Highest frequency in Hz at which a force exceeds what the noise of a motion becomes as an inertia force; 0 if nowhere.

    Where friction or cogging holds a body, the force has content at frequencies at which the body hardly moves. The records of
    the force in N and of the body's motion have shape (n,), at a rate in Hz; the motion needs one or two `derivatives` to become
    the acceleration of the mass in kg.
    """
    (power, _), (_, noise) = _spectrum(force), _spectrum(motion)
    omega = np.pi * rate * np.arange(len(power)) / (len(power) - 1)
    above = _averaged(power) > SIGNAL * noise * mass**2 * omega ** (2 * derivatives)
    return float(np.flatnonzero(above).max(initial=0)) / (len(power) - 1) * rate / 2.0


def velocity_corner(values: FloatArray, rate: float) -> float:
    """Corner frequency in Hz of the low-pass for a record of positions, shape (n,), before it is differentiated.

    What it passes of the noise is `SLOPE_NOISE` of the velocity, and it passes the record up to its `signal_edge`. Infinite if
    the noise is less in all, or the record exceeds it everywhere.
    """
    power, noise = _spectrum(values)
    edge = _edge(power, noise, rate)
    if not np.isfinite(edge):
        return np.inf
    frequency = np.arange(len(power)) * rate / len(values)
    velocity = float((power * frequency**2)[frequency <= edge].sum())
    passed = np.cumsum(noise * frequency**2) <= SLOPE_NOISE**2 * velocity
    return np.inf if passed[-1] else max(float(frequency[passed][-1]), edge / PASSES)


def _spectrum(values: FloatArray) -> tuple[FloatArray, float]:
    # Power of a record in the bins of numpy's rfft, and that of its noise in each.
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    return power, float(np.median(power[-len(power) // 6 :])) / np.log(2.0)


def _averaged(power: FloatArray) -> FloatArray:
    return np.convolve(power, np.ones(AVERAGED) / AVERAGED, mode="same")


def _edge(power: FloatArray, noise: FloatArray | float, rate: float) -> float:
    edge = float(np.flatnonzero(_averaged(power) > SIGNAL * noise).max(initial=0)) / (len(power) - 1)
    return edge * rate / 2.0 if np.any(noise > 0.0) and 0.0 < edge < NEARLY_ALL else np.inf
