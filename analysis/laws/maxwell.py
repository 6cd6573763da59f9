"""A spring and a damper in series."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Formula


class Maxwell(SpringLaw, frozen=True, kw_only=True, tag="maxwell"):
    """A spring and a damper in series: df/dt = series_stiffness v - (series_stiffness / series_damping) f (N/m, N s/m)."""

    series_stiffness: float
    series_damping: float
    parameters: ClassVar[dict[str, Parameter]] = {
        "series_stiffness": Parameter("N/m", 1e2, 1e4),
        "series_damping": Parameter("N s/m", 3.0, 100.0),
    }
    remembers: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("series_stiffness", above=0.0)
        self.require("series_damping", above=0.0)

    def element(self, stiffness: float) -> Element:
        params = (self.series_stiffness, self.series_damping)
        return Element(formula=FORMULA, params=params, memories=1, steepest=(self.series_stiffness, 0.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, stiffness: float) -> FloatArray:
        return memory[0]

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        return np.array([self.series_stiffness * (v - memory[0] / self.series_damping)])


@kernel
def resist(p: FloatArray, gate: float, memory: FloatArray, d: float, v: float, t: float) -> float:
    return memory[0]


@kernel
def carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    # RK4 in sub-steps with parabolic velocity.
    b, c = -3.0 * v0 + 4.0 * vm - v1, 2.0 * (v0 - 2.0 * vm + v1)
    rate, f = p[0] / p[1], memory[0]
    parts = 1 + int(5.0 * rate * (high - low) * h)
    dx = (high - low) / parts
    for k in range(parts):
        x = low + k * dx
        xm, x1 = x + 0.5 * dx, x + dx
        va, vb, vc = v0 + x * (b + c * x), v0 + xm * (b + c * xm), v0 + x1 * (b + c * x1)
        k1 = p[0] * va - rate * f
        k2 = p[0] * vb - rate * (f + 0.5 * dx * h * k1)
        k3 = p[0] * vb - rate * (f + 0.5 * dx * h * k2)
        k4 = p[0] * vc - rate * (f + dx * h * k3)
        f += dx * h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    after[0] = f


FORMULA = Formula(resist=resist, carry=carry)
