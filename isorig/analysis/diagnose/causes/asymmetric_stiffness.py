"""A spring that is unlike in its two directions."""

from collections.abc import Iterable

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Polynomial
from isorig.analysis.model.rig_model import RigModel

#: Share of the spring's largest force that the square adds, and that the cube adds, at the starts.
STARTS = ((0.1, 0.0), (-0.1, 0.0), (0.3, 0.3), (-0.3, 0.3))
#: Finite differences of a fit, as a share of the spring's largest force.
STEP = 1e-4


class AsymmetricStiffness(LinkCause):
    """A spring that is stiffer in one direction than in the other (a gas spring, a membrane, a weight on a hardening spring).

    The force is k d + k2 d^2 + k3 d^3.
    """

    kind = "spring_shape"
    family = "spring"
    rank = 3
    law = Polynomial
    generalizes = frozenset({"hardening_stiffness"})
    phrase = "an asymmetric spring in the {place}, quadratic stiffness {quadratic_stiffness}, cubic stiffness {cubic_stiffness}"
    signs = frozenset({"amplitude", "blocked by the lock", "uneven directions"})

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        quadratic, cubic = _scales(link)
        for square, cube in STARTS:
            yield link.having(Polynomial(quadratic_stiffness=square * quadratic, cubic_stiffness=cube * cubic))

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        names = ("quadratic_stiffness", "cubic_stiffness")
        for name, scale in zip(names, _scales(link), strict=True):
            yield Free(path=name, low=-1e2 * scale, high=1e2 * scale, log=False, step=STEP * scale)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> Polynomial:
        quadratic, cubic = _scales(link)
        square, cube = sizes.weak_to_strong(0.2, 0.4), sizes.weak_to_strong(0.1, 0.3)
        sign = sizes.one_of((-1.0, 1.0))
        return Polynomial(quadratic_stiffness=sign * size * square * quadratic, cubic_stiffness=size * cube * cubic)


def _scales(link: LinkInRuns) -> tuple[float, float]:
    # Where each term adds as much force as the spring has, N/m^2 and N/m^3.
    return link.stiffness / link.deflection, link.cubic_scale
