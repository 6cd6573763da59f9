"""Derivatives of sampled records."""

import numpy as np

from isorig.analysis.campaign import FloatArray

#: Weights of the next, second next, ... sample in a central difference of order 8 (B. Fornberg 1988, Math. Comp. 51, 699): at a
#: twelfth of the sample rate its error is 1e-5, that of the difference of the two neighbours 4 %.
WEIGHTS = (4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0)


def derivative(values: FloatArray, rate: float) -> FloatArray:
    """Time derivative of a record at a rate in Hz, shape (n,); at its ends from neighbouring samples alone."""
    found, n, side = np.gradient(values, 1.0 / rate), len(values), len(WEIGHTS)
    if n > 2 * side:
        found[side : n - side] = rate * sum(
            weight * (values[side + k : n - side + k] - values[side - k : n - side - k]) for k, weight in enumerate(WEIGHTS, 1)
        )
    return found
