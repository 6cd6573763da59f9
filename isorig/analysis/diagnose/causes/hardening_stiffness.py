"""A spring that becomes stiffer."""

from collections.abc import Iterable

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Cubic
from isorig.analysis.model.rig_model import RigModel


class HardeningStiffness(LinkCause):
    """A spring whose stiffness increases with the square of its deflection.

    The force is k d + k3 d^3 with k3 > 0.
    """

    kind = "spring_shape"
    family = "spring"
    law = Cubic
    phrase = "a hardening spring in the {place}, cubic stiffness {cubic_stiffness}"
    signs = frozenset({"amplitude", "blocked by the lock", "stiffens"})

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        return (link.having(Cubic(cubic_stiffness=share * link.cubic_scale)) for share in (0.05, 0.6, 6.0))

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        return (Free(path="cubic_stiffness", low=1e-5 * link.cubic_scale, high=1e3 * link.cubic_scale),)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> Cubic:
        return Cubic(cubic_stiffness=size * sizes.weak_to_strong(0.3, 1.0) * link.cubic_scale)
