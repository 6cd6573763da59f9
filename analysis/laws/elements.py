"""What a law tells the engine: states in which its force is straight in position and speed, ways out of them, a curved rest.

Resistance is the force with which an element opposes its elongation d and speed v.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from isorig.analysis.campaign import FloatArray


@dataclass(frozen=True, kw_only=True)
class Exit:
    """A state ends when a margin falls below zero.

    It is hold * (holding force) + const + d * d + v * v + a * (relative acceleration) + curve * (curved rest).
    """

    to: int
    hold: float = 0.0
    const: float = 0.0
    d: float = 0.0
    v: float = 0.0
    a: float = 0.0
    curve: float = 0.0


@dataclass(frozen=True, kw_only=True)
class State:
    """Resistance const + d * d + v * v + curve * (curved rest), or whatever `holds` the relative speed.

    `settles` takes that speed to zero first.
    """

    const: float = 0.0
    d: float = 0.0
    v: float = 0.0
    holds: bool = False
    settles: bool = False
    curve: float = 1.0
    exits: tuple[Exit, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Formula:
    """The curved rest of a law as kernels.

    Parameters
    ----------
    resist
        Resistance: ``resist(p, gate, d, v, t)`` with the parameters p, the state's gate, elongation (m), speed (m/s) and time
        (s); ``resist(p, gate, memory, d, v, t)`` where the law remembers.
    carry
        What the law remembers, from the share `low` of a step of h seconds to the share `high`:
        ``carry(p, memory, after, d0, d1, v0, vm, v1, low, high, h)`` fills `after`; d0 and d1 are the elongations at those
        shares, v0, vm and v1 the speeds at the step's start, middle and end. None where the law does not remember.
    """

    resist: Callable[..., float]
    carry: Callable[..., None] | None = None


@dataclass(frozen=True, kw_only=True)
class Element:
    """One law along a direction: its states (the first is where it begins) and its curved rest.

    Parameters
    ----------
    states
        At least one.
    formula, params
        The curved rest and its parameters; None where there is none.
    memories
        Numbers that it remembers.
    gates
        Sign of the curved rest in each state.
    steepest
        Largest stiffness and damping of the curved rest, as far as known beforehand: they limit the step.
    name, direction, rubs
        Of the link or contact: its name, the weights of the coordinates in its elongation, whether it is a contact.
    """

    states: tuple[State, ...] = (State(),)
    formula: Formula | None = None
    params: tuple[float, ...] = ()
    memories: int = 0
    gates: tuple[float, ...] = ()
    steepest: tuple[float, float] = (0.0, 0.0)
    name: str = ""
    direction: FloatArray = field(default_factory=lambda: np.zeros(0))
    rubs: bool = False


def dry(
    levels: tuple[float, float], breakaway: tuple[float, float], viscous: tuple[float, float] = (0.0, 0.0)
) -> tuple[State, ...]:
    """Held, sliding forward, sliding backward: sliding and breakaway forces (N) and viscosities (N s/m) each way."""
    out = (Exit(to=1, const=breakaway[0], hold=-1.0), Exit(to=2, const=breakaway[1], hold=1.0))
    return (
        State(holds=True, settles=True, exits=out),
        State(const=levels[0], v=viscous[0], exits=(Exit(to=0, v=1.0),)),
        State(const=-levels[1], v=viscous[1], exits=(Exit(to=0, v=-1.0),)),
    )


def levelled() -> tuple[State, ...]:
    """Held, sliding forward, sliding backward, the curved rest being the level of breakaway and of sliding (gates 1, 1, -1)."""
    out = (Exit(to=1, hold=-1.0, curve=1.0), Exit(to=2, hold=1.0, curve=1.0))
    return (State(holds=True, settles=True, curve=0.0, exits=out), *dry((0.0, 0.0), (0.0, 0.0))[1:])
