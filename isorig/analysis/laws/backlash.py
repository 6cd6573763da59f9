"""Backlash in a spring's mounting."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Exit, State


class Backlash(SpringLaw, frozen=True, kw_only=True, tag="backlash"):
    """Spring acts only beyond `clearance` (m, half the play); within it a share `residual` of the stiffness remains."""

    clearance: Annotated[float, Parameter("m", 1e-4, 1e-2, least=0.0)]
    residual: Annotated[float, Parameter("1", 0.0, 0.5, least=0.0, most=1.0)] = 0.0

    def element(self, link: LinkConstants) -> Element | None:
        slack, c = link.stiffness * (1.0 - self.residual), self.clearance
        if slack == 0.0 or c == 0.0:
            return None
        return Element(
            states=(
                State(d=-slack, exits=(Exit(to=1, const=c, d=-1.0), Exit(to=2, const=c, d=1.0))),
                State(const=-slack * c, exits=(Exit(to=0, const=-c, d=1.0),)),
                State(const=slack * c, exits=(Exit(to=0, const=-c, d=-1.0),)),
            )
        )

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return np.asarray(-link.stiffness * (1.0 - self.residual) * np.clip(d, -self.clearance, self.clearance))
