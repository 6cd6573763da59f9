"""The kind of each cause: the second of three levels of naming, between place and form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast, get_args

from isorig.analysis.diagnose.mechanisms import CATALOGUE
from isorig.analysis.diagnose.mechanisms.base import Kind

#: The catalogued forms of each kind.
FORMS: Mapping[Kind, tuple[str, ...]] = {
    kind: tuple(mechanism.cause for mechanism in CATALOGUE if mechanism.kind == kind) for kind in get_args(Kind)
}
#: Kinds with a free shape: it bounds what any law of the kind can explain.
SHAPED: frozenset[Kind] = frozenset(("spring_shape", "damping_shape", "friction_shape", "memory", "drift", "sensor"))
_KIND_OF: dict[str, Kind] = {mechanism.cause: mechanism.kind for mechanism in CATALOGUE}


def kind_of(cause: str) -> Kind:
    """The kind of a cause; the name of a kind is its own kind."""
    return _KIND_OF.get(cause, cast("Kind", cause))
