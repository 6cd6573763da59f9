"""The compiled inner loop: linear motion from mode to mode, exits located to the last bit, curved forces as parabolas.

All in units of a step; see `Compiled` for the vector y and the arrays.
"""

from __future__ import annotations

import numpy as np

from analysis.jit import kernel
from analysis.measured import FloatArray, IntArray
from analysis.simulate.curves import advance, resist
from analysis.simulate.step import first_exit, point

#: Steps of a run that may bend too much for one parabola before their share counts.
PATIENCE = 64
#: Changes of mode that one step may see; beyond it the step is taken as it is.
TRIPS = 60
#: Passes of the curved forces over a step, and the share of a force that may be left unsettled when they end.
PASSES, SETTLED = 10, 1e-8
#: Share of a force by which a parabola may miss it between its points where a step is looked at closely. Elsewhere the last
#: parabola, continued, may miss the step's end by so much, 64 times of what the step's own then misses in between.
FINE, ROUGH = 1e-6, 64 * 4e-6
#: Shortest piece of a step that is taken to meet that.
SHORTEST = 1e-4
#: What is left after a step of the size that a force lately had.
FADING = 0.9998
#: Forces below this share of the drive are not worth being exact.
LEAST = 0.1
#: How much worse than last seen a pass may settle, and how much a step on which it was not seen adds to that.
CAUTION, WEAR = 4.0, 1.02


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
def read_out(
    at: int, mode: int, m: int, y: FloatArray, sense: FloatArray, places: IntArray, filled: IntArray,
    out: FloatArray, curved: FloatArray, modes: IntArray,
) -> None:  # fmt: skip
    """Sensors' values, and where wanted the curved forces and the mode, at a point of the grid."""
    for r in range(sense.shape[0]):
        acc = 0.0
        for k in range(filled[r]):
            acc += sense[r, k] * y[places[r, k]]
        out[r, at] = acc
    if len(modes) > 0:
        modes[at] = mode
        for c in range(curved.shape[0]):
            curved[c, at] = y[m + 3 + 3 * c]


@kernel
def march(
    q: int, u: FloatArray, cuts: int, step: float, t0: float, mode: int, columns: FloatArray, blocks: int, ways: int,
    codes: IntArray, params: FloatArray, gate: FloatArray, directions: FloatArray, inner: FloatArray, inner1: FloatArray,
    ends: FloatArray, largest: FloatArray, floor: FloatArray, d0: FloatArray, v0: FloatArray, ratio: FloatArray,
    y: FloatArray, m: int, base: FloatArray, after8: FloatArray, sense: FloatArray, places: IntArray,
    filled: IntArray, out: FloatArray, curved: FloatArray, modes: IntArray,
) -> int:  # fmt: skip
    """Whole steps from step `q` on in one mode, up to the first in which a margin may fall below zero; that step's number."""
    after = after8.reshape(-1)
    size, curves = len(y), len(codes)
    n, state, looks = m // 2, 4 * curves, -(-4 * curves // 8)
    share = 1.0 / cuts
    at, cut = q // cuts, q % cuts
    base[:] = 0.0
    for c in range(curves):
        d0[c], v0[c] = along(directions[c], y, n, step)
    while at < len(u) - 1:
        if cut == 0:
            # As in `read_out`; a call costs as much as the step.
            for r in range(sense.shape[0]):
                acc = 0.0
                for k in range(filled[r]):
                    acc += sense[r, k] * y[places[r, k]]
                out[r, at] = acc
            if len(modes) > 0:
                read_out(at, mode, m, y, sense, places, filled, out, curved, modes)
        slope = (u[at + 1] - u[at]) * share
        y[m + 1], y[m + 2] = u[at] + slope * cut, slope
        if curves == 0:
            ahead(columns, blocks, y, 0, m + 3, base, after8)
        else:
            base[:] = 0.0
            ahead(columns, blocks, y, 0, m + 3, base, base)
            now = t0 + (at * cuts + cut) * step
            before = 0.0
            ratio[0] = min(WEAR * ratio[0], 1.0)
            for c in range(curves):
                f = m + 3 + 3 * c
                ends[c] = y[f] + y[f + 1] + 0.5 * y[f + 2]
            for attempt in range(PASSES):
                ahead(columns, looks, y, m + 3, size, base, after8)
                worst = 0.0
                for c in range(curves):
                    f0, k = y[m + 3 + 3 * c], 4 * c
                    fm, f1, inner1[c] = advance(
                        codes[c], params[c], gate[c], inner[c], d0[c], v0[c], after[k], after[k + 1], after[k + 2], after[k + 3],
                        step, now,
                    )  # fmt: skip
                    bend(y, m + 3 + 3 * c, f0, fm, f1, 1.0)
                    largest[c] = max(abs(f1), FADING * largest[c], floor[c])
                    worst = max(worst, abs(f1 - ends[c]) / largest[c])
                    ends[c] = f1
                    if codes[c] >= 7 and v0[c] * after[k + 3] < 0.0:
                        # A memory's rate has a corner where the speed turns.
                        worst = max(worst, 1.0)
                if attempt == 0 and worst > ROUGH:
                    return at * cuts + cut
                if attempt > 0:
                    ratio[0] = min(CAUTION * worst / before, 1.0)
                before = worst
                if worst * ratio[0] <= SETTLED:
                    break
            ahead(columns, blocks, y, m + 3, size, base, after8)
        for g in range(ways):
            g1, slope1 = after[state + m + 2 * g], after[state + m + 2 * g + 1]
            # Below zero, or perhaps there and back: the tangent at the end began below zero.
            if not (g1 >= 0.0 and slope1 <= g1):
                return at * cuts + cut
        for i in range(m):
            y[i] = after[state + i]
        for c in range(curves):
            f = m + 3 + 3 * c
            # The next step's first guess: this one's parabola, continued.
            y[f], y[f + 1] = ends[c], y[f + 1] + y[f + 2]
            inner[c], d0[c], v0[c] = inner1[c], after[4 * c + 2], after[4 * c + 3]
        cut += 1
        if cut == cuts:
            at, cut = at + 1, 0
    return at * cuts


@kernel
def along(direction: FloatArray, y: FloatArray, n: int, step: float) -> tuple[float, float]:
    """Elongation (m) and its speed (m/s) along a direction."""
    d, v = 0.0, 0.0
    for i in range(n):
        d += direction[i] * y[i]
        v += direction[i] * y[n + i]
    return d, v / step


@kernel
def stop(settle: FloatArray, y: FloatArray, n: int, work: FloatArray) -> None:
    """Take the speeds of settled contacts to zero."""
    for i in range(n):
        work[i] = 0.0
        for j in range(n):
            work[i] += settle[i, j] * y[n + j]
    for i in range(n):
        y[n + i] = work[i]


@kernel
def bend(y: FloatArray, f: int, f0: float, fm: float, f1: float, left: float) -> None:
    """Make the curved force at y[f] a parabola through its values at start, middle and end of `left` of a step."""
    y[f + 1] = (-3.0 * f0 + 4.0 * fm - f1) / left
    y[f + 2] = 4.0 * (f0 - 2.0 * fm + f1) / (left * left)


@kernel
def run(
    u: FloatArray,
    cuts: int,
    step: float,
    t0: float,
    n: int,
    whole: FloatArray,
    blocks: IntArray,
    series: FloatArray,
    terms: int,
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
    split_share: float,
) -> int:
    """Run a rig from rest through a drive on a fine grid.

    Parameters
    ----------
    u
        The drive, shape (n,); a fine step has `cuts` steps of `step` seconds, the first at `t0`.
    n
        Number of coordinates.
    whole, blocks, series, terms, exits, settle, strides, counts, curve_of, codes, params, directions, gates
        See `Compiled`.
    sense
        Rows on z for what is wanted on the grid, shape (sensors, m).
    out, curved, modes
        Filled with the sensors' values (sensors, n), the curved forces (curves, n) and the mode (n,); the last two only
        where `modes` is not empty.
    log
        Filled with (time, element, state) of every change of state as far as there is room.
    split_share
        Share of the steps up to which curved forces may bend too much for one parabola.

    Returns
    -------
    int
        Number of changes of state; -1 where the motion grows without bound, -2 where more steps bend too much.
    """
    m, size, curves = 2 * n, whole.shape[2], len(codes)
    bent, looks, groups = 2 * curves, -(-2 * curves // 8), series.shape[1] // terms
    # Sensors read few coordinates: keep their weights in front.
    sense = sense.copy()
    places, filled = np.zeros(sense.shape, dtype=np.int64), np.zeros(len(sense), dtype=np.int64)
    for r in range(len(sense)):
        for i in range(m):
            if sense[r, i] != 0.0:
                places[r, filled[r]] = i
                sense[r, filled[r]] = sense[r, i]
                filled[r] += 1
    y, y1 = np.zeros(size), np.zeros(8 * groups)
    middle, quarter, work, p = np.zeros(8 * groups), np.zeros(8 * groups), np.zeros(n), np.zeros(terms)
    still, known8, taylor8 = np.zeros((len(series[0]), 8)), np.zeros((len(series[0]), 8)), np.zeros((len(series[0]), 8))
    taylor = taylor8.reshape(terms, -1)
    base, after = np.zeros((whole.shape[1], 8)), np.zeros((whole.shape[1], 8))
    inner, inner1, ends, largest = np.zeros(curves), np.zeros(curves), np.zeros(curves), np.zeros(curves)
    d0, v0, gate, floor = np.zeros(curves), np.zeros(curves), np.zeros(curves), np.zeros(curves)
    # How far a pass leaves the curved forces from where the next one takes them, as last seen.
    ratio = np.ones(1)
    y[m] = 1.0
    mode, fresh, events, q, splits = 0, -1, 0, 0, 0
    share = 1.0 / cuts
    peak = np.abs(u).max()
    for c in range(curves):
        push, bends = 0.0, 1e-300
        for i in range(n):
            lane = 4 * curves + n + i
            push = max(push, np.abs(whole[:, lane // 8, m + 1, lane % 8]).max())
            bends = max(bends, np.abs(whole[:, lane // 8, m + 3 + 3 * c, lane % 8]).max())
        floor[c] = LEAST * peak * push / bends + 1e-30
        gate[c] = gates[c, (mode // strides[curve_of[c]]) % counts[curve_of[c]]]
        y[m + 3 + 3 * c] = resist(codes[c], params[c], gate[c], inner[c], 0.0, 0.0, t0)
    while True:
        if fresh < 0:
            ways = 0
            while ways < exits.shape[1] and exits[mode, ways, 0] >= 0:
                ways += 1
            q = march(
                q, u, cuts, step, t0, mode, whole[mode], blocks[mode], ways, codes, params, gate, directions, inner, inner1,
                ends, largest, floor, d0, v0, ratio, y, m, base, after, sense, places, filled, out, curved, modes,
            )  # fmt: skip
        at, cut = q // cuts, q % cuts
        if cut == 0:
            read_out(at, mode, m, y, sense, places, filled, out, curved, modes)
        for i in range(n):
            if not abs(y[i]) < 1e9:
                return -1
        if at == len(u) - 1:
            return events
        slope = (u[at + 1] - u[at]) * share
        y[m + 1], y[m + 2] = u[at] + slope * cut, slope
        now, left, part, trips, split = t0 + q * step, 1.0, 1.0, 0, False
        while left > 1e-13:
            part = min(part, left)
            for c in range(curves):
                d0[c], v0[c] = along(directions[c], y, n, step)
                f = m + 3 + 3 * c
                ends[c] = y[f] + part * (y[f + 1] + 0.5 * part * y[f + 2])
            ahead(series[mode], len(series[mode]), y, 0, m + 3, still, known8 if curves > 0 else taylor8)
            if curves > 0:
                ahead(series[mode], len(series[mode]), y, m + 3, size, known8, taylor8)
            before = 0.0
            for attempt in range(PASSES if curves > 0 else 0):
                point(taylor, 0.5 * part, looks, middle)
                point(taylor, part, looks, y1)
                worst = 0.0
                for c in range(curves):
                    fm, f1, inner1[c] = advance(
                        codes[c], params[c], gate[c], inner[c], d0[c], v0[c], middle[2 * c], middle[2 * c + 1], y1[2 * c],
                        y1[2 * c + 1], part * step, now,
                    )  # fmt: skip
                    bend(y, m + 3 + 3 * c, y[m + 3 + 3 * c], fm, f1, part)
                    largest[c] = max(abs(f1), FADING * largest[c], floor[c])
                    worst = max(worst, abs(f1 - ends[c]) / largest[c])
                    ends[c] = f1
                ahead(series[mode], len(series[mode]), y, m + 3, size, known8, taylor8)
                if attempt > 0:
                    ratio[0] = min(CAUTION * worst / before, 1.0)
                before = worst
                if worst * ratio[0] <= SETTLED:
                    break
            point(taylor, part, groups, y1)
            missed = 0.0
            if curves > 0:
                point(taylor, 0.5 * part, looks, middle)
                point(taylor, 0.25 * part, looks, quarter)
            for c in range(curves):
                f = m + 3 + 3 * c
                # Half-way through the first half: what the parabola says of a point that it was not drawn through.
                fq, _, _ = advance(
                    codes[c], params[c], gate[c], inner[c], d0[c], v0[c], quarter[2 * c], quarter[2 * c + 1], middle[2 * c],
                    middle[2 * c + 1], 0.5 * part * step, now,
                )  # fmt: skip
                drawn = y[f] + 0.25 * part * (y[f + 1] + 0.125 * part * y[f + 2])
                missed = max(missed, abs(fq - drawn) / largest[c])
            if missed > FINE and part > SHORTEST:
                part *= 0.5
                split = split or trips == 0
                continue
            best, which = 2.0, -1
            for g in range(exits.shape[1] if trips < TRIPS else 0):
                e, row = exits[mode, g, 0], bent + m + g
                if e < 0:
                    break
                young = e == fresh and exits[mode, g, 2] == 1
                g0, g1 = taylor[0, row], y1[row]
                look = g1 < 0.0 or (g0 < 0.0 and not young)
                if not look and taylor[1, row] < 0.0:
                    # Two crossings within the step: where the tangents at its ends meet below zero.
                    slope0, slope1 = taylor[1, row], 0.0
                    for k in range(terms - 1, 0, -1):
                        slope1 = slope1 * part + k * taylor[k, row]
                    if slope1 * part > g1:
                        meet = (g1 - slope1 * part - g0) / (slope0 - slope1)
                        look = g0 + slope0 * meet < 0.0
                if look:
                    p[:] = taylor[:, row]
                    tau = first_exit(p, part, g1 < 0.0, young)
                    if tau < best:
                        best, which = tau, g
            tau = part if which < 0 else min(best, part)
            if which >= 0:
                point(taylor, tau, groups, y1)
            for i in range(m):
                y[i] = y1[bent + i]
            y[m + 1] += tau * y[m + 2]
            left -= tau
            if which < 0:
                for c in range(curves):
                    f = m + 3 + 3 * c
                    y[f], y[f + 1], inner[c] = ends[c], y[f + 1] + tau * y[f + 2], inner1[c]
                now += tau * step
                fresh = -1
                part *= 2.0
                continue
            if curves > 0:
                point(taylor, 0.5 * tau, looks, middle)
            for c in range(curves):
                _, _, inner[c] = advance(
                    codes[c], params[c], gate[c], inner[c], d0[c], v0[c], middle[2 * c], middle[2 * c + 1], y1[2 * c],
                    y1[2 * c + 1], tau * step, now,
                )  # fmt: skip
                y[m + 4 + 3 * c] += tau * y[m + 5 + 3 * c]
            now += tau * step
            trips += 1
            ratio[0] = 1.0
            for _ in range(exits.shape[1] + 1):
                e, state = exits[mode, which, 0], exits[mode, which, 1]
                # What held has drifted by rounding: it leaves without speed, as it came.
                stop(settle[mode], y, n, work)
                mode += (state - (mode // strides[e]) % counts[e]) * strides[e]
                stop(settle[mode], y, n, work)
                for c in range(curves):
                    gate[c] = gates[c, (mode // strides[curve_of[c]]) % counts[curve_of[c]]]
                    d, v = along(directions[c], y, n, step)
                    y[m + 3 + 3 * c] = resist(codes[c], params[c], gate[c], inner[c], d, v, now)
                if events < len(log):
                    log[events, 0], log[events, 1], log[events, 2] = now, e, state
                events += 1
                fresh = e
                # What landed may not hold: then it goes on at once.
                which = -1
                ahead(series[mode], groups, y, 0, size, still, taylor8)
                for g in range(exits.shape[1]):
                    e = exits[mode, g, 0]
                    if e < 0 or which >= 0:
                        break
                    if (e != fresh or exits[mode, g, 2] == 0) and taylor[0, bent + m + g] < 0.0:
                        which = g
                if which < 0:
                    break
        q += 1
        if split and trips == 0:
            splits += 1
            if splits > PATIENCE + split_share * q:
                return -2
