"""Tabulated laws: splines through given points."""

from functools import lru_cache
from itertools import pairwise
from math import isfinite
from typing import Annotated, Literal

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import ContactLaw, LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, curved, dry, levelled

#: Minimum points of a tabulated law for a line, and maximum for a fast spline.
FEWEST_POINTS, MOST_POINTS = 2, 65
#: What curves and levels are over: the first parameter of their kernels is its place, plus `OF_DAMPING` for one of the damping.
CURVES, LEVELS, OF_DAMPING = ("deflection", "speed", "time"), ("speed", "position", "time"), 3


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


@lru_cache(maxsize=64)
def _shares(at: tuple[float, ...]) -> FloatArray:
    # Coefficients of a natural cubic spline per value, the highest power first, shape (4, intervals, points): they are linear in
    # the values, and a fit changes only these.
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(at, np.eye(len(at)), bc_type="natural").c)


@lru_cache(maxsize=256)
def spline(at: tuple[float, ...], values: tuple[float, ...]) -> tuple[tuple[float, ...], float]:
    """Natural cubic spline in the form for the kernel (see `tabulated`), and its steepest slope between neighbouring points."""
    pieces = (_shares(at) @ np.array(values))[::-1].T
    slope = float(np.abs(np.diff(values) / np.diff(at)).max())
    return (float(len(at)), *at, *pieces.ravel().tolist()), slope


def read(at: tuple[float, ...], values: tuple[float, ...], x: FloatArray, *, straight: bool) -> FloatArray:
    """The same spline in plain numpy, `straight` or constant beyond its ends."""
    from scipy.interpolate import PPoly

    curve = PPoly.construct_fast(_shares(at) @ np.array(values), np.array(at))
    inside = np.clip(x, at[0], at[-1])
    found = np.asarray(curve(inside))
    return found + np.where(x < at[0], curve(at[0], 1), curve(at[-1], 1)) * (x - inside) if straight else found


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


class Curve(SpringLaw, frozen=True, kw_only=True, tag="curve"):
    """A tabulated law: a natural cubic spline through the points (`at`, `values`), linear beyond its ends.

    over "deflection" (m) or "speed" (m/s): a force in N added to the link's; over "time" (s since the campaign's first sample,
    constant beyond the ends): a stiffness in N/m added to the link's. Over deflection or time, it is a damping in N s/m, constant
    beyond the ends, if it is `of` the damping.
    """

    over: Literal["deflection", "speed", "time"]
    at: Annotated[tuple[float, ...], Parameter("m", 1e-3, 2e-2)]
    values: Annotated[tuple[float, ...], Parameter("N", 0.0, 10.0)]
    of: Literal["stiffness", "damping"] = "stiffness"

    def __post_init__(self) -> None:
        super().__post_init__()
        table(self.at, self.values)
        if self.of == "damping" and self.over == "speed":
            raise ModelError("a curve of the damping is over speed; give one over deflection or time, or a curve of the force")

    def element(self, link: LinkConstants) -> Element:
        params, slope = spline(self.at, self.values)
        kind = CURVES.index(self.over)
        steepest = ((slope, 0.0), (0.0, slope), (0.0, 0.0))[kind]
        if self.of == "damping":
            kind, steepest = kind + OF_DAMPING, (0.0, max(map(abs, self.values)))
        return Element(formula=curve, params=(float(kind), *params), steepest=steepest)

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        x = {"deflection": d, "speed": v, "time": t}[self.over]
        if self.of == "damping" or self.over == "time":
            return read(self.at, self.values, x, straight=False) * (v if self.of == "damping" else d)
        return read(self.at, self.values, x, straight=True)


@curved
def curve(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    if p[0] == 0.0:
        return tabulated(p, 1, d, True)
    if p[0] == 1.0:
        return tabulated(p, 1, v, True)
    if p[0] == OF_DAMPING:
        return tabulated(p, 1, d, False) * v
    return tabulated(p, 1, t, False) * (v if p[0] > OF_DAMPING else d)


class FrictionCurve(ContactLaw, frozen=True, kw_only=True, tag="friction_curve"):
    """Dry friction with a tabulated level: a natural cubic spline through (`at`, `levels`), never negative.

    over "speed": the level at |v| (m/s), with `backward` for v < 0; breakaway is the level at zero velocity. Over "position": the
    level at elongation d (m). Over "time": the level at a time (s since the campaign's first sample). Beyond the ends the level
    is constant.
    """

    over: Literal["speed", "position", "time"]
    at: Annotated[tuple[float, ...], Parameter("m/s", 1e-3, 1.0)]
    levels: Annotated[tuple[float, ...], Parameter("N", 1.0, 12.0)]
    backward: Annotated[tuple[float, ...], Parameter("N", 1.0, 12.0)] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        table(self.at, self.levels)
        if self.backward:
            table(self.at, self.backward)
        if self.backward and self.over != "speed":
            raise ModelError(f"backward levels need levels over speed, not over {self.over}; remove them")
        if self.over == "speed" and self.at[0] != 0.0:
            raise ModelError(f"levels over speed start at {self.at[0]:g} m/s; start them at 0, which is breakaway")
        lowest = min((*self.levels, *self.backward))
        if lowest < 0.0:
            raise ModelError(f"a friction level is {lowest:g} N; give levels of zero or more")

    def element(self, link: LinkConstants) -> Element:
        params, slope = spline(self.at, self.levels)
        kind = float(LEVELS.index(self.over))
        if self.over != "speed":
            steepest = (slope, 0.0) if self.over == "position" else (0.0, 0.0)
            return Element(states=levelled(), formula=level, params=(kind, *params), gates=(1.0, 1.0, -1.0), steepest=steepest)
        back, other = spline(self.at, self.backward or self.levels)
        at_rest = self.levels[0], (self.backward or self.levels)[0]
        return Element(
            states=dry(at_rest, at_rest), formula=level, params=(kind, *params, *back), gates=(0.0, 1.0, -1.0),
            steepest=(0.0, max(slope, other)),
        )  # fmt: skip

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        x = {"speed": np.abs(v), "position": d, "time": t}[self.over]
        levels = read(self.at, self.levels, x, straight=False)
        if self.backward:
            levels = np.where(v < 0.0, read(self.at, self.backward, x, straight=False), levels)
        return np.asarray(np.maximum(levels, 0.0) * np.sign(v))


@curved
def level(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    if p[0] > 0.0:
        return gate * max(tabulated(p, 1, d if p[0] == 1.0 else t, False), 0.0)
    if gate == 0.0:
        return 0.0
    # The difference from the level at rest, which is part of the states; the backward table follows the forward one.
    first = 1 if gate > 0.0 else 5 * int(p[1]) - 2
    return gate * (max(tabulated(p, first, gate * v, False), 0.0) - tabulated(p, first, 0.0, False))
