"""Correlation of the errors of an averaged H1 between frequency bins, including leakage.

With X and Y = H X seen through a window, e = Y - E[H1] X consists of leakage from the segment's edges and noise. The error of H1
is sum(conj(X) e) / sum |X|^2 over segments. For a Gaussian white drive its second moments are products of those of X and e
(Isserlis 1918), which are integrals over frequency of the window's transform, H and its lag from segment to segment. Neighbouring
segments share the leakage, with opposite sign, so a resonance with few frequency bins scatters far less than its coherence
indicates.
"""

from collections.abc import Callable

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.spectra.windows import Window

#: Bins over which errors are correlated, reach of the window's transform in bins, and steps per bin of the integrals.
APART, REACH, STEPS = 4, 8, 16
#: Correlation of bins that counts as zero.
SLIGHT = 0.02
#: Passes of the noise's fit, in which each bin is weighted by the power that the pass before expects there: with weights by the
#: measured power, bins with little of it by chance would count most.
PASSES = 3


def error_moments(
    model: Callable[[FloatArray], ComplexArray], seen: ComplexArray, frequency: FloatArray, resolution: float,
    variance: FloatArray, averages: float, window: Window, overlap: float, groups: int,
) -> tuple[tuple[ComplexArray, ComplexArray], tuple[ComplexArray, ComplexArray]]:  # fmt: skip
    """Covariance E[a conj(b)] and pseudo-covariance E[a b] of the errors of H1 in bins k and k + d.

    They are given for the whole record, and for the sum over `groups` of consecutive segments as if these were independent:
    what the scatter between the groups shows, which neighbouring segments of different groups do not lower.

    Parameters
    ----------
    model
        The transfer function itself at frequencies in Hz, any shape.
    seen
        The same as seen through the window in the bins, shape (bins,).
    frequency
        Of consecutive bins, Hz, shape (bins,).
    resolution
        Frequency resolution, Hz.
    variance
        Variance of the complex value in each bin by its coherence, shape (bins,). The part not explained by leakage is noise.
    averages
        Effective number of averages.
    window, overlap
        Window of the segments, and their relative overlap.
    groups
        Number of groups.

    Returns
    -------
    All of shape (`APART` + 1, bins); entry [d, k] is that of bins k and k + d, zero beyond the last bin.
    """
    lines = len(frequency)
    x = np.arange(-REACH * STEPS, (REACH + APART) * STEPS + 1) / STEPS
    grid = frequency[:, None] + x * resolution
    true = model(grid)
    index = np.round(frequency / resolution)
    hop, segments = 1.0 - overlap, averages * window.segments_per_average(overlap)
    lags = [(np.ones(2), np.ones(grid.shape, dtype=np.complex128))]
    for apart in range(1, min(int(np.ceil(1.0 / hop)), int(np.ceil(segments)))):
        turned = np.exp(2j * np.pi * apart * hop * (index[:, None] + x))
        share = np.maximum(1.0 - apart * np.array([1, groups]) / segments, 0.0)
        lags += [(share, turned), (share, np.conj(turned))]
    covariance, pseudo = np.zeros((2, 2, APART + 1, lines), dtype=np.complex128)
    here = window.transform(x)
    leaked = (true - seen[:, None]) * here
    # The mean of 1 / sum |X|^2 over n averages is that of 1 / (n - 1) averages.
    free = max(averages - 1.0, 1.0)
    noise = _noise(free * variance, (np.abs(leaked) ** 2).sum(axis=1) / (here**2).sum(), np.abs(seen) ** 2, averages)
    for d in range(min(APART + 1, lines)):
        there = window.transform(x - d) * np.exp(-1j * np.pi * d)
        later = (true[: lines - d] - seen[d:, None]) * there
        both = here * there / (here**2).sum()
        for share, turn in lags:
            t = turn[: lines - d]
            drive = (both * t).sum(axis=1)
            rest = (leaked[: lines - d] * np.conj(later * t)).sum(axis=1) / (here**2).sum()
            rest = rest + np.sqrt(noise[: lines - d] * noise[d:]) * np.conj(drive)
            covariance[:, d, : lines - d] += share[:, None] * drive * rest
            onward = (here * later * t).sum(axis=1) / (here**2).sum()
            back = (leaked[: lines - d] * np.conj(there * t)).sum(axis=1) / (here**2).sum()
            pseudo[:, d, : lines - d] += share[:, None] * onward * back
    (whole, parts), (whole_pseudo, parts_pseudo) = (each * averages / (free * segments) for each in (covariance, pseudo))
    return (whole, whole_pseudo), (parts, parts_pseudo)


def record_moments(variance: FloatArray, decay: float, before: float) -> tuple[ComplexArray, ComplexArray]:
    """The same for transforms of whole records that start and end at rest, so that only noise remains.

    `variance` is that of the complex value in each bin, shape (bins,). An exponential window of `decay`, in 1 / (length of the
    record), correlates neighbouring bins; `before` is the share of the record before its pulse, the reference time of the phase.
    """
    # The transform of exp(-2 decay u), 0 <= u < 1, at whole bins -d is 2 decay / (2 decay - 2 pi i d) of that at 0.
    apart = min(int(np.ceil(decay / (np.pi * SLIGHT))), len(variance) - 1)
    size = np.sqrt(variance)
    covariance = np.zeros((apart + 1, len(variance)), dtype=np.complex128)
    covariance[0] = variance
    for d in range(1, apart + 1):
        tie = decay / (decay - 1j * np.pi * d) * np.exp(-2j * np.pi * d * before)
        covariance[d, : len(size) - d] = tie * size[: len(size) - d] * size[d:]
    return covariance, np.zeros_like(covariance)


def _noise(power: FloatArray, leaked: FloatArray, transfer: FloatArray, averages: float) -> FloatArray:
    # Noise not explained by leakage, and larger where a bin clearly has more: a constant due to the response, plus a share of the
    # squared transfer function due to the reference, both determined by the most accurate bins.
    from scipy.optimize import nnls

    left, noise = power - leaked, power
    columns = np.stack([np.ones(len(power)), transfer / max(transfer.max(), np.finfo(float).tiny)], axis=1)
    for _ in range(PASSES):
        weight = 1.0 / np.maximum(leaked + noise, 1e-12 * power.max())
        noise = columns @ nnls(columns * weight[:, None], left * weight)[0]
    return np.asarray(np.maximum(left - 3.0 * (leaked + noise) / np.sqrt(averages), noise))


def through(rows: ComplexArray, moments: tuple[ComplexArray, ComplexArray]) -> FloatArray:
    """Covariance of the real numbers Re(rows^H error), rows of shape (bins, numbers); shape (numbers, numbers)."""
    covariance, pseudo = moments
    straight, mirrored = covariance[0].real[:, None] * rows, pseudo[0][:, None] * np.conj(rows)
    for d in range(1, min(len(covariance), len(rows))):
        c, p = covariance[d, :-d, None], pseudo[d, :-d, None]
        straight[:-d] += c * rows[d:]
        straight[d:] += np.conj(c) * rows[:-d]
        mirrored[:-d] += p * np.conj(rows[d:])
        mirrored[d:] += p * np.conj(rows[:-d])
    return np.asarray(0.5 * (np.conj(rows).T @ (straight + mirrored)).real)
