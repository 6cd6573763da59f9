"""Backlash in a spring's mounting."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Exit, State


class Backlash(SpringLaw, frozen=True, kw_only=True, tag="backlash"):
    """Spring acts only beyond `clearance` (m, half the play).

    Within it a share `residual` of the stiffness and a share `damped` of the link's damping remain: of a damper that joins the
    same parts all of it, of the damping of the parts that touch none.
    """

    clearance: Annotated[float, Parameter("m", 1e-4, 1e-2, least=0.0)]
    residual: Annotated[float, Parameter("1", 0.0, 0.5, least=0.0, most=1.0)] = 0.0
    damped: Annotated[float, Parameter("1", 0.0, 1.0, least=0.0, most=1.0)] = 1.0

    def element(self, link: LinkConstants) -> Element | None:
        slack, loose, c = link.stiffness * (1.0 - self.residual), link.damping * (1.0 - self.damped), self.clearance
        if (slack == 0.0 and loose == 0.0) or c == 0.0:
            return None
        return Element(
            states=(
                State(d=-slack, v=-loose, exits=(Exit(to=1, const=c, d=-1.0), Exit(to=2, const=c, d=1.0))),
                State(const=-slack * c, exits=(Exit(to=0, const=-c, d=1.0),)),
                State(const=slack * c, exits=(Exit(to=0, const=-c, d=-1.0),)),
            )
        )

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        loose = np.where(np.abs(d) < self.clearance, link.damping * (1.0 - self.damped) * v, 0.0)
        return np.asarray(-link.stiffness * (1.0 - self.residual) * np.clip(d, -self.clearance, self.clearance) - loose)
