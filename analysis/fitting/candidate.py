"""A candidate: a changed model with free parameters, as the fits see a cause."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from isorig.analysis.fitting.solve import Free, base_parameters
from isorig.analysis.model.rig_model import RigModel


@dataclass(frozen=True, kw_only=True)
class Reported:
    """A parameter of the answer: its name in the findings, the model's path, its unit."""

    name: str
    path: str
    unit: str
    value: Callable[[RigModel], float] | None = None

    def of(self, model: RigModel) -> float:
        """The value in a model: at the path, or worked out from several parameters."""
        return model.get(self.path) if self.value is None else self.value(model)


@dataclass(frozen=True, kw_only=True)
class Shape:
    """Where the curve of a free shape stands in the model.

    Parameters
    ----------
    over, unit, value_unit
        What the curve runs over, that quantity's unit, and the values' unit.
    path
        Dotted path of the law.
    tables
        Names of its values; none where the law is no single curve.
    """

    over: str
    unit: str
    value_unit: str
    path: str
    tables: tuple[str, ...]


def always(model: RigModel) -> bool:
    """Every fit of most causes is plausible."""
    return True


def never(candidate: Candidate, fitted: RigModel) -> None:
    """Only a curve can have more points."""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A cause at a place, as extended models from which fits start.

    Parameters
    ----------
    cause, location
        Names of the findings' catalogue.
    family
        Causes of one family are alike in kind: friction, spring, mass, delay.
    starts
        The extended model at one or more starting values.
    free
        Its new parameters.
    dropped
        Paths of the baseline that the extension replaces.
    reported
        What is said of it in the findings.
    rank
        Simplicity: of two that fit alike the lower is kept.
    plausible
        Whether a fitted model still is what the cause's name says.
    twin
        Cause and location that lead to the same equations, so that no data of this rig can tell them apart.
    shape
        Of a free shape: where its curve stands.
    denser
        Of a free shape: itself with more points, started from a fitted model; None where no more are of use.
    """

    cause: str
    location: str
    family: str
    starts: tuple[RigModel, ...]
    free: tuple[Free, ...]
    reported: tuple[Reported, ...]
    dropped: tuple[str, ...] = ()
    rank: int = 1
    plausible: Callable[[RigModel], bool] = always
    twin: tuple[str, str] | None = None
    shape: Shape | None = None
    denser: Callable[[Candidate, RigModel], Candidate | None] = never

    @property
    def key(self) -> tuple[str, str]:
        """Cause and location."""
        return self.cause, self.location

    def refined(self, fitted: RigModel) -> Candidate | None:
        """The candidate with more points, started from a fitted model; None where no more are of use."""
        return self.denser(self, fitted)

    def parameters(self, model: RigModel, known: Sequence[Free] = ()) -> tuple[Free, ...]:
        """What is fitted of it: the current model's parameters (its free ones where `known` is empty) and its own."""
        own = {free.path for free in self.free}
        kept = (free for free in known or base_parameters(model) if free.path not in own and not self._drops(free.path))
        return (*kept, *self.free)

    def _drops(self, path: str) -> bool:
        return any(path == gone or path.startswith(f"{gone}.") for gone in self.dropped)
