"""Motion from records: integration of accelerations in the frequency domain, accelerations from displacements."""

from __future__ import annotations

import numpy as np

from isorig.analysis.campaign import MOTION, FloatArray, Quantity

#: Ratio of power to that of the noise above which a frequency bin belongs to the signal; number of bins averaged for it; share of
#: the spectrum from which on all belongs to it; order of the filter. Chosen: the second derivative of such a record has a few per
#: cent of noise.
SIGNAL, AVERAGED, NEARLY_ALL, ORDER = 30.0, 16, 0.9, 4


def integrals(acceleration: FloatArray, rate: float, band: tuple[float, float] | None) -> tuple[FloatArray, FloatArray]:
    """Velocity and displacement of an acceleration record, without frequencies below the drive's band."""
    n = len(acceleration)
    frequency = np.fft.rfftfreq(n, 1.0 / rate)
    spectrum = np.fft.rfft(acceleration)
    low = max(1.0, 1.5 * band[0]) if band is not None else 1.0
    omega = 2j * np.pi * np.maximum(frequency, low)
    spectrum[frequency < low] = 0.0
    return np.fft.irfft(spectrum / omega, n), np.fft.irfft(spectrum / omega**2, n)


def motion_of(
    values: FloatArray, quantity: Quantity, rate: float, band: tuple[float, float] | None
) -> tuple[FloatArray, FloatArray]:
    """Velocity (m/s) and displacement (m) of a record of acceleration, velocity or displacement, each shape (n,).

    For a rotation all are in rad.
    """
    if MOTION.get(quantity) == 0:
        return np.gradient(values, 1.0 / rate), values
    if MOTION.get(quantity) == 1:
        _, displacement = integrals(np.gradient(values, 1.0 / rate), rate, band)
        return values, displacement
    return integrals(values, rate, band)


def signal_edge(values: FloatArray) -> float:
    """Highest frequency at which a record exceeds its noise, as a share of half the sample rate; 1 if it does everywhere.

    The noise is assumed white; its level is the median power in the highest sixth of the spectrum (ln 2 times its mean).
    """
    n = len(values)
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(n))) ** 2
    noise = float(np.median(power[-len(power) // 6 :])) / np.log(2.0)
    smoothed = np.convolve(power, np.ones(AVERAGED) / AVERAGED, mode="same")
    edge = 2.0 * float(np.flatnonzero(smoothed > SIGNAL * noise).max(initial=0)) / n
    return edge if noise > 0.0 and 0.0 < edge < NEARLY_ALL else 1.0


def low_passed(values: FloatArray, edge: float) -> FloatArray:
    """Records, shape (n, ...), without frequencies above a share of half the sample rate, without delay; unchanged if it is 1."""
    if edge == 1.0:
        return values
    from scipy.signal import butter, sosfiltfilt

    return np.asarray(sosfiltfilt(butter(ORDER, edge, output="sos"), values, axis=0))


def acceleration_of(values: FloatArray, quantity: Quantity, rate: float) -> FloatArray:
    """Acceleration (m/s^2) of a record of acceleration, velocity or displacement, shape (n,)."""
    for _ in range(2 - MOTION[quantity]):
        values = np.gradient(values, 1.0 / rate)
    return values
