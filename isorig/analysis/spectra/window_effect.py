"""The window through which a transfer function was estimated, and the accuracy of each frequency bin."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial
from typing import Any

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.spectra.welch import FEWEST, Frf
from isorig.analysis.spectra.windows import Window

#: With fewer averages, a bin's own coherence is too uncertain for its weight: it is averaged over neighbouring bins.
AVERAGES, NEIGHBOURS = 100.0, 50.0
#: Below this size (exp(z) - 1 - z) / z^2 is computed from its series, whose terms z^k / (k + 2)! fall below rounding.
NEAR, SERIES = 0.1, [1.0 / factorial(k + 2) for k in reversed(range(9))]


@dataclass(frozen=True, kw_only=True)
class WindowEffect:
    """The window of an estimated transfer function.

    The window of the segments and their duration in s, none for transforms of whole records, and the rate of an exponential
    window, 1/s.
    """

    window: Window | None = None
    span: float = 0.0
    decay: float = 0.0

    @classmethod
    def of(cls, frf: Frf) -> WindowEffect:
        """That of an estimate."""
        return cls(window=frf.window, span=1.0 / frf.resolution, decay=frf.decay)

    def s(self, f: FloatArray) -> ComplexArray:
        """The Laplace variable at frequencies in Hz."""
        return np.asarray(self.decay + 2j * np.pi * f)

    def pole(self, f: FloatArray, pole: complex | ComplexArray) -> ComplexArray:
        """1 / (s - pole) at frequencies in Hz, of a pole or of poles that broadcast with them.

        With a window: the transform of exp(pole t), t > 0, times the window's autocorrelation, which is a sum of the transforms
        of (1 - u) exp(z u) and exp(z u), u = t / span from 0 to 1.
        """
        if self.window is None:
            return np.asarray(1.0 / (self.s(f) - pole))
        z: ComplexArray = np.asarray((pole - self.s(f)) * self.span)
        # exp(z + 2 pi i m) is exp(z).
        grown = np.expm1(z)
        ramps, flats = self.window.lag_terms
        weights = dict(flats)
        total = np.zeros(z.shape, dtype=np.complex128)
        for m, a in ramps:
            shifted = z + 2j * np.pi * m
            ramp, b = _ramp(shifted, grown), weights.get(m, 0.0)
            # A flat term is 1 + z ramp.
            total += (a + b * shifted) * ramp + b
        return np.asarray(self.span * total)


def _ramp(z: ComplexArray, grown: ComplexArray) -> ComplexArray:
    # (exp(z) - 1 - z) / z^2; near zero the quotient loses precision, the series does not.
    near = np.abs(z) < NEAR
    safe = np.where(near, 1.0, z)
    ramp = np.asarray((grown - safe) / safe**2)
    if near.any():
        ramp[near] = np.polyval(SERIES, z[near])
    return ramp


def pole_of(frequency: Any, damping: Any) -> Any:
    """The pole (1/s) of a natural frequency (Hz) and a damping ratio below 1, or of arrays of them."""
    return 2.0 * np.pi * frequency * (-damping + 1j * np.sqrt(np.maximum(1.0 - damping**2, 1e-12)))


def bin_variance(frf: Frf) -> FloatArray:
    """Variance of the real and of the imaginary part in each frequency bin by its own coherence, shape (bins,).

    A single average does not determine its errors: all bins then have the same variance.
    """
    size = np.abs(frf.value)
    if frf.averages < FEWEST:
        return np.full(len(size), np.mean(size**2))
    variance = frf.magnitude_std**2 * frf.averages / max(frf.averages - 1.0, 1.0)
    return np.asarray(np.maximum(variance, 1e-24 * size.max() ** 2), dtype=np.float64)


def bin_deviation(frf: Frf) -> FloatArray:
    """Standard deviation of the real and of the imaginary part in each frequency bin, shape (bins,).

    With few averages a bin's own coherence is too uncertain for its weight; it is then averaged over neighbouring bins.
    """
    variance = bin_variance(frf)
    if FEWEST <= frf.averages < AVERAGES:
        width = 2 * int(np.ceil(NEIGHBOURS / frf.averages)) + 1
        share = np.convolve(np.ones(len(variance)), np.ones(width), "same")
        variance = np.convolve(variance, np.ones(width), "same") / share
    return np.sqrt(variance)
