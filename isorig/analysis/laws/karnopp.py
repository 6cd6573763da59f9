"""Dry friction that sticks within a velocity band."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import SimulationError
from isorig.analysis.laws.base import NO_LINK, ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, Exit, State
from isorig.analysis.laws.shapes import falling
from isorig.analysis.laws.stribeck import resist


class Karnopp(ContactLaw, frozen=True, kw_only=True, tag="karnopp"):
    """Friction that sticks within a velocity band; viscous_coefficient * v is added everywhere.

    |v| < band (m/s): resists up to static_force Fs. While sticking, the velocity is kept, not set to zero (Karnopp, J. Dyn. Syst.
    Meas. Control 107, 1985). Outside: g(v) sign(v), g(v) = Fc + (Fs - Fc) exp(-|v / stribeck_velocity|^exponent) with
    friction_force Fc (thesis); Fc without stribeck_velocity.
    """

    friction_force: Annotated[float, Parameter("N", 1.0, 12.0, least=0.0)]
    static_force: Annotated[float, Parameter("N", 1.0, 20.0)]
    band: Annotated[float, Parameter("m/s", 1e-4, 0.03, above=0.0)]
    stribeck_velocity: Annotated[float | None, Parameter("m/s", 5e-3, 0.1, above=0.0)] = None
    exponent: Annotated[float, Parameter("1", 0.5, 2.0, above=0.0)] = 1.0
    viscous_coefficient: Annotated[float, Parameter("N s/m", 0.0, 20.0, least=0.0)] = 0.0

    def element(self, link: LinkConstants) -> Element:
        # Sticking within the band, moving through it in either direction, sliding in either direction.
        band, static, sliding, viscous = self.band, self.static_force, self.friction_force, self.viscous_coefficient
        out = (Exit(to=1, const=static, v=viscous, hold=-1.0), Exit(to=2, const=static, v=-viscous, hold=1.0))
        states = (
            State(holds=True, exits=out),
            State(const=static, v=viscous, exits=(Exit(to=3, const=band, v=-1.0), Exit(to=0, a=1.0))),
            State(const=-static, v=viscous, exits=(Exit(to=4, const=band, v=1.0), Exit(to=0, a=-1.0))),
            State(const=sliding, v=viscous, exits=(Exit(to=0, const=-band, v=1.0),)),
            State(const=-sliding, v=viscous, exits=(Exit(to=0, const=-band, v=-1.0),)),
        )  # fmt: skip
        falls = static - sliding
        if self.stribeck_velocity is None or falls == 0.0:
            return Element(states=states)
        return Element(
            states=states, formula=resist, params=(falls, self.stribeck_velocity, self.exponent, 0.0),
            gates=(0.0, 0.0, 0.0, 1.0, -1.0), steepest=(0.0, 2.0 * falls / self.stribeck_velocity),
        )  # fmt: skip

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        # Within the band it is the holding force, which does not follow from the motion.
        level: float | FloatArray = self.friction_force
        if self.stribeck_velocity is not None:
            level = falling(v, self.friction_force, self.static_force, self.stribeck_velocity, self.exponent)
        return np.where(np.abs(v) > self.band, level * np.sign(v), np.nan) + self.viscous_coefficient * v

    def along(self, d: FloatArray, v: FloatArray, rate: float, link: LinkConstants = NO_LINK) -> FloatArray:
        within = int(np.count_nonzero(np.abs(v) <= self.band))
        if within:
            raise SimulationError(
                f"{within} of {len(v)} samples are within Karnopp's band of {self.band:g} m/s, where the motion does not "
                "determine the friction force; choose a law with a force at every velocity, e.g. coulomb or stribeck"
            )
        return super().along(d, v, rate, link)
