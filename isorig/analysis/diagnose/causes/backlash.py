"""Play in a link."""

from collections.abc import Callable, Iterable
from functools import partial
from math import asin, pi, sqrt

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Backlash as BacklashLaw
from isorig.analysis.model.rig_model import RigModel

#: A typical amplitude as a share of the largest deflection.
TYPICAL_SWING = 0.35
#: With more than this share of the spring remaining inside, a play is a spring with stops.
INSIDE = 0.25


class Backlash(LinkCause):
    """A spring that acts only beyond a clearance."""

    kind = "spring_shape"
    family = "spring"
    law = BacklashLaw
    sliding = True
    phrase = "play of {play} in the {place} ({clearance_alone} either way)"
    signs = frozenset({"amplitude", "blocked by the lock", "stiffens"})

    def variants(self, link: LinkInRuns, evidence: Evidence) -> Iterable[Iterable[RigModel]]:
        """The link's damper joins the same parts, or what damps is the contact."""
        for damped in (1.0, 0.0) if link.link.damping > 0.0 else (1.0,):
            yield self.starts(link, evidence, damped)

    def starts(self, link: LinkInRuns, evidence: Evidence, damped: float = 1.0) -> Iterable[RigModel]:
        # Of a spring that is seldom reached, beyond a large play, the fit shows nothing.
        stiffnesses = {
            **{share: link.stiffness / _seen_through(share) for share in (0.008, 0.03, 0.12, 0.2)},
            **dict.fromkeys((0.5, 0.8), evidence.before(link.link).stiffness),
        }
        for share, stiffness in stiffnesses.items():
            law = BacklashLaw(clearance=share * link.deflection, residual=0.05, damped=damped)
            yield link.having(law).replace({f"links.{link.name}.stiffness": stiffness})

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        return (
            Free(path="clearance", low=1e-4 * link.deflection, high=0.9 * link.deflection),
            Free(path="residual", low=0.0, high=INSIDE, log=False, step=0.01),
        )

    def plausible(self, link: LinkInRuns, evidence: Evidence, path: str) -> Callable[[RigModel], bool]:
        return partial(_beyond_its_play, link.name, path, evidence.as_described(link.link).stiffness)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> BacklashLaw:
        clearance = size * sizes.weak_to_strong(0.06, 0.2) * link.deflection
        return BacklashLaw(clearance=clearance, residual=sizes.between(0.0, 0.06))


def is_play(inside: float, beyond: float, described: float) -> bool:
    """Whether a weaker spring inside and a stiffer one beyond a clearance are play: else they are a spring with stops.

    Both have the same equations where the spring inside is weak; the described spring is the one beyond the play (all in N/m).
    """
    return inside <= INSIDE * beyond and (inside <= 0.0 or described**2 >= inside * beyond)


def _beyond_its_play(link: str, path: str, described: float, model: RigModel) -> bool:
    beyond = model.link(link).stiffness
    return is_play(model.get(f"{path}.residual") * beyond, beyond, described)


def _seen_through(share: float) -> float:
    # The fitted spring is the describing function of the play at a typical swing: this share of the spring beyond the play.
    ratio = share / TYPICAL_SWING
    return 1.0 - 2.0 / pi * (asin(ratio) + ratio * sqrt(1.0 - ratio**2))
