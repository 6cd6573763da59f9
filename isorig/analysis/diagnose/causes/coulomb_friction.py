"""Dry friction where the baseline has none."""

from collections.abc import Iterable, Iterator

from isorig.analysis.diagnose.causes.at_link import LinkInRuns, blocked_throughout, rubbed
from isorig.analysis.diagnose.causes.base import Amplitudes, Cause, Evidence, RecordedRuns, RigWithCause, Sizes, sliding_links
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Coulomb
from isorig.analysis.model.rig_model import RigModel

#: Friction if unknown, as a share of the largest force of the drive: a starting value for fits.
SHARE_OF_PUSH = 0.2


class CoulombFriction(Cause):
    """Dry friction with a constant level, where the baseline has none."""

    kind = "friction_shape"
    family = "friction"
    rank = 0
    phrase = "dry friction of {friction_force} at the {place}"
    signs = frozenset({"amplitude", "blocked by the lock"})
    # Slip elements that give little imitate it, and where a body often rests they follow its force better.
    found_as = frozenset({"slip"})

    def places(self, model: RigModel) -> tuple[str, ...]:
        taken = {contact.name for contact in model.contacts}
        return tuple(link.name for link in sliding_links(model) if link.name not in taken)

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        link = model.link(place)
        # While the body sticks, a fit without friction makes the link stiff and damped: the description may be closer.
        force = min(
            max(end.stiffness * evidence.deflection[place], end.damping * evidence.speed[place])
            for end in (link, evidence.before(link))
        )
        # If the baseline has a large error, so have its link forces: the drive bounds the friction.
        levels = [0.02 * force, 0.15 * force, *([SHARE_OF_PUSH * evidence.push] if evidence.push > force else [])]
        recorded = evidence.forces.get(place)
        if recorded is not None and recorded.friction > levels[0]:
            levels.append(recorded.friction)
        path = f"contacts.{place}.law.friction_force"
        yield Candidate(
            cause=self.name, location=place, family=self.family, rank=self.rank,
            starts=tuple(rubbed(model, link, Coulomb(friction_force=level)) for level in levels),
            free=(Free(path=path, low=1e-4 * force, high=3.0 * max(force, evidence.push)),),
            reported=(Reported(name="friction_force", path=path, unit="N"),),
        )  # fmt: skip

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        link = LinkInRuns(model, runs, place)
        force = size * sizes.weak_to_strong(0.06, 0.3) * link.largest_force
        return RigWithCause(model=rubbed(model, link.link, Coulomb(friction_force=force)), parameters={"friction_force": force})

    def not_identifiable(self, model: RigModel, runs: RecordedRuns) -> Iterable[tuple[str, str]]:
        return blocked_throughout(model, runs)
