"""Friction that differs by direction."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import ClassVar

from isorig.analysis.diagnose.causes.at_contact import OFFSET, ContactCause, ContactInRuns
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Asymmetric
from isorig.analysis.model.rig_model import RigModel

#: Asymmetry of friction at a start, as a share: where a body sticks most of the time, no small step leads from one sign to the
#: other.
TILT = 0.3
#: The directions, as the law's parameters name them.
WAYS = ("forward", "backward")
#: The conclusion of a report without viscosities.
DRY = "friction at the {place} of {forward_force} forward and {backward_force} backward"


class AsymmetricFriction(ContactCause):
    """A dry or viscous friction level that differs by direction."""

    kind = "friction_shape"
    rank = 3
    law = Asymmetric
    # A constant offset of the drive is equivalent to two dry levels: one of them suffices.
    dropped = (OFFSET,)
    generalizes = frozenset({"coulomb_friction"})
    phrase = f"{DRY}, and damping of {{forward_viscosity}} forward and {{backward_viscosity}} backward"
    phrases_without: ClassVar[Mapping[tuple[str, ...], str]] = {("forward_viscosity", "backward_viscosity"): DRY}
    signs = frozenset({"amplitude", "blocked by the lock", "uneven directions"})

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        damping, viscosities = f"links.{place}.damping", [f"contacts.{place}.law.{way}_viscosity" for way in WAYS]
        for candidate in super().proposed(model, evidence, place):
            if damping in model.free:  # two viscosities contain a damping that is the same in both directions
                values = {damping: 0.0, **dict.fromkeys(viscosities, model.get(damping))}
                starts = tuple(start.replace(values) for start in candidate.starts)
                yield replace(candidate, starts=starts, dropped=(*candidate.dropped, damping))
            else:
                yield candidate

    def starts(self, contact: ContactInRuns) -> Iterable[RigModel]:
        return (contact.having(_law(tilt, contact.likely_friction)) for tilt in (0.0, TILT, -TILT))

    def free(self, contact: ContactInRuns) -> Iterable[Free]:
        force = contact.likely_friction
        viscosity = force / max(contact.speed, 1e-9)
        for way in WAYS:
            yield Free(path=f"{way}_force", low=1e-3 * force, high=20.0 * force)
        for way in WAYS:
            yield Free(path=f"{way}_viscosity", high=1e3 * viscosity, log=False, step=0.02 * viscosity)

    def sized_law(self, contact: ContactInRuns, size: float, sizes: Sizes) -> Asymmetric:
        tilt = sizes.one_of((1.0, -1.0)) * size * sizes.weak_to_strong(0.25, 0.5)
        return _law(tilt, contact.friction)


def _law(tilt: float, force: float) -> Asymmetric:
    return Asymmetric(forward_force=(1.0 + tilt) * force, backward_force=(1.0 - tilt) * force)
