"""A stop at a deflection."""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Literal

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns, blocked_throughout
from isorig.analysis.diagnose.causes.backlash import is_play
from isorig.analysis.diagnose.causes.base import Evidence, RecordedRuns, Sizes, sliding_links
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Backlash as BacklashLaw
from isorig.analysis.laws import EndStop as EndStopLaw
from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.model.rig_model import Link, RigModel
from isorig.analysis.wording import sized

#: Stroke as a share of the largest deflection, and stiffness of the contact as a multiple of the spring's, at the starts: of
#: stops at both ends, and at one.
STARTS, ONE_END = ((0.85, 2.0), (0.6, 3.0), (0.4, 3.0), (0.65, 0.3), (0.5, 0.3)), ((0.6, 3.0), (0.25, 3.0))


class EndStop(LinkCause):
    """A second, stiffer spring beyond a stroke, at both ends or at one; also the end of a rail without a spring."""

    kind = "spring_shape"
    family = "spring"
    rank = 2
    law = EndStopLaw
    sliding = True
    variant = ("end",)
    phrase = "an end stop in the {place} at {stroke}{at_end}, contact stiffness {contact_stiffness}"
    signs = frozenset({"amplitude", "blocked by the lock", "stiffens"})

    def can_be_at(self, model: RigModel, link: Link) -> bool:
        return True  # a rail without a spring ends, too

    def variants(self, link: LinkInRuns, evidence: Evidence) -> Iterable[Iterable[RigModel]]:
        yield self.starts(link, evidence)
        yield (link.having(_stop(link, start, end)) for start in ONE_END for end in (1, -1))

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        return (link.having(_stop(link, start)) for start in STARTS)

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        slight = _slight(link)
        return (
            Free(path="stroke", low=0.05 * link.deflection, high=1.2 * link.deflection),
            Free(path="contact_stiffness", low=1e-2 * _stiffness(link), high=1e4 * _stiffness(link)),
            Free(path="contact_damping", low=1e-3 * slight, high=1e4 * slight, log=False, step=slight),
        )

    def plausible(self, link: LinkInRuns, evidence: Evidence, path: str) -> Callable[[RigModel], bool]:
        return partial(_inside_its_stops, link.name, path, evidence.as_described(link.link).stiffness)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> EndStopLaw:
        stroke = sizes.weak_to_strong(0.75, 0.45) * link.deflection
        stiffness = size * sizes.weak_to_strong(1.5, 5.0) * _stiffness(link)
        return EndStopLaw(stroke=stroke, contact_stiffness=stiffness)

    def not_identifiable(self, model: RigModel, runs: RecordedRuns) -> Iterator[tuple[str, str]]:
        for link in sliding_links(model):
            reach = sized(runs.deflection.get(link.name, 0.0), unit_of(f"links.{link.name}.stroke", model))
            yield link.name, f"The runs deflect it by at most {reach}; a stop beyond that is not identifiable."
        yield from blocked_throughout(model, runs)


def _stop(link: LinkInRuns, start: tuple[float, float], end: Literal[-1, 0, 1] = 0) -> EndStopLaw:
    share, factor = start
    stroke, stiffness = share * link.deflection, factor * _stiffness(link)
    return EndStopLaw(stroke=stroke, contact_stiffness=stiffness, contact_damping=_slight(link), end=end)


def _slight(link: LinkInRuns) -> float:
    # A contact has a little damping; without it there would be another law, with fewer states. N s/m.
    return 1e-3 * _stiffness(link) * link.deflection / max(link.speed, 1e-12)


def _stiffness(link: LinkInRuns) -> float:
    # Of its spring; without one, of the spring on which its mass would move as it does, N/m.
    mass = link.model.constants_of(link.link).mass
    return link.stiffness or mass * (max(link.speed, 1e-12) / max(link.deflection, 1e-12)) ** 2


def _inside_its_stops(link: str, path: str, described: float, model: RigModel) -> bool:
    # Within a play of the link the parts do not touch, so there is no stop; where no spring is described there is no play.
    inside, stroke = model.link(link).stiffness, model.get(f"{path}.stroke")
    plays = [law.clearance for law in model.link(link).laws if isinstance(law, BacklashLaw)]
    beyond = inside + model.get(f"{path}.contact_stiffness")
    return max(plays, default=0.0) < stroke and not (described > 0.0 and is_play(inside, beyond, described))
