"""Links that are not a constant linear spring and damper."""

from __future__ import annotations

from functools import partial
from math import asin, log, pi, sqrt
from typing import ClassVar

import msgspec

from isorig.analysis import laws
from isorig.analysis.diagnose.mechanisms.base import Evidence, Kind, exchange
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.laws import LinkLaw
from isorig.analysis.model.rig_model import Link, RigModel


def added(model: RigModel, link: Link, law: LinkLaw) -> RigModel:
    """The rig with one more law on a link."""
    return msgspec.structs.replace(model, links=exchange(model.links, link.name, laws=(*link.laws, law)))


def _path(link: Link, key: str) -> str:
    return f"links.{link.name}.laws.{len(link.laws)}.{key}"


def _springs(model: RigModel, law: type) -> tuple[Link, ...]:
    # A law that exists already is not proposed again.
    return tuple(link for link in model.links if link.stiffness > 0.0 and not any(isinstance(old, law) for old in link.laws))


def _sliding(model: RigModel, law: type) -> tuple[Link, ...]:
    # Play, stops and drag are proposed for the link that a configuration blocks, or for any link of a rig without a lock.
    blocked = {name for configuration in model.configurations.values() for name in configuration.rigid}
    return tuple(link for link in _springs(model, law) if link.name in blocked or not blocked)


def _cubic(model: RigModel, evidence: Evidence, link: Link, share: float) -> RigModel:
    return added(model, link, laws.Cubic(cubic_stiffness=share * link.stiffness / evidence.deflection[link.name] ** 2))


class HardeningStiffness:
    """k d + k3 d^3, k3 > 0."""

    cause: ClassVar[str] = "hardening_stiffness"
    kind: ClassVar[Kind] = "spring_shape"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for link in _springs(model, laws.Cubic):
            scale = link.stiffness / evidence.deflection[link.name] ** 2
            path = _path(link, "cubic_stiffness")
            found.append(
                Candidate(
                    cause=self.cause, location=link.name, family="spring",
                    starts=tuple(_cubic(model, evidence, link, share) for share in (0.05, 0.6, 6.0)),
                    free=(Free(path=path, low=1e-5 * scale, high=1e3 * scale),),
                    reported=(Reported(name="cubic_stiffness", path=path, unit="N/m^3"),),
                )
            )  # fmt: skip
        return tuple(found)


class SofteningStiffness:
    """k ((1 - r) d + r s tanh(d / s))."""

    cause: ClassVar[str] = "softening_stiffness"
    kind: ClassVar[Kind] = "spring_shape"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for link in _springs(model, laws.BoundedSoftening):
            deflection = evidence.deflection[link.name]
            share, scale = _path(link, "softening"), _path(link, "scale")
            starts = tuple(
                added(model, link, laws.BoundedSoftening(softening=r, scale=s * deflection))
                for r, s in ((0.3, 0.3), (0.6, 0.1), (0.05, 0.4), (0.05, 0.15))
            )
            found.append(
                Candidate(
                    cause=self.cause, location=link.name, family="spring", starts=starts,
                    free=(
                        Free(path=share, low=1e-3, high=0.99),
                        Free(path=scale, low=5e-3 * deflection, high=5.0 * deflection),
                    ),
                    reported=(
                        Reported(name="softening", path=share, unit="1"),
                        Reported(name="scale", path=scale, unit="m"),
                    ),
                    rank=2,
                )
            )  # fmt: skip
        return tuple(found)


class Backlash:
    """The spring acts (almost) only beyond a clearance."""

    cause: ClassVar[str] = "backlash"
    kind: ClassVar[Kind] = "spring_shape"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for link in _sliding(model, laws.Backlash):
            deflection = evidence.deflection[link.name]
            clearance, residual = _path(link, "clearance"), _path(link, "residual")
            # Of a spring that is seldom reached, beyond a large play, the fit shows nothing.
            stiffnesses = {
                **{share: link.stiffness / _seen_through(share) for share in (0.008, 0.03, 0.12, 0.2)},
                **dict.fromkeys((0.5, 0.8), evidence.before(link).stiffness),
            }
            starts = tuple(_with_play(model, link, share * deflection, k) for share, k in stiffnesses.items())
            found.append(
                Candidate(
                    cause=self.cause, location=link.name, family="spring", starts=starts,
                    free=(
                        Free(path=clearance, low=1e-4 * deflection, high=0.9 * deflection),
                        Free(path=residual, low=0.0, high=INSIDE, log=False, step=0.01),
                    ),
                    reported=(
                        Reported(name="clearance", path=clearance, unit="m"),
                        Reported(name="residual", path=residual, unit="1"),
                    ),
                )
            )  # fmt: skip
        return tuple(found)


def _with_play(model: RigModel, link: Link, clearance: float, stiffness: float) -> RigModel:
    other = model.replace({f"links.{link.name}.stiffness": stiffness})
    return added(other, other.link(link.name), laws.Backlash(clearance=clearance, residual=0.05))


def _seen_through(share: float) -> float:
    # The fitted spring is the describing function of the play at a typical swing: this share of the spring beyond the play.
    ratio = share / TYPICAL_SWING
    return 1.0 - 2.0 / pi * (asin(ratio) + ratio * sqrt(1.0 - ratio**2))


#: A typical amplitude as a share of the largest deflection.
TYPICAL_SWING = 0.35
#: With more than this share of the spring remaining inside, a play is a spring with stops.
INSIDE = 0.25


class EndStop:
    """A second, stiffer spring beyond a deflection."""

    cause: ClassVar[str] = "end_stop"
    kind: ClassVar[Kind] = "spring_shape"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for link in _sliding(model, laws.EndStop):
            deflection = evidence.deflection[link.name]
            stroke, stiffness, damping = (_path(link, key) for key in ("stroke", "contact_stiffness", "contact_damping"))
            # A contact has a little damping; without it there would be another law, with fewer states.
            slight = 1e-3 * link.stiffness * deflection / max(evidence.speed[link.name], 1e-12)
            starts = tuple(
                added(
                    model,
                    link,
                    laws.EndStop(stroke=share * deflection, contact_stiffness=factor * link.stiffness, contact_damping=slight),
                )
                for share, factor in ((0.85, 2.0), (0.6, 3.0), (0.4, 3.0), (0.65, 0.3), (0.5, 0.3))
            )
            found.append(
                Candidate(
                    cause=self.cause, location=link.name, family="spring", starts=starts,
                    free=(
                        Free(path=stroke, low=0.05 * deflection, high=1.2 * deflection),
                        Free(path=stiffness, low=1e-2 * link.stiffness, high=1e4 * link.stiffness),
                        Free(path=damping, low=1e-3 * slight, high=1e4 * slight, log=False, step=slight),
                    ),
                    reported=(
                        Reported(name="stroke", path=stroke, unit="m"),
                        Reported(name="contact_stiffness", path=stiffness, unit="N/m"),
                        Reported(name="contact_damping", path=damping, unit="N s/m"),
                    ),
                    rank=2, plausible=partial(_has_a_spring_inside, evidence.before(link), stroke, stiffness, deflection),
                )
            )  # fmt: skip
        return tuple(found)


def _has_a_spring_inside(before: Link, stroke: str, contact: str, deflection: float, model: RigModel) -> bool:
    # With almost no spring inside it is play where the stroke is small, or the spring beyond it is the one that was expected.
    inside = model.link(before.name).stiffness
    beyond = inside + model.get(contact)
    if inside > INSIDE * beyond:
        return True
    expected = before.stiffness
    return model.get(stroke) > 0.3 * deflection and abs(log(inside / expected)) < abs(log(beyond / expected))


class QuadraticDamping:
    """c v + q v |v|."""

    cause: ClassVar[str] = "quadratic_damping"
    kind: ClassVar[Kind] = "damping_shape"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for link in _sliding(model, laws.QuadraticDamping):
            path = _path(link, "quadratic_damping")
            scale = max(link.damping, 1e-9) / evidence.speed[link.name]
            starts = tuple(added(model, link, laws.QuadraticDamping(quadratic_damping=share * scale)) for share in (0.3, 2.0))
            found.append(
                Candidate(
                    cause=self.cause, location=link.name, family="damping", starts=starts,
                    free=(Free(path=path, low=1e-4 * scale, high=1e4 * scale),),
                    reported=(Reported(name="quadratic_damping", path=path, unit="N s^2/m^2"),),
                )
            )  # fmt: skip
        return tuple(found)


class StiffnessDrift:
    """k (1 + rate t)."""

    cause: ClassVar[str] = "stiffness_drift"
    kind: ClassVar[Kind] = "drift"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        if evidence.end_time <= 0.0:
            return ()
        found = []
        for link in _springs(model, laws.Drift):
            path = _path(link, "drift_rate")
            law = laws.Drift(drift_rate=0.0, until=evidence.end_time)
            most = 0.95 / evidence.end_time
            found.append(
                Candidate(
                    cause=self.cause, location=link.name, family="drift", starts=(added(model, link, law),),
                    free=(Free(path=path, low=-most, high=10.0 * most, log=False, step=0.01 * most),),
                    reported=(Reported(name="drift_rate", path=path, unit="1/s"),),
                )
            )  # fmt: skip
        return tuple(found)
