"""A link that relaxes: a spring and a damper in series, parallel to it."""

from collections.abc import Iterable

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns, natural
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Maxwell
from isorig.analysis.model.rig_model import RigModel

#: Relaxation stiffness at a start, as shares of the link's stiffness, and relaxation time, as multiples of 1 / w of the link. Far
#: above w = 1 / T it is a spring and far below it a damper, which the link has already.
STIFFNESSES, TIMES = (0.3, 1.5), (0.3, 1.0, 3.0)
#: Largest multiple of 1 / w: a longer time is a stiffness in every record of some periods.
LONGEST = 300.0


class Relaxation(LinkCause):
    """A spring and a damper in series, parallel to the link (a rubber mount, a hose, a cable).

    The force is k d + c v + f, df/dt = k1 v - f / T.
    """

    kind = "memory"
    family = "memory"
    rank = 2
    law = Maxwell
    phrase = "a force in the {place} that relaxes, {relaxation_stiffness} within {relaxation_time}"

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        omega = natural(link.model, link.link)
        return (
            link.having(Maxwell(relaxation_stiffness=share * link.stiffness, relaxation_time=times / omega))
            for share in STIFFNESSES
            for times in TIMES
        )

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        omega = natural(link.model, link.link)
        return (
            Free(path="relaxation_stiffness", low=1e-3 * link.stiffness, high=1e2 * link.stiffness),
            Free(path="relaxation_time", low=min(0.5 / link.runs.sample_rate, 0.1 / omega), high=LONGEST / omega),
        )

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> Maxwell:
        stiffness = size * sizes.weak_to_strong(0.3, 0.8) * link.stiffness
        time = sizes.between(0.5, 2.0) / natural(link.model, link.link)
        return Maxwell(relaxation_stiffness=stiffness, relaxation_time=time)
