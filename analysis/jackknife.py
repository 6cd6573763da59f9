"""Standard deviations from what leaving out each part of the data does to a figure (Tukey 1958; Efron and Stein 1981)."""

from __future__ import annotations

import numpy as np

from isorig.analysis.campaign import FloatArray

#: Two-sided 95 % of the normal distribution: a deviation times this is half of a 95 % interval.
NORMAL = 1.959964


def deviation(moves: FloatArray, slope: FloatArray) -> float:
    """Standard deviation of a figure that goes with some values by `slope`, in which few parts of the data are made up for.

    Where few parts carry a value, its deviation is itself uncertain, and grows to what Student's distribution with that many
    degrees of freedom needs (Satterthwaite 1946, as Bell and McCaffrey 2002).

    Parameters
    ----------
    moves
        How far leaving out each part of the data moves the values, shape (parts, values).
    slope
        How the figure goes with the values, shape (values,).
    """
    from scipy.special import stdtrit

    own = (moves @ slope) ** 2
    whole = float(own.sum())
    if whole == 0.0:
        return 0.0
    # Of a normal variable the fourth moment is three times the second one's square.
    degrees = 3.0 * whole**2 / float((own**2).sum())
    return float(np.sqrt(whole) * stdtrit(max(degrees, 2.0), 0.975) / NORMAL)
