"""Friction other than the baseline's: missing dry friction, Stribeck, presliding, direction-dependent level."""

from __future__ import annotations

from typing import ClassVar

import msgspec

from isorig.analysis.diagnose.mechanisms.base import SHARE_OF_PUSH, Evidence, Kind, exchange
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import Asymmetric, Coulomb, Dahl, ElastoSlip, FrictionLaw, Stribeck
from isorig.analysis.model.rig_model import Contact, Link, RigModel


def _moving_links(model: RigModel) -> tuple[Link, ...]:
    """The links with sliding ends: those that some configuration blocks, or all if there is none."""
    blocked = {name for configuration in model.configurations.values() for name in configuration.rigid}
    return tuple(link for link in model.links if link.name in blocked or not blocked)


def _dry(model: RigModel) -> tuple[tuple[Contact, Coulomb], ...]:
    return tuple((c, c.law) for c in model.contacts if isinstance(c.law, Coulomb))


def _exchanged(model: RigModel, contact: Contact, law: FrictionLaw) -> RigModel:
    return msgspec.structs.replace(model, contacts=exchange(model.contacts, contact.name, law=law), free=())


def _rubbing(model: RigModel, link: Link, force: float) -> RigModel:
    contact = Contact(name=link.name, a=link.a, b=link.b, law=Coulomb(friction_force=force))
    return msgspec.structs.replace(model, contacts=(*model.contacts, contact))


def _force(model: RigModel, evidence: Evidence, contact: Contact, law: Coulomb) -> float:
    # A biased fit may have lost the friction: at least a share of the spring's largest force.
    link = next((link for link in model.links if link.name == contact.name), None)
    least = 0.0 if link is None else 0.03 * link.stiffness * evidence.deflection[link.name]
    return max(law.friction_force, least, 1e-6)


class CoulombFriction:
    """Dry friction if the baseline has none."""

    cause: ClassVar[str] = "coulomb_friction"
    kind: ClassVar[Kind] = "friction_shape"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for link in _moving_links(model):
            if any(contact.name == link.name for contact in model.contacts):
                continue
            # While the body sticks, a fit without friction makes the link stiff and damped: the description may be closer.
            ends = (link, evidence.before(link))
            force = min(
                max(end.stiffness * evidence.deflection[link.name], end.damping * evidence.speed[link.name]) for end in ends
            )
            path = f"contacts.{link.name}.law.friction_force"
            # If the baseline has a large error, so have its link forces: the drive bounds the friction.
            levels = [0.02 * force, 0.15 * force, *([SHARE_OF_PUSH * evidence.push] if evidence.push > force else [])]
            recorded = evidence.forces.get(link.name)
            if recorded is not None and recorded.friction > levels[0]:
                levels.append(recorded.friction)
            starts = tuple(_rubbing(model, link, level) for level in levels)
            found.append(
                Candidate(
                    cause=self.cause, location=link.name, family="friction", starts=starts,
                    free=(Free(path=path, low=1e-4 * force, high=3.0 * max(force, evidence.push)),),
                    reported=(Reported(name="friction_force", path=path, unit="N"),), rank=0,
                )
            )  # fmt: skip
        return tuple(found)


class StribeckFriction:
    """Breakaway above sliding friction, decreasing with velocity."""

    cause: ClassVar[str] = "stribeck_friction"
    kind: ClassVar[Kind] = "friction_shape"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for contact, law in _dry(model):
            speed = evidence.speed.get(contact.name, 0.1)
            path = f"contacts.{contact.name}.law"
            force = _force(model, evidence, contact, law)
            starts = tuple(
                _exchanged(
                    model, contact,
                    Stribeck(friction_force=level * force, static_force=breakaway * force, stribeck_velocity=share * speed),
                )
                for level, breakaway in ((0.8, 1.3), (0.98, 1.08))
                for share in (0.02, 0.1)
            )  # fmt: skip
            found.append(
                Candidate(
                    cause=self.cause, location=contact.name, family="friction", starts=starts,
                    free=(
                        Free(path=f"{path}.static_force", low=1e-3 * force, high=20.0 * force),
                        Free(path=f"{path}.stribeck_velocity", low=2e-4 * speed, high=2.0 * speed),
                    ),
                    reported=(
                        Reported(name="static_force", path=f"{path}.static_force", unit="N"),
                        Reported(name="friction_force", path=f"{path}.friction_force", unit="N"),
                        Reported(name="stribeck_velocity", path=f"{path}.stribeck_velocity", unit="m/s"),
                    ),
                    rank=2,
                )
            )  # fmt: skip
        return tuple(found)


class PreslidingFriction:
    """Elastic before it slides (Dahl)."""

    cause: ClassVar[str] = "presliding_friction"
    kind: ClassVar[Kind] = "memory"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for contact, law in _dry(model):
            deflection = evidence.deflection.get(contact.name, 1e-3)
            path = f"contacts.{contact.name}.law.bristle_stiffness"
            force = _force(model, evidence, contact, law)
            starts = tuple(_bristled(model, contact, force, share * deflection) for share in (0.01, 0.05))
            found.append(
                Candidate(
                    cause=self.cause, location=contact.name, family="friction", starts=starts,
                    free=(Free(path=path, low=0.1 * force / deflection, high=3e3 * force / deflection),),
                    reported=(Reported(name="bristle_stiffness", path=path, unit="N/m"),),
                )
            )  # fmt: skip
        return tuple(found)


def _bristled(model: RigModel, contact: Contact, force: float, give: float) -> RigModel:
    return _exchanged(model, contact, Dahl(friction_force=force, bristle_stiffness=force / give))


#: Asymmetry of friction at a start, as a share: where a body sticks most of the time, no small step leads from one sign to the
#: other.
TILT = 0.3


class AsymmetricFriction:
    """Different dry or viscous level in each direction."""

    cause: ClassVar[str] = "asymmetric_friction"
    kind: ClassVar[Kind] = "friction_shape"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for contact, law in _dry(model):
            path = f"contacts.{contact.name}.law"
            force = _force(model, evidence, contact, law)
            speed = max(evidence.speed.get(contact.name, 0.1), 1e-9)
            starts = tuple(
                _exchanged(model, contact, Asymmetric(forward_force=(1.0 + tilt) * force, backward_force=(1.0 - tilt) * force))
                for tilt in (0.0, TILT, -TILT)
            )
            viscosity = force / speed
            found.append(
                Candidate(
                    cause=self.cause, location=contact.name, family="friction", starts=starts,
                    free=(
                        Free(path=f"{path}.forward_force", low=1e-3 * force, high=20.0 * force),
                        Free(path=f"{path}.backward_force", low=1e-3 * force, high=20.0 * force),
                        Free(path=f"{path}.forward_viscosity", high=1e3 * viscosity, log=False, step=0.02 * viscosity),
                        Free(path=f"{path}.backward_viscosity", high=1e3 * viscosity, log=False, step=0.02 * viscosity),
                    ),
                    # A constant offset of the drive is equivalent to two dry levels: one of them suffices.
                    dropped=(f"{path}.friction_force", "drive.chain.offset"),
                    reported=(
                        Reported(name="forward_force", path=f"{path}.forward_force", unit="N"),
                        Reported(name="backward_force", path=f"{path}.backward_force", unit="N"),
                        Reported(name="forward_viscosity", path=f"{path}.forward_viscosity", unit="N s/m"),
                        Reported(name="backward_viscosity", path=f"{path}.backward_viscosity", unit="N s/m"),
                    ),
                    rank=3,
                )
            )  # fmt: skip
        return tuple(found)


class PlayAndFriction:
    """Play, a spring and dry friction in series: at every reversal, first play, then elastic deflection, then sliding."""

    cause: ClassVar[str] = "play_and_friction"
    kind: ClassVar[Kind] = "memory"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for link in _moving_links(model):
            if any(isinstance(law, ElastoSlip) for law in link.laws):
                continue
            law = next((contact.law for contact in model.contacts if contact.name == link.name), None)
            if law is not None and not isinstance(law, Coulomb):
                continue
            swing = evidence.deflection[link.name]
            most = max(link.stiffness * swing, link.damping * evidence.speed[link.name])
            force = law.friction_force if law is not None and law.friction_force > 0.0 else 0.3 * most
            path = f"links.{link.name}.laws.{len(link.laws)}"
            starts = tuple(
                _in_a_row(model, link, times * force, play * swing, 0.2 * swing) for times in (1.0, 5.0) for play in (0.1, 0.4)
            )
            found.append(
                Candidate(
                    cause=self.cause, location=link.name, family="memory", starts=starts,
                    free=(
                        Free(path=f"{path}.clearance", low=1e-4 * swing, high=swing),
                        Free(path=f"{path}.spring_stiffness", low=1e-3 * force / swing, high=1e4 * force / swing),
                        Free(path=f"{path}.slip_force", low=1e-3 * force, high=1e3 * force),
                    ),
                    dropped=(f"contacts.{link.name}",),
                    reported=(
                        Reported(name="clearance", path=f"{path}.clearance", unit="m"),
                        Reported(name="spring_stiffness", path=f"{path}.spring_stiffness", unit="N/m"),
                        Reported(name="friction_force", path=f"{path}.slip_force", unit="N"),
                    ),
                    rank=3,
                )
            )  # fmt: skip
        return tuple(found)


def _in_a_row(model: RigModel, link: Link, force: float, play: float, give: float) -> RigModel:
    row = ElastoSlip(spring_stiffness=force / give, slip_force=force, clearance=play)
    contacts = tuple(contact for contact in model.contacts if contact.name != link.name)
    free = tuple(path for path in model.free if not path.startswith(f"contacts.{link.name}."))
    return msgspec.structs.replace(
        model, links=exchange(model.links, link.name, laws=(*link.laws, row)), contacts=contacts, free=free
    )
