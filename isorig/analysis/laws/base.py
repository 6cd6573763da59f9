"""Base classes of all laws: parameters with units and practical range, element, and the formula in plain numpy."""

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.given import all_of_type, number, one_of
from isorig.analysis.laws.elements import Element


@dataclass(frozen=True)
class Parameter:
    """SI unit of a parameter, its practical range (the law's envelope, from which tests draw rigs), and its limits, if any.

    A value is allowed from `least` on, or only `above` a number; with `most`, from `least` to `most`.
    """

    unit: str
    low: float
    high: float
    least: float | None = None
    above: float | None = None
    most: float | None = None


@dataclass(frozen=True)
class LinkConstants:
    """Constants of the link that has a law: stiffness (N/m), damping (N s/m), and the mass of its lighter end (kg)."""

    stiffness: float = 0.0
    damping: float = 0.0
    mass: float = math.inf


#: Of a contact.
NO_LINK = LinkConstants()


class Law(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="law"):
    """Base of all laws: every number is finite and within its limit.

    d is the relative displacement in m and v the relative velocity in m/s along the element; positive forces oppose positive d
    and v. A law is a subclass of `SpringLaw` or `ContactLaw` with a unique tag, in any file of this package.
    """

    #: By field: the annotation of every number of the law has one.
    parameters: ClassVar[dict[str, Parameter]]
    #: The fields that are several numbers, those that may be None, and the texts that others may be.
    tables: ClassVar[frozenset[str]]
    optional: ClassVar[frozenset[str]]
    choices: ClassVar[dict[str, tuple[str, ...]]]
    #: Whether it has a memory.
    remembers: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        hints = get_type_hints(cls, include_extras=True)
        cls.parameters = {name: hint.__metadata__[0] for name, hint in hints.items() if get_origin(hint) is Annotated}
        kinds = {name: hints[name].__origin__ for name in cls.parameters}
        cls.choices = {
            name: get_args(hint)
            for name, hint in hints.items()
            if get_origin(hint) is Literal and isinstance(get_args(hint)[0], str)
        }
        cls.tables = frozenset(name for name, kind in kinds.items() if get_origin(kind) is tuple)
        cls.optional = frozenset(name for name, kind in kinds.items() if type(None) in get_args(kind))

    def __post_init__(self) -> None:
        for name, allowed in self.choices.items():
            one_of(getattr(self, name), allowed, name)
        for name, parameter in self.parameters.items():
            given = getattr(self, name)
            if name in self.tables:
                several = all_of_type(given, object, name, "a sequence of numbers; give one, for example (0.0, 1.0)")
                msgspec.structs.force_setattr(self, name, tuple(number(each, name) for each in several))
            if name in self.tables or (given is None and name in self.optional):
                continue
            value = number(given, name)
            if not math.isfinite(value):
                raise ModelError(f"{name} is {value}; give a finite number")
            if parameter.above is not None and value <= parameter.above:
                raise ModelError(f"{name} is {value:g}, which must be greater than {parameter.above:g}; correct it")
            if parameter.least is not None and parameter.most is not None and not parameter.least <= value <= parameter.most:
                raise ModelError(f"{name} is {value:g}, which must lie in [{parameter.least:g}, {parameter.most:g}]; correct it")
            if parameter.least is not None and value < parameter.least:
                raise ModelError(f"{name} is {value:g}, which must be at least {parameter.least:g}; correct it")

    def element(self, link: LinkConstants) -> Element | None:
        """The law in the form for the engine, on a link with these constants; None if its parameters make it zero."""
        raise NotImplementedError(f"the law {type(self).__name__} lacks element(); implement it")

    def force(self, d: FloatArray, v: FloatArray, t: FloatArray, memory: FloatArray, link: LinkConstants) -> FloatArray:
        """Resistance in N while sliding, by the law's formula in plain numpy, independent of the engine's kernels.

        Elongation d in m, velocity v in m/s and time t in s have shape (n,), the memory (numbers, n); `link` are constants of its
        link.
        """
        raise NotImplementedError(f"the law {type(self).__name__} lacks force(); implement it")

    def rates(self, d: float, v: float, memory: FloatArray) -> FloatArray:
        """Time derivative of the memory, shape (numbers,), in plain numpy, too; a law with memory implements it."""
        raise NotImplementedError(f"the law {type(self).__name__} lacks rates(); implement it")

    def begun(self) -> FloatArray:
        """Initial memory, shape (numbers,)."""
        return np.zeros(1 if self.remembers else 0)

    def along(self, d: FloatArray, v: FloatArray, rate: float, link: LinkConstants = NO_LINK) -> FloatArray:
        """Resistance in N along a measured motion, elongation (m) and velocity (m/s) at `rate` Hz, shape (n,).

        That of a law with memory depends on its own parameters only, not on the link's constants. Raises SimulationError if the
        law's force does not follow from a motion.
        """
        memory = np.zeros((len(d), len(self.begun())))
        if self.remembers and len(d) and (element := self.element(link)) is not None and element.formula is not None:
            memory[0] = self.begun()
            element.formula.follow(np.array(element.params), *map(np.ascontiguousarray, (d, v)), 1.0 / rate, memory)
        return self.force(d, v, np.arange(len(d)) / rate, memory.T, link)


class SpringLaw(Law, frozen=True, kw_only=True):
    """Base of the link laws: a force beyond the link's linear spring and damper."""


class ContactLaw(Law, frozen=True, kw_only=True):
    """Base of the contact laws: friction. A `static_force` is never below the `friction_force`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        static, sliding = getattr(self, "static_force", None), getattr(self, "friction_force", 0.0)
        if static is not None and static < sliding:
            raise ModelError(
                f"static_force is {static:g} N, below friction_force {sliding:g} N; breakaway is never below sliding friction"
            )
