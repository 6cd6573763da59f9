"""A tabulated spring, damper or stiffness over time."""

from __future__ import annotations

from typing import Annotated, Literal

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, curved
from isorig.analysis.laws.shapes import read, spline, table, tabulated


class Curve(SpringLaw, frozen=True, kw_only=True, tag="curve"):
    """A tabulated law: a natural cubic spline through the points (`at`, `values`), linear beyond its ends.

    over "deflection" (m) or "speed" (m/s): a force in N added to the link's; over "time" (s since the campaign's first sample,
    constant beyond the ends): a stiffness in N/m added to the link's, or a damping in N s/m if it is `of` the damping.
    """

    over: Literal["deflection", "speed", "time"]
    at: Annotated[tuple[float, ...], Parameter("m", 1e-3, 2e-2)]
    values: Annotated[tuple[float, ...], Parameter("N", 0.0, 10.0)]
    of: Literal["stiffness", "damping"] = "stiffness"

    def __post_init__(self) -> None:
        super().__post_init__()
        table(self.at, self.values)

    def element(self, link: LinkConstants) -> Element:
        params, slope = spline(self.at, self.values)
        if self.over == "deflection":
            return Element(formula=over_deflection, params=params, steepest=(slope, 0.0))
        if self.over == "speed":
            return Element(formula=over_speed, params=params, steepest=(0.0, slope))
        if self.of == "damping":
            return Element(formula=damping_over_time, params=params, steepest=(0.0, max(map(abs, self.values))))
        return Element(formula=over_time, params=params)

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        if self.over == "time":
            return read(self.at, self.values, t, straight=False) * (v if self.of == "damping" else d)
        return read(self.at, self.values, d if self.over == "deflection" else v, straight=True)


@curved
def over_deflection(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return tabulated(p, 0, d, True)


@curved
def over_speed(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return tabulated(p, 0, v, True)


@curved
def over_time(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return tabulated(p, 0, t, False) * d


@curved
def damping_over_time(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return tabulated(p, 0, t, False) * v
