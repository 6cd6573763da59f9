"""Standard deviations from the effect of leaving out each part of the data (Tukey 1958; Efron and Stein 1981)."""

import numpy as np

from isorig.analysis.campaign import FloatArray

#: Two-sided 95 % of the normal distribution: a standard deviation times this is half of a 95 % interval.
NORMAL = 1.959964


def deviation(moves: FloatArray, slope: FloatArray) -> float:
    """Standard uncertainty of a quantity with derivatives `slope`, allowing for few effective parts of the data.

    If few parts determine a value, its standard deviation is itself uncertain, and is increased to Student's distribution with
    that many degrees of freedom (Satterthwaite 1946, as Bell and McCaffrey 2002).

    `moves` are the changes of the values when each part of the data is left out, shape (parts, values); `slope` are the
    derivatives of the quantity with respect to the values, shape (values,).
    """
    from scipy.special import stdtrit

    changes = moves @ slope
    largest = float(np.abs(changes).max(initial=0.0))
    if largest == 0.0:
        return 0.0
    own = (changes / largest) ** 2  # the fourth power of a tiny change would be zero
    whole = float(own.sum())
    # For a normal variable the fourth moment is three times the square of the second.
    degrees = 3.0 * whole**2 / float((own**2).sum())
    return float(largest * np.sqrt(whole) * stdtrit(max(degrees, 2.0), 0.975) / NORMAL)
