"""Dry friction whose level depends on position."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, curved, levelled


class PositionDependent(ContactLaw, frozen=True, kw_only=True, tag="position_dependent"):
    """Sliding and breakaway at max(friction_force + gradient d + ripple cos(2 pi d / pitch), 0) N.

    `gradient` (N/m) describes a rail that tightens, `ripple` (N) with period `pitch` (m) the balls of a bearing or a screw
    (Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994).
    """

    friction_force: Annotated[float, Parameter("N", 3.0, 12.0, least=0.0)]
    gradient: Annotated[float, Parameter("N/m", -100.0, 100.0)] = 0.0
    ripple: Annotated[float, Parameter("N", 0.0, 2.0)] = 0.0
    pitch: Annotated[float, Parameter("m", 5e-3, 3e-2, above=0.0)] = 0.01

    def element(self, link: LinkConstants) -> Element:
        return Element(
            states=levelled(), formula=resist, gates=(1.0, 1.0, -1.0),
            params=(self.friction_force, self.gradient, self.ripple, 2.0 * np.pi / self.pitch),
            steepest=(abs(self.gradient) + 2.0 * np.pi * abs(self.ripple) / self.pitch, 0.0),
        )  # fmt: skip

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        level = self.friction_force + self.gradient * d + self.ripple * np.cos(2.0 * np.pi * d / self.pitch)
        return np.asarray(np.maximum(level, 0.0) * np.sign(v))


@curved
def resist(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return gate * max(p[0] + p[1] * d + p[2] * np.cos(p[3] * d), 0.0)
