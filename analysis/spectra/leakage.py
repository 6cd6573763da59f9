"""How the errors of an averaged H1 go together from line to line, leakage included.

With X and Y = H X seen through a window, e = Y - E[H1] X is what leaks in from the segment's edges, and noise. The error of H1
is sum(conj(X) e) / sum |X|^2 over segments. For a Gaussian white drive its second moments are products of those of X and e
(Isserlis 1918), which are integrals over frequency of the window's transform, H and its lag from segment to segment. Neighbouring
segments share what leaks, with opposite sign, so a resonance seen at few lines scatters far less than its coherence says.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.spectra.windows import HANN, Window

#: Lines over which errors are correlated, reach of the window's transform in lines, and steps per line of the integrals.
APART, REACH, STEPS = 4, 8, 16
#: Correlation of lines that counts as none.
SLIGHT = 0.02


def error_moments(
    model: Callable[[FloatArray], ComplexArray], seen: ComplexArray, frequency: FloatArray, resolution: float, power: FloatArray,
    averages: float, window: Window = HANN, overlap: float = 0.5,
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
        Distance of lines, Hz.
    power
        Measured power that the response has beside H X, over that of X, shape (lines,). What leakage does not explain is noise.
    averages
        Effective number of averages.
    window, overlap
        What segments are seen through, and the share by which they overlap.

    Returns
    -------
    Both of shape (`APART` + 1, lines); entry [d, k] is that of lines k and k + d, zero beyond the last line.
    """
    lines = len(frequency)
    x = np.arange(-REACH * STEPS, (REACH + APART) * STEPS + 1) / STEPS
    grid = frequency[:, None] + x * resolution
    true = model(grid)
    index = np.round(frequency / resolution)
    hop, segments = 1.0 - overlap, averages * window.tied(overlap)
    lags = [(1.0, np.ones(grid.shape, dtype=np.complex128))]
    for apart in range(1, min(int(np.ceil(1.0 / hop)), int(np.ceil(segments)))):
        turned = np.exp(2j * np.pi * apart * hop * (index[:, None] + x))
        lags += [(1.0 - apart / segments, turned), (1.0 - apart / segments, np.conj(turned))]
    covariance, pseudo = np.zeros((2, APART + 1, lines), dtype=np.complex128)
    here = window.transform(x)
    leaked = (true - seen[:, None]) * here
    noise = _noise(power, (np.abs(leaked) ** 2).sum(axis=1) / (here**2).sum(), averages)
    for d in range(min(APART + 1, lines)):
        there = window.transform(x - d) * np.exp(-1j * np.pi * d)
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


def record_moments(variance: FloatArray, decay: float, before: float) -> tuple[ComplexArray, ComplexArray]:
    """The same where whole records that begin and end at rest were transformed, so that only noise is left.

    Parameters
    ----------
    variance
        Of the complex value at each line, shape (lines,).
    decay
        Exponential window, in 1 / (length of the record): it ties neighbouring lines together.
    before
        Share of the record before its pulse, from which the phase counts.
    """
    # The transform of exp(-2 decay u), 0 <= u < 1, at whole lines -d is 2 decay / (2 decay - 2 pi i d) of that at 0.
    apart = min(int(np.ceil(decay / (np.pi * SLIGHT))), len(variance) - 1)
    size = np.sqrt(variance)
    covariance = np.zeros((apart + 1, len(variance)), dtype=np.complex128)
    covariance[0] = variance
    for d in range(1, apart + 1):
        tie = decay / (decay - 1j * np.pi * d) * np.exp(-2j * np.pi * d * before)
        covariance[d, : len(size) - d] = tie * size[: len(size) - d] * size[d:]
    return covariance, np.zeros_like(covariance)


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
