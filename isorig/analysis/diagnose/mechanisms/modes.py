"""Linear structural causes: an unmodelled attached resonator, a rocking motor, a mass that differs from the given one."""

from __future__ import annotations

from functools import partial
from math import copysign, pi, sqrt
from typing import ClassVar

import msgspec

from isorig.analysis.diagnose.mechanisms.base import Evidence, Kind, exchange
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import GROUND, Body, Link, RigModel

#: Relative spacing of starting frequencies of an attached resonator.
CLOSE = 0.035
#: A resonator closer than this share to the resonance of its body is not compensated for any further.
NEAR = 0.3
#: Starting values for the arms (m) of a rocking motor.
ARMS = (0.02, 0.06)
#: Factors on a given mass from which its fits start, besides the given value.
FACTORS = (0.6, 1.6)
ROCKING_RADIUS = 0.1  # m: radius of gyration of the motor; only products with arms matter, so any value can be used


def _blocked(model: RigModel) -> frozenset[str]:
    return frozenset(name for configuration in model.configurations.values() for name in configuration.rigid)


class ExtraMode:
    """A resonator attached to a body."""

    cause: ClassVar[str] = "extra_mode"
    kind: ClassVar[Kind] = "added_motion"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for body in model.bodies:
            name = f"{body.name}_added"
            if any(other.name == name for other in model.bodies) or body.name.endswith("_added"):
                continue
            mass = 0.04 * body.mass
            # A light one too: near a resonance a heavy resonator splits it, and no gradient leads back.
            starts = tuple(
                self._with_resonator(model, name, body, share * body.mass, f)
                for share in (0.04, 0.01)
                for f in _around(evidence.misfit_frequencies)
            )
            if not starts:
                continue
            mass_path, stiffness, damping = (
                f"bodies.{name}.mass",
                f"links.{name}.stiffness",
                f"links.{name}.damping",
            )
            found.append(
                Candidate(
                    cause=self.cause, location=body.name, family="mode", starts=starts,
                    free=(
                        Free(path=mass_path, low=1e-4 * body.mass, high=body.mass),
                        Free(path=stiffness, low=mass * 2.0, high=mass * (2 * pi * evidence.sample_rate) ** 2),
                        Free(path=damping, low=1e-6, high=mass * 2 * pi * evidence.sample_rate),
                    ),
                    reported=(
                        Reported(name="mode_mass", path=mass_path, unit="kg"),
                        Reported(name="mode_frequency", path=stiffness, unit="Hz", value=partial(_frequency, name)),
                        Reported(name="mode_damping", path=damping, unit="1", value=partial(_damping_ratio, name)),
                    ),
                    rank=3,
                )
            )  # fmt: skip
        return tuple(found)

    @staticmethod
    def _with_resonator(model: RigModel, name: str, body: Body, mass: float, frequency: float) -> RigModel:
        omega = 2.0 * pi * frequency
        link = Link(name=name, a=name, b=body.name, stiffness=mass * omega**2, damping=2 * 0.03 * mass * omega)
        # At the resonance of its body an attached resonator has the apparent mass m / (1 - (f / f_added)^2); the fit without it
        # has compensated this by the mass there or by the spring.
        bodies, links = model.bodies, model.links
        for own in (link for link in model.links if link.a == body.name):
            below = 1.0 - own.stiffness / (body.mass * omega**2)
            share = mass / body.mass / copysign(max(abs(below), NEAR), below)
            if f"bodies.{body.name}.mass" in model.free:
                bodies = exchange(bodies, body.name, mass=(1.0 - share) * body.mass)
            else:
                links = exchange(links, own.name, stiffness=(1.0 + share) * own.stiffness, damping=(1.0 + share) * own.damping)
        return msgspec.structs.replace(model, bodies=(*bodies, Body(name=name, mass=mass)), links=(*links, link))


def _around(frequencies: tuple[float, ...]) -> list[float]:
    # A band is wide compared with a mode with little damping: use closer spacing at the largest residual.
    close = [f * (1.0 + CLOSE * k) for f in frequencies[:2] for k in range(-3, 4)]
    return [*close, *frequencies[2:]]


def _frequency(name: str, model: RigModel) -> float:
    return float(sqrt(model.link(name).stiffness / model.body(name).mass) / (2.0 * pi))


def _damping_ratio(name: str, model: RigModel) -> float:
    return float(model.link(name).damping / (2.0 * sqrt(model.link(name).stiffness * model.body(name).mass)))


class MomentCoupling:
    """The drive force does not pass through the centre of gravity and the body rocks on its bearings."""

    cause: ClassVar[str] = "moment_coupling"
    kind: ClassVar[Kind] = "added_motion"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        found = []
        for pushed, weight in model.drive.pushes.items():
            sensors = [s.channel for s in model.sensors if s.body == pushed]
            links = [link.name for link in model.links if link.name in _blocked(model) and pushed in (link.a, link.b)]
            if not sensors or not links or any(body.name == "rocking" for body in model.bodies):
                continue
            starts = tuple(
                self._rocking(model, pushed, weight, sensors, links[0], frequency, arm, height)
                for frequency in evidence.misfit_frequencies
                for arm in ARMS
                for height in (arm, -arm)
            )
            inertia = model.body(pushed).mass * ROCKING_RADIUS**2
            push = "drive.pushes.rocking"
            height = f"sensors.{sensors[0]}.arms.rocking"
            bearing = f"links.{links[0]}.arms.rocking"
            stiffness, damping = "links.bearing.stiffness", "links.bearing.damping"
            found.append(
                Candidate(
                    cause=self.cause, location=pushed, family="mode", starts=starts,
                    free=(
                        Free(path=push, low=-1.0, high=1.0, log=False, step=1e-3),
                        Free(path=height, low=-1.0, high=1.0, log=False, step=1e-3),
                        Free(path=bearing, low=-1.0, high=1.0, log=False, step=1e-3),
                        Free(path=stiffness, low=inertia, high=inertia * (2 * pi * evidence.sample_rate) ** 2),
                        Free(path=damping, low=1e-8, high=inertia * 2 * pi * evidence.sample_rate),
                    ),
                    reported=(
                        Reported(name="drive_arm", path=push, unit="m"),
                        Reported(name="sensor_height", path=height, unit="m"),
                        Reported(name="bearing_height", path=bearing, unit="m"),
                        Reported(name="rocking_stiffness", path=stiffness, unit="N m/rad"),
                    ),
                    rank=5,
                )
            )  # fmt: skip
        return tuple(found)

    @staticmethod
    def _rocking(
        model: RigModel, pushed: str, weight: float, sensors: list[str], link: str, frequency: float, arm: float, height: float
    ) -> RigModel:
        inertia = model.body(pushed).mass * ROCKING_RADIUS**2
        omega = 2.0 * pi * frequency
        bearing = Link(
            name="bearing",
            a="rocking",
            b=GROUND,
            stiffness=inertia * omega**2,
            damping=2 * 0.03 * inertia * omega,
        )
        locked = {
            name: msgspec.structs.replace(c, rigid=(*c.rigid, "bearing")) if link in c.rigid else c
            for name, c in model.configurations.items()
        }
        return msgspec.structs.replace(
            model,
            bodies=(*model.bodies, Body(name="rocking", mass=inertia)),
            links=(*exchange(model.links, link, arms={"rocking": arm}), bearing),
            sensors=exchange(model.sensors, sensors[0], arms={"rocking": height}),
            drive=msgspec.structs.replace(model.drive, pushes={**model.drive.pushes, "rocking": arm * weight}),
            configurations=locked,
        )


class WrongMass:
    """A mass that differs from its given value."""

    cause: ClassVar[str] = "wrong_mass"
    kind: ClassVar[Kind] = "known_value"

    def candidates(self, model: RigModel, evidence: Evidence) -> tuple[Candidate, ...]:
        by_mass = model.drive.quantity == "acceleration" and model.drive.imposes is None
        places = [("drive.factor", model.drive.channel)] if by_mass else []
        places += [(f"bodies.{body.name}.mass", body.name) for body in model.bodies if _weighed(model, body)]
        return tuple(
            Candidate(
                cause=self.cause, location=location, family="mass", starts=(model, *_heavier(model, path, location)),
                free=(Free(path=path, low=0.2 * model.get(path), high=5.0 * model.get(path)),),
                reported=(Reported(name="mass", path=path, unit="kg"),), rank=0,
                twin=("sensor_gain", model.drive.channel) if path == "drive.factor" else None,
            )
            for path, location in places
            if path not in model.free
        )  # fmt: skip


def _heavier(model: RigModel, path: str, body: str) -> tuple[RigModel, ...]:
    # A mass far from its given value, on a link that keeps its frequency and damping ratio: the fit has the right ones of both.
    if not path.startswith("bodies."):
        return ()
    links = [link for link in model.links if link.a == body]
    return tuple(
        model.replace(
            {path: share * model.get(path)}
            | {f"links.{link.name}.{name}": share * getattr(link, name) for link in links for name in ("stiffness", "damping")}
        )
        for share in FACTORS
    )


def _weighed(model: RigModel, body: Body) -> bool:
    return f"bodies.{body.name}.mass" not in model.free and not body.name.endswith("_added") and body.name != "rocking"
