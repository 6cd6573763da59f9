"""What kind of thing each cause is: the second of three levels of naming, between the place and the form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast, get_args

from isorig.analysis.diagnose.mechanisms import CATALOGUE
from isorig.analysis.diagnose.mechanisms.base import Kind

#: The catalogued forms of each kind.
FORMS: Mapping[Kind, tuple[str, ...]] = {
    kind: tuple(mechanism.cause for mechanism in CATALOGUE if mechanism.kind == kind) for kind in get_args(Kind)
}
#: Kinds of which a free shape is fitted: it says how far any law of the kind could get.
SHAPED: frozenset[Kind] = frozenset(("spring_shape", "damping_shape", "friction_shape", "memory", "drift", "sensor"))
_KIND_OF: dict[str, Kind] = {mechanism.cause: mechanism.kind for mechanism in CATALOGUE}


def kind_of(cause: str) -> Kind:
    """The kind of a cause; a kind's own word is its kind."""
    return _KIND_OF.get(cause, cast("Kind", cause))
