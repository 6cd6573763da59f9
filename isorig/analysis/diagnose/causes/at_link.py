"""Causes that are a law on a link."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import sqrt
from typing import ClassVar

import msgspec

from isorig.analysis.diagnose.causes.base import (
    Amplitudes,
    Cause,
    Evidence,
    RecordedRuns,
    RigWithCause,
    Sizes,
    exchange,
    sliding_links,
)  # fmt: skip
from isorig.analysis.fitting.candidate import Candidate, Reported, always
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Coulomb, FrictionLaw, SpringLaw
from isorig.analysis.model.rig_model import Link, RigModel


def natural(model: RigModel, link: Link) -> float:
    """Natural angular frequency in rad/s of the lighter of a link's two bodies on the link alone."""
    return sqrt(link.stiffness / model.constants_of(link).mass)


def added(model: RigModel, link: Link, law: SpringLaw) -> RigModel:
    """The rig with one more law on a link."""
    return msgspec.structs.replace(model, links=exchange(model.links, link.name, laws=(*link.laws, law)))


def rubbed(model: RigModel, link: Link, law: FrictionLaw) -> RigModel:
    """The rig with friction that resists a link's elongation."""
    return msgspec.structs.replace(model, contacts=(*model.contacts, link.rubbing(law)))


@dataclass(frozen=True)
class LinkInRuns:
    """A link with its largest motion: what the sizes of its laws are relative to."""

    model: RigModel
    runs: Amplitudes
    name: str

    @property
    def link(self) -> Link:
        """Its description."""
        return self.model.link(self.name)

    @property
    def stiffness(self) -> float:
        """N/m."""
        return self.link.stiffness

    @property
    def deflection(self) -> float:
        """Largest deflection, m."""
        return self.runs.deflection[self.name]

    @property
    def speed(self) -> float:
        """Largest velocity, m/s."""
        return self.runs.speed[self.name]

    @property
    def largest_force(self) -> float:
        """The spring's or the damper's largest force, whichever is larger, N."""
        return max(self.stiffness * self.deflection, self.link.damping * self.speed, 1e-12)

    @property
    def resistance(self) -> float:
        """Dry friction, or the damper's largest force if that is larger, N."""
        dry = [c.law.friction_force for c in self.model.contacts if c.name == self.name and isinstance(c.law, Coulomb)]
        return max(*dry, self.link.damping * self.speed, 1e-12)

    @property
    def cubic_scale(self) -> float:
        """Where a cube of the largest deflection is as large as the spring's force, N/m^3."""
        return self.stiffness / self.deflection**2

    def having(self, law: SpringLaw) -> RigModel:
        """The rig with one more law on the link."""
        return added(self.model, self.link, law)


class LinkCause(Cause):
    """A cause that is a law on a link, proposed where no such law is yet."""

    law: ClassVar[type[SpringLaw]]
    #: Whether only links with sliding ends can have it.
    sliding: ClassVar[bool] = False
    #: Numbers of the law that are reported besides the free ones: its variants differ in them.
    variant: ClassVar[tuple[str, ...]] = ()
    #: Names in the findings of parameters that differ from those of the law.
    names: ClassVar[Mapping[str, str]] = {}

    def places(self, model: RigModel) -> tuple[str, ...]:
        """The springs without this law."""
        links = (link for link in (sliding_links(model) if self.sliding else model.links) if self.can_be_at(model, link))
        return tuple(link.name for link in links if not any(isinstance(law, self.law) for law in link.laws))

    def can_be_at(self, model: RigModel, link: Link) -> bool:
        """Whether a link without this law can have it."""
        return link.stiffness > 0.0

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        link = LinkInRuns(model, evidence, place)
        path = f"links.{place}.laws.{len(link.link.laws)}"
        free = tuple(replace(one, path=f"{path}.{one.path}") for one in self.free(link))
        names = [*(one.path.removeprefix(f"{path}.") for one in free), *self.variant]
        for starts in self.variants(link, evidence):
            yield Candidate(
                cause=self.name, location=place, family=self.family, rank=self.rank, starts=tuple(starts), free=free,
                dropped=self.dropped(place), plausible=self.plausible(link, evidence, path),
                reported=tuple(
                    Reported(name=self.names.get(name, name), path=f"{path}.{name}", unit=self.law.parameters[name].unit)
                    if name not in self.variant
                    else Reported(name=name, path=f"{path}.{name}", unit="1")
                    for name in names
                ),
            )  # fmt: skip

    def variants(self, link: LinkInRuns, evidence: Evidence) -> Iterable[Iterable[RigModel]]:
        """The starting points of each variant of the law: variants differ in what no fit changes."""
        yield self.starts(link, evidence)

    def starts(self, link: LinkInRuns, evidence: Evidence) -> Iterable[RigModel]:
        """The rig with the law at one or more starting values."""
        raise NotImplementedError(f"{type(self).__name__} has no starting values; implement starts")

    def free(self, link: LinkInRuns) -> Iterable[Free]:
        """The law's free parameters, each with its name as the path."""
        raise NotImplementedError(f"{type(self).__name__} has no free parameters; implement free")

    def sized_law(self, link: LinkInRuns, size: float, sizes: Sizes) -> SpringLaw:
        """The law at a relative size."""
        raise NotImplementedError(f"{type(self).__name__} has no size; implement sized_law")

    def installed(self, link: LinkInRuns, law: SpringLaw) -> RigModel:
        """The rig with the law."""
        return link.having(law)

    def dropped(self, place: str) -> tuple[str, ...]:
        """Paths of the baseline that the law replaces."""
        return ()

    def plausible(self, link: LinkInRuns, evidence: Evidence, path: str) -> Callable[[RigModel], bool]:
        """Whether a fitted model, with the law at a path, is still what the cause's name says."""
        return always

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        link = LinkInRuns(model, runs, place)
        law = self.sized_law(link, size, sizes)
        values = {self.names.get(name, name): getattr(law, name) for name in (free.path for free in self.free(link))}
        return RigWithCause(model=self.installed(link, law), parameters=values)

    def not_identifiable(self, model: RigModel, runs: RecordedRuns) -> Iterable[tuple[str, str]]:
        return blocked_throughout(model, runs) if self.kind == "spring_shape" else ()


def blocked_throughout(model: RigModel, runs: RecordedRuns) -> Iterator[tuple[str, str]]:
    """The sliding links that every run blocks, with the reason why nothing there is identifiable."""
    for link in sliding_links(model):
        if all(link.name in model.configurations[name].rigid for name in runs.configurations):
            yield link.name, "It is blocked in all runs; record one in a configuration that does not block it."
