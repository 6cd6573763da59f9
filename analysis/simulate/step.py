"""Parts of a step: the motion as a polynomial in time, and where along it a margin falls below zero."""

from __future__ import annotations

from analysis.jit import kernel
from analysis.measured import FloatArray


@kernel
def point(coefficients: FloatArray, x: float, count: int, out: FloatArray) -> None:
    """The first `count` rows at the share x of a step, from their Taylor coefficients (terms, rows)."""
    last = len(coefficients) - 1
    for i in range(count):
        out[i] = coefficients[last, i]
    for k in range(last - 1, -1, -1):
        for i in range(count):
            out[i] = out[i] * x + coefficients[k, i]


@kernel
def polynomial(p: FloatArray, x: float) -> float:
    """Value at x of the polynomial with ascending coefficients."""
    acc = 0.0
    for k in range(len(p) - 1, -1, -1):
        acc = acc * x + p[k]
    return acc


@kernel
def falls(p: FloatArray, low: float, high: float) -> float:
    """Where the polynomial, positive at `low` and negative at `high`, crosses zero: Newton, kept between the two."""
    above, below = polynomial(p, low), polynomial(p, high)
    x = low + (high - low) * above / (above - below) if above > below else 0.5 * (low + high)
    for _ in range(80):
        value, slope = 0.0, 0.0
        for k in range(len(p) - 1, -1, -1):
            slope = slope * x + value
            value = value * x + p[k]
        if value > 0.0:
            low = x
        else:
            high = x
        new = x - value / slope if slope != 0.0 else 0.5 * (low + high)
        if not low < new < high:
            new = 0.5 * (low + high)
        # Newton doubles the digits with every step: the next one would lie below rounding.
        if abs(new - x) <= 1e-9 * high or new in (low, high):
            return new
        x = new
    return x


@kernel
def first_exit(p: FloatArray, left: float, ends_below: bool, fresh: bool) -> float:
    """Part of a step after which a margin falls below zero; 2 where it does not.

    Parameters
    ----------
    p
        Taylor coefficients of the margin.
    left
        What is left of the step.
    ends_below
        Whether the margin is negative at the end; otherwise it may dip below zero in between.
    fresh
        Whether the margin starts from zero because its state has just begun.
    """
    total = 0.0
    for k in range(len(p)):
        total += abs(p[k])
    if fresh and abs(p[0]) < 1e-9 * total:
        # The zero at the start is where the state came from: look for the next one.
        p[0] = 0.0
        if not ends_below:
            return 2.0
        low = left
        for _ in range(40):
            low *= 0.5
            if polynomial(p, low) > 0.0:
                return falls(p, low, left)
        return 0.0
    if p[0] < 0.0:
        return 0.0
    if ends_below:
        return falls(p, 0.0, left)
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
    return falls(p, 0.0, high) if polynomial(p, high) < 0.0 else 2.0
