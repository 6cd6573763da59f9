"""The half-power damping ratio with tests of its assumptions; refused if they fail."""

from dataclasses import dataclass, replace

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.spectra.modal_fit import Mode
from isorig.analysis.spectra.welch import Frf
from isorig.analysis.spectra.windows import vertex

#: Frequency bins per half-power bandwidth below which half-power is refused, and below which a warning is given for its bias.
REFUSED, WARNED = 4.0, 10.0
#: Required distance of the next peak in bandwidths: a neighbour of equal height then adds a tenth to the amplitude.
APART = 5.0
#: Damping ratio above which the half-power points do not determine it.
LIGHT = 0.2
#: Required ratio of a peak to its surroundings.
PROMINENT = 1.4
#: Minimum number of frequency bins of a band: a peak, and two on each side.
FEWEST = 5


@dataclass(frozen=True, kw_only=True)
class HalfPower:
    """A half-power result, or the reason why there is none."""

    mode: Mode | None  #: None if refused.
    refused: str = ""  #: The reason; empty if there is a mode.
    warning: str = ""  #: A warning about the mode, may be empty.
    #: Frequencies of the peak and its half-power points, Hz (NaN if not found), and the peak's magnitude.
    peak: float = float("nan")
    low: float = float("nan")
    high: float = float("nan")
    amplitude: float = float("nan")


def half_power(frf: Frf, band: tuple[float, float]) -> HalfPower:
    """The damping ratio (f_high - f_low) / (2 f0) at the highest peak in a band (Hz), with interpolation between frequency bins.

    Bins outside the band are searched for neighbouring peaks.

    Notes
    -----
    Refused if there is no peak, or if the peak has fewer than `REFUSED` bins in its bandwidth, a neighbour closer than `APART`
    bandwidths, an asymmetric shape or heavy damping. The uncertainty is that of the amplitudes at the three points.
    """
    f, size = frf.frequency, np.abs(frf.value)
    inside = np.flatnonzero((f >= band[0]) & (f <= band[1]))
    if len(inside) < FEWEST:
        return HalfPower(
            mode=None, refused=f"the band {band[0]:g} to {band[1]:g} Hz has {len(inside)} frequency bins, fewer than {FEWEST}"
        )
    top = int(inside[np.argmax(size[inside])])
    if top in (inside[0], inside[-1]) or top in (0, len(f) - 1):
        return HalfPower(
            mode=None, refused=f"the magnitude is largest at the edge of the band, {f[top]:g} Hz: there is no peak in it"
        )
    shift, amplitude = vertex(size, top)
    peak = float(f[top] + shift * (f[1] - f[0]))
    below, above = (_crossing(f, size, top, step, amplitude / np.sqrt(2.0)) for step in (-1, 1))
    if below is None or above is None:
        return HalfPower(
            mode=None, peak=peak, amplitude=amplitude,
            refused=f"next to the peak at {peak:.4g} Hz the magnitude increases again before it has fallen to half the power",
        )  # fmt: skip
    (low, slope_low, at_low), (high, slope_high, at_high) = below, above
    # An exponential window adds decay / (2 pi f) to every damping ratio.
    width, damping = high - low, (high - low) / (2.0 * peak) - frf.decay / (2.0 * np.pi * peak)
    found = HalfPower(mode=None, peak=peak, low=low, high=high, amplitude=amplitude)
    reason = _doubt(frf, top, peak, low, high)
    if reason:
        return replace(found, refused=reason)
    spread = [
        np.hypot(frf.magnitude_std[at], frf.magnitude_std[top] / np.sqrt(2.0)) / slope
        for at, slope in ((at_low, slope_low), (at_high, slope_high))
    ]
    bins = width / frf.resolution
    # The uncertainty of a parabola's vertex is that of its outer points divided by its curvature.
    curvature = abs(size[top - 1] - 2.0 * size[top] + size[top + 1])
    std = frf.resolution * frf.magnitude_std[top] / (np.sqrt(2.0) * max(curvature, 1e-300))
    mode = Mode(
        frequency=peak, frequency_std=float(min(std, frf.resolution)), damping=damping,
        damping_std=float(np.hypot(*spread) / (2.0 * peak)), bins=bins,
    )  # fmt: skip
    coarse = f"only {bins:.1f} frequency bins in the bandwidth: below {WARNED:g} the window increases a half-power damping"
    return replace(found, mode=mode, warning=coarse if bins < WARNED else "")


def _crossing(f: FloatArray, size: FloatArray, top: int, step: int, level: float) -> tuple[float, float, int] | None:
    # Where the magnitude falls through the level: frequency, slope there, bin. None if there is a minimum before.
    at = top
    while 0 < at + step < len(f) - 1 and size[at] > level:
        if size[at + step] > 1.1 * size[at] and abs(at - top) > 1:
            return None
        at += step
    if size[at] > level:
        return None
    inner = at - step
    slope = (size[inner] - size[at]) / abs(f[inner] - f[at])
    return float(f[at] + (level - size[at]) / slope * (-step)), float(slope), at


def _doubt(frf: Frf, top: int, peak: float, low: float, high: float) -> str:
    width, bins = high - low, (high - low) / frf.resolution
    if bins < REFUSED:
        return (
            f"the bandwidth of {width:.3g} Hz has {bins:.1f} frequency bins, but half-power needs {REFUSED:g}: "
            f"use a resolution of {width / WARNED:.2g} Hz"
        )
    if width / (2.0 * peak) > LIGHT:
        return f"a damping ratio of {width / (2.0 * peak):.2f} is above {LIGHT:g}, where half-power is not valid"
    near = [f for f in peaks(frf) if abs(f - frf.frequency[top]) > 0.5 * width]
    closest = min(near, key=lambda f: abs(f - peak), default=None)
    if closest is not None and abs(closest - peak) < APART * width:
        return (
            f"its neighbour at {closest:.4g} Hz is {abs(closest - peak) / width:.1f} bandwidths away, but half-power needs "
            f"{APART:g}: fit both modes together"
        )
    if not 0.5 < (high - peak) / (peak - low) < 2.0:
        return f"the half-power points at {low:.4g} and {high:.4g} Hz are asymmetric about {peak:.4g} Hz: another mode overlaps"
    return ""


def peaks(frf: Frf) -> tuple[float, ...]:
    """Frequencies (Hz) of peaks that exceed their surroundings by `PROMINENT` and by three standard deviations."""
    from scipy.signal import find_peaks, peak_prominences

    size = np.maximum(np.abs(frf.value), np.finfo(float).tiny)
    scatter = frf.magnitude_std / size
    found = find_peaks(np.log(size), prominence=np.log(PROMINENT))[0]
    rises = peak_prominences(np.log(size), found)[0]
    return tuple(
        float(frf.frequency[i]) for i, rise in zip(found, rises, strict=True) if rise > 3.0 * scatter[i] and scatter[i] < 0.3
    )
