"""Dry friction."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, dry


class Coulomb(ContactLaw, frozen=True, kw_only=True, tag="coulomb"):
    """friction_force * sign(v) while sliding; sticks up to static_force (default friction_force)."""

    friction_force: Annotated[float, Parameter("N", 1.0, 12.0, least=0.0)]
    static_force: Annotated[float | None, Parameter("N", 1.0, 20.0)] = None

    def element(self, link: LinkConstants) -> Element | None:
        static = self.friction_force if self.static_force is None else self.static_force
        if static == 0.0:
            return None
        return Element(states=dry((self.friction_force, self.friction_force), (static, static)))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.friction_force * np.sign(v)
