"""The exact motion of a linear rig between samples of its drive: scipy's `lsim`, whose loop is Python, in a compiled loop."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.linalg import expm

from isorig.analysis.campaign import FloatArray


def moved(system: FloatArray, inputs: FloatArray, signals: FloatArray, step: float) -> FloatArray:
    """States from rest at zero, shape (states, n), for signals of shape (inputs, n) that are linear between steps of seconds."""
    states, count = inputs.shape
    size = states + 2 * count
    rates = np.zeros((size, size))
    rates[:states, :states], rates[:states, states : states + count] = system * step, inputs * step
    rates[states : states + count, states + count :] = np.eye(count)
    onward = expm(rates)
    later = onward[:states, states + count :]
    now = onward[:states, states : states + count] - later
    return np.asarray(_stepped(onward[:states, :states].copy(), now @ signals[:, :-1] + later @ signals[:, 1:]))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _stepped(onward: FloatArray, pushes: FloatArray) -> FloatArray:
    states, steps = pushes.shape
    found = np.zeros((states, steps + 1))
    for k in range(steps):
        for i in range(states):
            total = pushes[i, k]
            for j in range(states):
                total += onward[i, j] * found[j, k]
            found[i, k + 1] = total
    return found
