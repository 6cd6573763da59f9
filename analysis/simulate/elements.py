"""Laws as the engine sees them: states in which a force is straight in position and speed, ways out of them, a curved rest.

Resistance is the force with which an element opposes its elongation d and speed v.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import assert_never

from analysis import laws
from analysis.measured import FloatArray
from analysis.model import Link

#: Codes of the curved laws in the kernel.
CUBIC, SOFTENING, QUADRATIC, DRIFT, ARCTAN, STRIBECK, DAHL, LUGRE = range(1, 9)
#: Parameters that a curved law may have.
WIDTH = 7


@dataclass(frozen=True, kw_only=True)
class Exit:
    """A state ends when hold * (holding force) + const + d * d + v * v + a * (relative acceleration) falls below zero."""

    to: int
    hold: float = 0.0
    const: float = 0.0
    d: float = 0.0
    v: float = 0.0
    a: float = 0.0


@dataclass(frozen=True, kw_only=True)
class State:
    """Resistance const + d * d + v * v, or whatever `holds` the relative speed; `settles` takes that speed to zero first."""

    const: float = 0.0
    d: float = 0.0
    v: float = 0.0
    holds: bool = False
    settles: bool = False
    exits: tuple[Exit, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Element:
    """One law along a direction: its states (the first is where it begins) and its curved rest.

    Parameters
    ----------
    name
        Of the link or contact.
    direction
        Weights of the coordinates in its elongation.
    states
        At least one.
    curve, params
        Code and parameters of the curved rest; 0 where there is none.
    gates
        Sign of the curved rest in each state.
    steepest
        Largest stiffness and damping of the curved rest, as far as known beforehand: they limit the step.
    rubs
        Whether it is a contact's.
    """

    name: str
    direction: FloatArray
    states: tuple[State, ...] = (State(),)
    curve: int = 0
    params: tuple[float, ...] = ()
    gates: tuple[float, ...] = (1.0,)
    steepest: tuple[float, float] = (0.0, 0.0)
    rubs: bool = False


def of_link(link: Link, law: laws.LinkLaw, direction: FloatArray) -> Element | None:
    """A link's law as an element; None where its numbers make it nothing."""
    curve = 0
    params: tuple[float, ...] = ()
    states: tuple[State, ...] = (State(),)
    match law:
        case laws.Cubic():
            curve, params = CUBIC, (law.cubic_stiffness,)
        case laws.BoundedSoftening():
            curve, params = SOFTENING, (link.stiffness * law.softening, law.scale)
        case laws.QuadraticDamping():
            curve, params = QUADRATIC, (law.quadratic_damping,)
        case laws.Drift():
            curve, params = DRIFT, (link.stiffness * law.drift_rate, 1e18 if law.until is None else law.until)
        case laws.Backlash():
            slack, c = link.stiffness * (1.0 - law.residual), law.clearance
            if slack == 0.0 or c == 0.0:
                return None
            states = (
                State(d=-slack, exits=(Exit(to=1, const=c, d=-1.0), Exit(to=2, const=c, d=1.0))),
                State(const=-slack * c, exits=(Exit(to=0, const=-c, d=1.0),)),
                State(const=slack * c, exits=(Exit(to=0, const=-c, d=-1.0),)),
            )
        case laws.EndStop():
            states = _end_stop(law.stroke, law.contact_stiffness, law.contact_damping)
        case _:
            assert_never(law)
    return Element(name=link.name, direction=direction, states=states, curve=curve, params=params, gates=(1.0,) * len(states))


def of_contact(name: str, law: laws.FrictionLaw, direction: FloatArray) -> Element | None:
    """A contact's law as an element; None where its numbers make it nothing."""
    curve, steepest = 0, (0.0, 0.0)
    params: tuple[float, ...] = ()
    states: tuple[State, ...] = (State(),)
    gates: tuple[float, ...] = (1.0,)
    match law:
        case laws.Viscous():
            states = (State(v=law.viscous_coefficient),)
        case laws.Coulomb():
            static = law.friction_force if law.static_force is None else law.static_force
            if static == 0.0:
                return None
            states = _dry((law.friction_force, law.friction_force), (static, static))
        case laws.Asymmetric():
            levels = (law.forward_force, law.backward_force)
            states = _dry(levels, levels, (law.forward_viscosity, law.backward_viscosity))
        case laws.Stribeck():
            if law.static_force == 0.0:
                return None
            states = _dry((law.friction_force, law.friction_force), (law.static_force, law.static_force))
            shape = 0.0 if law.shape == "exponential" else 1.0
            curve, gates = STRIBECK, (0.0, 1.0, -1.0)
            params = (law.static_force - law.friction_force, law.stribeck_velocity, law.exponent, shape)
            steepest = (0.0, 2.0 * (law.static_force - law.friction_force) / law.stribeck_velocity)
        case laws.Karnopp():
            states = _karnopp(law)
        case laws.Arctan():
            curve, params = ARCTAN, (law.friction_force, law.smoothing_velocity)
            steepest = (0.0, law.friction_force / law.smoothing_velocity)
        case laws.Dahl():
            curve, params = DAHL, (law.friction_force, law.bristle_stiffness)
            steepest = (2.0 * law.bristle_stiffness, 0.0)
        case laws.LuGre():
            curve = LUGRE
            steepest = (2.0 * law.bristle_stiffness, 2.0 * (law.bristle_damping + law.viscous_coefficient))
            params = (
                law.bristle_stiffness, law.bristle_damping, law.viscous_coefficient, law.friction_force,
                law.static_force - law.friction_force, law.stribeck_velocity, law.exponent,
            )  # fmt: skip
        case _:
            assert_never(law)
    return Element(
        name=name, direction=direction, states=states, curve=curve, params=params, gates=gates, steepest=steepest, rubs=True
    )


def _dry(
    levels: tuple[float, float], breakaway: tuple[float, float], viscous: tuple[float, float] = (0.0, 0.0)
) -> tuple[State, ...]:
    # Held, sliding forward, sliding backward.
    out = (Exit(to=1, const=breakaway[0], hold=-1.0), Exit(to=2, const=breakaway[1], hold=1.0))
    return (
        State(holds=True, settles=True, exits=out),
        State(const=levels[0], v=viscous[0], exits=(Exit(to=0, v=1.0),)),
        State(const=-levels[1], v=viscous[1], exits=(Exit(to=0, v=-1.0),)),
    )


def _end_stop(stroke: float, k: float, c: float) -> tuple[State, ...]:
    # Free, pressing at either end; a damped stop lets go before it is left, for it never pulls.
    free = State(exits=(Exit(to=1, const=stroke, d=-1.0), Exit(to=2, const=stroke, d=1.0)))
    if c == 0.0:
        return (
            free,
            State(const=-k * stroke, d=k, exits=(Exit(to=0, const=-stroke, d=1.0),)),
            State(const=k * stroke, d=k, exits=(Exit(to=0, const=-stroke, d=-1.0),)),
        )
    return (
        free,
        State(const=-k * stroke, d=k, v=c, exits=(Exit(to=3, const=-k * stroke, d=k, v=c),)),
        State(const=k * stroke, d=k, v=c, exits=(Exit(to=4, const=-k * stroke, d=-k, v=-c),)),
        State(exits=(Exit(to=0, const=-stroke, d=1.0), Exit(to=1, const=k * stroke, d=-k, v=-c))),
        State(exits=(Exit(to=0, const=-stroke, d=-1.0), Exit(to=2, const=k * stroke, d=k, v=c))),
    )


def _karnopp(law: laws.Karnopp) -> tuple[State, ...]:
    # Held within the band, pulled through it either way, sliding either way.
    band, static, sliding = law.band, law.static_force, law.friction_force
    return (
        State(holds=True, exits=(Exit(to=1, const=static, hold=-1.0), Exit(to=2, const=static, hold=1.0))),
        State(const=static, exits=(Exit(to=3, const=band, v=-1.0), Exit(to=0, a=1.0))),
        State(const=-static, exits=(Exit(to=4, const=band, v=1.0), Exit(to=0, a=-1.0))),
        State(const=sliding, exits=(Exit(to=0, const=-band, v=1.0),)),
        State(const=-sliding, exits=(Exit(to=0, const=-band, v=-1.0),)),
    )
