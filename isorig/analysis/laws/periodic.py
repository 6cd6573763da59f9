"""A force that repeats with the position."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, curved


class Periodic(SpringLaw, frozen=True, kw_only=True, tag="periodic"):
    """Force periodic_force sin(2 pi d / pitch + phase) added to the link (N, m, rad).

    The cogging of a motor, whose magnets prefer some positions, and the meshing of teeth (Hanselman, Brushless Permanent Magnet
    Motor Design, 2003, chapter 4). A spring is at equilibrium at d = 0, so its force there, periodic_force sin(phase), is
    subtracted.
    """

    periodic_force: Annotated[float, Parameter("N", 0.5, 5.0, least=0.0)]
    pitch: Annotated[float, Parameter("m", 5e-3, 3e-2, above=0.0)]
    phase: Annotated[float, Parameter("1", -3.0, 3.0)] = 0.0

    def element(self, link: LinkConstants) -> Element:
        wave = 2.0 * np.pi / self.pitch
        params = (self.periodic_force, wave, self.phase, self._at_rest(link))
        return Element(formula=resist, params=params, steepest=(self.periodic_force * wave, 0.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.periodic_force * np.sin(2.0 * np.pi * d / self.pitch + self.phase) - self._at_rest(link)

    def _at_rest(self, link: LinkConstants) -> float:
        return float(self.periodic_force * np.sin(self.phase)) if link.stiffness > 0.0 else 0.0


@curved
def resist(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * np.sin(p[1] * d + p[2]) - p[3]
