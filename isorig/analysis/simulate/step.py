"""Parts of a step: the motion as a polynomial in time, and the time at which a margin falls below zero."""

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import inlined, kernel

#: Newton's correction of a zero, as a share of the interval, below which Halley's method, which triples the number of correct
#: digits, is exact to rounding. Its own correction also vanishes at a minimum.
EXACT = 1e-6


@inlined
def point(taylor: FloatArray, x: float, groups: int, points: FloatArray, which: int) -> None:
    """Evaluate the first groups of eight rows at the share x of a step, by Horner's method; store them in points[which].

    `taylor` are their Taylor coefficients, term by term, (terms * groups, 8). The index is unsigned for the reason in `ahead`.
    """
    term = np.uint64(points.shape[1])
    for b in range(groups):
        at = np.uint64(len(taylor) + b) - term
        a0, a1, a2, a3 = taylor[at, 0], taylor[at, 1], taylor[at, 2], taylor[at, 3]
        a4, a5, a6, a7 = taylor[at, 4], taylor[at, 5], taylor[at, 6], taylor[at, 7]
        while at >= term:
            at -= term
            a0 = a0 * x + taylor[at, 0]
            a1 = a1 * x + taylor[at, 1]
            a2 = a2 * x + taylor[at, 2]
            a3 = a3 * x + taylor[at, 3]
            a4 = a4 * x + taylor[at, 4]
            a5 = a5 * x + taylor[at, 5]
            a6 = a6 * x + taylor[at, 6]
            a7 = a7 * x + taylor[at, 7]
        points[which, b, 0], points[which, b, 1], points[which, b, 2], points[which, b, 3] = a0, a1, a2, a3
        points[which, b, 4], points[which, b, 5], points[which, b, 6], points[which, b, 7] = a4, a5, a6, a7


@kernel
def polynomial(p: FloatArray, x: float) -> float:
    """Value at x of the polynomial with ascending coefficients."""
    acc = 0.0
    for k in range(len(p) - 1, -1, -1):
        acc = acc * x + p[k]
    return acc


@kernel
def falls(p: FloatArray, high: float, below: float) -> float:
    """Zero of a polynomial that is positive at zero and has the negative value `below` at `high`, by bracketed Halley."""
    low = 0.0
    # Start at the zero of the parabola through both values with the slope at zero; its coefficients are those of x / high.
    rise = p[1] * high
    under = np.sqrt(max(rise * rise - 4.0 * (below - p[0] - rise) * p[0], 0.0)) - rise
    x = high * (2.0 * p[0] / under) if 0.0 < under < np.inf else 0.5 * (low + high)
    if not low < x < high:
        x = 0.5 * (low + high)
    for _ in range(80):
        # Value, slope and half the second derivative.
        value, slope, bend = 0.0, 0.0, 0.0
        for k in range(len(p) - 1, -1, -1):
            bend = bend * x + slope
            slope = slope * x + value
            value = value * x + p[k]
        if value > 0.0:
            low = x
        else:
            high = x
        new = x - value * slope / (slope * slope - value * bend) if slope != 0.0 else -1.0
        if not low <= new <= high:
            # Towards another zero, where the margin rises.
            new = 0.5 * (low + high)
            if new in (low, high):
                return new
        elif abs(value) <= EXACT * high * abs(slope):
            return new
        x = new
    return x


@kernel
def first_exit(p: FloatArray, left: float) -> float:
    """Share of a step after which a margin falls below zero; 2 if it does not.

    Parameters
    ----------
    p
        Taylor coefficients of the margin, shape (terms,); the first non-zero one is positive. If the margin starts at zero,
        because its state has just begun, that zero is divided out; the array is overwritten.
    left
        Remaining share of the step.
    """
    zeros = 0
    while p[zeros] == 0.0:
        zeros += 1
    if zeros > 0:
        for k in range(len(p)):
            p[k] = p[k + zeros] if k + zeros < len(p) else 0.0
    value, slope = 0.0, 0.0
    for k in range(len(p) - 1, -1, -1):
        slope = slope * left + value
        value = value * left + p[k]
    if value < 0.0:
        return falls(p, left, value)
    # It may fall below zero in between: if the tangents at both ends meet below zero, evaluate its minimum.
    if p[1] >= 0.0 or slope <= 0.0 or p[0] + p[1] * (value - slope * left - p[0]) / (p[1] - slope) >= 0.0:
        return 2.0
    low, high = 0.0, left
    for _ in range(60):
        x = 0.5 * (low + high)
        slope = 0.0
        for k in range(len(p) - 1, 0, -1):
            slope = slope * x + k * p[k]
        if slope < 0.0:
            low = x
        else:
            high = x
    value = polynomial(p, high)
    return falls(p, high, value) if value < 0.0 else 2.0
