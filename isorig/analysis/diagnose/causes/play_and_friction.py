"""Play with friction after it."""

from collections.abc import Iterable, Mapping
from typing import ClassVar

import msgspec

from isorig.analysis.diagnose.causes.at_link import LinkCause, LinkInRuns
from isorig.analysis.diagnose.causes.base import Amplitudes, Evidence, RigWithCause, Sizes
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Coulomb, ElastoSlip, SpringLaw
from isorig.analysis.model.rig_model import Link, RigModel

#: Slip force as multiples of the friction, and play as shares of the largest deflection, at the starts; elastic deflection before
#: it slips, as such a share.
FORCES, PLAYS, GIVE = (1.0, 5.0), (0.1, 0.4), 0.2
#: Friction if unknown, as a share of the link's largest force.
UNKNOWN = 0.3


class PlayAndFriction(LinkCause):
    """A clearance, a spring and dry friction in series.

    At every reversal, first play, then elastic deflection, then sliding.
    """

    kind = "memory"
    family = "memory"
    rank = 3
    law = ElastoSlip
    sliding = True
    names: ClassVar[Mapping[str, str]] = {"slip_force": "friction_force"}
    found_as = frozenset({"slip"})
    phrase = "play of {play} with friction of {friction_force} behind it in the {place}"
    phrases_without: ClassVar[Mapping[tuple[str, ...], str]] = {
        ("clearance",): "friction of {friction_force} behind a spring of {spring_stiffness} in the {place}"
    }

    def can_be_at(self, model: RigModel, link: Link) -> bool:
        return all(isinstance(contact.law, Coulomb) for contact in model.contacts if contact.name == link.name)

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        force, swing = _force(link), link.deflection
        laws = (
            ElastoSlip(spring_stiffness=times * force / (GIVE * swing), slip_force=times * force, clearance=play * swing)
            for times in FORCES
            for play in PLAYS
        )
        return (self.installed(link, law) for law in laws)

    def installed(self, link: LinkInRuns, law: SpringLaw) -> RigModel:
        """The law replaces the contact."""
        model = link.having(law)
        return msgspec.structs.replace(
            model, contacts=tuple(contact for contact in model.contacts if contact.name != link.name),
            free=tuple(path for path in model.free if not path.startswith(f"contacts.{link.name}.")),
        )  # fmt: skip

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        force, swing = _force(link), link.deflection
        return (
            Free(path="clearance", low=1e-4 * swing, high=swing),
            Free(path="spring_stiffness", low=1e-3 * force / swing, high=1e4 * force / swing),
            Free(path="slip_force", low=1e-3 * force, high=1e3 * force),
        )

    def dropped(self, place: str) -> tuple[str, ...]:
        return (f"contacts.{place}",)

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> ElastoSlip:
        force, swing = _force(link), link.deflection
        give = sizes.between(0.05, 0.3) * swing
        return ElastoSlip(
            spring_stiffness=force / give, slip_force=force, clearance=size * sizes.weak_to_strong(0.06, 0.2) * swing
        )

    def smallest(self, model: RigModel, runs: Amplitudes, place: str) -> Iterable[RigWithCause]:
        """None: the smallest one is a small clearance, which proposals assume as `Backlash`."""
        return ()


def _force(link: LinkInRuns) -> float:
    # Friction of the contact there, N.
    known = next((c.law.friction_force for c in link.model.contacts if c.name == link.name and isinstance(c.law, Coulomb)), 0.0)
    return known or UNKNOWN * link.largest_force
