"""A spring that becomes softer, like a pendulum's."""

from collections.abc import Iterable

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Cubic
from isorig.analysis.model.rig_model import RigModel

#: Share of the spring's largest force that the cube removes at the starts; from a third on, the force decreases at the end.
STARTS = (0.02, 0.1, 0.25)
#: Largest such share, and smallest: with one, no force is left at the largest deflection.
MOST, LEAST = 1.0, 1e-5
#: Finite differences of a fit, as such a share.
STEP = 1e-4


class CubicSoftening(LinkCause):
    """A spring whose stiffness decreases with the square of its deflection (a pendulum, a magnetic spring).

    The force is k d + k3 d^3 with k3 < 0.
    """

    kind = "spring_shape"
    family = "spring"
    law = Cubic
    phrase = "a softening spring in the {place}, cubic stiffness {cubic_stiffness}"
    signs = frozenset({"amplitude", "blocked by the lock", "softens"})

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        return (link.having(Cubic(cubic_stiffness=-share * _scale(link))) for share in STARTS)

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        scale = _scale(link)
        return (Free(path="cubic_stiffness", low=-MOST * scale, high=-LEAST * scale, log=False, step=STEP * scale),)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> Cubic:
        return Cubic(cubic_stiffness=-size * sizes.weak_to_strong(0.05, 0.2) * _scale(link))


def _scale(link: LinkInRuns) -> float:
    # Where the cube is as large as the spring's force, N/m^3.
    return link.stiffness / link.deflection**2
