"""Damping that grows with the velocity."""

from collections.abc import Iterable

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import QuadraticDamping as QuadraticDampingLaw
from isorig.analysis.model.rig_model import Link, RigModel, damps


class QuadraticDamping(LinkCause):
    """A damping force that grows with the square of the velocity.

    The force is c v + q v |v|.
    """

    kind = "damping_shape"
    family = "damping"
    law = QuadraticDampingLaw
    sliding = True
    phrase = "damping in the {place} that grows with the square of the velocity, {quadratic_damping}"
    signs = frozenset({"amplitude", "blocked by the lock", "more at low and high velocity"})

    def can_be_at(self, model: RigModel, link: Link) -> bool:
        return (link.stiffness > 0.0 or link.damping > 0.0) and damps(model, link)

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        return (link.having(QuadraticDampingLaw(quadratic_damping=share * _scale(link))) for share in (0.3, 2.0))

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        return (Free(path="quadratic_damping", low=1e-4 * _scale(link), high=1e4 * _scale(link)),)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> QuadraticDampingLaw:
        share = size * sizes.weak_to_strong(0.5, 2.0)
        return QuadraticDampingLaw(quadratic_damping=share * link.resistance / link.speed**2)


def _scale(link: LinkInRuns) -> float:
    # Where it is as large as the viscous damping, N s^2/m^2.
    return max(link.link.damping, 1e-9) / link.speed
