"""Motion of a lumped rig by the leapfrog scheme with friction as impulses: none of the project's simulation is used.

Positions are known at the steps and velocities between them, so the accelerations satisfy the equations of motion exactly at
every step. Dry friction and locks are impulses that are bounded by their level and stop the relative velocity if they can
(Moreau's time stepping; Acary, Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, 2008).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
kernel: Callable[[Callable[..., Any]], Callable[..., Any]] = numba.njit(cache=True, fastmath=True, nogil=True)

#: Coordinates that one elongation may depend on, and parameters and memory of one law.
REACH, PARAMETERS, MEMORY = 3, 6, 4
#: Sweeps over several contacts; one contact needs one.
SWEEPS = 12
#: Level of a lock, N.
LOCKED = 1e15

SPRINGS = {
    name: code
    for code, name in enumerate((
        "power", "softening", "backlash", "smooth backlash", "stop", "one-sided stop", "cogging", "speed power", "drift",
        "maxwell", "dahl", "lugre", "bouc-wen", "sliders",
    ))
}  # fmt: skip
FRICTIONS = {name: code for code, name in enumerate(("coulomb", "stribeck", "asymmetric", "lock", "worn"))}


@dataclass(frozen=True, kw_only=True)
class Elongation:
    """Sum of weight times coordinate, over at most three coordinates."""

    bodies: tuple[int, ...]
    weights: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Spring:
    """A spring and damper, and whether its far end is the floor."""

    along: Elongation
    stiffness: float
    damping: float
    floor: bool


@dataclass(frozen=True, kw_only=True)
class Law:
    """A further force in a spring: name in `SPRINGS`, index of the spring, parameters."""

    name: str
    spring: int
    parameters: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Rub:
    """Dry friction or a lock: name in `FRICTIONS`, parameters, and (share, pitch, phase) of an uneven level."""

    name: str
    along: Elongation
    parameters: tuple[float, ...]
    uneven: tuple[float, float, float] = (0.0, 1.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What is recorded: 0 displacement, 1 velocity, 2 acceleration of an elongation."""

    along: Elongation
    order: int


def _table(parts: Sequence[Elongation]) -> tuple[NDArray[np.int64], FloatArray]:
    bodies, weights = np.zeros((len(parts), REACH), np.int64), np.zeros((len(parts), REACH))
    for k, part in enumerate(parts):
        bodies[k, : len(part.bodies)], weights[k, : len(part.weights)] = part.bodies, part.weights
    return bodies, weights


def _padded(rows: Sequence[Sequence[float]], width: int) -> FloatArray:
    out = np.zeros((len(rows), width))
    for k, row in enumerate(rows):
        out[k, : len(row)] = row
    return out


def run(
    masses: Sequence[float], springs: Sequence[Spring], laws: Sequence[Law], rubs: Sequence[Rub], seen: Sequence[Seen],
    push: FloatArray, force: FloatArray, floor: FloatArray, step: float, *, begin: float = 0.0,
) -> FloatArray:  # fmt: skip
    """The recorded quantities at every step, shape (seen, n).

    Parameters
    ----------
    masses, springs, laws, rubs, seen
        The rig.
    push
        Weight of the drive at each body, shape (bodies,).
    force, floor
        Drive in N and displacement of the floor in m at every step, shape (n,).
    step
        s.
    begin
        Seconds of the session at the first step, for drifts.
    """
    if len(floor) != len(force):
        raise ValueError(f"the floor has {len(floor)} steps, the drive {len(force)}")
    sb, sw = _table([s.along for s in springs])
    cb, cw = _table([r.along for r in rubs])
    ob, ow = _table([s.along for s in seen])
    out = np.empty((len(seen), len(force)))
    _run(
        1.0 / np.asarray(masses, float), sb, sw, np.array([s.stiffness for s in springs]), np.array([s.damping for s in springs]),
        np.array([1.0 if s.floor else 0.0 for s in springs]), np.array([law.spring for law in laws], np.int64),
        np.array([SPRINGS[law.name] for law in laws], np.int64), _padded([law.parameters for law in laws], PARAMETERS),
        cb, cw, np.array([FRICTIONS[r.name] for r in rubs], np.int64), _padded([r.parameters for r in rubs], PARAMETERS),
        _padded([r.uneven for r in rubs], 3), ob, ow, np.array([s.order for s in seen], np.int64),
        push, force, floor, step, begin, out,
    )  # fmt: skip
    return out


@kernel
def _law(code: int, p: FloatArray, m: FloatArray, d: float, v: float, t: float, k: float) -> float:
    # Force at the present position; memory as of the last `_remember`.
    if code == 0:
        return p[0] * abs(d) ** (p[1] - 1.0) * d
    if code == 1:
        return k * p[0] * (p[1] * math.tanh(d / p[1]) - d)
    if code == 2:
        return -k * (1.0 - p[1]) * min(max(d, -p[0]), p[0])
    if code == 3:
        w = p[2]
        high, low = abs((d + p[0]) / w), abs((d - p[0]) / w)
        soft = high - low + math.log1p(math.exp(-2.0 * high)) - math.log1p(math.exp(-2.0 * low))
        return -k * (1.0 - p[1]) * 0.5 * w * soft
    if code == 4:
        over = abs(d) - p[0]
        if over <= 0.0:
            return 0.0
        side = 1.0 if d > 0.0 else -1.0
        return side * max(p[1] * over + p[2] * side * v, 0.0)
    if code == 5:
        over = p[2] * d - p[0]
        return p[2] * p[1] * over if over > 0.0 else 0.0
    if code == 6:
        return p[0] * (math.sin(2.0 * math.pi * d / p[1] + p[2]) - math.sin(p[2]))
    if code == 7:
        return p[0] * abs(v) ** (p[1] - 1.0) * v
    if code == 8:
        return k * p[0] * t * d
    if code == 11:
        level = p[1] + (p[2] - p[1]) * math.exp(-((v / p[3]) ** 2))
        return p[0] * m[0] + p[4] * (v - p[0] * abs(v) * m[0] / level)
    if code == 13:
        force = 0.0
        for j in range(int(p[0])):
            x = d - m[j]
            free = abs(x) - p[3]
            if free > 0.0:
                force += p[1] * free * (1.0 if x > 0.0 else -1.0)
        return force
    return m[0]


@kernel
def _remember(code: int, p: FloatArray, m: FloatArray, d: float, v: float, h: float) -> None:
    # Memory after a step of length h with velocity v that ends at d.
    if code == 9:
        kept = math.exp(-h / p[1])
        m[0] = m[0] * kept + p[0] * p[1] * v * (1.0 - kept)
    elif code == 10:
        level = p[0] if v > 0.0 else -p[0]
        m[0] = level + (m[0] - level) * math.exp(-p[1] * abs(v) * h / p[0])
    elif code == 11:
        level = p[1] + (p[2] - p[1]) * math.exp(-((v / p[3]) ** 2))
        m[0] = (m[0] + h * v) / (1.0 + h * p[0] * abs(v) / level)
    elif code == 12:
        z = m[0] / p[0]
        bent = p[3] * abs(v) * z * abs(z) ** (p[2] - 1.0) + (1.0 - p[3]) * v * abs(z) ** p[2]
        z += h * p[1] / p[0] * (v - bent)
        m[0] = p[0] * min(max(z, -1.0), 1.0)
    elif code == 13:
        for j in range(int(p[0])):
            x = d - m[j]
            # The slip forces of several sliders increase evenly, up to twice their mean.
            slip = p[2] * 2.0 * (j + 1.0) / (p[0] + 1.0) / p[1] + p[3]
            if x > slip:
                m[j] = d - slip
            elif x < -slip:
                m[j] = d + slip


@kernel
def _run(
    inverse: FloatArray, sb: Any, sw: FloatArray, k: FloatArray, c: FloatArray, on_floor: FloatArray,
    law_spring: Any, law_code: Any, law_p: FloatArray, cb: Any, cw: FloatArray, rub_code: Any, rub_p: FloatArray,
    uneven: FloatArray, ob: Any, ow: FloatArray, order: Any, push: FloatArray, drive: FloatArray, floor: FloatArray,
    h: float, begin: float, out: FloatArray,
) -> None:  # fmt: skip
    n, springs, laws, rubs, seen = len(inverse), len(k), len(law_code), len(rub_code), len(order)
    q, w, older, new = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    d, v, f = np.zeros(springs), np.zeros(springs), np.zeros(n)
    memory, impulse, yields = np.zeros((laws, MEMORY)), np.zeros(rubs), np.zeros(rubs)
    for r in range(rubs):
        for j in range(REACH):
            yields[r] += cw[r, j] ** 2 * inverse[cb[r, j]]
    sweeps = 1 if rubs == 1 else SWEEPS
    for i in range(len(drive)):
        t = begin + i * h
        moved = floor[i]
        shaken = (floor[i] - floor[i - 1]) / h if i else 0.0
        for b in range(n):
            f[b] = push[b] * drive[i]
        for s in range(springs):
            dist, speed = -on_floor[s] * moved, -on_floor[s] * shaken
            for j in range(REACH):
                b = sb[s, j]
                dist += sw[s, j] * q[b]
                # Velocity at the step, extrapolated from the two intervals before it.
                speed += sw[s, j] * (1.5 * w[b] - 0.5 * older[b])
            d[s], v[s] = dist, speed
            force = k[s] * dist + c[s] * speed
            for a in range(laws):
                if law_spring[a] == s:
                    force += _law(law_code[a], law_p[a], memory[a], dist, speed, t, k[s])
            for j in range(REACH):
                f[sb[s, j]] -= sw[s, j] * force
        for b in range(n):
            new[b] = w[b] + h * inverse[b] * f[b]
        for r in range(rubs):
            impulse[r] = 0.0
        for _ in range(sweeps):
            for r in range(rubs):
                rel, at, was = 0.0, 0.0, 0.0
                for j in range(REACH):
                    b = cb[r, j]
                    rel += cw[r, j] * new[b]
                    was += cw[r, j] * w[b]
                    at += cw[r, j] * q[b]
                code = rub_code[r]
                if code == 3:
                    low, high = -1e15, 1e15
                else:
                    level = rub_p[r, 0]
                    if code == 1:
                        level += (rub_p[r, 1] - level) * math.exp(-abs(was) / rub_p[r, 2])
                    elif code == 4:
                        level *= 1.0 + rub_p[r, 1] * t
                    other = level
                    if code == 2:
                        # Forward friction opposes forward motion: it bounds the impulse from below.
                        other = rub_p[r, 1] + rub_p[r, 3] * abs(was)
                        level += rub_p[r, 2] * abs(was)
                    wave = 1.0 + uneven[r, 0] * math.sin(2.0 * math.pi * at / uneven[r, 1] + uneven[r, 2])
                    low, high = -level * wave * h, other * wave * h
                wanted = min(max(impulse[r] - rel / yields[r], low), high)
                more = wanted - impulse[r]
                impulse[r] = wanted
                for j in range(REACH):
                    b = cb[r, j]
                    new[b] += inverse[b] * cw[r, j] * more
        for s in range(seen):
            value = 0.0
            for j in range(REACH):
                b = ob[s, j]
                if order[s] == 0:
                    value += ow[s, j] * q[b]
                elif order[s] == 1:
                    value += ow[s, j] * 0.5 * (w[b] + new[b])
                else:
                    value += ow[s, j] * (new[b] - w[b]) / h
            out[s, i] = value
        for b in range(n):
            older[b] = w[b]
            w[b] = new[b]
            q[b] += h * new[b]
        for a in range(laws):
            if law_code[a] >= 9:
                s = law_spring[a]
                dist, speed = 0.0, 0.0
                for j in range(REACH):
                    dist += sw[s, j] * q[sb[s, j]]
                    speed += sw[s, j] * w[sb[s, j]]
                _remember(law_code[a], law_p[a], memory[a], dist, speed, h)
