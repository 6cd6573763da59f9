"""Interface between laws and engine: states with a force linear in position and velocity, exit conditions, a nonlinear part.

Resistance is the force by which an element opposes its elongation d and velocity v.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import cast

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.jit import Kernel, kernel


@dataclass(frozen=True, kw_only=True)
class Exit:
    """A state ends when a margin becomes negative.

    It is hold * (holding force) + const + d * d + v * v + a * (relative acceleration) + curve * (nonlinear part).
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
    """Resistance const + d * d + v * v + curve * (nonlinear part), or a force that `holds` the relative velocity.

    `settles` sets that velocity to zero first.
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
    """The nonlinear part of a law as kernels."""

    #: Resistance: ``resist(p, gate, d, v, t)`` with the parameters p, the state's gate, elongation (m), velocity (m/s) and time
    #: (s); ``resist(p, gate, memory, d, v, t)`` for a law with memory.
    resist: Callable[..., float]
    #: The memory, from the fraction `low` of a step of h seconds to the fraction `high`: ``carry(p, memory, after, d0, d1, v0,
    #: vm, v1, low, high, h)`` fills `after`; d0 and d1 are the elongations at these fractions, v0, vm and v1 the velocities at
    #: the step's start, middle and end. None for a law without memory.
    carry: Callable[..., None] | None = None
    #: Distance in m from elongation d to the next kink of the force over the elongation, while it moves with the `sign` of its
    #: velocity and the memory follows: ``to_kink(p, memory, d, sign)``. None for a law with memory whose force has kinks only
    #: where the velocity changes sign.
    to_kink: Callable[..., float] | None = None

    @cached_property
    def follow(self) -> Callable[..., None]:
        """Kernel for the memory along a measured motion: ``follow(p, d, v, h, memory)`` fills `memory`, shape (n, numbers), whose
        first row is given; d and v are elongations (m) and velocities (m/s) at samples h seconds apart."""
        carry = cast("Kernel", self.carry)

        def follow(p: FloatArray, d: FloatArray, v: FloatArray, h: float, memory: FloatArray) -> None:
            # The motion may begin where no memory of zero is possible.
            carry(p, memory[0], memory[0], d[0], d[0], v[0], v[0], v[0], 0.0, 0.0, h)
            for k in range(len(d) - 1):
                # In the middle by the cubic through four samples.
                before, after = v[max(k - 1, 0)], v[min(k + 2, len(d) - 1)]
                vm = (9.0 * (v[k] + v[k + 1]) - before - after) / 16.0
                carry(p, memory[k], memory[k + 1], d[k], d[k + 1], v[k], vm, v[k + 1], 0.0, 1.0, h)

        # The compiler's cache has a file for each name.
        follow.__qualname__ = f"follow_{carry.symbol}"
        return kernel(follow)


def curved(resist: Callable[[FloatArray, float, float, float, float], float]) -> Formula:
    """Decorator: the nonlinear part of a law without memory, by its resistance."""
    return Formula(resist=kernel(resist))


@dataclass(frozen=True, kw_only=True)
class Element:
    """One law along a direction: its states (the first is the initial one) and its nonlinear part."""

    states: tuple[State, ...] = (State(),)  #: At least one.
    #: The nonlinear part and its parameters; None if there is none.
    formula: Formula | None = None
    params: tuple[float, ...] = ()
    memories: int = 0  #: Number of memory values.
    gates: tuple[float, ...] = ()  #: Sign of the nonlinear part in each state.
    #: Largest stiffness and damping of the nonlinear part, as far as known in advance: they limit the step.
    steepest: tuple[float, float] = (0.0, 0.0)
    #: Of the link or contact: its name, the weights of the coordinates in its elongation, shape (coordinates,), whether it is a
    #: contact.
    name: str = ""
    direction: FloatArray = field(default_factory=lambda: np.zeros(0))
    rubs: bool = False


def dry(
    levels: tuple[float, float], breakaway: tuple[float, float], viscous: tuple[float, float] = (0.0, 0.0)
) -> tuple[State, ...]:
    """Sticking, sliding forward, sliding backward: sliding and breakaway forces (N) and viscosities (N s/m) in each direction."""
    out = (Exit(to=1, const=breakaway[0], hold=-1.0), Exit(to=2, const=breakaway[1], hold=1.0))
    return (
        State(holds=True, settles=True, exits=out),
        State(const=levels[0], v=viscous[0], exits=(Exit(to=0, v=1.0),)),
        State(const=-levels[1], v=viscous[1], exits=(Exit(to=0, v=-1.0),)),
    )


def levelled() -> tuple[State, ...]:
    """Sticking, sliding forward, sliding backward; the nonlinear part is the breakaway and sliding level (gates 1, 1, -1)."""
    out = (Exit(to=1, hold=-1.0, curve=1.0), Exit(to=2, hold=1.0, curve=1.0))
    return (State(holds=True, settles=True, curve=0.0, exits=out), *dry((0.0, 0.0), (0.0, 0.0))[1:])
