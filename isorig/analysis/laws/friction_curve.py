"""Dry friction with a tabulated level."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.laws.base import ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, curved, dry, levelled
from isorig.analysis.laws.shapes import read, spline, table, tabulated


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
        if self.over == "speed":
            back, other = spline(self.at, self.backward or self.levels)
            at_rest = self.levels[0], (self.backward or self.levels)[0]
            return Element(
                states=dry(at_rest, at_rest), formula=over_speed, params=(*params, *back), gates=(0.0, 1.0, -1.0),
                steepest=(0.0, max(slope, other)),
            )  # fmt: skip
        if self.over == "position":
            return Element(states=levelled(), formula=over_position, params=params, gates=(1.0, 1.0, -1.0), steepest=(slope, 0.0))
        return Element(states=levelled(), formula=over_time, params=params, gates=(1.0, 1.0, -1.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        x = {"speed": np.abs(v), "position": d, "time": t}[self.over]
        level = read(self.at, self.levels, x, straight=False)
        if self.backward:
            level = np.where(v < 0.0, read(self.at, self.backward, x, straight=False), level)
        return np.asarray(np.maximum(level, 0.0) * np.sign(v))


@curved
def over_speed(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    if gate == 0.0:
        return 0.0
    # The difference from the level at rest, which is part of the states; the backward table follows the forward one.
    first = 0 if gate > 0.0 else 5 * int(p[0]) - 3
    return gate * (max(tabulated(p, first, gate * v, False), 0.0) - tabulated(p, first, 0.0, False))


@curved
def over_position(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return gate * max(tabulated(p, 0, d, False), 0.0)


@curved
def over_time(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return gate * max(tabulated(p, 0, t, False), 0.0)
