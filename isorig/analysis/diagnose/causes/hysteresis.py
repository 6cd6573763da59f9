"""Hysteresis without a clear onset of sliding: a rubber mount, a wire rope, a stack of blades."""

from collections.abc import Iterable, Iterator

import msgspec

from isorig.analysis.diagnose.causes.at_link import LinkInRuns, blocked_throughout, rubbed
from isorig.analysis.diagnose.causes.base import (
    Amplitudes,
    Cause,
    Evidence,
    RecordedRuns,
    RigWithCause,
    Sizes,
    exchange,
    sliding_links,
)
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import BoucWen, Coulomb
from isorig.analysis.model.rig_model import Link, RigModel

#: Friction at the starts, as a share of the link's largest force; deflection in which it builds up, as shares of the largest one.
FORCE, GIVES = 0.15, (0.05, 0.3)
#: Sharpness and pinching at the starts. Chosen: between Dahl's loop (1 and 1) and sharp corners with unloading less stiff.
SHARPNESS, PINCHING = 1.5, 0.7


class Hysteresis(Cause):
    """A friction force that builds up gradually over the deflection after every reversal (Bouc-Wen)."""

    kind = "memory"
    family = "memory"
    rank = 4
    generalizes = frozenset({"presliding_friction"})
    phrase = "hysteresis in the {place}: {friction_force} that build up with {initial_stiffness} after every reversal"
    signs = frozenset({"amplitude", "blocked by the lock", "softens"})
    found_as = frozenset({"slip"})

    def places(self, model: RigModel) -> tuple[str, ...]:
        taken = {contact.name for contact in model.contacts if not isinstance(contact.law, Coulomb)}
        return tuple(link.name for link in sliding_links(model) if link.name not in taken)

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        link, path = LinkInRuns(model, evidence, place), f"contacts.{place}.law"
        most, swing = link.largest_force, link.deflection
        laws = (_law(FORCE * most, give * swing) for give in GIVES)
        yield Candidate(
            cause=self.name, location=place, family=self.family, rank=self.rank,
            starts=tuple(_having(model, link.link, law) for law in laws), dropped=(f"{path}.friction_force",),
            free=(
                Free(path=f"{path}.friction_force", low=1e-3 * most, high=1e2 * most),
                Free(path=f"{path}.initial_stiffness", low=1e-2 * most / swing, high=1e4 * most / swing),
                Free(path=f"{path}.sharpness", low=1.0, high=10.0),
                Free(path=f"{path}.pinching", high=1.0, log=False, step=1e-3),
            ),
            reported=tuple(
                Reported(name=name, path=f"{path}.{name}", unit=BoucWen.parameters[name].unit)
                for name in ("friction_force", "initial_stiffness", "sharpness", "pinching")
            ),
        )  # fmt: skip

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        link = LinkInRuns(model, runs, place)
        dry = [c.law.friction_force for c in model.contacts if c.name == place and isinstance(c.law, Coulomb)]
        force = dry[0] if dry and dry[0] > 0.0 else size * sizes.weak_to_strong(0.06, 0.25) * link.largest_force
        law = _law(force, (size if dry else 1.0) * sizes.weak_to_strong(0.05, 0.2) * link.deflection)
        return RigWithCause(
            model=_having(model, link.link, law),
            parameters={"friction_force": force, "initial_stiffness": law.initial_stiffness},
        )

    def not_identifiable(self, model: RigModel, runs: RecordedRuns) -> Iterable[tuple[str, str]]:
        return blocked_throughout(model, runs)


def _law(force: float, give: float) -> BoucWen:
    return BoucWen(friction_force=force, initial_stiffness=force / give, sharpness=SHARPNESS, pinching=PINCHING)


def _having(model: RigModel, link: Link, law: BoucWen) -> RigModel:
    # The law replaces dry friction there.
    if all(contact.name != link.name for contact in model.contacts):
        return rubbed(model, link, law)
    free = tuple(path for path in model.free if not path.startswith(f"contacts.{link.name}."))
    return msgspec.structs.replace(model, contacts=exchange(model.contacts, link.name, law=law), free=free)
