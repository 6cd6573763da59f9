"""The pitch with which the force of an element repeats over its deflection."""

import numpy as np
from scipy.optimize import minimize_scalar

from isorig.analysis.campaign import FloatArray
from isorig.analysis.equations.sliding import Columns, Sliding, SlidingFit

#: Fewest periods over the range of the deflection, and the number of periods that the search ends at. Chosen: with fewer than two
#: a period is an inflection of a spring's curve; the shortest one has `CELLS` / `MOST` cells. A motor with a hundred teeth makes
#: a thousand in ten turns.
FEWEST, MOST = 2.0, 2048.0
#: The latter of an integrated deflection. Chosen: nothing turns there, and a pitch below its noise takes long to simulate.
MOST_INTEGRATED = 128.0
#: Cells over the range, for whose mean force the search is made, and frequencies for each period.
CELLS, STEPS = 16384, 4


def pitch_of(sliding: Sliding, base: SlidingFit, columns: Columns) -> float | None:
    """The pitch in m with which what an equation leaves repeats best over the element's deflection; None over too few cells.

    By the spectrum of the mean residual in cells of the deflection, each weighted by its number of samples, and near its largest
    value by the periodogram of Lomb and Scargle with a free mean (VanderPlas, Astrophysical Journal Supplement 236, 2018).
    """
    d, left = _residual(sliding, base, columns)
    low, high = sliding.range
    cell = np.clip(((d - low) / (high - low) * CELLS).astype(int), 0, CELLS - 1)
    count = np.bincount(cell, minlength=CELLS)
    there = np.flatnonzero(count)
    if len(there) < 2 * FEWEST * STEPS:
        return None
    from scipy.signal import lombscargle  # imports half of scipy

    at = (there + 0.5) / CELLS  # as shares of the range
    mean = np.bincount(cell, left, minlength=CELLS)[there] / count[there]
    weights = count[there] / count.sum()

    whole = np.zeros(CELLS)
    whole[there] = weights * (mean - weights @ mean)
    # Samples show no force that repeats more often than every second one, not even those of the slowest run.
    slowest = min(float(np.std(run.velocity)) for run in sliding.runs)
    most = min(MOST_INTEGRATED if sliding.integrated else MOST, (high - low) * 0.5 * sliding.rate / max(slowest, 1e-300))
    if most < FEWEST + 1.0 / STEPS:
        return None
    spectrum = np.abs(np.fft.rfft(whole, STEPS * CELLS)[: round(STEPS * most)])
    spectrum[: round(STEPS * FEWEST)] = 0.0
    best = float(np.argmax(spectrum)) / STEPS

    def missed(periods: float) -> float:
        return -float(lombscargle(at, mean, np.array([2.0 * np.pi * periods]), weights=weights, floating_mean=True))

    fine = minimize_scalar(missed, bounds=(max(best - 1.0 / STEPS, FEWEST), best + 1.0 / STEPS), method="bounded")
    return (high - low) / float(fine.x)


def _residual(sliding: Sliding, base: SlidingFit, columns: Columns) -> tuple[FloatArray, FloatArray]:
    # Deflection in m and residual force in N at the samples in use.
    d, left = [], []
    for block in sliding.active:
        place = block.first + block.used
        matrix, _ = sliding.evaluated(block, columns)
        d.append(block.run.deflection[place] + block.run.slow[place])
        left.append(sliding.left(block, matrix, base.values))
    return np.concatenate(d), np.concatenate(left)
