"""A spring that becomes softer."""

from collections.abc import Iterable

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import BoundedSoftening
from isorig.analysis.model.rig_model import RigModel

#: Share of the stiffness that is lost, and deflection at which, as a share of the largest, at the starts.
STARTS = ((0.3, 0.3), (0.6, 0.1), (0.05, 0.4), (0.05, 0.15))


class SofteningStiffness(LinkCause):
    """A spring whose stiffness decreases with its deflection.

    The force is k ((1 - r) d + r s tanh(d / s)).
    """

    kind = "spring_shape"
    family = "spring"
    rank = 2
    law = BoundedSoftening
    phrase = "a softening spring in the {place}: it loses {softening} of its stiffness beyond {scale}"
    signs = frozenset({"amplitude", "blocked by the lock", "softens"})

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        return (link.having(BoundedSoftening(softening=r, scale=s * link.deflection)) for r, s in STARTS)

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        most = link.deflection
        return Free(path="softening", low=1e-3, high=0.99), Free(path="scale", low=5e-3 * most, high=5.0 * most)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> BoundedSoftening:
        softening = size * sizes.weak_to_strong(0.3, 0.6)
        return BoundedSoftening(softening=softening, scale=sizes.between(0.1, 0.4) * link.deflection)
