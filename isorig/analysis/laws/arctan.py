"""Smoothed dry friction: it creeps and never sticks."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, State, curved
from isorig.analysis.laws.shapes import falling


class Arctan(ContactLaw, frozen=True, kw_only=True, tag="arctan"):
    """(2 / pi) g(v) arctan(v / smoothing_velocity) + viscous_coefficient * v: never sticks.

    g(v) = Fc + (Fs - Fc) exp(-|v / stribeck_velocity|^exponent) with friction_force Fc and static_force Fs (thesis;
    Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994); Fc without static_force.
    """

    friction_force: Annotated[float, Parameter("N", 1.0, 12.0, least=0.0)]
    smoothing_velocity: Annotated[float, Parameter("m/s", 5e-3, 0.1, above=0.0)]
    static_force: Annotated[float | None, Parameter("N", 1.0, 20.0)] = None
    stribeck_velocity: Annotated[float, Parameter("m/s", 5e-3, 0.1, above=0.0)] = 0.05
    exponent: Annotated[float, Parameter("1", 0.5, 2.0, above=0.0)] = 1.0
    viscous_coefficient: Annotated[float, Parameter("N s/m", 0.0, 20.0, least=0.0)] = 0.0

    def element(self, link: LinkConstants) -> Element:
        top = self._static
        falls = top - self.friction_force
        return Element(
            states=(State(v=self.viscous_coefficient),), formula=resist,
            params=(self.friction_force, self.smoothing_velocity, falls, self.stribeck_velocity, self.exponent),
            steepest=(0.0, top / self.smoothing_velocity + 2.0 * falls / self.stribeck_velocity),
        )  # fmt: skip

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        level = falling(v, self.friction_force, self._static, self.stribeck_velocity, self.exponent)
        return np.asarray(level * (2.0 / np.pi) * np.arctan(v / self.smoothing_velocity) + self.viscous_coefficient * v)

    @property
    def _static(self) -> float:
        return self.friction_force if self.static_force is None else self.static_force


@curved
def resist(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    level = p[0]
    if p[2] > 0.0:
        level += p[2] * np.exp(-((abs(v) / p[3]) ** p[4]))
    return level * (2.0 / np.pi) * np.arctan(v / p[1])
