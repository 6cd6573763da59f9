"""Held-out errors compared with their floors.

Errors are by run and channel, rms(predicted - measured) / rms(measured), shape (runs, channels); floors are the errors of a
perfect model, of the same shape. The excess is the mean square of an error above its floor.
"""

import numpy as np

from isorig.analysis.campaign import FloatArray

#: Adequacy threshold: a model is adequate if its largest ratio of error to floor, over runs and channels, is below this.
#: Chosen by the study: 406 campaigns without an effect stayed below it.
ADEQUATE = 1.5
#: Error of the simulation itself, as a share of the signal: the accuracy to which the sampling filter is known.
SIMULATION_LIMIT = 0.004
#: Maximum value of an error: a model that has lost the motion altogether is not worse than twice the signal.
MOST_ERROR = 2.0


def excess(error: FloatArray, floors: FloatArray) -> float:
    """Mean square of the errors above their floors, over runs and channels."""
    return float(np.mean(_beyond(error, floors)))


def _beyond(error: FloatArray, floors: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(np.minimum(error, MOST_ERROR) ** 2 - floors**2, 0.0))


def share_removed(before: FloatArray, after: FloatArray, floors: FloatArray) -> float:
    """Share of the excess of the errors `before` that is removed in the errors `after`."""
    whole = excess(before, floors)
    return 1.0 - excess(after, floors) / whole if whole > 0.0 else 0.0


def is_adequate(error: FloatArray, floors: FloatArray, enough: float, tolerance: float = 0.0) -> bool:
    """Whether every run and channel is explained down to its floor, or to the user's tolerance."""
    return bool(np.all(error < np.maximum(enough * floors, tolerance)))


def ratio(one: FloatArray, other: FloatArray, floors: FloatArray) -> float:
    """Ratio of the pooled rms errors of two models, each at least at the floor."""
    return float(np.sqrt(np.mean(pooled(one, floors)) / np.mean(pooled(other, floors))))


def log_excess(error: FloatArray, floors: FloatArray) -> float:
    """Mean over runs and channels of the logarithm of error divided by floor: zero for a perfect model."""
    return float(np.mean(np.log(np.maximum(error / floors, 1.0))))


def pooled(error: FloatArray, floors: FloatArray) -> FloatArray:
    """Mean square error of each run, each channel at least at its floor, shape (runs,)."""
    return np.asarray(np.mean(np.maximum(np.minimum(error, MOST_ERROR), floors) ** 2, axis=1))
