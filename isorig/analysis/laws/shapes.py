"""Parts shared by laws: tabulated curves, a level that decreases with velocity, zeros of the velocity within a step."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from math import isfinite

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.jit import inlined, kernel

#: Relative change of a state variable in one Runge-Kutta step, below which it is rounding: steady sliding is not integrated.
SATURATED = 1e-13
#: Runge-Kutta steps in the distance over which a state variable changes by a factor of e: (1/5)^5 / 120 = 3e-6 of error in each.
STEPS = 5.0
#: Minimum points of a tabulated law for a line, and maximum for a fast spline.
FEWEST_POINTS, MOST_POINTS = 2, 65


def table(at: tuple[float, ...], values: tuple[float, ...]) -> None:
    """Raise ModelError if a curve's points are not valid."""
    if len(at) != len(values):
        raise ModelError(f"a curve has {len(at)} points and {len(values)} values; give one value for each point")
    if not FEWEST_POINTS <= len(at) <= MOST_POINTS:
        raise ModelError(f"a curve has {len(at)} points; give {FEWEST_POINTS} to {MOST_POINTS}")
    if not all(map(isfinite, (*at, *values))):
        raise ModelError("a curve has a point that is not finite; give finite numbers")
    if not all(a < b for a, b in pairwise(at)):
        raise ModelError("a curve's points do not increase; sort them and remove repeated ones")


@lru_cache(maxsize=256)
def spline(at: tuple[float, ...], values: tuple[float, ...]) -> tuple[tuple[float, ...], float]:
    """Natural cubic spline in the form for the kernel (see `tabulated`), and its steepest slope between neighbouring points."""
    from scipy.interpolate import CubicSpline

    pieces = CubicSpline(at, values, bc_type="natural").c[::-1].T
    slope = float(np.abs(np.diff(values) / np.diff(at)).max())
    return (float(len(at)), *at, *pieces.ravel().tolist()), slope


def read(at: tuple[float, ...], values: tuple[float, ...], x: FloatArray, *, straight: bool) -> FloatArray:
    """The same spline in plain numpy, `straight` or constant beyond its ends."""
    from scipy.interpolate import CubicSpline

    curve = CubicSpline(at, values, bc_type="natural")
    inside = np.clip(x, at[0], at[-1])
    slope = np.where(x < at[0], curve(at[0], 1), curve(at[-1], 1))
    return np.asarray(curve(inside) + (slope * (x - inside) if straight else 0.0))


def falling(v: FloatArray, sliding: float, static: float, speed: float, exponent: float) -> FloatArray:
    """Level of dry friction in N, decreasing from `static` to `sliding`: by 1 - 1/e at that velocity in m/s (Stribeck)."""
    return np.asarray(sliding + (static - sliding) * np.exp(-((np.abs(v) / speed) ** exponent)))


@kernel
def tabulated(p: FloatArray, first: int, x: float, straight: bool) -> float:
    """Spline through points from p[first] on: their number, their positions, four coefficients for each interval.

    Beyond the ends it is linear (`straight`) or constant.
    """
    count = int(p[first])
    places, last = first + 1, first + count
    if x < p[places]:
        c = last + 1
        return p[c] + (p[c + 1] * (x - p[places]) if straight else 0.0)
    k = 0
    while k < count - 2 and x > p[places + k + 1]:
        k += 1
    c, u = last + 1 + 4 * k, x - p[places + k]
    if x > p[last]:
        u = p[last] - p[places + k]
        slope = p[c + 1] + u * (2.0 * p[c + 2] + 3.0 * u * p[c + 3])
        return p[c] + u * (p[c + 1] + u * (p[c + 2] + u * p[c + 3])) + (slope * (x - p[last]) if straight else 0.0)
    return p[c] + u * (p[c + 1] + u * (p[c + 2] + u * p[c + 3]))


@kernel
def turning(v0: float, vm: float, v1: float, low: float, high: float) -> float:
    """Zero between `low` and `high` (fractions of a step) of the parabola through three velocities; -1 if there is none."""
    b, c = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1)
    at_low, at_high = v0 + low * (b + c * low), v0 + high * (b + c * high)
    if at_low * at_high >= 0.0:
        return -1.0
    # Both zeros without cancellation; one of them lies in between.
    q = -0.5 * (b + np.copysign(np.sqrt(max(b * b - 4.0 * c * v0, 0.0)), b))
    x = v0 / q if q != 0.0 else low
    if not low <= x <= high and c != 0.0:
        x = q / c
    return min(max(x, low), high)


@kernel
def reversal(d0: float, v0: float, vm: float, v1: float, low: float, high: float, h: float) -> float:
    """Elongation in m at which the velocity changes sign between `low` and `high`; d0, that at `low`, if it does not."""
    x = turning(v0, vm, v1, low, high)
    return d0 + way(v0, vm, v1, low, x, h) if x >= 0.0 else d0


@kernel
def way(v0: float, vm: float, v1: float, low: float, x: float, h: float) -> float:
    """Distance in m from fraction `low` of a step of h seconds to fraction x with the parabola through three velocities."""
    b, c = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1)
    return h * ((x - low) * v0 + b * (x * x - low * low) / 2.0 + c * (x**3 - low**3) / 3.0)


@inlined
def integrated(
    rate: Callable[[FloatArray, float, float], float], p: FloatArray, z: float, fastest: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> float:  # fmt: skip
    """State variable at the fraction `high` of a step of h seconds from its value z at `low`, by classical Runge-Kutta steps.

    ``rate(p, z, v)`` is dz/dt at the velocity v, and `fastest` the rate in 1/m at which z can change with the distance. The
    velocity is the parabola through three velocities. Steps end where it changes sign, because the rate has a kink there.
    """
    b, c = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1)
    steps = STEPS * fastest * max(abs(v0), abs(vm), abs(v1)) * h
    x = turning(v0, vm, v1, low, high)
    for begin, end in ((low, high), (high, high)) if x < 0.0 else ((low, x), (x, high)):
        parts = 1 + int(steps * (end - begin))
        dx = (end - begin) / parts
        for k in range(parts):
            x = begin + k * dx
            xm, x1 = x + 0.5 * dx, x + dx
            va, vb, vc = v0 + x * (b + c * x), v0 + xm * (b + c * xm), v0 + x1 * (b + c * x1)
            k1 = rate(p, z, va)
            k2 = rate(p, z + 0.5 * dx * h * k1, vb)
            if abs(k2) * dx * h <= SATURATED * abs(z):  # at x itself the velocity may be zero
                break
            k3 = rate(p, z + 0.5 * dx * h * k2, vb)
            k4 = rate(p, z + dx * h * k3, vc)
            z += dx * h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    return z


@kernel
def dragged(u: float, give: float, d: float) -> float:
    """Position of a slider that is dragged once the elongation, moving linearly to d, leads it by more than `give`."""
    return d - give if d - u > give else (d + give if u - d > give else u)
