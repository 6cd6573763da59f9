"""Modes with common poles, fitted to many transfer functions at once, each frequency bin weighted by its error bar.

Natural frequencies and damping ratios are common to all transfer functions; residues and the background due to modes outside the
band are linear and solved for each function (variable projection: Golub and Pereyra 1973; derivative of Kaufman 1975).
"""

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.spectra.window_effect import WindowEffect, pole_of

#: Iterations, smallest relative step, and factor of the damping of steps.
ITERATIONS, STEP, FACTOR = 60, 1e-9, 10.0
#: Relative step of derivatives.
SLOPE = 1e-6


@dataclass(frozen=True, kw_only=True)
class Data:
    """Transfer functions in the frequency bins of a band."""

    frequency: FloatArray  #: Hz, shape (bins,).
    #: Complex values and the standard deviation of their real and of their imaginary part, shape (functions, bins).
    values: ComplexArray
    deviations: FloatArray
    seen: WindowEffect  #: The window of the estimate.
    #: Power of s of the motion relative to a displacement: 2 for accelerations per force. Modes below the band leave
    #: s^(power - 2), modes above it s^power.
    power: int

    @property
    def numbers(self) -> int:
        """Number of fitted real values."""
        return 2 * self.values.size


@dataclass(frozen=True, kw_only=True)
class SolvedPoles:
    """The best residues for given poles."""

    pairs: FloatArray  #: Natural frequency (Hz) and damping ratio, shape (modes, 2).
    residues: ComplexArray  #: A of A / (s - pole) + conj(A) / (s - conj(pole)), shape (functions, modes).
    background: ComplexArray  #: Coefficients of the background's terms, shape (functions, 2).
    chi2: float  #: Sum of squared weighted residuals.
    #: With respect to the logarithms of the pairs, shape (2 modes, 2 modes) and (2 modes,).
    normal: FloatArray
    gradient: FloatArray
    gains: FloatArray  #: Increase of `chi2` without each mode, after solving the others' residues again, shape (modes,).


def mode_columns(data: Data, frequency: float, damping: float) -> ComplexArray:
    """Contributions of a residue's real and imaginary part to a transfer function, shape (bins, 2)."""
    pole = pole_of(frequency, damping)
    one, other = (data.seen.pole(data.frequency, each) for each in (pole, np.conj(pole)))
    return np.stack([one + other, 1j * (one - other)], axis=1)


def background_columns(data: Data) -> ComplexArray:
    """Background due to modes below and above the band, shape (bins, 4): each term's real and imaginary part."""
    s = data.seen.s(data.frequency) / (2.0 * np.pi * data.frequency[-1])
    terms = [s ** (data.power - 2), s**data.power]
    return np.stack([turn * term for term in terms for turn in (1.0, 1j)], axis=1)


def _real(values: ComplexArray, deviation: FloatArray) -> FloatArray:
    weighted = values / (deviation[:, None] if values.ndim == 2 else deviation)
    return np.concatenate([weighted.real, weighted.imag])


def solve(data: Data, pairs: FloatArray) -> SolvedPoles:
    """The best residues and background for given poles, and the derivatives of the error with respect to the poles."""
    columns, slopes = _columns(data, pairs)
    modes = len(pairs)
    normal, gradient = np.zeros((2 * modes, 2 * modes)), np.zeros(2 * modes)
    chi2, gains = 0.0, np.zeros(modes)
    residues = np.empty((len(data.values), modes), dtype=np.complex128)
    background = np.empty((len(data.values), 2), dtype=np.complex128)
    for k, (values, deviation) in enumerate(zip(data.values, data.deviations, strict=True)):
        q, r = np.linalg.qr(_real(columns, deviation))
        side = _real(values, deviation)
        known = q.T @ side
        left = side - q @ known
        amplitudes = np.linalg.lstsq(r, known, rcond=None)[0]
        chi2 += float(left @ left)
        moved = np.stack([slope @ amplitudes[2 * (j // 2) : 2 * (j // 2) + 2] for j, slope in enumerate(slopes)], axis=1)
        moved_real = _real(moved, deviation)
        moved_real -= q @ (q.T @ moved_real)
        normal += moved_real.T @ moved_real
        gradient += moved_real.T @ left
        residues[k], background[k] = np.split(amplitudes[0::2] + 1j * amplitudes[1::2], [modes])
        spread = np.linalg.pinv(r)
        covariance = spread @ spread.T
        for m in range(modes):
            own = slice(2 * m, 2 * m + 2)
            gains[m] += float(amplitudes[own] @ np.linalg.pinv(covariance[own, own]) @ amplitudes[own])
    return SolvedPoles(
        pairs=pairs, residues=residues, background=background, chi2=chi2, normal=normal, gradient=gradient, gains=gains
    )


def _columns(data: Data, pairs: FloatArray) -> tuple[ComplexArray, list[ComplexArray]]:
    # All columns, and derivatives of each mode's two columns with respect to the logarithms of its frequency and damping ratio.
    columns = [mode_columns(data, *pair) for pair in pairs]
    slopes = []
    for (f, zeta), own in zip(pairs, columns, strict=True):
        slopes.append((mode_columns(data, f * (1.0 + SLOPE), zeta) - own) / SLOPE)
        slopes.append((mode_columns(data, f, zeta * (1.0 + SLOPE)) - own) / SLOPE)
    return np.concatenate([*columns, background_columns(data)], axis=1), slopes


def fit(data: Data, pairs: FloatArray, steps: int = ITERATIONS) -> SolvedPoles:
    """Poles and residues with the smallest error, from starting values, within a number of steps."""
    now, damping = solve(data, pairs), 1e-3
    for _ in range(steps):
        scale = np.maximum(np.diag(now.normal), 1e-30 * max(float(np.trace(now.normal)), 1e-300))
        while True:
            step = np.linalg.lstsq(now.normal + damping * np.diag(scale), now.gradient, rcond=None)[0]
            # No step exceeds a factor of e, the range in which the derivatives are valid.
            step = np.clip(step, -1.0, 1.0)
            tried = now.pairs * np.exp(step.reshape(-1, 2))
            tried[:, 1] = np.clip(tried[:, 1], 1e-7, 0.99)
            after = solve(data, tried)
            if np.isfinite(after.chi2) and after.chi2 <= now.chi2:
                break
            damping *= FACTOR
            if damping > 1e12:
                return now
        done = bool(np.abs(step).max(initial=0.0) < STEP) or now.chi2 - after.chi2 < 1e-10 * now.chi2
        now, damping = after, max(damping / FACTOR, 1e-12)
        if done:
            return now
    return now


def model(data: Data, solved: SolvedPoles) -> ComplexArray:
    """The fitted transfer functions as seen through the window, shape (functions, bins)."""
    columns, _ = _columns(data, solved.pairs)
    amplitudes = np.concatenate([solved.residues, solved.background], axis=1)
    return np.asarray(amplitudes.real @ columns[:, 0::2].T + amplitudes.imag @ columns[:, 1::2].T)
