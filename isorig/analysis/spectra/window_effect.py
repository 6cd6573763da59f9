"""The window through which a transfer function was estimated, and the accuracy of each frequency bin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.spectra.welch import FEWEST, Frf
from isorig.analysis.spectra.windows import Window

#: With fewer averages, a bin's own coherence is too uncertain for its weight: it is averaged over neighbouring bins.
AVERAGES, NEIGHBOURS = 100.0, 50.0


@dataclass(frozen=True, kw_only=True)
class WindowEffect:
    """The window of an estimated transfer function.

    Parameters
    ----------
    window, span
        The window of the segments and their duration in s; none for transforms of whole records.
    decay
        Rate of an exponential window, 1/s.
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

    def pole(self, f: FloatArray, pole: complex) -> ComplexArray:
        """1 / (s - pole) at frequencies in Hz.

        With a window: the transform of exp(pole t), t > 0, times the window's autocorrelation, which is a sum of the transforms
        of (1 - u) exp(z u) and exp(z u), u = t / span from 0 to 1.
        """
        if self.window is None:
            return np.asarray(1.0 / (self.s(f) - pole))
        z: ComplexArray = np.asarray((pole - self.s(f)) * self.span)
        ramps, flats = self.window.lag_terms()
        total = sum(a * _ramp(z + 2j * np.pi * m) for m, a in ramps)
        return np.asarray(self.span * (total + sum(b * _flat(z + 2j * np.pi * m) for m, b in flats)))


def _flat(z: ComplexArray) -> ComplexArray:
    return np.asarray(np.expm1(z) / z)


def _ramp(z: ComplexArray) -> ComplexArray:
    # Near zero the quotient loses precision; the series does not.
    near = np.abs(z) < 1e-2
    safe = np.where(near, 1.0, z)
    series = 0.5 + z / 6.0 + z**2 / 24.0 + z**3 / 120.0 + z**4 / 720.0
    return np.asarray(np.where(near, series, (np.expm1(safe) - safe) / safe**2))


def pole_of(frequency: float, damping: float) -> complex:
    """The pole (1/s) of a natural frequency (Hz) and a damping ratio below 1."""
    omega = 2.0 * np.pi * frequency
    return complex(omega * (-damping + 1j * np.sqrt(max(1.0 - damping**2, 1e-12))))


def line_deviation(frf: Frf) -> FloatArray:
    """Standard deviation of the real and of the imaginary part in each frequency bin, shape (bins,).

    With few averages a bin's own coherence is too uncertain for its weight; it is then averaged over neighbouring bins. A single
    average does not determine its errors: all bins then have the same weight.
    """
    if frf.averages < FEWEST:
        return np.full(len(frf.value), float(np.sqrt(np.mean(np.abs(frf.value) ** 2))))
    width = 2 * int(np.ceil(NEIGHBOURS / frf.averages)) + 1 if frf.averages < AVERAGES else 1
    variance = frf.magnitude_std**2
    if width > 1:
        share = np.convolve(np.ones(len(variance)), np.ones(width), "same")
        variance = np.convolve(variance, np.ones(width), "same") / share
    variance = variance * frf.averages / max(frf.averages - 1.0, 1.0)
    return np.asarray(np.sqrt(np.maximum(variance, 1e-24 * float(np.max(np.abs(frf.value))) ** 2)), dtype=np.float64)
