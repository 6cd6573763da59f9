"""Motion from records: integration of accelerations in the frequency domain, accelerations from displacements."""

import numpy as np

from isorig.analysis.campaign import MOTION, FloatArray, Quantity


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


def acceleration_of(values: FloatArray, quantity: Quantity, rate: float) -> FloatArray:
    """Acceleration (m/s^2) of a record of acceleration, velocity or displacement, shape (n,)."""
    for _ in range(2 - MOTION[quantity]):
        values = np.gradient(values, 1.0 / rate)
    return values
