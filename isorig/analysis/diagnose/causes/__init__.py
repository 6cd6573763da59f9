"""The catalogue of causes: one file for each, with all that the program knows of it (`base.Cause`)."""

import re
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pkgutil import iter_modules

import msgspec

from isorig.analysis.diagnose.causes.base import Cause, Evidence, SignKind
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import RigModel

_FILES = [import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__)]

#: Every class of this package's files that states its kind.
CATALOGUE: tuple[Cause, ...] = tuple(
    value()
    for file in _FILES
    for value in vars(file).values()
    if isinstance(value, type) and value.__module__ == file.__name__ and issubclass(value, Cause) and "kind" in vars(value)
)
#: The causes by what the equations of motion of the records call them.
FOUND_AS: Mapping[str, frozenset[str]] = {
    what: frozenset(cause.name for cause in CATALOGUE if what in cause.found_as)
    for what in sorted({what for cause in CATALOGUE for what in cause.found_as})
}
#: The simpler causes that each cause contains.
GENERALIZED: Mapping[str, frozenset[str]] = {cause.name: cause.generalizes for cause in CATALOGUE}


def contains(key: tuple[str, str], simpler: tuple[str, str]) -> bool:
    """Whether a more general form at a place contains a simpler one: data that this explains cannot exclude it."""
    return key[1] == simpler[1] and simpler[0] in GENERALIZED.get(key[0], ())


def proposed(model: RigModel, evidence: Evidence) -> Iterator[Candidate]:
    """The candidates of all causes for a model with this evidence."""
    return (candidate for cause in CATALOGUE for candidate in cause.candidates(model, evidence))


def containing(
    simple: Candidate, start: RigModel, free: Sequence[Free], evidence: Evidence
) -> Iterator[tuple[Candidate, tuple[Free, ...]]]:  # fmt: skip
    """The forms that contain a simple one at its place, and their fitted parameters; a model with its law is their start.

    They take the place of its law: a rig without friction has no Stribeck friction before it has some.
    """
    model = msgspec.structs.replace(start, free=tuple(each.path for each in free))
    for cause in CATALOGUE:
        if simple.cause in cause.generalizes:
            forms = (form for form in cause.candidates(model, evidence) if form.location == simple.location)
            yield from ((form, form.parameters(model, free)) for form in forms)


def same_form(candidate: Candidate, model: RigModel, evidence: Evidence) -> Iterator[Candidate]:
    """The candidates for a model with the cause, place and free parameters of one for another model: its variants, too.

    The place of their law in the list of a link's laws may differ.
    """
    own = (c for cause in CATALOGUE if cause.name == candidate.cause for c in cause.candidates(model, evidence))
    return (c for c in own if c.key == candidate.key and _parameters(c) == _parameters(candidate))


def _parameters(candidate: Candidate) -> list[str]:
    # The paths of its free parameters, without the places of laws in the lists of the links' laws.
    return [re.sub(r"\.laws\.\d+\.", ".laws.", free.path) for free in candidate.free]


def supported(sign: SignKind, *places: str) -> tuple[tuple[str, str], ...]:
    """The causes that a sign in the records supports, each at these places (at an unknown one, "", if there are none)."""
    return tuple((cause.name, place) for cause in CATALOGUE if sign in cause.signs for place in places or ("",))
