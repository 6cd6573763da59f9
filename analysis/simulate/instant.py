"""One instant at which contacts change: the joint state in which all of them go on.

Every contact at rest may hold, slide forward or slide backward. A combination is right where no margin falls below zero right
after the instant: held forces within breakaway, what slides sliding its own way. With breakaway equal to sliding friction this is
a linear complementarity problem, whose motion is unique. Where breakaway is greater several combinations may be right. Taken is
the one that the present leads to: what holds goes on holding as long as it can, and where several cannot, the one
furthest above its breakaway force lets go first. Only where that runs in a circle are all combinations looked through, those with
the fewest changes first.
"""

from __future__ import annotations

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import inlined, kernel
from isorig.analysis.simulate.curves import resist, step_on
from isorig.analysis.simulate.workspace import Motion, Rig, first_margin, force_at

#: Share of the terms of a sum that is rounding.
ROUNDING = 1e-11
#: Share of a breakaway force, or of a margin's change in a step, that is surely more than rounding.
CLEAR = 1e-6
#: Share of a curved force that the parabola of a step may miss.
DRAWN = 4e-6
#: Share of a step over which the rate of a curved force is taken.
SHORT = 1e-3
#: States of a contact that it may go on in from rest: held, forward, backward. Sliding outside of Karnopp's band has others.
AT_REST = 3
#: Combinations tried in turn, by the one that lets go first, for each element.
TRIALS = 4


@kernel
def along(direction: FloatArray, y: FloatArray, n: int, step: float) -> tuple[float, float]:
    """Elongation (m) and its speed (m/s) along a direction."""
    d, v = 0.0, 0.0
    for i in range(n):
        d += direction[i] * y[i]
        v += direction[i] * y[n + i]
    return d, v / step


@inlined
def stop(settle: FloatArray, y: FloatArray, n: int, work: FloatArray) -> None:
    """Take the speeds of settled contacts to zero."""
    for i in range(n):
        work[i] = 0.0
        for j in range(n):
            work[i] += settle[i, j] * y[n + j]
    for i in range(n):
        y[n + i] = work[i]


@kernel
def begins(
    series: FloatArray, groups: int, row: int, y: FloatArray, n: int, largest: FloatArray, clear: float, p: FloatArray
) -> int:
    """Sign of a margin right after now: that of its first Taylor coefficient beyond rounding; 0 where all are rounding.

    Parameters
    ----------
    series
        Taylor coefficients of a mode, see `Compiled`.
    groups, row
        Groups of eight rows by term; the margin's row.
    y, n
        The vector, and the number of coordinates.
    largest
        Size of each curved force, which is known to a share of `DRAWN`.
    clear
        Size from which on a margin is surely more than rounding.
    p
        Filled with the margin's coefficients up to the first that counts, those before it zero.
    """
    block, lane = row // 8, row % 8
    value, before, free = 0.0, 0.0, 0.0
    for k in range(len(p)):
        known, size, drawn = value, 0.0, 0.0
        value = 0.0
        for j in range(len(y)):
            term = series[k * groups + block, j, lane] * y[j]
            value += term
            size += abs(term)
        for c in range(len(largest)):
            drawn += abs(series[k * groups + block, force_at(n, c), lane]) * largest[c]
        if k == 0 and abs(value) > clear:
            p[0] = value
            return 1 if value > 0.0 else -1
        if k > 0:
            # What is uncertain in one coefficient comes from motion that the next one tells of.
            p[k - 1] = known
            if abs(known) > ROUNDING * (before + size) + DRAWN * (free + drawn):
                return 1 if known > 0.0 else -1
            p[k - 1] = 0.0
        before, free = size, drawn
    return 0


@inlined
def start_curves(rig: Rig, motion: Motion, mode: int, now: float) -> None:
    """Curved forces as they are in a mode, and their rates."""
    n, step, y, rows = rig.n, rig.step, motion.y, rig.series[mode]
    groups = len(rows) // rig.terms
    for c in range(len(rig.codes)):
        motion.gate[c] = rig.gates[c, rig.states[mode, rig.curve_of[c]]]
        d, v = along(rig.directions[c], y, n, step)
        f = force_at(n, c)
        y[f] = resist(rig.codes[c], rig.params[c], motion.gate[c], motion.inner, c, d, v, now)
        y[f + 1] = y[f + 2] = 0.0
    for c in range(len(rig.codes)):
        d, v = along(rig.directions[c], y, n, step)
        # The speed's own rate is the second row of the curve's two, one term further.
        row, acceleration = 2 * c + 1, 0.0
        for j in range(len(y)):
            acceleration += rows[groups + row // 8, j, row % 8] * y[j]
        h = SHORT * step
        vm, v1 = v + 0.5 * SHORT * acceleration, v + SHORT * acceleration
        _, end = step_on(
            rig.codes[c], rig.params[c], motion.gate[c], motion.inner, motion.half, motion.spare, c, d, v,
            d + 0.25 * h * (v + vm), vm, d + 0.5 * h * (v + v1), v1, h, now,
        )  # fmt: skip
        y[force_at(n, c) + 1] = (end - y[force_at(n, c)]) / SHORT


@inlined
def resting(rig: Rig, motion: Motion, mode: int, which: int) -> int:
    """Mark the contacts that may hold or slide from now on; give the mode in which all of them are held."""
    y, kinds, exits, rests, rows = motion.y, rig.kinds, rig.exits, motion.rests, rig.series[mode]
    first, groups = first_margin(rig), len(rows) // rig.terms
    target, held = exits[mode, which, 1], mode
    for e in range(len(kinds)):
        state, to = rig.states[mode, e], rig.states[target, e]
        rests[e] = 0
        if kinds[e] == 2:
            rests[e] = state < AT_REST or state != to
        elif kinds[e] == 1:
            rests[e] = state == 0 or to == 0
    for g in range(exits.shape[1] if len(kinds) > 1 else 0):
        e = exits[mode, g, 0]
        if e < 0:
            break
        if kinds[e] == 1 and rests[e] == 0 and exits[mode, g, 2] == 1:
            block, lane, value, size = (first + g) // 8, (first + g) % 8, 0.0, 0.0
            for j in range(len(y)):
                term = rows[block, j, lane] * y[j]
                value += term
                size += abs(term) + abs(rows[groups + block, j, lane] * y[j])
            rests[e] = abs(value) <= ROUNDING * size
    for e in range(len(kinds)):
        if kinds[e] == 1 and rests[e] == 1:
            held -= rig.states[held, e] * rig.strides[e]
    return held


@inlined
def weakest(rig: Rig, motion: Motion, mode: int) -> int:
    """The exit by which a mode ends at once, -1 where it goes on: what slides the wrong way first, then the most overloaded."""
    exits, limits, rows, p = rig.exits, rig.limits, rig.series[mode], motion.p
    first, groups = first_margin(rig), len(rows) // rig.terms
    found, most = -1, -1.0
    for g in range(exits.shape[1]):
        if exits[mode, g, 0] < 0:
            break
        # Springs are far from a million million times as strong as the friction beside them.
        clear = CLEAR * limits[mode, g] if exits[mode, g, 2] == 2 and len(rig.codes) == 0 else np.inf
        if begins(rows, groups, first + g, motion.y, rig.n, motion.largest, clear, p) < 0:
            if exits[mode, g, 2] < 2:
                return g
            if -p[0] / limits[mode, g] > most:
                found, most = g, -p[0] / limits[mode, g]
    return found


@inlined
def follow(rig: Rig, motion: Motion, mode: int, which: int, now: float, late: bool) -> int:
    """The mode in which the motion goes on after exit `which` of `mode`, speeds and curved forces made ready; -1 if none.

    `late` says that the margin is below zero already, as after a jump of the force: then others may be further below.
    """
    exits, kinds, states = rig.exits, rig.kinds, rig.states
    stop(rig.settle[resting(rig, motion, mode, which)], motion.y, rig.n, motion.speeds)
    target = trial = mode if late and exits[mode, which, 2] > 0 else exits[mode, which, 1]
    for _ in range(TRIALS * (len(kinds) + 1)):
        if len(rig.codes) > 0:
            start_curves(rig, motion, trial, now)
        g = weakest(rig, motion, trial)
        if g < 0 and rig.possible[trial] == 1:
            return trial
        if g < 0:
            break
        if exits[trial, g, 2] == 0:
            # A stop or a play changes too: contacts begin from there.
            e = exits[trial, g, 0]
            target += (states[exits[trial, g, 1], e] - states[target, e]) * rig.strides[e]
        trial = exits[trial, g, 1]
    return look_through(rig, motion, mode, target, now)


@kernel
def look_through(rig: Rig, motion: Motion, mode: int, target: int, now: float) -> int:
    """The right combination of the contacts at rest with the fewest changes against `target`; -1 if there is none."""
    states, rests = rig.states, motion.rests
    combinations = 1
    for e in range(len(rests)):
        if rests[e] == 1:
            combinations *= AT_REST + 1
    for changes in range(len(rests) + 1):
        for k in range(combinations):
            trial, left, changed, known = target, k, 0, True
            for e in range(len(rests)):
                if rests[e] == 0:
                    continue
                state, choice = states[target, e], left % (AT_REST + 1)
                left //= AT_REST + 1
                # The last choice is a state beyond those at rest: Karnopp's outside of the band.
                to = choice if choice < AT_REST else max(state, states[mode, e])
                known = known and (choice < AT_REST or to >= AT_REST)
                changed += to != state
                trial += (to - state) * rig.strides[e]
            if changed != changes or not known or rig.possible[trial] == 0:
                continue
            start_curves(rig, motion, trial, now)
            if weakest(rig, motion, trial) < 0:
                return trial
    return -1
