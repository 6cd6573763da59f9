"""Natural frequencies and damping ratios from transfer functions: a fit with the window's effect modelled.

For a broad-band drive an averaged H1 is the Fourier transform of the impulse response times the window's autocorrelation.
A mode's impulse response is exponential, so for the Hann window that transform has a closed form, and the fit sees the resonance
through the same window as the estimate did: its damping has no bias from the resolution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from analysis.errors import DataError, FitError
from analysis.leakage import error_moments, through
from analysis.measured import ComplexArray, FloatArray
from analysis.spectra import Frf

Kind = Literal["accelerance", "transmissibility", "general"]


@dataclass(frozen=True, kw_only=True)
class Mode:
    """A natural frequency (Hz) and a damping ratio with standard deviations, and the bandwidth 2 zeta f in lines."""

    frequency: float
    frequency_std: float
    damping: float
    damping_std: float
    lines: float


@dataclass(frozen=True, kw_only=True)
class ModalFit:
    """Modes fitted to a transfer function.

    Parameters
    ----------
    modes
        Ascending in frequency.
    kind
        What each mode's shape is.
    frequency, fitted
        Hz and the complex model as the window shows it, shape (lines,): to be drawn over the estimate.
    misfit
        rms of the weighted residuals; 1 where the error bars explain them.
    warning
        What to keep in mind, may be empty.
    """

    modes: tuple[Mode, ...]
    kind: Kind
    frequency: FloatArray
    fitted: ComplexArray
    misfit: float
    warning: str = ""


def fit_modes(
    frf: Frf, band: tuple[float, float], *, kind: Kind = "accelerance", guesses: Sequence[tuple[float, float]] = (),
    residuals: int = 2, tapered: bool = True,
) -> ModalFit:  # fmt: skip
    """Fit modes to the lines of a band, as the Hann window shows them.

    Parameters
    ----------
    frf
        Estimated with the Hann window (`analysis.spectra.estimate`), H1.
    band
        Hz: the lines that are fitted.
    kind
        accelerance: each mode is A s^2 / (s^2 + 2 zeta w s + w^2); transmissibility: A (2 zeta w s + w^2) over the same.
        A is real and fitted. general: any complex residue, for modes that damping couples, and complex residuals.
    guesses
        (frequency in Hz, damping ratio) of each mode; the highest peak in the band where none.
    residuals
        Terms for modes outside the band: 0 none, 1 a constant, 2 a constant and one that goes with frequency squared.
    tapered
        Whether the window's effect is modelled. Without it this is the ordinary fit, for comparison.

    Raises
    ------
    DataError
        Where the band holds too few lines.
    FitError
        Where the fit finds no mode inside the band.

    Notes
    -----
    Weights are the error bars. Deviations come from the covariance of the lines' errors, which the window correlates, and grow
    with a misfit above 1.
    """
    from scipy.optimize import least_squares

    kept = (frf.frequency >= band[0]) & (frf.frequency <= band[1]) & (frf.frequency > 0.0)
    f, value = frf.frequency[kept], frf.value[kept]
    guesses = guesses or _guess(f, np.abs(value), frf.resolution)
    if 2 * len(f) <= 4 * len(guesses) + 2 * residuals or len(f) < 5:
        raise DataError(
            f"the band {band[0]:g} to {band[1]:g} Hz holds {len(f)} lines, too few for {len(guesses)} modes; "
            "widen it or take a finer resolution"
        )
    sigma = np.asarray(line_deviation(frf)[kept], dtype=np.float64)
    shape = _Shape(f, kind, frf.resolution if tapered else 0.0, residuals)
    start = np.log([number for guess in guesses for number in guess])
    side = _parts(value / sigma)

    def error(theta: FloatArray) -> FloatArray:
        columns = _parts(shape.columns(np.exp(theta)) / sigma[:, None])
        return np.asarray(columns @ np.linalg.lstsq(columns, side, rcond=None)[0] - side)

    solved = least_squares(error, start, method="trf", x_scale="jac", xtol=1e-12, ftol=1e-12)
    pairs = np.asarray(np.exp(solved.x), dtype=np.float64).reshape(-1, 2)
    if not np.isfinite(pairs).all() or ((pairs[:, 0] < band[0]) | (pairs[:, 0] > band[1]) | (pairs[:, 1] > 1.0)).any():
        raise FitError(
            f"the fit of {len(guesses)} modes left the band {band[0]:g} to {band[1]:g} Hz; give guesses or another band"
        )
    columns = shape.columns(pairs.ravel())
    weighted = _parts(columns / sigma[:, None])
    amplitudes = np.asarray(np.linalg.lstsq(weighted, side, rcond=None)[0], dtype=np.float64)
    misfit = float(np.sqrt(np.mean((weighted @ amplitudes - side) ** 2)))
    std = max(misfit, 1.0) * _deviations(shape, pairs.ravel(), amplitudes, sigma, frf)
    order = np.argsort(pairs[:, 0])
    modes = tuple(
        Mode(
            frequency=float(pairs[i, 0]), frequency_std=float(std[2 * i]), damping=float(pairs[i, 1]),
            damping_std=float(std[2 * i + 1]), lines=float(2.0 * pairs[i, 1] * pairs[i, 0] / frf.resolution),
        )
        for i in order
    )  # fmt: skip
    narrow = min(mode.lines for mode in modes)
    return ModalFit(
        modes=modes, kind=kind, frequency=f, fitted=np.asarray(columns @ amplitudes), misfit=misfit,
        warning=f"only {narrow:.1f} lines in the narrowest bandwidth; take a finer resolution" if narrow < 1.5 else "",
    )  # fmt: skip


def _guess(f: FloatArray, size: FloatArray, resolution: float) -> list[tuple[float, float]]:
    top = int(np.argmax(size)) if len(size) else 0
    wide = int((size > 0.7 * size[top]).sum()) if len(size) else 1
    return [(float(f[top]), min(0.3, max(wide - 1.0, 1.0) * resolution / (2.0 * float(f[top]))))] if len(f) else [(1.0, 0.1)]


def line_deviation(frf: Frf) -> FloatArray:
    """Standard deviation of the real and of the imaginary part at each line, shape (lines,).

    With few averages a line's own coherence is too uncertain to weigh it by; it is then averaged over neighbours.
    """
    width = 2 * int(np.ceil(50.0 / frf.averages)) + 1 if frf.averages < 100.0 else 1
    variance = frf.magnitude_std**2
    if width > 1:
        share = np.convolve(np.ones(len(variance)), np.ones(width), "same")
        variance = np.convolve(variance, np.ones(width), "same") / share
    variance = variance * frf.averages / max(frf.averages - 1.0, 1.0)
    return np.asarray(np.sqrt(np.maximum(variance, 1e-24 * float(np.max(np.abs(frf.value))) ** 2)), dtype=np.float64)


def _parts(values: ComplexArray) -> FloatArray:
    return np.concatenate([values.real, values.imag])


class _Shape:
    """The model's columns: one per mode and one per residual term, each as the window shows it."""

    def __init__(self, f: FloatArray, kind: Kind, resolution: float, residuals: int, top: float | None = None) -> None:
        self.frequency = f
        self._s: ComplexArray = np.asarray(2j * np.pi * f, dtype=np.complex128)
        self._kind, self._resolution, self._residuals = kind, resolution, residuals
        self._top = float(f.max()) if top is None else top
        rest: list[ComplexArray] = [np.ones(f.shape, dtype=np.complex128), np.asarray((f / self._top) ** 2 + 0j)][:residuals]
        # Damped modes far off leave a background of any phase.
        self._rest = [turn * term for term in rest for turn in (1.0, 1j)] if kind == "general" else rest

    def at(self, f: FloatArray) -> _Shape:
        """The same model at other frequencies, without the window."""
        return _Shape(f, self._kind, 0.0, self._residuals, self._top)

    def columns(self, pairs: FloatArray) -> ComplexArray:
        """Shape (..., modes + residuals), for frequencies (Hz) and damping ratios in turn."""
        modes = [column for i in range(0, len(pairs), 2) for column in self._mode(2.0 * np.pi * pairs[i], pairs[i + 1])]
        return np.stack([*modes, *self._rest], axis=-1)

    def _mode(self, omega: float, zeta: float) -> tuple[ComplexArray, ...]:
        # (2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2) in partial fractions; s^2 over the same is one less it.
        pole = omega * (-zeta + 1j * np.sqrt(max(1.0 - zeta**2, 1e-12)))
        seen, mirrored = self._seen(pole), self._seen(np.conj(pole))
        if self._kind == "general":
            return omega * (seen + mirrored), 1j * omega * (seen - mirrored)
        residue = (2.0 * zeta * omega * pole + omega**2) / (pole - np.conj(pole))
        ratio: ComplexArray = np.asarray(residue * seen + np.conj(residue) * mirrored)
        return (ratio,) if self._kind == "transmissibility" else (np.asarray(1.0 - ratio),)

    def _seen(self, pole: complex) -> ComplexArray:
        # The transform of exp(pole t), t > 0, times the Hann window's autocorrelation (1 - u)(2 + cos 2 pi u) / 3 +
        # sin(2 pi u) / 2 pi, u = t / T: sums of the transforms of (1 - u) exp(z u) and exp(z u).
        if self._resolution == 0.0:
            return np.asarray(1.0 / (self._s - pole))
        span = 1.0 / self._resolution
        z: ComplexArray = np.asarray((pole - self._s) * span, dtype=np.complex128)
        turn = np.complex128(2j * np.pi)
        up: ComplexArray = z + turn
        down: ComplexArray = z - turn
        return np.asarray(
            span * (2.0 / 3.0 * _ramp(z) + (_ramp(up) + _ramp(down)) / 6.0 + (_flat(up) - _flat(down)) / (4j * np.pi))
        )


def _flat(z: ComplexArray) -> ComplexArray:
    return np.asarray((np.exp(z) - 1.0) / z)


def _ramp(z: ComplexArray) -> ComplexArray:
    return np.asarray((np.exp(z) - 1.0 - z) / z**2)


def _deviations(shape: _Shape, pairs: FloatArray, amplitudes: FloatArray, sigma: FloatArray, frf: Frf) -> FloatArray:
    # Weighted least squares with correlated errors: (J'J)^-1 J'CJ (J'J)^-1, J the weighted derivatives.
    columns = shape.columns(pairs)
    slopes = []
    for i, value in enumerate(pairs):
        moved = pairs.copy()
        moved[i] += 1e-5 * value
        slopes.append((shape.columns(moved) - columns) @ amplitudes / (1e-5 * value))
    rows: ComplexArray = np.concatenate([np.stack(slopes, axis=1), columns], axis=1)
    stacked = _parts(rows / sigma[:, None])
    bread = np.linalg.pinv(stacked.T @ stacked)

    def bare(f: FloatArray) -> ComplexArray:
        return np.asarray(shape.at(f).columns(pairs) @ amplitudes)

    moments = error_moments(
        bare, columns @ amplitudes, shape.frequency, frf.resolution, 2.0 * frf.averages * sigma**2, frf.averages
    )
    covariance = bread @ through(rows / sigma[:, None] ** 2, moments) @ bread
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0))[: len(pairs)])
