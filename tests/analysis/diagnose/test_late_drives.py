"""Carts whose drive acts late by samples, beside another cause; the motion is integrated here, not by the engine."""

from __future__ import annotations

from math import copysign

import numpy as np
import pytest
from msgspec.structs import replace

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import equations_of
from isorig.analysis.laws import Coulomb
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor

SEED = 8500
RATE, FINE, LATE = 200, 10_000, 2
#: kg, N/m, N s/m, and the friction forward and backward in N.
MASS, STIFFNESS, DAMPING, FORWARD, BACKWARD = 0.85, 135.0, 1.3, 1.05, 0.6
RIG = RigModel(
    name="cart", bodies=(Body(name="cart", mass=0.85),), links=(Link(name="spring", a="cart", stiffness=121.0, damping=1.45),),
    drive=Drive(channel="u", factor=3.2, pushes={"cart": 1.0}, quantity="voltage"),
    sensors=(Sensor(channel="x", body="cart", quantity="displacement"),),
    free=("links.spring.stiffness", "links.spring.damping", "drive.factor"),
)  # fmt: skip


def moved(command: FloatArray) -> FloatArray:
    """Position at the command's samples; each acts for one sample, two samples late."""
    acting = np.repeat(np.concatenate([np.zeros(LATE), command[:-LATE]]), FINE // RATE)
    course, x, v, h = np.empty(len(acting)), 0.0, 0.0, 1.0 / FINE
    for k, volts in enumerate(acting.tolist()):
        force = 3.0 * volts - STIFFNESS * x - DAMPING * v
        if v == 0.0 and -BACKWARD <= force <= FORWARD:
            after = 0.0
        else:
            way = copysign(1.0, v if v != 0.0 else force)
            after = v + h * (force - (FORWARD if way > 0.0 else -BACKWARD)) / MASS
            after = 0.0 if v * after < 0.0 else after
        v, x = after, x + h * after
        course[k] = x
    return course[:: FINE // RATE]


def recorded(seed: int) -> Campaign:
    runs = []
    for number in range(3):
        draw, n = np.random.default_rng(seed + number), 12 * RATE
        command = np.repeat(draw.uniform(-2.0, 2.0, n // RATE), RATE)
        command[: RATE // 2] = 0.0
        position = moved(command) + draw.normal(0.0, 1e-5, n)
        channels = {
            "u": Channel(name="u", samples=command, quantity="voltage", unit="V"),
            "x": Channel(name="x", samples=2e-5 * np.round(position / 2e-5), quantity="displacement", unit="m"),
        }
        runs.append(Run(id=f"r{number}", configuration="unlocked", sample_rate=float(RATE), gain=1.0, channels=channels))
    return Campaign(runs=tuple(runs), source="carts")


def test_the_equations_show_friction_that_differs_by_direction_beside_a_level_and_a_late_drive() -> None:
    """Else the constant force that the difference is would be a curve over the deflection."""
    rubbing = Contact(name="spring", a="cart", law=Coulomb(friction_force=0.8))
    rig = replace(RIG, contacts=(rubbing,), free=(*RIG.free, "contacts.spring.law.friction_force"))
    best = ranking(equations_of(recorded(SEED), rig)).explanations[0]
    assert (best.kind, best.place, best.what) == ("friction_shape", "spring", "friction by direction")


# The equations decide which causes are fitted: above.
@pytest.mark.study
@pytest.mark.parametrize("seed", [SEED, SEED + 10])
def test_friction_that_differs_by_direction_is_named_beside_a_late_drive(seed: int) -> None:
    """Beside a level that is the same in both directions, their difference is a constant force: no curve over the deflection."""
    found = diagnose(recorded(seed), RIG)
    named = {step.cause: step for step in found.steps}
    assert set(named) == {"channel_delay", "asymmetric_friction"}
    force = {way: named["asymmetric_friction"].parameters[f"{way}_force"][0] for way in ("forward", "backward")}
    assert force["forward"] == pytest.approx(FORWARD, rel=0.02)
    assert force["backward"] == pytest.approx(BACKWARD, rel=0.02)
    assert abs(named["channel_delay"].parameters["delay"][0]) == pytest.approx(LATE / RATE, rel=0.05)
    assert found.extended_error < 0.01 * found.baseline_error
