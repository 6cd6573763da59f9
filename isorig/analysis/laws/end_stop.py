"""Stops at both ends of a stroke."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Exit, State


class EndStop(SpringLaw, frozen=True, kw_only=True, tag="end_stop"):
    """Second spring beyond `stroke` (m) on each side: contact_stiffness N/m, contact_damping N s/m, compression only."""

    stroke: float
    contact_stiffness: float
    contact_damping: float = 0.0
    parameters: ClassVar[dict[str, Parameter]] = {
        "stroke": Parameter("m", 2e-3, 2e-2),
        "contact_stiffness": Parameter("N/m", 1e3, 3e5),
        "contact_damping": Parameter("N s/m", 0.0, 50.0),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require("stroke", above=0.0)
        self.require("contact_stiffness", least=0.0)
        self.require("contact_damping", least=0.0)

    def element(self, link: LinkConstants) -> Element:
        # Free, or pressing at either end; a damped stop separates before the stroke is left, because it never pulls.
        stroke, k, c = self.stroke, self.contact_stiffness, self.contact_damping
        free = State(exits=(Exit(to=1, const=stroke, d=-1.0), Exit(to=2, const=stroke, d=1.0)))
        if c == 0.0:
            return Element(
                states=(
                    free,
                    State(const=-k * stroke, d=k, exits=(Exit(to=0, const=-stroke, d=1.0),)),
                    State(const=k * stroke, d=k, exits=(Exit(to=0, const=-stroke, d=-1.0),)),
                )
            )
        return Element(
            states=(
                free,
                State(const=-k * stroke, d=k, v=c, exits=(Exit(to=3, const=-k * stroke, d=k, v=c),)),
                State(const=k * stroke, d=k, v=c, exits=(Exit(to=4, const=-k * stroke, d=-k, v=-c),)),
                State(exits=(Exit(to=0, const=-stroke, d=1.0), Exit(to=1, const=k * stroke, d=-k, v=-c))),
                State(exits=(Exit(to=0, const=-stroke, d=-1.0), Exit(to=2, const=k * stroke, d=k, v=c))),
            )
        )

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        side, over = np.sign(d), np.abs(d) - self.stroke
        pressed = self.contact_stiffness * over + self.contact_damping * v * side
        return np.asarray(np.where(over > 0.0, np.maximum(pressed, 0.0) * side, 0.0))
