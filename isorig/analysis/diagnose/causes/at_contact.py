"""Causes that replace the dry friction of a contact by another law."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import msgspec

from isorig.analysis.diagnose.causes.at_link import blocked_throughout
from isorig.analysis.diagnose.causes.base import Amplitudes, Cause, Evidence, RecordedRuns, RigWithCause, Sizes, exchange
from isorig.analysis.fitting.candidate import Candidate, Reported, always
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import ContactLaw, Coulomb
from isorig.analysis.model.rig_model import RigModel

#: Least friction at a start, as a share of the spring's largest force: a biased fit may have lost it.
LEAST = 0.03
#: Deflection in m and velocity in m/s of a contact without a link, for starting values.
DEFLECTION, SPEED = 1e-3, 0.1
#: A constant force, as friction of two levels has it: half their difference.
OFFSET = "drive.chain.offset"


@dataclass(frozen=True)
class ContactInRuns:
    """A contact with dry friction, with its largest motion: what the sizes of its laws are relative to."""

    model: RigModel
    runs: Amplitudes
    name: str

    @property
    def friction(self) -> float:
        """N."""
        law = self.model.contact(self.name).law
        return max(law.friction_force if isinstance(law, Coulomb) else 0.0, 1e-12)

    @property
    def likely_friction(self) -> float:
        """The same, or a share of the spring's largest force if that is larger, N."""
        link = next((link for link in self.model.links if link.name == self.name), None)
        return max(self.friction, 0.0 if link is None else LEAST * link.stiffness * self.deflection, 1e-6)

    @property
    def deflection(self) -> float:
        """Largest deflection, m."""
        return self.runs.deflection.get(self.name, DEFLECTION)

    @property
    def speed(self) -> float:
        """Largest velocity, m/s."""
        return self.runs.speed.get(self.name, SPEED)

    def having(self, law: ContactLaw) -> RigModel:
        """The rig with another law there."""
        return msgspec.structs.replace(self.model, contacts=exchange(self.model.contacts, self.name, law=law), free=())


class ContactCause(Cause):
    """A cause that is another law at a contact with dry friction."""

    family = "friction"
    law: ClassVar[type[ContactLaw]]
    #: The reported parameters; the free ones if there are none.
    reports: ClassVar[tuple[str, ...]] = ()
    #: Parameters of the baseline that the law makes superfluous, besides the old law's.
    dropped: ClassVar[tuple[str, ...]] = ()

    def places(self, model: RigModel) -> tuple[str, ...]:
        """The contacts with dry friction."""
        return tuple(contact.name for contact in model.contacts if isinstance(contact.law, Coulomb))

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        contact, path = ContactInRuns(model, evidence, place), f"contacts.{place}.law"
        free = tuple(self.free(contact))
        # What the law makes superfluous may have absorbed a part of it.
        given = {other: evidence.described.get(other) for other in self.dropped}
        names = self.reports or tuple(one.path for one in free)
        for starts in self.variants(contact):
            yield Candidate(
                cause=self.name, location=place, family=self.family, rank=self.rank,
                starts=tuple(start.replace(given) for start in starts),
                free=tuple(replace(one, path=f"{path}.{one.path}") for one in free),
                dropped=(f"{path}.friction_force", *self.dropped) if self.dropped else (), plausible=self.plausible(path),
                reported=tuple(Reported(name=name, path=f"{path}.{name}", unit=self.law.parameters[name].unit) for name in names),
            )  # fmt: skip

    def plausible(self, path: str) -> Callable[[RigModel], bool]:
        """Whether a fitted model, with the law at a path, is still what the cause's name says."""
        return always

    def variants(self, contact: ContactInRuns) -> Iterable[Iterable[RigModel]]:
        """The starting points of each variant of the law: variants differ in what no fit changes."""
        yield self.starts(contact)

    def starts(self, contact: ContactInRuns) -> Iterable[RigModel]:
        """The rig with the law at one or more starting values."""
        raise NotImplementedError(f"{type(self).__name__} has no starting values; implement starts")

    def free(self, contact: ContactInRuns) -> Iterable[Free]:
        """The law's free parameters, each with its name as the path."""
        raise NotImplementedError(f"{type(self).__name__} has no free parameters; implement free")

    def sized_law(self, contact: ContactInRuns, size: float, sizes: Sizes) -> ContactLaw:
        """The law at a relative size."""
        raise NotImplementedError(f"{type(self).__name__} has no size; implement sized_law")

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        contact = ContactInRuns(model, runs, place)
        law = self.sized_law(contact, size, sizes)
        names = self.reports or tuple(one.path for one in self.free(contact))
        return RigWithCause(model=contact.having(law), parameters={name: getattr(law, name) for name in names})

    def not_identifiable(self, model: RigModel, runs: RecordedRuns) -> Iterable[tuple[str, str]]:
        return blocked_throughout(model, runs) if self.kind == "friction_shape" else ()
