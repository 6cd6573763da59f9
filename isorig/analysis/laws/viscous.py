"""Friction proportional to velocity."""

from __future__ import annotations

from typing import Annotated

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, State


class Viscous(ContactLaw, frozen=True, kw_only=True, tag="viscous"):
    """viscous_coefficient * v, N s/m."""

    viscous_coefficient: Annotated[float, Parameter("N s/m", 1.0, 100.0, least=0.0)]

    def element(self, link: LinkConstants) -> Element:
        return Element(states=(State(v=self.viscous_coefficient),))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.viscous_coefficient * v
