"""Forces of a link by its deflection, its velocity and the time: springs, stops, play, damping, drifts."""

from typing import Annotated, Literal

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.laws.base import LinkConstants, Parameter, SpringLaw
from isorig.analysis.laws.elements import Element, Exit, State, curved

#: Time in s longer than any campaign.
NEVER = 1e18


class Cubic(SpringLaw, frozen=True, kw_only=True, tag="cubic"):
    """Force cubic_stiffness * d^3 added to the spring (N/m^3); negative softens."""

    cubic_stiffness: Annotated[float, Parameter("N/m^3", 1e4, 1e7)]

    def element(self, link: LinkConstants) -> Element:
        return Element(formula=cubed, params=(self.cubic_stiffness,))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.cubic_stiffness * d**3


@curved
def cubed(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * d * d * d


class Polynomial(SpringLaw, frozen=True, kw_only=True, tag="polynomial"):
    """Force quadratic_stiffness d^2 + cubic_stiffness d^3 added to the spring (N/m^2, N/m^3): unlike in the two directions.

    A gas spring, a membrane, or a hardening spring that carries a weight (Nayfeh and Mook, Nonlinear Oscillations, 1979).
    """

    quadratic_stiffness: Annotated[float, Parameter("N/m^2", -1e4, 1e4)]
    cubic_stiffness: Annotated[float, Parameter("N/m^3", 0.0, 1e7)] = 0.0

    def element(self, link: LinkConstants) -> Element:
        return Element(formula=squared_and_cubed, params=(self.quadratic_stiffness, self.cubic_stiffness))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.quadratic_stiffness * d**2 + self.cubic_stiffness * d**3


@curved
def squared_and_cubed(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return (p[0] + p[1] * d) * d * d


class Bilinear(SpringLaw, frozen=True, kw_only=True, tag="bilinear"):
    """Force stiffness_difference * |d| (N/m): so much more stiffness in extension, d > 0, and so much less in compression."""

    stiffness_difference: Annotated[float, Parameter("N/m", -500.0, 500.0)]

    def element(self, link: LinkConstants) -> Element:
        more = self.stiffness_difference
        return Element(states=(State(d=more, exits=(Exit(to=1, d=1.0),)), State(d=-more, exits=(Exit(to=0, d=-1.0),))))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.stiffness_difference * np.abs(d)


class BoundedSoftening(SpringLaw, frozen=True, kw_only=True, tag="bounded_softening"):
    """Spring force k ((1 - r) d + r s tanh(d / s)): softening r in [0, 1), scale s in m."""

    softening: Annotated[float, Parameter("1", 0.0, 0.95)]
    scale: Annotated[float, Parameter("m", 1e-3, 3e-2, above=0.0)]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.softening < 1.0:
            raise ModelError(f"softening is {self.softening:g}, which must lie in [0, 1); correct it")

    def element(self, link: LinkConstants) -> Element:
        return Element(formula=softened, params=(link.stiffness * self.softening, self.scale))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return np.asarray(link.stiffness * self.softening * (self.scale * np.tanh(d / self.scale) - d))


@curved
def softened(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * (p[1] * np.tanh(d / p[1]) - d)


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
        return Element(formula=repeated, params=params, steepest=(self.periodic_force * wave, 0.0))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.periodic_force * np.sin(2.0 * np.pi * d / self.pitch + self.phase) - self._at_rest(link)

    def _at_rest(self, link: LinkConstants) -> float:
        return float(self.periodic_force * np.sin(self.phase)) if link.stiffness > 0.0 else 0.0


@curved
def repeated(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * np.sin(p[1] * d + p[2]) - p[3]


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


class QuadraticDamping(SpringLaw, frozen=True, kw_only=True, tag="quadratic_damping"):
    """Force quadratic_damping * v |v| (N s^2/m^2)."""

    quadratic_damping: Annotated[float, Parameter("N s^2/m^2", 1.0, 300.0, least=0.0)]

    def element(self, link: LinkConstants) -> Element:
        return Element(formula=squared, params=(self.quadratic_damping,))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.quadratic_damping * v * np.abs(v)


@curved
def squared(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * v * abs(v)


class AsymmetricDamping(SpringLaw, frozen=True, kw_only=True, tag="asymmetric_damping"):
    """Force damping_difference * |v| (N s/m): so much more damping in extension, v > 0, and so much less in compression."""

    damping_difference: Annotated[float, Parameter("N s/m", -20.0, 20.0)]

    def element(self, link: LinkConstants) -> Element:
        more = self.damping_difference
        return Element(states=(State(v=more, exits=(Exit(to=1, v=1.0),)), State(v=-more, exits=(Exit(to=0, v=-1.0),))))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return self.damping_difference * np.abs(v)


class LinearDrift(SpringLaw, frozen=True, kw_only=True):
    """A constant of a link times drift_rate t, drift_rate in 1/s, t from the campaign's first sample, at most `until` s."""

    drift_rate: Annotated[float, Parameter("1/s", -0.1, 0.2)]
    until: Annotated[float | None, Parameter("s", 0.5, 2.0)] = None

    @property
    def end(self) -> float:
        """Time from which on it is constant, s."""
        return NEVER if self.until is None else self.until


class Drift(LinearDrift, frozen=True, kw_only=True, tag="drift"):
    """Stiffness k (1 + drift_rate t), drift_rate in 1/s, t from the campaign's first sample, constant after `until` s."""

    def element(self, link: LinkConstants) -> Element:
        return Element(formula=pull, params=(link.stiffness * self.drift_rate, self.end))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return np.asarray(link.stiffness * self.drift_rate * np.minimum(t, self.end) * d)


class DampingDrift(LinearDrift, frozen=True, kw_only=True, tag="damping_drift"):
    """Damping c (1 + drift_rate t), drift_rate in 1/s, t from the campaign's first sample, constant after `until` s."""

    def element(self, link: LinkConstants) -> Element:
        rate = link.damping * self.drift_rate
        steepest = 0.0 if self.until is None else abs(rate) * self.until
        return Element(formula=drag, params=(rate, self.end), steepest=(0.0, steepest))

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        return np.asarray(link.damping * self.drift_rate * np.minimum(t, self.end) * v)


@curved
def pull(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * min(t, p[1]) * d


@curved
def drag(p: FloatArray, gate: float, d: float, v: float, t: float) -> float:
    return p[0] * min(t, p[1]) * v
