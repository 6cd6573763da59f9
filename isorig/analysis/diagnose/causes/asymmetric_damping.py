"""A damper that is unlike in its two directions."""

from collections.abc import Callable, Iterable

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import AsymmetricDamping as AsymmetricDampingLaw
from isorig.analysis.model.rig_model import Link, RigModel

#: Difference of each direction from the damping, as a share of it, at the starts.
STARTS = (0.3, -0.3)
#: Finite difference of a fit, as a share of the damping.
STEP = 1e-4
#: Largest difference of each direction from the damping, as a share of it. Derived: beyond, a damper would push; with a margin
#: for uncertain values.
MOST = 1.05


class AsymmetricDamping(LinkCause):
    """A damper that is stiffer in extension than in compression, or the reverse (a shock absorber).

    The force is c v + a |v|.
    """

    kind = "damping_shape"
    family = "damping"
    law = AsymmetricDampingLaw
    phrase = "a damper in the {place} with {damping_difference} more in extension, and as much less in compression"
    signs = frozenset({"independent of amplitude", "uneven directions"})

    def can_be_at(self, model: RigModel, link: Link) -> bool:
        # Where dry friction acts, asymmetric friction has a viscosity for each direction.
        return link.damping > 0.0 and all(contact.name != link.name for contact in model.contacts)

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        return (link.having(AsymmetricDampingLaw(damping_difference=share * link.link.damping)) for share in STARTS)

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        damping = link.link.damping
        return (Free(path="damping_difference", low=-1e2 * damping, high=1e2 * damping, log=False, step=STEP * damping),)

    def plausible(self, link: LinkInRuns, evidence: Evidence, path: str) -> Callable[[RigModel], bool]:
        def damps(fitted: RigModel) -> bool:
            return abs(fitted.get(f"{path}.damping_difference")) <= MOST * fitted.link(link.name).damping

        return damps

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> AsymmetricDampingLaw:
        share = min(size * sizes.weak_to_strong(0.3, 0.8), 1.0)
        return AsymmetricDampingLaw(damping_difference=sizes.one_of((1.0, -1.0)) * share * link.link.damping)
