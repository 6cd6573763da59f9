"""Synthetic drives: band-limited noise, odd random-phase multisines, sweeps, consecutive moves."""

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import DataError


def random(*, samples: int, sample_rate: float, rms: float, band: tuple[float, float], seed: int) -> FloatArray:
    """Gaussian noise with this rms and a flat spectrum within `band` (Hz), shape (samples,)."""
    frequency = np.fft.rfftfreq(samples, 1.0 / sample_rate)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    if not inside.any():
        raise DataError(f"the band {band[0]:g} to {band[1]:g} Hz contains no frequency bin at {sample_rate:g} Hz; widen it")
    generator = np.random.default_rng(seed)
    spectrum = (generator.normal(size=len(frequency)) + 1j * generator.normal(size=len(frequency))) * inside
    values = np.fft.irfft(spectrum, samples)
    return np.asarray(values * (rms / values.std()))


def multisine(
    *, period: int, periods: int, sample_rate: float, rms: float, band: tuple[float, float], seed: int
) -> tuple[FloatArray, FloatArray]:
    """Odd random-phase multisine with a random one of every four odd harmonics omitted, and the excited frequencies in Hz.

    The omitted odd harmonics show odd distortion, the even ones even distortion (Pintelon and Schoukens, System
    Identification, 2012, ch. 4).
    """
    lines = np.arange(1, period // 2, 2)
    frequency = lines * sample_rate / period
    lines = lines[(frequency >= band[0]) & (frequency <= band[1])]
    if len(lines) == 0:
        raise DataError(f"the band {band[0]:g} to {band[1]:g} Hz contains no odd harmonic of a period of {period} samples")
    generator = np.random.default_rng(seed)
    kept = np.concatenate(
        [np.delete(g, generator.integers(len(g))) if len(g) == 4 else g for g in np.array_split(lines, max(len(lines) // 4, 1))]
    )
    spectrum = np.zeros(period // 2 + 1, dtype=np.complex128)
    spectrum[kept] = np.exp(2j * np.pi * generator.random(len(kept)))
    values = np.fft.irfft(spectrum, period)
    return np.tile(values * (rms / values.std()), periods), kept * sample_rate / period


def sweep(
    *, samples: int, sample_rate: float, peak: float, band: tuple[float, float], of: int | None = None, first: int = 0
) -> FloatArray:  # fmt: skip
    """Logarithmic sine sweep from band[0] to band[1] Hz over `of` samples (all if None), from its sample `first` on."""
    t = (first + np.arange(samples)) / sample_rate
    rate = np.log(band[1] / band[0]) * sample_rate / ((of or samples) - 1)
    return np.asarray(peak * np.sin(2 * np.pi * band[0] * np.expm1(rate * t) / rate))


def sine(*, samples: int, sample_rate: float, peak: float, frequency: float, start: float = 0.0) -> FloatArray:
    """A sine of `frequency` (Hz) that starts at `start` s, shape (samples,)."""
    t = np.arange(samples) / sample_rate - start
    return np.where(t >= 0.0, peak * np.sin(2 * np.pi * frequency * t), 0.0)


def half_sine(*, samples: int, sample_rate: float, peak: float, length: float, start: float = 0.0) -> FloatArray:
    """One half sine of `length` seconds that starts at `start`, shape (samples,)."""
    t = np.arange(samples) / sample_rate - start
    return np.where((t >= 0.0) & (t <= length), peak * np.sin(np.pi * t / length), 0.0)


def hits(*, samples: int, sample_rate: float, peak: float, length: float, every: float, start: float, seed: int) -> FloatArray:
    """Hammer hits, shape (n,): half sines of `length` seconds, one in `every` seconds from `start` on.

    As with a hand-held hammer, the peaks vary at random within a fifth of `peak`.
    """
    generator = np.random.default_rng(seed)
    times = np.arange(start, samples / sample_rate - length, every)
    sizes = peak * generator.uniform(0.8, 1.2, len(times))
    return np.asarray(
        sum(
            (
                half_sine(samples=samples, sample_rate=sample_rate, peak=float(size), length=length, start=float(time))
                for time, size in zip(times, sizes, strict=True)
            ),
            np.zeros(samples),
        )
    )


def moves(
    *, samples: int, sample_rate: float, distance: float = 3e-3, peak: float = 12.5, pause: float = 0.05,
    start: float = 0.25,
) -> FloatArray:  # fmt: skip
    """Consecutive moves of `distance` (m), each one period of a sine of acceleration, with pauses (s) between.

    A sine of acceleration of period T and peak a moves a T^2 / (2 pi).
    """
    period = float(np.sqrt(2.0 * np.pi * distance / peak))
    t = np.arange(samples) / sample_rate - start
    within = np.mod(t, period + pause)
    moving = (t >= 0.0) & (within < period)
    return np.where(moving, peak * np.sin(2.0 * np.pi * within / period), 0.0)


def steps(
    *, samples: int, sample_rate: float, distance: float = 3e-3, peak: float = 12.5, pause: float = 0.7, start: float = 0.25,
) -> FloatArray:  # fmt: skip
    """Moves back and forth by `distance` (m), accelerated in the first half and decelerated in the second, with long pauses.

    A constant acceleration of `peak` one way and then the other for T / 2 each moves peak T^2 / 4. The pauses (s) are long
    enough for the rig to come to rest.
    """
    period = 2.0 * float(np.sqrt(distance / peak))
    t = np.arange(samples) / sample_rate - start
    within = np.mod(t, period + pause)
    way = np.where(np.mod(np.floor_divide(t, period + pause), 2.0) == 0.0, 1.0, -1.0)
    pushed = np.where(within < 0.5 * period, peak, -peak)
    return np.where((t >= 0.0) & (within < period), way * pushed, 0.0)
