"""The force of a spring that slips beyond an elongation, along a measured motion."""

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import kernel


@kernel
def _slip_into(deflection: FloatArray, at: float, found: FloatArray) -> None:
    state = 0.0
    for k in range(1, len(deflection)):
        state = min(max(state + deflection[k] - deflection[k - 1], -at), at)
        found[k] = state / at


def slip_operator(deflection: FloatArray, at: float) -> FloatArray:
    """Force of a spring that slips at the elongation `at` in m, relative to its slip force, along a deflection of shape (n,)."""
    found = np.zeros(len(deflection))
    if at > 0.0:  # what does not move, does not slip
        _slip_into(np.ascontiguousarray(deflection), at, found)
    return found
