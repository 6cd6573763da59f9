"""Instants at which contacts change state: the consistent combination of all contacts' states afterwards.

Every contact at rest may stick, slide forward or slide backward. A combination is consistent if no margin falls below zero right
after the instant: the forces of sticking contacts stay within breakaway, and each sliding contact slides in its direction. If
breakaway equals sliding friction this is a linear complementarity problem with a unique motion. If breakaway is larger, several
combinations may be consistent. The one reached from the present state is chosen: sticking contacts stick as long as they can; if
several cannot, the one furthest above its breakaway force slides first. Only if this repeats in a cycle are all combinations
searched, those with the fewest changes first.
"""

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import inlined, kernel
from isorig.analysis.simulate.curves import resist, step_on
from isorig.analysis.simulate.workspace import Motion, Rig, first_margin, force_at

#: Ratio of a sum to the sum of its absolute terms below which it is rounding.
ROUNDING = 1e-11
#: Share of a breakaway force, or of a margin's change in a step, that is certainly larger than rounding.
CLEAR = 1e-6
#: Maximum relative error of the parabola of a curved force in a step.
DRAWN = 4e-6
#: Share of a step over which the rate of a curved force is computed.
SHORT = 1e-3
#: Number of states that may follow rest: sticking, sliding forward, sliding backward. Karnopp's law has more, beyond its band.
AT_REST = 3
#: Maximum number of combinations tried one after another, per element, before all are searched.
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
    """Set the speeds of sticking contacts to zero."""
    for i in range(n):
        speed = 0.0
        for j in range(n):
            speed += settle[i, j] * y[n + j]
        work[i] = speed
    for i in range(n):
        y[n + i] = work[i]


@kernel
def begins(
    series: FloatArray, groups: int, row: int, y: FloatArray, n: int, largest: FloatArray, clear: float, p: FloatArray
) -> int:
    """Sign of a margin right after now: that of its first Taylor coefficient beyond rounding; 0 if all are rounding.

    Parameters
    ----------
    series
        Taylor coefficients of a mode, see `Rig`.
    groups, row
        Number of groups of eight rows per term; the margin's row.
    y, n
        The vector, shape (m,), and the number of coordinates.
    largest
        Magnitude of each curved force, shape (curves,); its relative error is `DRAWN`.
    clear
        Magnitude above which a margin is certainly larger than rounding.
    p
        Filled with the margin's coefficients, shape (terms,), up to the first beyond rounding, those before it zero.
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
            # The uncertainty of a coefficient depends on motion that appears in the next one.
            p[k - 1] = known
            if abs(known) > ROUNDING * (before + size) + DRAWN * (free + drawn):
                return 1 if known > 0.0 else -1
            p[k - 1] = 0.0
        before, free = size, drawn
    return 0


@inlined
def start_curves(rig: Rig, motion: Motion, mode: int, now: float) -> None:
    """Compute the curved forces in a mode, and their rates."""
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
        # The acceleration is in the second of the curve's two rows, one term further.
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
    """Mark the contacts that may stick or slide from now on; return the mode in which all of them stick."""
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
    """Exit by which a mode ends at once, -1 if it continues: contacts sliding the wrong way first, then the most overloaded."""
    exits, limits, rows, p = rig.exits, rig.limits, rig.series[mode], motion.p
    first, groups = first_margin(rig), len(rows) // rig.terms
    found, most = -1, -1.0
    for g in range(exits.shape[1]):
        if exits[mode, g, 0] < 0:
            break
        # Spring forces are assumed to be less than 1e12 times the friction forces.
        clear = CLEAR * limits[mode, g] if exits[mode, g, 2] == 2 and len(rig.codes) == 0 else np.inf
        if begins(rows, groups, first + g, motion.y, rig.n, motion.largest, clear, p) < 0:
            if exits[mode, g, 2] < 2:
                return g
            if -p[0] / limits[mode, g] > most:
                found, most = g, -p[0] / limits[mode, g]
    return found


@inlined
def follow(rig: Rig, motion: Motion, mode: int, which: int, now: float, late: bool) -> int:
    """Prepare speeds and curved forces after exit `which` of `mode`; return the mode that follows, -1 if none.

    `late` states that the margin is already below zero, for example after a jump of the force; others may then be further below.
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
            # A stop or a backlash changes state too: the contacts follow from that.
            e = exits[trial, g, 0]
            target += (states[exits[trial, g, 1], e] - states[target, e]) * rig.strides[e]
        trial = exits[trial, g, 1]
    return look_through(rig, motion, mode, target, now)


@kernel
def look_through(rig: Rig, motion: Motion, mode: int, target: int, now: float) -> int:
    """The consistent combination of the contacts at rest with the fewest changes from `target`; -1 if there is none."""
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
                # The last choice is a state that does not follow rest: of Karnopp's law outside its band.
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
