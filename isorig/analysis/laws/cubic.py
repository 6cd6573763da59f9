"""A spring that hardens or softens with the cube of its deflection."""

from __future__ import annotations

from typing import Annotated

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, curved


class Cubic(SpringLaw, frozen=True, kw_only=True, tag="cubic"):
    """Force cubic_stiffness * d^3 added to the spring (N/m^3); negative softens."""

    cubic_stiffness: Annotated[float, Parameter("N/m^3", 1e4, 1e7)]

    def element(self, link: LinkConstants) -> Element:
        return Element(formula=resist, params=(self.cubic_stiffness,))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.cubic_stiffness * d**3


@curved
def resist(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * d * d * d
