"""Filters of attached resonators and rocking bodies."""

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray

#: Rocking: damping ratio.
ROCKING_DAMPING = 0.035


def resonator(omega: FloatArray, frequency: float, damping: float) -> ComplexArray:
    """Inertia force of an attached resonator per unit mass and acceleration of its base."""
    own = 2.0 * np.pi * frequency
    return np.asarray(
        (own**2 + 2j * damping * own * omega) / (own**2 - omega**2 + 2j * damping * own * omega), dtype=np.complex128
    )


def rocker(omega: FloatArray, frequency: float) -> ComplexArray:
    """Angular acceleration of a rocking body per unit torque and inertia."""
    own = 2.0 * np.pi * frequency
    return np.asarray(omega**2 / (own**2 - omega**2 + 2j * ROCKING_DAMPING * own * omega), dtype=np.complex128)


def filtered(spectrum: ComplexArray, n: int, rate: float, mode: tuple[float, float]) -> FloatArray:
    """The acceleration of a base, by the spectrum of its n samples, through an attached resonator, shape (n,)."""
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(n, 1.0 / rate), dtype=np.float64)
    return np.asarray(np.fft.irfft(spectrum * resonator(omega, *mode), n))


def rocked(force: FloatArray, rate: float, frequency: float) -> list[FloatArray]:
    """Angle of a body that a force makes rock, and its two derivatives relative to the natural frequency; each shape (n,)."""
    n = len(force)
    ratio = np.fft.rfftfreq(n, 1.0 / rate) / frequency
    angle = np.fft.rfft(force) / (1.0 - ratio**2 + 2j * ROCKING_DAMPING * ratio)
    return [np.asarray(np.fft.irfft(angle * factor, n)) for factor in (1.0, 1j * ratio, -(ratio**2))]
