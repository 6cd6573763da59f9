"""Dry and viscous friction with different values in each direction."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, dry


class Asymmetric(ContactLaw, frozen=True, kw_only=True, tag="asymmetric"):
    """Separate dry level (N) and viscous coefficient (N s/m) for each direction, forward being v > 0."""

    forward_force: Annotated[float, Parameter("N", 1.0, 12.0, least=0.0)]
    backward_force: Annotated[float, Parameter("N", 1.0, 12.0, least=0.0)]
    forward_viscosity: Annotated[float, Parameter("N s/m", 0.0, 20.0, least=0.0)] = 0.0
    backward_viscosity: Annotated[float, Parameter("N s/m", 0.0, 20.0, least=0.0)] = 0.0

    def element(self, link: LinkConstants) -> Element:
        levels = (self.forward_force, self.backward_force)
        return Element(states=dry(levels, levels, (self.forward_viscosity, self.backward_viscosity)))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        forward = self.forward_force + self.forward_viscosity * np.abs(v)
        backward = self.backward_force + self.backward_viscosity * np.abs(v)
        return np.asarray(np.where(v > 0.0, forward, np.where(v < 0.0, -backward, 0.0)))
