"""Mains hum: sines at a frequency and its multiples, detected and removed by least squares.

The phase differs from run to run, so it is not a parameter of a rig: it is determined from the fitted part of a run.
"""

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.spectra.windows import hanning, vertex

#: Number of multiples of the mains frequency.
HARMONICS = 7
#: Nominal mains frequencies and their tolerance, Hz.
MAINS = (50.0, 60.0)
STRAY = 0.5
#: Required ratio of a spectral line's power to the median around it.
LINE = 60.0
#: Bins on either side that the Hann window spreads a spectral line over, and further bins that it must exceed as well: a
#: resonance near the mains frequency is wider than a spectral line.
SPREAD, NEIGHBOURS = 4, 24


def hum(samples: FloatArray, rate: float, frequency: float, length: int | None = None) -> FloatArray:
    """The hum in a record of shape (n,), at a rate and a mains frequency in Hz: fitted to all samples, and extrapolated to shape
    (length,) if `length` is larger."""
    n = len(samples)
    total = n if length is None else length
    orders = np.arange(1, HARMONICS + 1)
    orders = orders[orders * frequency < 0.45 * rate]
    turn = 2.0 * np.pi * frequency / rate * np.arange(total)[:, None] * orders
    waves = np.hstack([np.cos(turn), np.sin(turn)])
    seen = waves[:n]
    weights = np.linalg.solve(seen.T @ seen, seen.T @ samples)
    return np.asarray(waves @ weights)


def mains_in(samples: FloatArray, rate: float) -> float | None:
    """The mains frequency in Hz if a record has a spectral line there that exceeds its surroundings, otherwise None."""
    n = len(samples)
    if n < 8.0 * rate:
        return None
    power = np.abs(np.fft.rfft(samples * hanning(n))) ** 2
    step = rate / n
    best: tuple[float, float] | None = None
    for mains in MAINS:
        for order in (1, 2, 3):
            middle = order * mains
            if middle + 5.0 > 0.45 * rate:
                continue
            near = slice(round((middle - order * STRAY) / step), round((middle + order * STRAY) / step) + 1)
            around = np.median(power[round((middle - 5.0) / step) : round((middle + 5.0) / step)])
            k = near.start + int(np.argmax(power[near]))
            neighbours = np.median(np.r_[power[max(k - NEIGHBOURS, 0) : k - SPREAD], power[k + SPREAD + 1 : k + NEIGHBOURS + 1]])
            height = float(power[k] / max(around, neighbours, 1e-300))
            if height > LINE and (best is None or height > best[0]):
                best = height, (k + vertex(power, k)[0]) * step / order
    return None if best is None else best[1]
