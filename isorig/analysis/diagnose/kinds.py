"""The kind of each cause: the second of three levels of naming, between place and form."""

from collections.abc import Mapping
from typing import cast, get_args

from isorig.analysis.diagnose.causes import CATALOGUE
from isorig.analysis.diagnose.causes.base import Kind

#: The catalogued forms of each kind.
FORMS: Mapping[Kind, tuple[str, ...]] = {
    kind: tuple(cause.name for cause in CATALOGUE if cause.kind == kind) for kind in get_args(Kind)
}
#: Kinds with a free shape: it bounds what any law of the kind can explain.
SHAPED: frozenset[Kind] = frozenset(("spring_shape", "damping_shape", "friction_shape", "memory", "drift", "sensor"))
#: Kinds that a force over velocity cannot distinguish: where one is suspected, so is the other.
OVER_VELOCITY = frozenset({"damping_shape", "friction_shape"})
_KIND_OF: dict[str, Kind] = {cause.name: cause.kind for cause in CATALOGUE}


def kind_of(cause: str) -> Kind:
    """The kind of a cause; the name of a kind is its own kind."""
    return _KIND_OF.get(cause, cast("Kind", cause))
