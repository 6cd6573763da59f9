"""Friction that is elastic before it slides."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import NO_LINK, ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, Formula
from isorig.analysis.laws.shapes import turning, way


class Dahl(ContactLaw, frozen=True, kw_only=True, tag="dahl"):
    """df/dt = bristle_stiffness v (1 - f sign(v) / friction_force): elastic before it slides (N/m)."""

    friction_force: Annotated[float, Parameter("N", 1.0, 12.0, above=0.0)]
    bristle_stiffness: Annotated[float, Parameter("N/m", 1e3, 3e4, above=0.0)]
    remembers: ClassVar[bool] = True

    def element(self, link: LinkConstants) -> Element:
        params = (self.friction_force, self.bristle_stiffness)
        return Element(formula=FORMULA, params=params, memories=1, steepest=(2.0 * self.bristle_stiffness, 0.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return memory[0]

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        return np.array([self.bristle_stiffness * (v - abs(v) * memory[0] / self.friction_force)])

    def along(self, d: FloatArray, v: FloatArray, rate: float, link: LinkConstants = NO_LINK) -> FloatArray:
        out = np.empty(len(v))
        slid_along(np.array([self.friction_force, self.bristle_stiffness]), np.ascontiguousarray(v) / rate, out)
        return out


@kernel
def slid(f: float, p: FloatArray, x: float) -> float:
    """Force after a distance x (m) in one direction: df/dx = k (1 - f sign(v) / Fc) in closed form."""
    s = 1.0 if x >= 0.0 else -1.0
    return s * p[0] + (f - s * p[0]) * np.exp(-p[1] * abs(x) / p[0])


@kernel
def slid_along(p: FloatArray, distance: FloatArray, out: FloatArray) -> None:
    """Forces after each of the distances (m), one after another, into `out`, shape (n,)."""
    force = 0.0
    for k in range(len(distance)):
        force = slid(force, p, distance[k])
        out[k] = force


@kernel
def resist(p: FloatArray, gate: float, memory: FloatArray, d: float, v: float, t: float) -> float:
    return memory[0]


@kernel
def carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    x = turning(v0, vm, v1, low, high)
    if x < 0.0:
        after[0] = slid(memory[0], p, d1 - d0)
    else:
        # Split where the velocity changes sign.
        gone = way(v0, vm, v1, low, x, h)
        after[0] = slid(slid(memory[0], p, gone), p, d1 - d0 - gone)


FORMULA = Formula(resist=resist, carry=carry)
