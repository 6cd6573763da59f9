"""A spring with another stiffness in each direction."""

from collections.abc import Callable, Iterable

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Bilinear
from isorig.analysis.model.rig_model import RigModel

#: Difference of each direction from the stiffness, as a share of it, at the starts.
STARTS = (0.15, -0.15)
#: Finite difference of a fit, as a share of the stiffness.
STEP = 1e-4


class BilinearStiffness(LinkCause):
    """A spring with another stiffness in each direction from its rest on (a crack that closes, a contact that lifts).

    The force is k d + s |d|.
    """

    kind = "spring_shape"
    family = "spring"
    law = Bilinear
    phrase = "a spring in the {place} with {stiffness_difference} more in extension, and as much less in compression"
    signs = frozenset({"independent of amplitude", "blocked by the lock", "uneven directions"})

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        return (link.having(Bilinear(stiffness_difference=share * link.stiffness)) for share in STARTS)

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        k = link.stiffness
        return (Free(path="stiffness_difference", low=-1e2 * k, high=1e2 * k, log=False, step=STEP * k),)

    def plausible(self, link: LinkInRuns, evidence: Evidence, path: str) -> Callable[[RigModel], bool]:
        def pulls_back(fitted: RigModel) -> bool:
            return abs(fitted.get(f"{path}.stiffness_difference")) < fitted.link(link.name).stiffness

        return pulls_back

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> Bilinear:
        share = min(size * sizes.weak_to_strong(0.1, 0.3), 0.9)
        return Bilinear(stiffness_difference=sizes.one_of((1.0, -1.0)) * share * link.stiffness)
