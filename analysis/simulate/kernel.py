"""The compiled inner loop: linear motion from mode to mode, exits located to the last bit, curved forces as parabolas.

All in units of a step; see `Compiled` for the vector y and the arrays.
"""

from __future__ import annotations

import numpy as np

from analysis.jit import kernel
from analysis.measured import FloatArray, IntArray
from analysis.simulate.curves import advance, resist

#: Changes of mode that one step may see; beyond it the step is taken as it is.
TRIPS = 60
#: Passes of the curved forces over a step, and the change at which they end.
PASSES, SETTLED = 10, 1e-10


@kernel
def jump(rate: FloatArray, y: FloatArray, tau: float, speed: float, out: FloatArray, term: FloatArray, work: FloatArray) -> None:
    """State after a part `tau` of a step by its Taylor series, into out[:m]."""
    m, size = rate.shape
    curves = (size - m - 3) // 3
    for i in range(m):
        acc = 0.0
        for j in range(size):
            acc += rate[i, j] * y[j]
        term[i] = tau * acc
        out[i] = y[i] + term[i]
    bound = 1.0
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
        for i in range(m):
            term[i] = work[i]
            out[i] += work[i]
        bound *= speed * tau / k
        if k > 3 and bound < 1e-18:
            break


@kernel
def ahead(columns: FloatArray, blocks: int, y: FloatArray, first: int, last: int, base: FloatArray, out: FloatArray) -> None:
    """base + the columns from `first` up to `last` times y, eight rows at a time: their sums stay in wide registers."""
    for b in range(blocks):
        a0, a1, a2, a3 = base[b, 0], base[b, 1], base[b, 2], base[b, 3]
        a4, a5, a6, a7 = base[b, 4], base[b, 5], base[b, 6], base[b, 7]
        for j in range(first, last):
            x = y[j]
            a0 += columns[b, j, 0] * x
            a1 += columns[b, j, 1] * x
            a2 += columns[b, j, 2] * x
            a3 += columns[b, j, 3] * x
            a4 += columns[b, j, 4] * x
            a5 += columns[b, j, 5] * x
            a6 += columns[b, j, 6] * x
            a7 += columns[b, j, 7] * x
        out[b, 0], out[b, 1], out[b, 2], out[b, 3] = a0, a1, a2, a3
        out[b, 4], out[b, 5], out[b, 6], out[b, 7] = a4, a5, a6, a7


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


@kernel
def run(
    u: FloatArray,
    cuts: int,
    step: float,
    t0: float,
    speed: float,
    rate: FloatArray,
    whole: FloatArray,
    half: FloatArray,
    blocks: IntArray,
    guards: FloatArray,
    exits: IntArray,
    settle: FloatArray,
    strides: IntArray,
    counts: IntArray,
    curve_of: IntArray,
    codes: IntArray,
    params: FloatArray,
    directions: FloatArray,
    gates: FloatArray,
    sense: FloatArray,
    out: FloatArray,
    curved: FloatArray,
    modes: IntArray,
    log: FloatArray,
) -> int:
    """Run a rig from rest through a drive on a fine grid.

    Parameters
    ----------
    u
        The drive, shape (n,); a fine step has `cuts` steps of `step` seconds, the first at `t0`.
    speed, rate, whole, half, blocks, guards, exits, settle, strides, counts, curve_of, codes, params, directions, gates
        See `Compiled`.
    sense
        Rows on z for what is wanted on the grid, shape (sensors, m).
    out, curved, modes
        Filled with the sensors' values (sensors, n), the curved forces (curves, n) and the mode (n,); the last two only
        where `modes` is not empty.
    log
        Filled with (time, element, state) of every change of state as far as there is room.

    Returns
    -------
    int
        Number of changes of state; -1 where the motion grows without bound.
    """
    m, size = rate.shape[1], rate.shape[2]
    n, curves = m // 2, len(codes)
    # Sensors read few coordinates: keep their weights in front.
    sense = sense.copy()
    places, filled = np.zeros(sense.shape, dtype=np.int64), np.zeros(len(sense), dtype=np.int64)
    for r in range(len(sense)):
        for i in range(m):
            if sense[r, i] != 0.0:
                places[r, filled[r]] = i
                sense[r, filled[r]] = sense[r, i]
                filled[r] += 1
    y, y1 = np.zeros(size), np.zeros(size)
    term, work = np.zeros(m), np.zeros(m)
    base, base_half = np.zeros((whole.shape[1], 8)), np.zeros((half.shape[1], 8))
    nothing, after8, middle8 = np.zeros((whole.shape[1], 8)), np.zeros((whole.shape[1], 8)), np.zeros((half.shape[1], 8))
    after, middle = after8.reshape(-1), middle8.reshape(-1)
    p = np.zeros(guards.shape[2])
    margin = np.zeros(exits.shape[1])
    inner, inner1, ends = np.zeros(curves), np.zeros(curves), np.zeros(curves)
    y[m] = y1[m] = 1.0
    mode, fresh, events = 0, -1, 0
    share = 1.0 / cuts
    known, smooth = False, False
    for at in range(len(u)):
        for r in range(sense.shape[0]):
            acc = 0.0
            for k in range(filled[r]):
                acc += sense[r, k] * y[places[r, k]]
            out[r, at] = acc
        if len(modes) > 0:
            modes[at] = mode
        last = at == len(u) - 1
        if last and (curves == 0 or len(modes) == 0):
            break
        for cut in range(1 if last else cuts):
            slope = 0.0 if last else (u[at + 1] - u[at]) * share
            y[m + 1], y[m + 2] = u[at] + slope * cut, slope
            now = t0 + (at * cuts + cut) * step
            left = 1.0
            for trip in range(TRIPS):
                entire = left == 1.0
                if curves == 0:
                    if entire:
                        ahead(whole[mode], blocks[mode], y, 0, m + 3, nothing, after8)
                        for i in range(m):
                            y1[i] = after[i]
                    else:
                        jump(rate[mode], y, left, speed, y1, term, work)
                else:
                    for c in range(curves):
                        e = curve_of[c]
                        d, v = 0.0, 0.0
                        for i in range(n):
                            d += directions[c, i] * y[i]
                            v += directions[c, i] * y[n + i]
                        gate = gates[c, (mode // strides[e]) % counts[e]]
                        f = m + 3 + 3 * c
                        y[f] = resist(codes[c], params[c], gate, inner[c], d, v / step, now)
                        # Begin with the parabola of the step before, where nothing changed since.
                        y[f + 1] = y[f + 1] + y[f + 2] if smooth and entire else 0.0
                        y[f + 2] = y[f + 2] if smooth and entire else 0.0
                        ends[c] = y[f] + y[f + 1] + 0.5 * y[f + 2]
                        if cut == 0 and trip == 0 and len(modes) > 0:
                            curved[c, at] = y[f]
                    if last:
                        break
                    if entire:
                        ahead(whole[mode], blocks[mode], y, 0, m + 3, nothing, base)
                        ahead(half[mode], half.shape[1], y, 0, m + 3, nothing, base_half)
                    for _ in range(PASSES):
                        if entire:
                            ahead(whole[mode], blocks[mode], y, m + 3, size, base, after8)
                            ahead(half[mode], half.shape[1], y, m + 3, size, base_half, middle8)
                            for i in range(m):
                                y1[i] = after[i]
                        else:
                            jump(rate[mode], y, 0.5 * left, speed, middle, term, work)
                            jump(rate[mode], y, left, speed, y1, term, work)
                        change, largest = 0.0, 0.0
                        for c in range(curves):
                            e = curve_of[c]
                            gate = gates[c, (mode // strides[e]) % counts[e]]
                            f0, fm, f1, inner1[c] = advance(
                                codes[c], params[c], gate, inner[c], directions[c], y, middle, y1, step, left, now
                            )
                            f = m + 3 + 3 * c
                            y[f + 1] = (-3.0 * f0 + 4.0 * fm - f1) / left
                            y[f + 2] = 4.0 * (f0 - 2.0 * fm + f1) / (left * left)
                            change = max(change, abs(f1 - ends[c]))
                            largest = max(largest, abs(f1), abs(f0))
                            ends[c] = f1
                        if change <= SETTLED * largest:
                            break
                y1[m + 1], y1[m + 2] = y[m + 1] + y[m + 2] * left, y[m + 2]
                for c in range(curves):
                    f = m + 3 + 3 * c
                    y1[f] = y[f] + left * (y[f + 1] + 0.5 * left * y[f + 2])
                    y1[f + 1] = y[f + 1] + left * y[f + 2]
                    y1[f + 2] = y[f + 2]
                best, which = 2.0, -1
                for g in range(exits.shape[1]):
                    e = exits[mode, g, 0]
                    if e < 0:
                        break
                    if entire:
                        g1, slope1 = after[m + 2 * g], after[m + 2 * g + 1]
                    else:
                        g1, slope1 = 0.0, 0.0
                        for j in range(size):
                            g1 += guards[mode, g, 0, j] * y1[j]
                            slope1 += guards[mode, g, 1, j] * y1[j]
                    g0 = margin[g]
                    margin[g] = g1
                    young = e == fresh and exits[mode, g, 2] == 1
                    if not known:
                        g0 = 0.0
                        for j in range(size):
                            g0 += guards[mode, g, 0, j] * y[j]
                    look = g1 < 0.0 or (g0 < 0.0 and not young)
                    if not look and slope1 * left > g1:
                        # Two crossings within the step: where the tangents at its ends meet below zero.
                        slope0 = 0.0
                        for j in range(size):
                            slope0 += guards[mode, g, 1, j] * y[j]
                        if slope0 < 0.0:
                            meet = (g1 - slope1 * left - g0) / (slope0 - slope1)
                            look = g0 + slope0 * meet < 0.0
                    if look:
                        tau = first_exit(guards[mode, g], y, left, g1 < 0.0, young, p)
                        if tau < best:
                            best, which = tau, g
                if which < 0 or trip == TRIPS - 1:
                    for i in range(m):
                        y[i] = y1[i]
                    for c in range(curves):
                        inner[c] = inner1[c]
                    fresh = -1
                    known, smooth = curves == 0, entire
                    break
                tau = min(best, left)
                jump(rate[mode], y, tau, speed, y1, term, work)
                if curves > 0:
                    jump(rate[mode], y, 0.5 * tau, speed, middle, term, work)
                    for c in range(curves):
                        e = curve_of[c]
                        gate = gates[c, (mode // strides[e]) % counts[e]]
                        _, _, _, inner[c] = advance(
                            codes[c], params[c], gate, inner[c], directions[c], y, middle, y1, step, tau, now
                        )
                for i in range(m):
                    y[i] = y1[i]
                y[m + 1] += tau * y[m + 2]
                left -= tau
                now += tau * step
                for _ in range(exits.shape[1] + 1):
                    e, state = exits[mode, which, 0], exits[mode, which, 1]
                    mode += (state - (mode // strides[e]) % counts[e]) * strides[e]
                    for i in range(n):
                        acc = 0.0
                        for j in range(n):
                            acc += settle[mode, i, j] * y[n + j]
                        work[i] = acc
                    for i in range(n):
                        y[n + i] = work[i]
                    if events < len(log):
                        log[events, 0], log[events, 1], log[events, 2] = now, e, state
                    events += 1
                    fresh = e
                    # What landed may not hold: then it goes on at once.
                    which = -1
                    if curves == 0:
                        for g in range(exits.shape[1]):
                            e = exits[mode, g, 0]
                            if e < 0 or which >= 0:
                                break
                            if e != fresh or exits[mode, g, 2] == 0:
                                g0 = 0.0
                                for j in range(size):
                                    g0 += guards[mode, g, 0, j] * y[j]
                                if g0 < 0.0:
                                    which = g
                    if which < 0:
                        break
                known, smooth = False, False
                if left <= 1e-13:
                    break
        for i in range(n):
            if not abs(y[i]) < 1e9:
                return -1
    return events
