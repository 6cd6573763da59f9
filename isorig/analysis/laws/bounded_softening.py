"""A spring that softens with deflection and keeps a positive stiffness."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, curved


class BoundedSoftening(SpringLaw, frozen=True, kw_only=True, tag="bounded_softening"):
    """Spring force k ((1 - r) d + r s tanh(d / s)): softening r in [0, 1), scale s in m."""

    softening: Annotated[float, Parameter("1", 0.0, 0.95)]
    scale: Annotated[float, Parameter("m", 1e-3, 3e-2, above=0.0)]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.softening < 1.0:
            raise ModelError(f"softening is {self.softening:g}, which must lie in [0, 1); correct it")

    def element(self, link: LinkConstants) -> Element:
        return Element(formula=resist, params=(link.stiffness * self.softening, self.scale))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return np.asarray(link.stiffness * self.softening * (self.scale * np.tanh(d / self.scale) - d))


@curved
def resist(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * (p[1] * np.tanh(d / p[1]) - d)
