"""95 % limits of the magnitude of a transfer function: random error, leakage at narrow peaks, noise on the reference.

An averaged H1 has two errors that its coherence does not show. Leakage lowers and widens a peak with few frequency bins (Bendat
and Piersol 2010, 8.5). It is computed from modes fitted to each narrow peak including the window, as the difference between the
modes with and without it; where no mode fits, there are no limits. Noise on the reference makes H1 too small by its share of the
reference's power (9.1). Neither spectrum nor coherence separate it from noise on the response; but sensor noise is white, so the
frequency bins with the smallest incoherent power bound its level, and the upper limit includes that bound.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from isorig.analysis.campaign import BoolArray, FloatArray, IntArray
from isorig.analysis.errors import AnalysisError
from isorig.analysis.spectra.modal_fit import SolvedModes, solved_modes
from isorig.analysis.spectra.welch import FEWEST, Frf
from isorig.analysis.spectra.window_effect import bin_deviation

#: Frequency bins between the half-power points of a peak below which its leakage is computed (at 20 bins it is 0.1 % of the
#: magnitude), and below which a peak without a fitted mode has no limits (at 10 bins leakage is 0.5 %).
WIDE, NARROW = 20, 10
#: A peak exceeds its half-power points by this many standard deviations; at most this many peaks are fitted, the highest first.
CLEAR, PEAKS = 4.0, 30
#: Largest number of peaks fitted together: the time of a fit increases with its square.
TOGETHER = 6
#: Bins and half-power widths on each side of a peak in the fit of its mode.
REACH_BINS, REACH_WIDTHS = 6.0, 4.0
#: Bins on each side of the fitted peaks in which their leakage is computed: farther away it is below 1e-7 of the peak.
FAR = 1000
#: rms of the weighted residuals above which the fitted modes do not describe a peak: with the right number of modes 95 % of fits
#: have less than 1.1. Modes are added to a peak, at most this many, until it is reached.
MISFIT, ADDED = 1.25, 2
#: Their fits end with a step that reduces the sum of squares by less than this share: the modes then move by about a thousandth
#: of the error bars. Superfluous modes would take a thousand such steps.
SETTLED = 1e-6
#: An error below this share of the standard deviation is neglected: it lowers the coverage from 95 to 94 %.
SLIGHT = 0.3
#: Noise of the reference is bounded by this quantile, over the bins, of the incoherent power averaged over this many bins, up to
#: this share of the highest frequency, above which anti-aliasing filters attenuate noise too.
QUANTILE, SMOOTHED, BELOW_FILTER = 0.1, 5, 0.78
#: Two-sided 95 %.
COVERED = 0.95


@dataclass(frozen=True, kw_only=True)
class MagnitudeLimits:
    """95 % limits of the magnitude of a transfer function."""

    #: In the unit of its value, shape (bins,); NaN where no limits can be given.
    low: FloatArray
    high: FloatArray
    #: Estimated magnitude minus the true one due to leakage, in the unit of its value, shape (bins,); NaN where it is unknown.
    leakage: FloatArray
    reference_noise: FloatArray  #: Largest share by which noise on the reference may lower the magnitude, shape (bins,).
    #: Frequencies of narrow peaks whose magnitude is corrected for leakage by more than `SLIGHT` standard deviations, Hz.
    narrow: tuple[float, ...] = ()
    unknown: tuple[float, ...] = ()  #: Frequencies of narrow peaks that no mode fits, Hz.
    reason: str = ""  #: Why there are no limits at all; empty if there are.


class _Peak(NamedTuple):
    top: int
    bins: int


def magnitude_limits(frf: Frf, reference_density: FloatArray) -> MagnitudeLimits:
    """95 % limits of the magnitude of a transfer function from segments or hammer hits.

    `reference_density` is the power spectral density of its reference in its bins, unit^2 / Hz, shape (bins,).

    Notes
    -----
    The random error uses Student's distribution with 2 (n - 1) degrees of freedom, n the averages: each has a real and an
    imaginary part, and the mean takes one.
    """
    size = np.abs(frf.value)
    reason = ""
    if frf.estimator != "H1":
        reason = f"{frf.estimator} adds up noise and leakage of both channels; use H1"
    elif frf.averages < FEWEST:
        reason = "a single average, or an unknown number, does not show the scatter; measure longer or use a coarser resolution"
    if reason:
        none = np.full(size.shape, np.nan)
        return MagnitudeLimits(low=none, high=none, leakage=none, reference_noise=none, reason=reason)
    from scipy.special import stdtrit

    degrees = 2.0 * max(frf.averages - 1.0, 0.5)
    reach = stdtrit(degrees, 0.5 + 0.5 * COVERED) * np.sqrt(frf.averages / max(frf.averages - 1.0, 0.5)) * frf.magnitude_std
    leakage, narrow, unknown = _leakage(frf, size)
    noise = _reference_noise(frf, reference_density)
    low = np.maximum(size - leakage - reach, 0.0)
    high = (size - leakage + reach) / (1.0 - noise)
    return MagnitudeLimits(low=low, high=high, leakage=leakage, reference_noise=noise, narrow=narrow, unknown=unknown)


def _leakage(frf: Frf, size: FloatArray) -> tuple[FloatArray, tuple[float, ...], tuple[float, ...]]:
    complex_bias = np.zeros(size.shape, dtype=np.complex128)
    if frf.window is None:
        return np.zeros(size.shape), (), ()
    missing = np.zeros(size.shape, dtype=bool)
    narrow: list[float] = []
    unknown: list[float] = []
    for group in _groups(_peaks(frf, size)):
        fit = _fitted(frf, group)
        own = np.zeros(size.shape, dtype=np.complex128)
        if fit is not None:
            close = slice(max(0, group[0].top - FAR), group[-1].top + FAR + 1)
            own[close] = fit.leakage(frf.frequency[close])
        matters = np.abs(size - np.abs(frf.value - own)) > SLIGHT * frf.magnitude_std
        described = fit is not None and fit.misfit <= MISFIT
        if described:
            complex_bias += own
        else:
            # Modes that do not describe a wide peak give the right size of its leakage at least.
            missing |= _near(frf, [peak for peak in group if peak.bins < NARROW]) | (matters & _near(frf, group))
        for peak in group:
            around = _near(frf, [peak])
            if described and (matters & around).any():
                narrow.append(float(frf.frequency[peak.top]))
            elif not described and (missing & around).any():
                unknown.append(float(frf.frequency[peak.top]))
    bias = size - np.abs(frf.value - complex_bias)
    bias[missing] = np.nan
    return bias, tuple(narrow), tuple(unknown)


def _peaks(frf: Frf, size: FloatArray) -> list[_Peak]:
    # Maxima with half-power points on both sides, of fewer than `WIDE` bins.
    clear = (1.0 - np.sqrt(0.5)) * size >= CLEAR * frf.magnitude_std
    inner = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:]) & clear[1:-1]) + 1
    left, right = (_fall(size, inner, way) for way in (-1, 1))
    bins = left + right - 1
    whole = (left > 0) & (right > 0) & (bins < WIDE)
    found = [_Peak(top, count) for top, count in zip(inner[whole].tolist(), bins[whole].tolist(), strict=True)]
    return sorted(sorted(found, key=lambda peak: -size[peak.top])[:PEAKS])


def _fall(size: FloatArray, tops: IntArray, way: Literal[-1, 1]) -> IntArray:
    # Number of bins from maxima to the first one below half of their power, shape (maxima,); 0 if none of the next `WIDE` is, or
    # a larger bin is before it.
    found = np.zeros(len(tops), dtype=np.int64)
    going = np.arange(len(tops))
    for distance in range(1, WIDE + 1):
        at = tops[going] + way * distance
        inside = (at >= 0) & (at < len(size))
        going, at = going[inside], at[inside]
        top, here = size[tops[going]], size[at]
        below = here < top * np.sqrt(0.5)
        found[going[below]] = distance
        going = going[~below & (here <= top)]
    return found


def _span(peak: _Peak) -> float:
    return max(REACH_WIDTHS * peak.bins, REACH_BINS)


def _groups(peaks: list[_Peak]) -> list[list[_Peak]]:
    # Peaks whose fitted bands overlap are fitted together.
    groups: list[list[_Peak]] = []
    for peak in peaks:
        close = bool(groups) and peak.top - groups[-1][-1].top <= _span(peak) + _span(groups[-1][-1])
        if close and len(groups[-1]) < TOGETHER:
            groups[-1].append(peak)
        else:
            groups.append([peak])
    return groups


def _near(frf: Frf, group: list[_Peak]) -> BoolArray:
    within = np.zeros(len(frf.frequency), dtype=bool)
    for peak in group:
        reach = int(np.ceil(_span(peak)))
        within[max(0, peak.top - reach) : peak.top + reach + 1] = True
    return within


def _fitted(frf: Frf, group: list[_Peak]) -> SolvedModes | None:
    # Modes are added where the residual is largest until the peaks are described.
    f, step = frf.frequency, frf.resolution
    low = max(float(f[group[0].top]) - _span(group[0]) * step, 0.5 * step)
    high = float(f[group[-1].top]) + _span(group[-1]) * step
    kept = (f >= low) & (f <= high) & (f > 0.0)
    # The window widens a peak by about one and a half bins.
    guesses = [
        (float(f[peak.top]), min(0.5, float(np.sqrt(max(peak.bins**2 - 2.0, 0.25)) * step / (2.0 * f[peak.top]))))
        for peak in group
    ]
    best: SolvedModes | None = None
    for _ in range(1 + ADDED):
        try:
            with np.errstate(all="ignore"):  # a mode that runs away ends in an error
                fit = solved_modes(frf, (low, high), kind="general", guesses=guesses, settled=SETTLED)
        except (AnalysisError, np.linalg.LinAlgError, ValueError):
            return best
        if best is None or fit.misfit < best.misfit:
            best = fit
        if fit.misfit <= MISFIT:
            return fit
        left = np.abs(frf.value[kept] - fit.fitted) / bin_deviation(frf)[kept]
        worst = float(fit.frequency[int(np.argmax(left))])
        modes = sorted(map(tuple, fit.pairs.tolist()))
        guesses = [*modes, (worst, modes[0][1])]
    return best


def _reference_noise(frf: Frf, density: FloatArray) -> FloatArray:
    # The bound of the noise's share of the reference's power.
    explained = frf.coherence if frf.multiple_coherence is None else frf.multiple_coherence
    incoherent = np.clip(1.0 - explained, 0.0, 1.0) * density
    n = len(incoherent)
    inside = incoherent[2 : max(int(BELOW_FILTER * n), min(n, 2 + SMOOTHED))]
    if len(inside) < SMOOTHED:
        return np.zeros(n)
    smooth = np.convolve(inside, np.full(SMOOTHED, 1.0 / SMOOTHED), "valid")
    level = float(np.quantile(smooth, QUANTILE))
    return np.asarray(np.clip(level / np.maximum(density, 1e-300), 0.0, np.clip(1.0 - explained, 0.0, 0.99)))
