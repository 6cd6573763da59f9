"""Dry friction that decreases with velocity."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, curved, dry


class Stribeck(ContactLaw, frozen=True, kw_only=True, tag="stribeck"):
    """Decreases from static_force Fs to friction_force Fc with velocity.

    exponential: Fc + (Fs - Fc) exp(-|v / vs|^exponent); rational: Fc + (Fs - Fc) / (1 + |v / vs|^exponent).
    """

    friction_force: Annotated[float, Parameter("N", 1.0, 12.0, least=0.0)]
    static_force: Annotated[float, Parameter("N", 1.0, 20.0)]
    stribeck_velocity: Annotated[float, Parameter("m/s", 5e-3, 0.1, above=0.0)]
    exponent: Annotated[float, Parameter("1", 0.5, 2.0, above=0.0)] = 1.0
    shape: Literal["exponential", "rational"] = "exponential"

    def element(self, link: LinkConstants) -> Element | None:
        if self.static_force == 0.0:
            return None
        falls = self.static_force - self.friction_force
        return Element(
            states=dry((self.friction_force, self.friction_force), (self.static_force, self.static_force)),
            formula=resist, params=(falls, self.stribeck_velocity, self.exponent, float(self.shape == "rational")),
            gates=(0.0, 1.0, -1.0), steepest=(0.0, 2.0 * falls / self.stribeck_velocity),
        )  # fmt: skip

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        ratio = (np.abs(v) / self.stribeck_velocity) ** self.exponent
        fall = np.exp(-ratio) if self.shape == "exponential" else 1.0 / (1.0 + ratio)
        return np.asarray((self.friction_force + (self.static_force - self.friction_force) * fall) * np.sign(v))


@curved
def resist(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    if gate == 0.0:
        return 0.0
    # A trial step may go beyond the reversal that will end it: continue smoothly there, otherwise the parabola is distorted.
    x = max(gate * v / p[1], -0.5)
    if p[2] != 1.0:
        x = abs(x) ** p[2]
    return gate * p[0] * (np.exp(-x) if p[3] == 0.0 else 1.0 / (1.0 + x))
