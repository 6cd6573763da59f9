"""Stops at the ends of a stroke."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Exit, State


class EndStop(SpringLaw, frozen=True, kw_only=True, tag="end_stop"):
    """Second spring beyond `stroke` (m): contact_stiffness N/m, contact_damping N s/m, compression only.

    It acts at both ends of the stroke, or only at the `end` of positive (1) or negative (-1) elongation.
    """

    stroke: Annotated[float, Parameter("m", 2e-3, 2e-2, above=0.0)]
    contact_stiffness: Annotated[float, Parameter("N/m", 1e3, 3e5, least=0.0)]
    contact_damping: Annotated[float, Parameter("N s/m", 0.0, 50.0, least=0.0)] = 0.0
    end: Literal[-1, 0, 1] = 0

    @property
    def _ends(self) -> tuple[int, ...]:
        return (self.end,) if self.end else (1, -1)

    def element(self, link: LinkConstants) -> Element:
        # Free, or pressing at either end; a damped stop separates before the stroke is left, because it never pulls.
        stroke, k, c, ends = self.stroke, self.contact_stiffness, self.contact_damping, self._ends
        states = [State(exits=tuple(Exit(to=1 + i, const=stroke, d=-way) for i, way in enumerate(ends)))]
        for i, way in enumerate(ends):
            parted = Exit(to=1 + len(ends) + i, const=-k * stroke, d=way * k, v=way * c)
            left = Exit(to=0, const=-stroke, d=way)
            states.append(State(const=-way * k * stroke, d=k, v=c, exits=(parted if c else left,)))
        for i, way in enumerate(ends if c else ()):
            pressed = Exit(to=1 + i, const=k * stroke, d=-way * k, v=-way * c)
            states.append(State(exits=(Exit(to=0, const=-stroke, d=way), pressed)))
        return Element(states=tuple(states))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        side, over = np.sign(d), np.abs(d) - self.stroke
        pressed = self.contact_stiffness * over + self.contact_damping * v * side
        acts = (over > 0.0) & np.isin(side, self._ends)
        return np.asarray(np.where(acts, np.maximum(pressed, 0.0) * side, 0.0))
