"""Friction by the velocity, and the position: it slides by a formula, and most of it sticks."""

from typing import Annotated, Literal

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import SimulationError
from isorig.analysis.laws.base import NO_LINK, ContactLaw, LinkConstants, Parameter
from isorig.analysis.laws.elements import Element, Exit, State, curved, dry, levelled


def falling(v: FloatArray, sliding: float, static: float, speed: float, exponent: float) -> FloatArray:
    """Level of dry friction in N, decreasing from `static` to `sliding`: by 1 - 1/e at that velocity in m/s (Stribeck)."""
    return np.asarray(sliding + (static - sliding) * np.exp(-((np.abs(v) / speed) ** exponent)))


class Viscous(ContactLaw, frozen=True, kw_only=True, tag="viscous"):
    """viscous_coefficient * v, N s/m."""

    viscous_coefficient: Annotated[float, Parameter("N s/m", 1.0, 100.0, least=0.0)]

    def element(self, link: LinkConstants) -> Element:
        return Element(states=(State(v=self.viscous_coefficient),))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.viscous_coefficient * v


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


class Asymmetric(ContactLaw, frozen=True, kw_only=True, tag="asymmetric"):
    """Separate dry level (N) and viscous coefficient (N s/m) for each direction, forward being v > 0."""

    forward_force: Annotated[float, Parameter("N", 1.0, 12.0, least=0.0)]
    backward_force: Annotated[float, Parameter("N", 1.0, 12.0, least=0.0)]
    forward_viscosity: Annotated[float, Parameter("N s/m", 0.0, 20.0, least=0.0)] = 0.0
    backward_viscosity: Annotated[float, Parameter("N s/m", 0.0, 20.0, least=0.0)] = 0.0

    def element(self, link: LinkConstants) -> Element:
        levels = (self.forward_force, self.backward_force)
        return Element(states=dry(levels, levels, (self.forward_viscosity, self.backward_viscosity)))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        forward = self.forward_force + self.forward_viscosity * np.abs(v)
        backward = self.backward_force + self.backward_viscosity * np.abs(v)
        return np.asarray(np.where(v > 0.0, forward, np.where(v < 0.0, -backward, 0.0)))


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
            states=levelled(), formula=at_position, gates=(1.0, 1.0, -1.0),
            params=(self.friction_force, self.gradient, self.ripple, 2.0 * np.pi / self.pitch),
            steepest=(abs(self.gradient) + 2.0 * np.pi * abs(self.ripple) / self.pitch, 0.0),
        )  # fmt: skip

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        level = self.friction_force + self.gradient * d + self.ripple * np.cos(2.0 * np.pi * d / self.pitch)
        return np.asarray(np.maximum(level, 0.0) * np.sign(v))


@curved
def at_position(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return gate * max(p[0] + p[1] * d + p[2] * np.cos(p[3] * d), 0.0)


class Stribeck(ContactLaw, frozen=True, kw_only=True, tag="stribeck"):
    """Decreases from static_force Fs to friction_force Fc with velocity.

    exponential: Fc + (Fs - Fc) exp(-|v / vs|^exponent); rational: Fc + (Fs - Fc) / (1 + |v / vs|^exponent).
    """

    friction_force: Annotated[float, Parameter("N", 1.0, 12.0, least=0.0)]
    static_force: Annotated[float, Parameter("N", 1.0, 20.0)]
    stribeck_velocity: Annotated[float, Parameter("m/s", 5e-3, 0.1, above=0.0)]
    exponent: Annotated[float, Parameter("1", 0.5, 2.0, above=0.0)] = 1.0
    shape: Literal["exponential", "rational"] = "exponential"

    def element(self, link: LinkConstants) -> Element | None:
        if self.static_force == 0.0:
            return None
        falls = self.static_force - self.friction_force
        return Element(
            states=dry((self.friction_force, self.friction_force), (self.static_force, self.static_force)),
            formula=falls_smoothly, params=(falls, self.stribeck_velocity, self.exponent, float(self.shape == "rational")),
            gates=(0.0, 1.0, -1.0), steepest=(0.0, 2.0 * falls / self.stribeck_velocity),
        )  # fmt: skip

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        ratio = (np.abs(v) / self.stribeck_velocity) ** self.exponent
        fall = np.exp(-ratio) if self.shape == "exponential" else 1.0 / (1.0 + ratio)
        return np.asarray((self.friction_force + (self.static_force - self.friction_force) * fall) * np.sign(v))


@curved
def falls_smoothly(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    if gate == 0.0:
        return 0.0
    # A trial step may go beyond the reversal that will end it: continue smoothly there, otherwise the parabola is distorted.
    x = max(gate * v / p[1], -0.5)
    if p[2] != 1.0:
        x = abs(x) ** p[2]
    return gate * p[0] * (np.exp(-x) if p[3] == 0.0 else 1.0 / (1.0 + x))


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
            states=states, formula=falls_smoothly, params=(falls, self.stribeck_velocity, self.exponent, 0.0),
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


class Arctan(ContactLaw, frozen=True, kw_only=True, tag="arctan"):
    """(2 / pi) g(v) arctan(v / smoothing_velocity) + viscous_coefficient * v: never sticks.

    g(v) = Fc + (Fs - Fc) exp(-|v / stribeck_velocity|^exponent) with friction_force Fc and static_force Fs (thesis;
    Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30, 1994); Fc without static_force.
    """

    friction_force: Annotated[float, Parameter("N", 1.0, 12.0, least=0.0)]
    smoothing_velocity: Annotated[float, Parameter("m/s", 5e-3, 0.1, above=0.0)]
    static_force: Annotated[float | None, Parameter("N", 1.0, 20.0)] = None
    stribeck_velocity: Annotated[float, Parameter("m/s", 5e-3, 0.1, above=0.0)] = 0.05
    exponent: Annotated[float, Parameter("1", 0.5, 2.0, above=0.0)] = 1.0
    viscous_coefficient: Annotated[float, Parameter("N s/m", 0.0, 20.0, least=0.0)] = 0.0

    def element(self, link: LinkConstants) -> Element:
        top = self._static
        falls = top - self.friction_force
        return Element(
            states=(State(v=self.viscous_coefficient),), formula=smoothed,
            params=(self.friction_force, self.smoothing_velocity, falls, self.stribeck_velocity, self.exponent),
            steepest=(0.0, top / self.smoothing_velocity + 2.0 * falls / self.stribeck_velocity),
        )  # fmt: skip

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        level = falling(v, self.friction_force, self._static, self.stribeck_velocity, self.exponent)
        return np.asarray(level * (2.0 / np.pi) * np.arctan(v / self.smoothing_velocity) + self.viscous_coefficient * v)

    @property
    def _static(self) -> float:
        return self.friction_force if self.static_force is None else self.static_force


@curved
def smoothed(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    level = p[0]
    if p[2] > 0.0:
        level += p[2] * np.exp(-((abs(v) / p[3]) ** p[4]))
    return level * (2.0 / np.pi) * np.arctan(v / p[1])
