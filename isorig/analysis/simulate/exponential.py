"""Matrix exponentials of many small matrices at once."""

from __future__ import annotations

import numpy as np

from isorig.analysis.campaign import FloatArray

#: Number of terms of the series: accurate to rounding for a norm of one half.
TERMS = 14


def exponentials(matrices: FloatArray) -> FloatArray:
    """exp of each matrix, shape (..., n, n), by scaling and squaring a Taylor series.

    Much faster for stacks of small matrices than a library function called for each. No balancing is needed, because the
    series is evaluated at a norm below one half.

    Parameters
    ----------
    matrices
        Shape (..., n, n).
    """
    norm = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    squarings = max(0, int(np.ceil(np.log2(max(norm, 1e-300) / 0.5))))
    scaled = matrices / 2.0**squarings
    # Without the identity, so that small increments keep their precision in the squarings.
    term = scaled.copy()
    total = scaled.copy()
    for k in range(2, TERMS):
        term = term @ scaled / k
        total = total + term
    for _ in range(squarings):
        total = 2.0 * total + total @ total
    return total + np.eye(total.shape[-1])
