"""Bristle friction: elastic before it slides, decreasing with velocity."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import kernel
from isorig.analysis.laws.base import ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, Formula
from isorig.analysis.laws.shapes import falling, integrated


class LuGre(ContactLaw, frozen=True, kw_only=True, tag="lugre"):
    """Bristles of mean deflection z: force = s0 z + s1 dz/dt + s2 v, dz/dt = v - s0 |v| z / g(v).

    g(v) = Fc + (Fs - Fc) exp(-|v / vs|^exponent); s0 is `bristle_stiffness` (N/m), s1 `bristle_damping` and s2
    `viscous_coefficient` (N s/m) (Canudas de Wit et al., IEEE Trans. Autom. Control 40, 1995).
    """

    bristle_stiffness: Annotated[float, Parameter("N/m", 1e3, 3e4, above=0.0)]
    friction_force: Annotated[float, Parameter("N", 1.0, 12.0, above=0.0)]
    static_force: Annotated[float, Parameter("N", 1.0, 20.0)]
    stribeck_velocity: Annotated[float, Parameter("m/s", 5e-3, 0.1, above=0.0)]
    bristle_damping: Annotated[float, Parameter("N s/m", 0.0, 20.0, least=0.0)] = 0.0
    viscous_coefficient: Annotated[float, Parameter("N s/m", 0.0, 20.0, least=0.0)] = 0.0
    exponent: Annotated[float, Parameter("1", 1.0, 2.0, above=0.0)] = 2.0
    remembers: ClassVar[bool] = True

    def element(self, link: LinkConstants) -> Element:
        return Element(
            formula=FORMULA, memories=1,
            steepest=(2.0 * self.bristle_stiffness, 2.0 * (self.bristle_damping + self.viscous_coefficient)),
            params=(
                self.bristle_stiffness, self.bristle_damping, self.viscous_coefficient, self.friction_force,
                self.static_force - self.friction_force, self.stribeck_velocity, self.exponent,
            ),
        )  # fmt: skip

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        moving = v - self.bristle_stiffness * np.abs(v) * memory[0] / self._level(v)
        return np.asarray(self.bristle_stiffness * memory[0] + self.bristle_damping * moving + self.viscous_coefficient * v)

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        return np.asarray(v - self.bristle_stiffness * abs(v) * memory / self._level(np.array(v)))

    def _level(self, v: FloatArray) -> FloatArray:
        return falling(v, self.friction_force, self.static_force, self.stribeck_velocity, self.exponent)


@kernel
def bristle_rate(p: FloatArray, z: float, v: float) -> float:
    """dz/dt of the mean bristle."""
    level = p[3] + p[4] * np.exp(-((abs(v) / p[5]) ** p[6]))
    return v - p[0] * abs(v) * z / level


@kernel
def resist(p: FloatArray, gate: float, memory: FloatArray, d: float, v: float, t: float) -> float:
    return p[0] * memory[0] + p[1] * bristle_rate(p, memory[0], v) + p[2] * v


@kernel
def carry(
    p: FloatArray, memory: FloatArray, after: FloatArray, d0: float, d1: float, v0: float, vm: float, v1: float,
    low: float, high: float, h: float,
) -> None:  # fmt: skip
    after[0] = integrated(bristle_rate, p, memory[0], p[0] / p[3], v0, vm, v1, low, high, h)


FORMULA = Formula(resist=resist, carry=carry)
