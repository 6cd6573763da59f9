"""The compiled inner loop: exact linear motion within a mode, changes of mode located to rounding, curved forces as parabolas.

All quantities are in units of a step; see `Rig` for the vector y and the arrays.
"""

from typing import Any

import numpy as np

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.analysis.jit import allocating_kernel, inlined, kernel
from isorig.analysis.simulate.curves import MEMORY, advance, remember, resist, step_on, to_kink
from isorig.analysis.simulate.instant import CLEAR, along, begins, follow
from isorig.analysis.simulate.step import falls, first_exit, point
from isorig.analysis.simulate.workspace import END, LEAP, MIDDLE, QUARTER, Motion, Record, Rig, first_margin, force_at, room

#: Number of steps that may need more than one parabola before the limit on their share applies.
PATIENCE = 64
#: Maximum number of changes of mode within one step; beyond it the run is refused as not converging.
TRIPS = 10_000
#: Maximum number of fixed-point passes for the curved forces in a step, and their relative convergence tolerance.
PASSES, SETTLED = 10, 1e-8
#: FINE: relative error of a parabola between its points above which a step is halved. ROUGH: relative error at the end of the
#: step, of the extrapolated parabola of the last step, above which that error is checked; it is 64 times the error in between.
FINE, ROUGH = 1e-6, 64 * 4e-6
#: Shortest part of a step to which halving may lead; a kink this near to the start or, relative to the part, to the end of a part
#: does not divide it.
SHORTEST = 1e-4
#: Number of times that one part is shortened to a kink, which the motion on the shorter part may move, before it is halved.
KINKS = 3
#: Factor per step by which the recent magnitude of a force decays.
FADING = 0.9998
#: Share of the drive below which a curved force need not be exact in relative terms.
LEAST = 0.1
#: Safety factor on the last observed convergence ratio, and its growth in each step without an observation.
CAUTION, WEAR = 4.0, 1.02


@inlined
def ahead(columns: FloatArray, blocks: int, y: FloatArray, first: int, last: int, base: FloatArray, out: FloatArray) -> None:
    """Add columns `first` up to `last` times y to base, eight rows at a time, so that the sums stay in vector registers.

    Every row has two sums, over every second column, from the last one on: what depends on the step before comes last, and waits
    for half as many additions. The indices are unsigned, so that none is checked for being negative.
    """
    for b in range(blocks):
        a0, a1, a2, a3 = base[b, 0], base[b, 1], base[b, 2], base[b, 3]
        a4, a5, a6, a7 = base[b, 4], base[b, 5], base[b, 6], base[b, 7]
        b0, b1, b2, b3, b4, b5, b6, b7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        low, high = np.uint64(first), np.uint64(last)
        if (high - low) & np.uint64(1):
            high -= np.uint64(1)
            x = y[high]
            b0 = columns[b, high, 0] * x
            b1 = columns[b, high, 1] * x
            b2 = columns[b, high, 2] * x
            b3 = columns[b, high, 3] * x
            b4 = columns[b, high, 4] * x
            b5 = columns[b, high, 5] * x
            b6 = columns[b, high, 6] * x
            b7 = columns[b, high, 7] * x
        while high > low:
            high -= np.uint64(2)
            x, z = y[high], y[high + np.uint64(1)]
            a0 += columns[b, high, 0] * x
            a1 += columns[b, high, 1] * x
            a2 += columns[b, high, 2] * x
            a3 += columns[b, high, 3] * x
            a4 += columns[b, high, 4] * x
            a5 += columns[b, high, 5] * x
            a6 += columns[b, high, 6] * x
            a7 += columns[b, high, 7] * x
            h = high + np.uint64(1)
            b0 += columns[b, h, 0] * z
            b1 += columns[b, h, 1] * z
            b2 += columns[b, h, 2] * z
            b3 += columns[b, h, 3] * z
            b4 += columns[b, h, 4] * z
            b5 += columns[b, h, 5] * z
            b6 += columns[b, h, 6] * z
            b7 += columns[b, h, 7] * z
        out[b, 0], out[b, 1], out[b, 2], out[b, 3] = a0 + b0, a1 + b1, a2 + b2, a3 + b3
        out[b, 4], out[b, 5], out[b, 6], out[b, 7] = a4 + b4, a5 + b5, a6 + b6, a7 + b7


@inlined
def read_sensors(record: Record, y: FloatArray, at: int) -> None:
    """Record the sensors' values at a grid point."""
    for r in range(len(record.filled)):
        acc = record.weights[r, 0] * y[np.uint64(record.places[r, 0])]
        for k in range(1, record.filled[r]):
            acc += record.weights[r, k] * y[record.places[r, k]]
        record.out[np.uint64(r), np.uint64(at)] = acc


@kernel
def read_out(record: Record, y: FloatArray, n: int, at: int, mode: int) -> None:
    """Record the sensors' values, and if requested the curved forces and the mode, at a grid point."""
    read_sensors(record, y, at)
    if len(record.modes) > 0:
        record.modes[at] = mode
        for c in range(len(record.curved)):
            record.curved[c, at] = y[force_at(n, c)]


@inlined
def leaps(
    rig: Rig, motion: Motion, record: Record, u: FloatArray, more: FloatArray, mode: int, ways: int, at: int
) -> tuple[int, bool]:
    """Take `LEAP` steps at once from step `at` on in one mode; return the next step, and whether a margin may fall below zero
    in it.
    """
    y, drives, landed, m = motion.y, motion.known_drives, motion.landed, 2 * rig.n
    first = LEAP * m
    blocks = -(-(first + 2 * LEAP * ways) // 8)
    drives[m] = 1.0
    while at + LEAP < len(u):
        for i in range(m):
            drives[i] = y[i]
        for k in range(LEAP + 1):
            drives[m + 1 + k] = u[at + k]
            for e in range(len(more)):
                drives[m + 1 + (e + 1) * (LEAP + 1) + k] = more[e, at + k]
        ahead(rig.leap[mode], blocks, drives, 0, len(drives), motion.nothing, motion.leaped)
        taken = LEAP
        for g in range(ways):
            for k in range(taken):
                margin = first + 2 * (g * LEAP + k)
                if not (landed[margin] >= 0.0 and landed[margin + 1] <= landed[margin]):
                    taken = k
                    break
        # What is recorded beyond the steps taken is overwritten later.
        for r in range(len(record.filled)):
            w, p = record.weights[r, 0], np.uint64(record.places[r, 0])
            a0, a1, a2, a3 = w * y[p], w * landed[m + p], w * landed[2 * m + p], w * landed[3 * m + p]
            for k in range(1, record.filled[r]):
                w, p = record.weights[r, k], np.uint64(record.places[r, k])
                a0, a1 = a0 + w * y[p], a1 + w * landed[m + p]
                a2, a3 = a2 + w * landed[2 * m + p], a3 + w * landed[3 * m + p]
            record.out[r, at], record.out[r, at + 1], record.out[r, at + 2], record.out[r, at + 3] = a0, a1, a2, a3
        for k in range(LEAP if len(record.modes) > 0 else 0):
            record.modes[at + k] = mode
        at += taken
        if taken < LEAP:
            for i in range(m if taken > 0 else 0):
                y[i] = landed[taken * m + i]
            return at, True
        for i in range(m):
            y[i] = landed[i]
    return at, False


@inlined
def march(
    rig: Rig, motion: Motion, record: Record, u: FloatArray, more: FloatArray, cuts: int, t0: float, mode: int, q: int
) -> int:
    """Take whole steps from step `q` on in one mode; return the first step in which a margin may fall below zero."""
    y, base, ends, largest, d0, v0 = motion.y, motion.base, motion.ends, motion.largest, motion.d0, motion.v0
    after8, after, ratio, codes = motion.ahead, motion.reached, motion.ratio, rig.codes
    columns, blocks, step, n = rig.whole[mode], rig.blocks[mode], rig.step, rig.n
    m, size, curves = 2 * n, len(y), len(codes)
    state, curve_blocks, ways = 4 * curves, -(-4 * curves // 8), 0
    while ways < rig.exits.shape[1] and rig.exits[mode, ways, 0] >= 0:
        ways += 1
    share = 1.0 / cuts
    at, cut = q // cuts, q % cuts
    if rig.leap.shape[1] > 0:
        at, ends_here = leaps(rig, motion, record, u, more, mode, ways, at)
        if ends_here:
            return at
    base[:] = 0.0
    for c in range(curves):
        d0[c], v0[c] = along(rig.directions[c], y, n, step)
    while at < len(u) - 1:
        if cut == 0:
            # The first part of `read_out`, inlined: a call takes as long as the step.
            read_sensors(record, y, at)
            if len(record.modes) > 0:
                read_out(record, y, n, at, mode)
        slope = (u[at + 1] - u[at]) * share
        y[m + 1], y[m + 2] = u[at] + slope * cut, slope
        if len(more) > 0:
            further(more, at, cut, share, y)
        if curves == 0:
            ahead(columns, blocks, y, 0, size, base, after8)
        else:
            base[:] = 0.0
            ahead(columns, blocks, y, 0, m + 3, base, base)
            now = t0 + (at * cuts + cut) * step
            before = 0.0
            ratio[0] = min(WEAR * ratio[0], 1.0)
            for c in range(curves):
                f = force_at(n, c)
                ends[c] = y[f] + y[f + 1] + 0.5 * y[f + 2]
            for attempt in range(PASSES):
                ahead(columns, curve_blocks, y, m + 3, size, base, after8)
                worst = 0.0
                for c in range(curves):
                    f, k = force_at(n, c), 4 * c
                    fm, f1 = advance(
                        codes[c], rig.params[c], motion.gate[c], motion.inner, motion.half, motion.after, c, d0[c], v0[c],
                        after[k], after[k + 1], after[k + 2], after[k + 3], step, now,
                    )  # fmt: skip
                    bend(y, f, y[f], fm, f1, 1.0)
                    largest[c] = max(abs(f1), FADING * largest[c], motion.floor[c])
                    worst = max(worst, abs(f1 - ends[c]) / largest[c])
                    ends[c] = f1
                    if codes[c] >= MEMORY and v0[c] * after[k + 3] < 0.0:
                        # The rate of a law with memory has a kink where the speed changes sign.
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
            # Below zero at the end, or possibly in between: the tangent at the end is below zero at the start.
            if not (g1 >= 0.0 and slope1 <= g1):
                return at * cuts + cut
        for i in range(m):
            y[i] = after[state + i]
        for c in range(curves):
            f = force_at(n, c)
            # Starting value of the next step: this step's parabola, extrapolated.
            y[f], y[f + 1] = ends[c], y[f + 1] + y[f + 2]
            d0[c], v0[c] = after[4 * c + 2], after[4 * c + 3]
            remember(codes[c], motion.inner, motion.after, c)
        cut += 1
        if cut == cuts:
            at, cut = at + 1, 0
    return at * cuts


@kernel
def further(more: FloatArray, at: int, cut: int, share: float, y: FloatArray) -> None:
    """Set the further drives and their rates, the last entries of the vector, at the start of a step."""
    first = len(y) - 2 * len(more)
    for e in range(len(more)):
        slope = (more[e, at + 1] - more[e, at]) * share
        y[first + 2 * e], y[first + 2 * e + 1] = more[e, at] + slope * cut, slope


@kernel
def bend(y: FloatArray, f: int, f0: float, fm: float, f1: float, left: float) -> None:
    """Set the curved force at y[f] to the parabola through its values at start, middle and end of the share `left` of a step."""
    y[f + 1] = (-3.0 * f0 + 4.0 * fm - f1) / left
    y[f + 2] = 4.0 * (f0 - 2.0 * fm + f1) / (left * left)


@inlined
def settle_forces(rig: Rig, motion: Motion, mode: int, part: float, now: float) -> None:
    """Compute Taylor coefficients and end of a part of a step, iterating the curved forces until they agree with the motion."""
    n, y, ends, largest, d0, v0, ratio = rig.n, motion.y, motion.ends, motion.largest, motion.d0, motion.v0, motion.ratio
    rows, curves, middle, end = rig.series[mode], len(rig.codes), motion.middle, motion.end
    known, drive, size, curve_blocks = motion.known, 2 * n + 3, len(y), -(-2 * curves // 8)
    for c in range(curves):
        d0[c], v0[c] = along(rig.directions[c], y, n, rig.step)
        f = force_at(n, c)
        ends[c] = y[f] + part * (y[f + 1] + 0.5 * part * y[f + 2])
    ahead(rows, len(rows), y, 0, drive if curves > 0 else size, motion.still, known if curves > 0 else motion.taylor)
    if curves > 0:
        ahead(rows, len(rows), y, drive, size, known, motion.taylor)
    before = 0.0
    for attempt in range(PASSES if curves > 0 else 0):
        point(motion.taylor, 0.5 * part, curve_blocks, motion.points, MIDDLE)
        point(motion.taylor, part, curve_blocks, motion.points, END)
        worst = 0.0
        for c in range(curves):
            f = force_at(n, c)
            fm, f1 = step_on(
                rig.codes[c], rig.params[c], motion.gate[c], motion.inner, motion.half, motion.after, c, d0[c], v0[c],
                middle[2 * c], middle[2 * c + 1], end[2 * c], end[2 * c + 1], part * rig.step, now,
            )  # fmt: skip
            bend(y, f, y[f], fm, f1, part)
            largest[c] = max(abs(f1), FADING * largest[c], motion.floor[c])
            worst = max(worst, abs(f1 - ends[c]) / largest[c])
            ends[c] = f1
        ahead(rows, len(rows), y, drive, size, known, motion.taylor)
        if attempt > 0:
            ratio[0] = min(CAUTION * worst / before, 1.0)
        before = worst
        if worst * ratio[0] <= SETTLED:
            break
    point(motion.taylor, part, motion.points.shape[1], motion.points, END)


@inlined
def missed(rig: Rig, motion: Motion, part: float, now: float) -> float:
    """Largest relative error of the curved forces' parabolas at a quarter of a part of a step."""
    curves, middle, quarter = len(rig.codes), motion.middle, motion.quarter
    curve_blocks, worst = -(-2 * curves // 8), 0.0
    if curves > 0:
        point(motion.taylor, 0.5 * part, curve_blocks, motion.points, MIDDLE)
        point(motion.taylor, 0.25 * part, curve_blocks, motion.points, QUARTER)
    for c in range(curves):
        f = force_at(rig.n, c)
        # The parabola does not interpolate this point.
        fq, _ = step_on(
            rig.codes[c], rig.params[c], motion.gate[c], motion.inner, motion.half, motion.spare, c, motion.d0[c], motion.v0[c],
            quarter[2 * c], quarter[2 * c + 1], middle[2 * c], middle[2 * c + 1], 0.5 * part * rig.step, now,
        )  # fmt: skip
        drawn = motion.y[f] + 0.25 * part * (motion.y[f + 1] + 0.125 * part * motion.y[f + 2])
        worst = max(worst, abs(fq - drawn) / motion.largest[c])
    return worst


@kernel
def first_kink(rig: Rig, motion: Motion, part: float) -> float:
    """Share of a step at which a law with memory first has a kink within a part: it reverses, or one of its springs starts or
    stops to slip or to touch; `part` if there is none.
    """
    p, first = motion.p, part
    for c in range(len(rig.codes)):
        if rig.codes[c] < MEMORY:
            continue
        d0, v0, sign = motion.d0[c], motion.v0[c], np.sign(motion.end[2 * c] - motion.d0[c])
        if v0 * motion.end[2 * c + 1] < 0.0:
            for k in range(rig.terms):
                p[k] = np.sign(v0) * motion.columns[k, 2 * c + 1]
            reversal = first_exit(p, first)
            if reversal > SHORTEST:
                sign = np.sign(v0)
                first = min(first, reversal)
        if sign == 0.0:
            continue
        passed = SHORTEST * abs(v0) * rig.step
        distance = passed + to_kink(rig.codes[c], rig.params[c], motion.inner, c, d0 + sign * passed, sign)
        if distance < np.inf:
            for k in range(rig.terms):
                p[k] = -sign * motion.columns[k, 2 * c]
            p[0] = distance
            first = min(first, first_exit(p, first))
    return first


@inlined
def next_exit(rig: Rig, motion: Motion, mode: int, part: float, calm: bool, passed: int) -> tuple[float, int]:
    """Share of a step after which the first margin falls below zero, and its number; -1 if none does.

    `calm` is true unless the mode has just changed; `passed` is an exit to ignore, because it did not change the mode.
    """
    taylor, p, exits, terms, rows = motion.columns, motion.p, rig.exits, rig.terms, rig.series[mode]
    first, groups = first_margin(rig), len(rows) // terms
    best, which = 2.0, -1
    for g in range(exits.shape[1]):
        row = first + g
        if exits[mode, g, 0] < 0:
            break
        g0, g1 = taylor[0, row], motion.end[row]
        # Right after a change a margin below zero is rounding.
        crosses = g1 < 0.0 or (g0 < 0.0 and calm)
        if not crosses and taylor[1, row] < 0.0:
            # Possibly two crossings within the step: if the tangents at its ends meet below zero.
            slope0, slope1 = taylor[1, row], 0.0
            for k in range(terms - 1, 0, -1):
                slope1 = slope1 * part + k * taylor[k, row]
            if slope1 * part > g1:
                meet = (g1 - slope1 * part - g0) / (slope0 - slope1)
                crosses = g0 + slope0 * meet < 0.0
        if crosses and g != passed:
            for k in range(terms):
                p[k] = taylor[k, row]
            # Only the sign of a margin near zero is in doubt from rounding.
            clear = g0 > CLEAR * abs(g1)
            if clear and g1 < 0.0:
                tau = falls(p, part, g1)
            elif clear:
                tau = first_exit(p, part)
            else:
                sign = begins(rows, groups, row, motion.y, rig.n, motion.largest, np.inf, p)
                tau = 0.0 if sign < 0 else first_exit(p, part) if sign > 0 else 2.0
            if tau < best:
                best, which = tau, g
    return best, which


@inlined
def begin(rig: Rig, motion: Motion, peaks: FloatArray, start: FloatArray, mode: int, t0: float) -> None:
    """Set the initial state, the curved forces in the first mode and the magnitudes below which they need not be exact."""
    n, curves, whole = rig.n, len(rig.codes), rig.whole
    motion.y[2 * n] = motion.ratio[0] = 1.0
    for i in range(n):
        motion.y[i], motion.y[n + i] = start[i], start[n + i] * rig.step
    last = len(motion.y) - 2 * len(peaks)
    for c in range(curves):
        f, pushed, bends = force_at(n, c), 0.0, 1e-300
        for i in range(n):
            block, lane = (4 * curves + n + i) // 8, (4 * curves + n + i) % 8
            for k in range(len(whole)):
                pushed = max(pushed, peaks[0] * abs(whole[k, block, 2 * n + 1, lane]))
                for e in range(1, len(peaks)):
                    pushed = max(pushed, peaks[e] * abs(whole[k, block, last + 2 * e, lane]))
                bends = max(bends, abs(whole[k, block, f, lane]))
        motion.floor[c] = LEAST * pushed / bends + 1e-30
        motion.gate[c] = rig.gates[c, rig.states[mode, rig.curve_of[c]]]
        d, v = along(rig.directions[c], motion.y, n, rig.step)
        motion.y[f] = resist(rig.codes[c], rig.params[c], motion.gate[c], motion.inner, c, d, v, t0)


@inlined
def note(rig: Rig, log: FloatArray, mode: int, new_mode: int, now: float, events: int) -> int:
    """Log the changes of state between two modes, up to the length of the log; return the number of changes so far."""
    for e in range(len(rig.kinds)):
        old, new = rig.states[mode, e], rig.states[new_mode, e]
        # A contact that reverses sticks at that instant.
        for state in (0, new) if old > 0 and new != old and rig.kinds[e] == 1 else (new, new):
            if state != old:
                if events < len(log):
                    log[events, 0], log[events, 1], log[events, 2] = now, e, state
                events += 1
                old = state
    return events


@kernel
def from_event_to_event(
    rig: Rig, motion: Motion, record: Record, u: FloatArray, more: FloatArray, peaks: FloatArray, start: FloatArray, mode: int,
    cuts: int, t0: float, split_share: float,
) -> int:  # fmt: skip
    """Simulate the run, see `run`."""
    n, y, curves = rig.n, motion.y, len(rig.codes)
    m, share, bent = 2 * n, 1.0 / cuts, 2 * curves
    # A literal number has a type of its own, for which the compiler would compile the functions called here once more.
    events: Any = np.int64(0)
    q: Any = np.int64(0)
    passed: Any = np.int64(-1)
    calm, splits = True, 0
    begin(rig, motion, peaks, start, mode, t0)
    while True:
        if calm:
            q = march(rig, motion, record, u, more, cuts, t0, mode, q)
        at, cut = q // cuts, q % cuts
        if cut == 0:
            read_out(record, y, n, at, mode)
        for i in range(n):
            if not abs(y[i]) < 1e9:
                return -1
        if at == len(u) - 1:
            return events
        slope = (u[at + 1] - u[at]) * share
        y[m + 1], y[m + 2] = u[at] + slope * cut, slope
        if len(more) > 0:
            further(more, at, cut, share, y)
        now, left, part, trips, split, passed, kinks = t0 + q * rig.step, 1.0, 1.0, 0, False, np.int64(-1), 0
        while left > 1e-13:
            part = min(part, left)
            settle_forces(rig, motion, mode, part, now)
            if missed(rig, motion, part, now) > FINE and part > SHORTEST:
                kink = first_kink(rig, motion, part) if kinks < KINKS else part
                if SHORTEST < kink < (1.0 - SHORTEST) * part:
                    part, kinks = kink, kinks + 1
                else:
                    part *= 0.5
                    split = split or trips == 0
                continue
            best, which = next_exit(rig, motion, mode, part, calm, passed)
            passed = np.int64(-1)
            tau = part if which < 0 else min(best, part)
            if which >= 0:
                point(motion.taylor, tau, motion.points.shape[1], motion.points, END)
            for i in range(m):
                y[i] = motion.end[bent + i]
            y[m + 1] += tau * y[m + 2]
            for e in range(len(y) - 2 * len(more), len(y), 2):
                y[e] += tau * y[e + 1]
            left -= tau
            if which < 0:
                for c in range(curves):
                    f = force_at(n, c)
                    y[f], y[f + 1] = motion.ends[c], y[f + 1] + tau * y[f + 2]
                    remember(rig.codes[c], motion.inner, motion.after, c)
                now += tau * rig.step
                calm = True
                part, kinks = 1.0 if kinks > 0 else 2.0 * part, 0
                continue
            if curves > 0:
                point(motion.taylor, 0.5 * tau, -(-2 * curves // 8), motion.points, MIDDLE)
            for c in range(curves):
                step_on(
                    rig.codes[c], rig.params[c], motion.gate[c], motion.inner, motion.half, motion.spare, c, motion.d0[c],
                    motion.v0[c], motion.middle[2 * c], motion.middle[2 * c + 1], motion.end[2 * c], motion.end[2 * c + 1],
                    tau * rig.step, now,
                )  # fmt: skip
                remember(rig.codes[c], motion.inner, motion.spare, c)
                f = force_at(n, c)
                y[f + 1] += tau * y[f + 2]
            now += tau * rig.step
            trips += 1
            motion.ratio[0] = 1.0
            calm = False
            if trips > TRIPS:
                return -3
            new_mode = follow(rig, motion, mode, which, now, tau == 0.0)
            if new_mode < 0:
                return -3
            if new_mode == mode and tau == 0.0:
                # The exit is an artefact of the parabolas' error in the curved forces.
                passed = which
            events = note(rig, record.log, mode, new_mode, now, events)
            mode = new_mode
        q += 1
        if split and trips == 0:
            splits += 1
            if splits > PATIENCE + split_share * q:
                return -2


@allocating_kernel
def run(
    u: FloatArray, more: FloatArray, peaks: FloatArray, start: FloatArray, mode: int, cuts: int, t0: float, rig: Rig,
    sense: FloatArray, out: FloatArray, curved: FloatArray, modes: IntArray, log: FloatArray, split_share: float, memories: int,
) -> int:  # fmt: skip
    """Simulate a rig under its drives on a fine grid.

    Parameters
    ----------
    u
        The drive, shape (n,).
    more
        Further drives, shape (drives - 1, n).
    peaks
        Largest magnitude of each drive, shape (drives,).
    start, mode
        Initial coordinates (m) and speeds (m/s), shape (2 n,), and the initial mode.
    cuts
        Number of steps of the rig in a step of the drive.
    t0
        Time of the first step since the start of the campaign, s.
    rig
        The rig for these steps.
    sense
        Rows on z that give the sensors' values on the grid, shape (sensors, m).
    out, curved, modes
        Filled with the sensors' values (sensors, n), the curved forces (curves, n) and the mode (n,); the last two only
        if `modes` is not empty.
    log
        Filled with (time, element, state) of each change of state, up to its length.
    split_share
        Maximum share of the steps in which curved forces may need more than one parabola.
    memories
        Maximum number of state variables of a law.

    Returns
    -------
    int
        Number of changes of state; -1 if the motion grows without bound, -2 if too many steps need more than one parabola,
        -3 if contacts change without end, or no combination of their states is consistent.
    """
    # Sensors read few coordinates: store only their non-zero weights; one of zero where there are none, or no coordinates.
    places = np.zeros((len(sense), max(2 * rig.n, 1)), dtype=np.int64)
    weights, filled = np.zeros(places.shape), np.zeros(len(sense), dtype=np.int64)
    for r in range(len(sense)):
        for i in range(2 * rig.n):
            if sense[r, i] != 0.0:
                places[r, filled[r]] = i
                weights[r, filled[r]] = sense[r, i]
                filled[r] += 1
    motion = room(rig, memories)
    record = Record(weights, places, filled, out, curved, modes, log)
    return from_event_to_event(rig, motion, record, u, more, peaks, start, mode, cuts, t0, split_share)
