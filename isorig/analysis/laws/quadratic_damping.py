"""Damping proportional to the square of the velocity."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, curved


class QuadraticDamping(SpringLaw, frozen=True, kw_only=True, tag="quadratic_damping"):
    """Force quadratic_damping * v |v| (N s^2/m^2)."""

    quadratic_damping: Annotated[float, Parameter("N s^2/m^2", 1.0, 300.0, least=0.0)]

    def element(self, link: LinkConstants) -> Element:
        return Element(formula=resist, params=(self.quadratic_damping,))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.quadratic_damping * v * np.abs(v)


@curved
def resist(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * v * abs(v)
