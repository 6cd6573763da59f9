"""Friction that is elastic before it slides."""

from collections.abc import Iterable

from isorig.analysis.diagnose.causes.at_contact import ContactCause, ContactInRuns
from isorig.analysis.diagnose.causes.base import Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Dahl
from isorig.analysis.model.rig_model import RigModel


class PreslidingFriction(ContactCause):
    """Friction that is elastic before it slides (Dahl)."""

    kind = "memory"
    law = Dahl
    phrase = "friction at the {place} that is elastic before it slides, with {bristle_stiffness}"
    signs = frozenset({"amplitude", "blocked by the lock", "softens", "less at low and high velocity"})
    found_as = frozenset({"slip"})

    def starts(self, contact: ContactInRuns) -> Iterable[RigModel]:
        force = contact.likely_friction
        for share in (0.01, 0.05):
            yield contact.having(Dahl(friction_force=force, bristle_stiffness=force / (share * contact.deflection)))

    def free(self, contact: ContactInRuns) -> Iterable[Free]:
        force, swing = contact.likely_friction, contact.deflection
        return (Free(path="bristle_stiffness", low=0.1 * force / swing, high=3e3 * force / swing),)

    def sized_law(self, contact: ContactInRuns, size: float, sizes: Sizes) -> Dahl:
        give = size * sizes.weak_to_strong(0.03, 0.1) * contact.deflection
        return Dahl(friction_force=contact.friction, bristle_stiffness=contact.friction / give)
