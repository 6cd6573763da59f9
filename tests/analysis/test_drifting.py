"""Which rigs drift away in a simulation: two inertias on a shaft, turned by a measured torque."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from isorig.analysis.campaign import Quantity
from isorig.analysis.model.linear import SETTLED, drifts
from isorig.analysis.model.rig_model import Body, Drive, Link, RigModel, Sensor

#: Inertias in kg m^2, shaft in N m/rad and N m s/rad, and what each bearing damps in N m s/rad.
MOTOR, LOAD, STIFFNESS, SHAFT, BEARING = 0.004, 0.012, 60.0, 0.02, 0.008
RIG = RigModel(
    name="drive",
    bodies=(Body(name="motor", mass=MOTOR, motion="rotation"), Body(name="load", mass=LOAD, motion="rotation")),
    links=(
        Link(name="bearing", a="motor", damping=BEARING), Link(name="load bearing", a="load", damping=BEARING),
        Link(name="shaft", a="motor", b="load", stiffness=STIFFNESS, damping=SHAFT),
    ),
    drive=Drive(channel="torque", factor=1.0, pushes={"motor": 1.0}, quantity="torque"),
    sensors=tuple(Sensor(channel=f"{body} speed", body=body, quantity="angular_velocity") for body in ("motor", "load")),
)  # fmt: skip
#: The speed of all that turns falls by a factor of e in this time, as the shaft's resonance is far above it.
FALLS = (MOTOR + LOAD) / (2.0 * BEARING)


@pytest.mark.parametrize(("share", "drifting"), [(0.98, True), (1.02, False)])
def test_speeds_that_dampers_hold_do_not_drift_in_long_runs(share: float, drifting: bool) -> None:
    assert drifts(RIG, share * SETTLED * FALLS) is drifting


@pytest.mark.parametrize(("quantity", "drifting"), [("angle", True), ("angular_acceleration", False)])
def test_a_measured_position_drifts(quantity: Quantity, drifting: bool) -> None:
    measured = replace(RIG, sensors=(*RIG.sensors[:1], replace(RIG.sensors[1], quantity=quantity)))
    assert drifts(measured, 100.0 * FALLS) is drifting


def test_a_position_that_springs_hold_does_not_drift_beside_a_speed_that_nothing_holds() -> None:
    # A belt moves a carriage on a spring; what turns moves the carriage by the belt's deflection only.
    belt = Link(name="belt", a="carriage", stiffness=1500.0, damping=2.0, arms={"motor": -0.03, "load": 0.03})
    held = Link(name="spring", a="carriage", stiffness=1800.0, damping=5.0)
    carriage = Sensor(channel="carriage", body="carriage", quantity="displacement")
    rig = replace(
        RIG,
        bodies=(*RIG.bodies, Body(name="carriage", mass=1.8)),
        links=(*RIG.links, belt, held),
        sensors=(RIG.sensors[1], carriage),
    )
    assert not drifts(rig, 100.0 * FALLS)
    assert drifts(replace(rig, sensors=(RIG.sensors[1], replace(carriage, body="load", quantity="angle"))), 100.0 * FALLS)


def test_speeds_without_dampers_drift_and_what_springs_hold_does_not() -> None:
    assert drifts(replace(RIG, links=(replace(RIG.links[0], damping=0.0), replace(RIG.links[1], damping=0.0), RIG.links[2])), 1e3)
    assert not drifts(replace(RIG, links=(replace(RIG.links[0], stiffness=1.0), *RIG.links[1:])), 1e-3)
