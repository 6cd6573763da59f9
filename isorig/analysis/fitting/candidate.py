"""A candidate: a modified model with free parameters, which represents a cause in fits."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from isorig.analysis.fitting.solve import Free, base_parameters
from isorig.analysis.model.rig_model import RigModel


@dataclass(frozen=True, kw_only=True)
class Reported:
    """A reported parameter: its name in the findings, its path in the model, its unit."""

    name: str
    path: str
    unit: str
    value: Callable[[RigModel], float] | None = None

    def of(self, model: RigModel) -> float:
        """The value in a model: at the path, or computed from several parameters."""
        return model.get(self.path) if self.value is None else self.value(model)


@dataclass(frozen=True, kw_only=True)
class Shape:
    """Location of a free shape's curve in the model."""

    #: Abscissa of the curve, its unit, and the unit of the values.
    over: str
    unit: str
    value_unit: str
    path: str  #: Dotted path of the law.
    tables: tuple[str, ...]  #: Names of its values; empty if the law is not a single curve.


def always(model: RigModel) -> bool:
    """Every fit of most causes is plausible."""
    return True


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A cause at a place, as extended models from which fits start.

    Parameters
    ----------
    cause, location
        Names of the findings' catalogue.
    family
        Causes of one family are similar: friction, spring, mass, delay.
    starts
        The extended model at one or more starting values.
    free
        Its new parameters.
    dropped
        Paths of the baseline that the extension replaces.
    reported
        The parameters reported in the findings.
    rank
        Simplicity: of two that fit equally well the lower is kept.
    plausible
        Whether a fitted model is still what the cause's name says.
    twin
        Cause and location with the same equations, so that no data of this rig can distinguish them.
    shape
        For a free shape: location of its curve.
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

    @property
    def key(self) -> tuple[str, str]:
        """Cause and location."""
        return self.cause, self.location

    def parameters(self, model: RigModel, known: Sequence[Free] = ()) -> tuple[Free, ...]:
        """Its fitted parameters: the current model's (the free ones if `known` is empty) and its own."""
        own = {free.path for free in self.free}
        kept = (free for free in known or base_parameters(model) if free.path not in own and not self._drops(free.path))
        return (*kept, *self.free)

    def _drops(self, path: str) -> bool:
        return any(path == gone or path.startswith(f"{gone}.") for gone in self.dropped)
