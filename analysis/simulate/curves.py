"""Curved laws as the kernel evaluates them: without memory, or with one state carried along the motion."""

from __future__ import annotations

import numpy as np

from analysis.jit import kernel
from analysis.measured import FloatArray


@kernel
def resist(code: int, p: FloatArray, gate: float, inner: float, d: float, v: float, t: float) -> float:
    """Resistance of a curved law at elongation d (m), speed v (m/s) and time t (s); `inner` is its memory."""
    # Codes as in elements.
    if code == 1:
        return p[0] * d * d * d
    if code == 2:
        return p[0] * (p[1] * np.tanh(d / p[1]) - d)
    if code == 3:
        return p[0] * v * abs(v)
    if code == 4:
        return p[0] * min(t, p[1]) * d
    if code == 5:
        return p[0] * (2.0 / np.pi) * np.arctan(v / p[1])
    if code == 6:
        if gate == 0.0:
            return 0.0
        # A trial step may run past the reversal that will cut it: go on smoothly there, or the parabola bends.
        x = max(gate * v / p[1], -0.5)
        if p[2] != 1.0:
            x = abs(x) ** p[2]
        return gate * p[0] * (np.exp(-x) if p[3] == 0.0 else 1.0 / (1.0 + x))
    if code == 7:
        return inner
    return p[0] * inner + p[1] * bristle_rate(p, inner, v) + p[2] * v


@kernel
def bristle_rate(p: FloatArray, z: float, v: float) -> float:
    """dz/dt of LuGre's mean bristle."""
    level = p[3] + p[4] * np.exp(-((abs(v) / p[5]) ** p[6]))
    return v - p[0] * abs(v) * z / level


@kernel
def slid(f: float, p: FloatArray, way: float) -> float:
    """Dahl's force after a way (m) in one direction: df/dx = k (1 - f sign(v) / Fc) in closed form."""
    s = 1.0 if way >= 0.0 else -1.0
    return s * p[0] + (f - s * p[0]) * np.exp(-p[1] * abs(way) / p[0])


@kernel
def turning(v0: float, vm: float, v1: float, low: float, high: float) -> float:
    """Where between `low` and `high` (shares of a step) the parabola through three speeds changes sign; -1 if nowhere."""
    b, c = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1)
    at_low, at_high = v0 + low * (b + c * low), v0 + high * (b + c * high)
    if at_low * at_high >= 0.0:
        return -1.0
    for _ in range(60):
        x = 0.5 * (low + high)
        if (v0 + x * (b + c * x)) * at_low > 0.0:
            low = x
        else:
            high = x
    return 0.5 * (low + high)


@kernel
def dahl(
    f: float, p: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float, low: float, high: float, h: float
) -> float:
    """Dahl's force from share `low` of a step (elongation d0) to share `high` (d1), split where the speed turns."""
    x = turning(v0, vm, v1, low, high)
    if x < 0.0:
        return slid(f, p, d1 - d0)
    b, c = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1)
    way = h * ((x - low) * v0 + b * (x * x - low * low) / 2.0 + c * (x**3 - low**3) / 3.0)
    return slid(slid(f, p, way), p, d1 - d0 - way)


@kernel
def bristles(z: float, p: FloatArray, v0: float, vm: float, v1: float, low: float, high: float, h: float) -> float:
    """LuGre's mean bristle from share `low` of a step to share `high` under a parabola of speeds, by RK4 in parts."""
    b, c = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1)
    fastest = max(abs(v0), abs(vm), abs(v1))
    # Its rate has a corner where the speed turns.
    x = turning(v0, vm, v1, low, high)
    for begin, end in ((low, high), (high, high)) if x < 0.0 else ((low, x), (x, high)):
        parts = 2 + int(10.0 * p[0] * fastest / p[3] * (end - begin) * h)
        dx = (end - begin) / parts
        for k in range(parts):
            x = begin + k * dx
            xm, x1 = x + 0.5 * dx, x + dx
            va, vb, vc = v0 + x * (b + c * x), v0 + xm * (b + c * xm), v0 + x1 * (b + c * x1)
            k1 = bristle_rate(p, z, va)
            k2 = bristle_rate(p, z + 0.5 * dx * h * k1, vb)
            k3 = bristle_rate(p, z + 0.5 * dx * h * k2, vb)
            k4 = bristle_rate(p, z + dx * h * k3, vc)
            z += dx * h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    return z


@kernel
def advance(
    code: int,
    p: FloatArray,
    gate: float,
    inner: float,
    d0: float,
    v0: float,
    dm: float,
    vm: float,
    d1: float,
    v1: float,
    h: float,
    t: float,
) -> tuple[float, float, float]:
    """Resistance at the middle and the end of `h` seconds from t on, and the memory at the end."""
    half, whole = inner, inner
    if code == 7:
        half = dahl(inner, p, d0, dm, v0, vm, v1, 0.0, 0.5, h)
        whole = dahl(half, p, dm, d1, v0, vm, v1, 0.5, 1.0, h)
    elif code == 8:
        half = bristles(inner, p, v0, vm, v1, 0.0, 0.5, h)
        whole = bristles(half, p, v0, vm, v1, 0.5, 1.0, h)
    return resist(code, p, gate, half, dm, vm, t + 0.5 * h), resist(code, p, gate, whole, d1, v1, t + h), whole
