"""How the errors of an averaged H1 go together from line to line, leakage included.

With X and Y = H X seen through a window, e = Y - E[H1] X is what leaks in from the segment's edges, and noise. The error of H1
is sum(conj(X) e) / sum |X|^2 over segments. For a Gaussian white drive its second moments are products of those of X and e
(Isserlis 1918), which are integrals over frequency of the window's transform, H and its lag from segment to segment. Neighbouring
segments share what leaks, with opposite sign, so a resonance seen at few lines scatters far less than its coherence says.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.measured import ComplexArray, FloatArray

#: Lines over which errors are correlated, reach of the window's transform in lines, and steps per line of the integrals.
APART, REACH, STEPS = 4, 8, 16
#: Correlation of half-overlapping Hann segments.
SHARED = 1.0 / 6.0


def error_moments(
    model: Callable[[FloatArray], ComplexArray], seen: ComplexArray, frequency: FloatArray, resolution: float, power: FloatArray,
    averages: float,
) -> tuple[ComplexArray, ComplexArray]:  # fmt: skip
    """Covariance E[a conj(b)] and pseudo-covariance E[a b] of the errors of H1 at lines k and k + d.

    Parameters
    ----------
    model
        The transfer function itself at frequencies in Hz, any shape.
    seen
        The same as the window shows it at the lines, shape (lines,).
    frequency
        Of consecutive lines, Hz, shape (lines,).
    resolution
        Distance of lines, Hz; half-overlapping Hann segments.
    power
        Measured power that the response has beside H X, over that of X, shape (lines,). What leakage does not explain is noise.
    averages
        Effective number of averages.

    Returns
    -------
    Both of shape (`APART` + 1, lines); entry [d, k] is that of lines k and k + d, zero beyond the last line.
    """
    lines = len(frequency)
    x = np.arange(-REACH * STEPS, (REACH + APART) * STEPS + 1) / STEPS
    grid = frequency[:, None] + x * resolution
    true = model(grid)
    index = np.round(frequency / resolution)
    turned = np.exp(1j * np.pi * np.mod(index[:, None] + x, 2.0))
    segments = averages * (1.0 + 2.0 * SHARED**2)
    lags = ((1.0, np.ones_like(turned)), (1.0 - 1.0 / segments, turned), (1.0 - 1.0 / segments, np.conj(turned)))
    covariance, pseudo = np.zeros((2, APART + 1, lines), dtype=np.complex128)
    here = _hann(x)
    leaked = (true - seen[:, None]) * here
    noise = _noise(power, (np.abs(leaked) ** 2).sum(axis=1) / (here**2).sum(), averages)
    for d in range(min(APART + 1, lines)):
        there = _hann(x - d) * np.exp(-1j * np.pi * d)
        later = (true[: lines - d] - seen[d:, None]) * there
        both = here * there / (here**2).sum()
        for share, turn in lags:
            t = turn[: lines - d]
            drive = (both * t).sum(axis=1)
            rest = (leaked[: lines - d] * np.conj(later * t)).sum(axis=1) / (here**2).sum()
            rest = rest + np.sqrt(noise[: lines - d] * noise[d:]) * np.conj(drive)
            covariance[d, : lines - d] += share * drive * rest
            onward = (here * later * t).sum(axis=1) / (here**2).sum()
            back = (leaked[: lines - d] * np.conj(there * t)).sum(axis=1) / (here**2).sum()
            pseudo[d, : lines - d] += share * onward * back
    return covariance / segments, pseudo / segments


def _hann(x: FloatArray) -> FloatArray:
    # Transform of the Hann window, x lines off, without its phase.
    return np.asarray(np.sinc(x) + 0.5 * (np.sinc(x - 1.0) + np.sinc(x + 1.0)))


def _noise(power: FloatArray, leaked: FloatArray, averages: float) -> FloatArray:
    # What leakage leaves unexplained: flat, told by the lines that tell it best, and more where a line clearly has more.
    left = power - leaked
    weight = 1.0 / np.maximum(power, 1e-12 * power.max()) ** 2
    flat = max(float((weight * left).sum() / weight.sum()), 0.0)
    return np.asarray(np.maximum(left - 3.0 * power / np.sqrt(averages), flat))


def through(rows: ComplexArray, moments: tuple[ComplexArray, ComplexArray]) -> FloatArray:
    """Covariance of the real numbers Re(rows^H error), rows of shape (lines, numbers); shape (numbers, numbers)."""
    covariance, pseudo = moments
    straight, mirrored = covariance[0].real[:, None] * rows, pseudo[0][:, None] * np.conj(rows)
    for d in range(1, min(len(covariance), len(rows))):
        c, p = covariance[d, :-d, None], pseudo[d, :-d, None]
        straight[:-d] += c * rows[d:]
        straight[d:] += np.conj(c) * rows[:-d]
        mirrored[:-d] += p * np.conj(rows[d:])
        mirrored[d:] += p * np.conj(rows[:-d])
    return np.asarray(0.5 * (np.conj(rows).T @ (straight + mirrored)).real)
