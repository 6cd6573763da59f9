"""A tabulated spring, damper or stiffness over time."""

from __future__ import annotations

from typing import Annotated, Literal

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Formula
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
            return Element(formula=OVER_DEFLECTION, params=params, steepest=(slope, 0.0))
        if self.over == "speed":
            return Element(formula=OVER_SPEED, params=params, steepest=(0.0, slope))
        if self.of == "damping":
            return Element(formula=DAMPING_OVER_TIME, params=params, steepest=(0.0, max(map(abs, self.values))))
        return Element(formula=OVER_TIME, params=params)

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        if self.over == "time":
            return read(self.at, self.values, t, straight=False) * (v if self.of == "damping" else d)
        return read(self.at, self.values, d if self.over == "deflection" else v, straight=True)


@kernel
def over_deflection(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return tabulated(p, 0, d, True)


@kernel
def over_speed(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return tabulated(p, 0, v, True)


@kernel
def over_time(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return tabulated(p, 0, t, False) * d


@kernel
def damping_over_time(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return tabulated(p, 0, t, False) * v


OVER_DEFLECTION, OVER_SPEED = Formula(resist=over_deflection), Formula(resist=over_speed)
OVER_TIME, DAMPING_OVER_TIME = Formula(resist=over_time), Formula(resist=damping_over_time)
