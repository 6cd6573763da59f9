"""A body that rocks."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi

import msgspec

from isorig.analysis.diagnose.causes.base import Amplitudes, Cause, Evidence, RigWithCause, Sizes, blocked_links, exchange
from isorig.analysis.fitting.candidate import Candidate, Reported
from isorig.analysis.fitting.solve import Free
from isorig.analysis.model.rig_model import GROUND, Body, Link, RigModel

#: Arms in m at the starts.
ARMS = (0.02, 0.06)
#: Radius of gyration in m: only products with arms matter, so any value can be used.
RADIUS = 0.1
#: Name of the link that holds the rocking body.
ADDED = "rocking_added"


class MomentCoupling(Cause):
    """A drive force that does not pass through the centre of gravity, so that the body also rocks."""

    kind = "added_motion"
    family = "mode"
    rank = 5
    phrase = "a drive force off the centre of gravity: the {place} rocks"
    signs = frozenset({"independent of amplitude", "mode"})
    found_as = frozenset({"rocking"})

    def places(self, model: RigModel) -> tuple[str, ...]:
        """The driven bodies with a sensor and a link that some configuration blocks."""
        if any(body.name == "rocking" for body in model.bodies):
            return ()
        sensed = {sensor.body for sensor in model.sensors}
        return tuple(body for body in model.drive.pushes if body in sensed and _bearings(model, body))

    def proposed(self, model: RigModel, evidence: Evidence, place: str) -> Iterator[Candidate]:
        inertia, fastest = model.body(place).mass * RADIUS**2, 2.0 * pi * evidence.sample_rate
        starts = (
            _Rocking(inertia=inertia, frequency=frequency, damping=0.03, drive_arm=arm, sensor_height=height, bearing_height=arm)
            for frequency in evidence.misfit_frequencies
            for arm in ARMS
            for height in (arm, -arm)
        )
        push, stiffness, damping = "drive.pushes.rocking", f"links.{ADDED}.stiffness", f"links.{ADDED}.damping"
        height, bearing = f"sensors.{_sensor(model, place)}.arms.rocking", f"links.{_bearings(model, place)[0]}.arms.rocking"
        yield Candidate(
            cause=self.name, location=place, family=self.family, rank=self.rank,
            starts=tuple(start.of(model, place) for start in starts),
            free=(
                *(Free(path=path, low=-1.0, high=1.0, log=False, step=1e-3) for path in (push, height, bearing)),
                Free(path=stiffness, low=inertia, high=inertia * fastest**2),
                Free(path=damping, low=1e-8, high=inertia * fastest),
            ),
            reported=(
                Reported(name="drive_arm", path=push, unit="m"),
                Reported(name="sensor_height", path=height, unit="m"),
                Reported(name="bearing_height", path=bearing, unit="m"),
                Reported(name="rocking_stiffness", path=stiffness, unit="N m/rad"),
            ),
        )  # fmt: skip

    def sized(self, model: RigModel, runs: Amplitudes, place: str, size: float, sizes: Sizes) -> RigWithCause:
        rocking = _Rocking(
            inertia=model.body(place).mass * sizes.between(0.06, 0.12) ** 2, frequency=sizes.between(15.0, 60.0),
            damping=sizes.between(0.02, 0.06), drive_arm=size * sizes.weak_to_strong(0.01, 0.04),
            sensor_height=sizes.between(0.02, 0.06), bearing_height=sizes.between(0.01, 0.04),
        )  # fmt: skip
        values = {"drive_arm": rocking.drive_arm, "sensor_height": rocking.sensor_height}
        return RigWithCause(model=rocking.of(model, place), parameters=values)


@dataclass(frozen=True, kw_only=True)
class _Rocking:
    # Inertia in kg m^2, frequency in Hz, damping ratio, and arms about the centre of gravity in m.
    inertia: float
    frequency: float
    damping: float
    drive_arm: float
    sensor_height: float
    bearing_height: float

    def of(self, model: RigModel, body: str) -> RigModel:
        omega, link = 2.0 * pi * self.frequency, _bearings(model, body)[0]
        damping = 2.0 * self.damping * self.inertia * omega
        bearing = Link(name=ADDED, a="rocking", b=GROUND, stiffness=self.inertia * omega**2, damping=damping)
        pushes = {**model.drive.pushes, "rocking": self.drive_arm * model.drive.pushes[body]}
        return msgspec.structs.replace(
            model,
            bodies=(*model.bodies, Body(name="rocking", mass=self.inertia)),
            links=(*exchange(model.links, link, arms={"rocking": self.bearing_height}), bearing),
            sensors=exchange(model.sensors, _sensor(model, body), arms={"rocking": self.sensor_height}),
            drive=msgspec.structs.replace(model.drive, pushes=pushes),
            configurations={
                name: msgspec.structs.replace(setup, rigid=(*setup.rigid, ADDED)) if link in setup.rigid else setup
                for name, setup in model.configurations.items()
            },
        )


def _bearings(model: RigModel, body: str) -> list[str]:
    return [link.name for link in model.links if link.name in blocked_links(model) and body in (link.a, link.b)]


def _sensor(model: RigModel, body: str) -> str:
    return next(sensor.channel for sensor in model.sensors if sensor.body == body)
