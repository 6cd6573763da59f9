"""Errors of a record that are no linear functions of any record: a bent curve, a limit, hum; a drive that is limited.

Each is a sum of signals with unknown factors, computed from the record alone.
"""

from collections.abc import Callable, Mapping

import numpy as np

from isorig.analysis.campaign import BoolArray, FloatArray
from isorig.analysis.spectra.hum import hum, mains_in
from isorig.analysis.spectra.overload import noisy_limit

#: Powers of a sensor's value in the error of its static curve.
POWERS = (2, 3)
#: Samples within this share of a record's extreme, or as far below a limit as noise scatters, are at a limit if there are at
#: least so many in a row, so many times.
NEAR, ROW, TIMES = 0.005, 3, 3
#: Limits of a drive, as shares of the largest value of its record; the small ones also show a dead band.
LIMITS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.3, 0.5, 0.7, 0.9)


def bent(values: FloatArray, peak: float, rate: float) -> list[FloatArray]:
    """Errors of a static curve: powers of the value relative to the largest one of all runs."""
    return [(values / peak) ** power for power in POWERS]


def clipped(values: FloatArray, peak: float, rate: float) -> list[FloatArray]:
    """The error at a limit: what is missing to a smooth curve through the samples next to it; [] if none is at a limit."""
    from scipy.interpolate import CubicSpline

    held = _held(values, peak) | _held(-values, peak)
    if not held.any():
        return []
    at, kept = np.flatnonzero(held), np.flatnonzero(~held)
    error = np.zeros(len(values))
    error[at] = values[at] - CubicSpline(kept, values[kept])(at)
    return [error]


def _held(values: FloatArray, peak: float) -> BoolArray:
    most = float(values.max())
    if most < 0.5 * peak:
        return np.zeros(len(values), dtype=bool)
    limit, scatter = noisy_limit(values) or (most, 0.0)
    near = values >= min((1.0 - NEAR) * most, limit - scatter)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(np.int8)))
    starts, stops = edges[::2], edges[1::2]
    long = stops - starts >= ROW
    if long.sum() < TIMES:
        return np.zeros(len(values), dtype=bool)
    found = np.zeros(len(values), dtype=bool)
    for start, stop in zip(starts[long], stops[long], strict=True):
        found[start:stop] = True
    return found


def humming(values: FloatArray, peak: float, rate: float) -> list[FloatArray]:
    """Sines at the mains frequency and its multiples; [] if the record has no such spectral lines."""
    frequency = mains_in(values, rate)
    return [] if frequency is None else [hum(values, rate, frequency)]


def saturated(values: FloatArray, peak: float, rate: float) -> list[FloatArray]:
    """What does not act of a drive's record beyond limits; their sum with any factors is a curve that bends at each."""
    return [np.clip(values, -share * peak, share * peak) - values for share in LIMITS]


#: The errors of a drive by name, as `ERRORS`.
DRIVE_ERRORS: Mapping[str, Callable[[FloatArray, float, float], list[FloatArray]]] = {"saturation": saturated}
#: The errors of a sensor by name: functions of a record, shape (n,), the largest value of all runs, and the sample rate in Hz.
ERRORS: Mapping[str, Callable[[FloatArray, float, float], list[FloatArray]]] = {
    "static curve": bent, "clipping": clipped, "hum": humming,
}  # fmt: skip
