"""A spring that becomes softer."""

from collections.abc import Iterable, Iterator, Mapping
from typing import ClassVar

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Evidence, Sizes
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import BoundedSoftening, Cubic
from isorig.analysis.model.rig_model import RigModel

#: Share of the stiffness that is lost, and deflection at which, as a share of the largest, at the starts.
STARTS = ((0.3, 0.3), (0.6, 0.1), (0.05, 0.4), (0.05, 0.15))
#: Share of the spring's largest force that a cube removes at the starts; from a third on, the force decreases at the end.
CUBES = (0.02, 0.1, 0.25)
#: Largest such share, with which no force is left at the largest deflection, smallest one, and finite difference of a fit.
MOST, LEAST, STEP = 1.0, 1e-5, 1e-4


class SofteningStiffness(LinkCause):
    """A spring whose stiffness decreases with its deflection (a pendulum, a magnetic spring).

    The force is k ((1 - r) d + r s tanh(d / s)), or k d + k3 d^3 with k3 < 0.
    """

    kind = "spring_shape"
    family = "spring"
    rank = 2
    law = BoundedSoftening
    phrase = "a softening spring in the {place}: it loses {softening} of its stiffness beyond {scale}"
    phrases_without: ClassVar[Mapping[tuple[str, ...], str]] = {
        ("softening", "scale"): "a softening spring in the {place}, cubic stiffness {cubic_stiffness}"
    }
    signs = frozenset({"amplitude", "blocked by the lock", "softens"})

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        yield from super().proposed(model, evidence, place)
        link = LinkInRuns(model, evidence, place)
        scale, name = link.cubic_scale, "cubic_stiffness"
        path = f"links.{place}.laws.{len(link.link.laws)}.{name}"
        if not any(isinstance(law, Cubic) for law in link.link.laws):
            yield Candidate(
                cause=self.name, location=place, family=self.family, rank=self.rank,
                starts=tuple(link.having(Cubic(cubic_stiffness=-share * scale)) for share in CUBES),
                free=(Free(path=path, low=-MOST * scale, high=-LEAST * scale, log=False, step=STEP * scale),),
                reported=(Reported(name=name, path=path, unit=Cubic.parameters[name].unit),),
            )  # fmt: skip

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        return (link.having(BoundedSoftening(softening=r, scale=s * link.deflection)) for r, s in STARTS)

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        most = link.deflection
        return Free(path="softening", low=1e-3, high=0.99), Free(path="scale", low=5e-3 * most, high=5.0 * most)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> BoundedSoftening:
        softening = size * sizes.weak_to_strong(0.3, 0.6)
        return BoundedSoftening(softening=softening, scale=sizes.between(0.1, 0.4) * link.deflection)
