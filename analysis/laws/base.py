"""What every law has: parameters with units and the range that benches see, its element, its formula written out plainly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.laws.elements import Element

#: Parts of a sample's interval in which a memory is carried along a measured motion.
PARTS = 16


@dataclass(frozen=True)
class Parameter:
    """SI unit of a parameter, and the range in which benches see it (its envelope): tests draw rigs from there."""

    unit: str
    low: float
    high: float


class Law(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="law"):
    """Base of all laws: every number is finite.

    d is the relative displacement in m and v the relative velocity in m/s along the element; positive forces oppose
    positive d and v. A law is one file of this package: a subclass of `SpringLaw` or `ContactLaw` with a tag of its own.
    """

    #: By field; every number of the law has one.
    parameters: ClassVar[dict[str, Parameter]] = {}
    #: Numbers that the law remembers along the motion.
    remembers: ClassVar[bool] = False

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if isinstance(value, float) and not math.isfinite(value):
                raise ModelError(f"{name} is {value}; give a finite number")

    def require(self, name: str, *, above: float | None = None, least: float | None = None) -> None:
        """Raise ModelError where the parameter lies at or below `above`, or below `least`."""
        value = getattr(self, name)
        if above is not None and value <= above:
            raise ModelError(f"{name} is {value:g}, which must be greater than {above:g}; correct it")
        if least is not None and value < least:
            raise ModelError(f"{name} is {value:g}, which must be at least {least:g}; correct it")

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Self:
        """A law with parameters from the envelope, evenly in their logarithm where the range lies above zero."""
        values = {}
        for name, p in cls.parameters.items():
            even = float(draw.uniform(0.0, 1.0))
            values[name] = p.low * (p.high / p.low) ** even if p.low > 0.0 else p.low + (p.high - p.low) * even
        return cls(**values)

    def element(self, stiffness: float) -> Element | None:
        """The law as the engine takes it, on a link of that stiffness in N/m; None where its numbers make it nothing."""
        raise NotImplementedError(f"the law {type(self).__name__} lacks element(); write it")

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, stiffness: float) -> FloatArray:
        """Resistance in N while it slides, by the law's formula in plain numpy, apart from what the engine runs.

        Parameters
        ----------
        d, v, t
            Elongation (m), speed (m/s) and time (s), shape (n,).
        memory
            What it remembers then, shape (numbers, n).
        stiffness
            Of the link that it is on, N/m.
        """
        raise SimulationError(f"the law {type(self).__name__} is not judged by force; use a rig that a spring holds")

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        """Rate of what the law remembers, shape (numbers,); a law that remembers has it, or `along`."""
        raise SimulationError(f"the law {type(self).__name__} is not judged by force; use a rig that a spring holds")

    def begun(self) -> FloatArray:
        """What the law remembers at first, shape (numbers,)."""
        return np.zeros(1 if self.remembers else 0)

    def along(self, d: FloatArray, v: FloatArray, rate: float, stiffness: float = 0.0) -> FloatArray:
        """Resistance in N along a measured motion, elongation (m) and speed (m/s) at `rate` Hz, shape (n,).

        Raises
        ------
        SimulationError
            Where the law's force does not follow from a motion.
        """
        memory = np.zeros((len(self.begun()), len(d)))
        if self.remembers:
            dt, now = 1.0 / (rate * PARTS), self.begun()
            memory[:, 0] = now
            for k in range(len(d) - 1):
                for part in range(PARTS):
                    at = (part + np.array([0.0, 0.5, 1.0])) / PARTS
                    x, y = d[k] + (d[k + 1] - d[k]) * at, v[k] + (v[k + 1] - v[k]) * at
                    k1 = self.rates(x[0], y[0], now)
                    k2 = self.rates(x[1], y[1], now + 0.5 * dt * k1)
                    k3 = self.rates(x[1], y[1], now + 0.5 * dt * k2)
                    now = now + dt * (k1 + 2.0 * k2 + 2.0 * k3 + self.rates(x[2], y[2], now + dt * k3)) / 6.0
                memory[:, k + 1] = now
        return self.force(d, v, np.arange(len(d)) / rate, memory, stiffness)


class SpringLaw(Law, frozen=True, kw_only=True):
    """Base of the laws of links: a force beyond the link's linear spring and damper."""


class ContactLaw(Law, frozen=True, kw_only=True):
    """Base of the laws of contacts: friction."""


def breakaway(static: float, sliding: float) -> None:
    """Raise ModelError where breakaway is below sliding friction."""
    if static < sliding:
        raise ModelError(
            f"static_force is {static:g} N, below friction_force {sliding:g} N; breakaway is never below sliding friction"
        )
