"""Parts of a step: the motion by its Taylor series, and where along it a margin falls below zero."""

from __future__ import annotations

from analysis.jit import kernel
from analysis.measured import FloatArray


@kernel
def jump(
    rate: FloatArray,
    y: FloatArray,
    tau: float,
    speed: float,
    out: FloatArray,
    middle: FloatArray,
    quarter: FloatArray,
    term: FloatArray,
    work: FloatArray,
) -> None:
    """State after a part `tau` of a step by its Taylor series, into out[:m], and half and a quarter of the way there."""
    m, size = rate.shape
    curves = (size - m - 3) // 3
    for i in range(m):
        acc = 0.0
        for j in range(size):
            acc += rate[i, j] * y[j]
        term[i] = tau * acc
        out[i] = y[i] + term[i]
        middle[i] = y[i] + 0.5 * term[i]
        quarter[i] = y[i] + 0.25 * term[i]
    bound, half = 1.0, 0.5
    for k in range(2, 40):
        for i in range(m):
            acc = 0.0
            for j in range(m):
                acc += rate[i, j] * term[j]
            if k == 2:
                acc += rate[i, m + 1] * tau * y[m + 2]
                for c in range(curves):
                    acc += rate[i, m + 3 + 3 * c] * tau * y[m + 4 + 3 * c]
            elif k == 3:
                for c in range(curves):
                    acc += rate[i, m + 3 + 3 * c] * 0.5 * tau * tau * y[m + 5 + 3 * c]
            work[i] = acc * tau / k
        half *= 0.5
        for i in range(m):
            term[i] = work[i]
            out[i] += work[i]
            middle[i] += half * work[i]
            quarter[i] += half * half * work[i]
        bound *= speed * tau / k
        if k > 3 and bound < 1e-18:
            break


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
        if abs(new - x) <= 1e-16 * high or new in (low, high):
            return new
        x = new
    return x


@kernel
def first_exit(margins: FloatArray, y: FloatArray, left: float, ends_below: bool, fresh: bool, p: FloatArray) -> float:
    """Part of a step after which a margin falls below zero; 2 where it does not.

    Parameters
    ----------
    margins
        Taylor rows of the margin, shape (terms, M).
    y
        The vector at the start.
    left
        What is left of the step.
    ends_below
        Whether the margin is negative at the end; otherwise it may dip below zero in between.
    fresh
        Whether the margin starts from zero because its state has just begun.
    p
        Room for the polynomial.
    """
    total = 0.0
    for k in range(len(p)):
        acc = 0.0
        for j in range(margins.shape[1]):
            acc += margins[k, j] * y[j]
        p[k] = acc
        total += abs(acc)
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
