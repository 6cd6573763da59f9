"""A pendulum that is released, swings and comes to rest off its middle: dry friction and a restoring torque like a sine."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import equations_of
from isorig.analysis.laws import Coulomb
from isorig.analysis.model.rig_model import Body, Configuration, Contact, Drive, Link, RigModel, Sensor

SEED = 5300
RATE, SECONDS = 100.0, 20.0
INERTIA, WEIGHT, DRAG, FRICTION = 0.021, 0.92, 0.0006, 0.0045


def swung(start: float) -> FloatArray:
    """The angle of a pendulum released at an angle in rad, by scipy from turn to turn."""
    grid = np.arange(round(SECONDS * RATE)) / RATE
    angle = np.full(len(grid), start)
    begin, now = 0.0, start

    def turn(t: float, state: FloatArray) -> float:
        return float(state[1])

    turn.terminal = True  # type: ignore[attr-defined]
    while begin < SECONDS and abs(WEIGHT * np.sin(now)) > FRICTION:
        way = -np.sign(now)

        def moved(t: float, state: FloatArray, way: float = way) -> list[float]:
            return [state[1], (-WEIGHT * np.sin(state[0]) - DRAG * state[1] - FRICTION * way) / INERTIA]

        turn.direction = -way  # type: ignore[attr-defined]
        begun = [now, way * 1e-9]
        done = solve_ivp(moved, (begin, SECONDS), begun, events=turn, rtol=1e-10, atol=1e-13, dense_output=True)
        inside = (grid >= begin) & (grid <= done.t[-1])
        angle[inside] = done.sol(grid[inside])[0]
        begin, now = float(done.t[-1]), float(done.y[0, -1])
        angle[grid > begin] = now
    return angle


def released() -> tuple[Campaign, RigModel]:
    """Two releases of a pendulum at known angles, and its description with values a quarter off."""
    runs = []
    for number, (name, start) in enumerate((("wide", 0.42), ("narrow", 0.2))):
        draw = np.random.default_rng(SEED + number)
        angle = swung(start)
        channels = {
            "torque": Channel(name="torque", samples=np.zeros(len(angle)), quantity="torque", unit="N m"),
            "angle": Channel(
                name="angle", samples=angle + draw.normal(0.0, 8e-4, len(angle)), quantity="angle", unit="rad"
            ),
        }  # fmt: skip
        runs.append(Run(id=name, configuration=name, sample_rate=RATE, gain=1.0, channels=channels, excitation="free"))
    rig = RigModel(
        name="pendulum", bodies=(Body(name="pendulum", mass=INERTIA, motion="rotation"),),
        links=(Link(name="pivot", a="pendulum", stiffness=0.75 * WEIGHT, damping=1.25 * DRAG),),
        drive=Drive(channel="torque", factor=1.0, pushes={"pendulum": 1.0}, quantity="torque"),
        sensors=(Sensor(channel="angle", body="pendulum", quantity="angle"),),
        configurations={
            "unlocked": Configuration(), "wide": Configuration(initial_position={"pendulum": 0.42}),
            "narrow": Configuration(initial_position={"pendulum": 0.2}),
        },
        free=("links.pivot.stiffness", "links.pivot.damping"),
    )  # fmt: skip
    return Campaign(runs=tuple(runs), source="released"), rig


def test_the_equations_show_dry_friction_where_every_sample_is_close_to_a_reversal() -> None:
    found = ranking(equations_of(*released()))
    best = next(item for item in found.explanations if item.kind == "friction_shape")
    assert (best.place, best.what) == ("pivot", "dry friction")
    assert best.score > 0.3


def test_a_restoring_torque_like_a_sine_is_named_beside_described_friction() -> None:
    campaign, rig = released()
    rubbing = Contact(name="pivot", a="pendulum", law=Coulomb(friction_force=1.2 * FRICTION))
    rig = replace(rig, contacts=(rubbing,), free=(*rig.free, "contacts.pivot.law.friction_force"))
    found = diagnose(campaign, rig)
    (softening,) = found.steps
    assert (found.verdict, softening.cause, softening.location) == ("explained", "softening_stiffness", "pivot")
    # The sine's second term; the next one makes the fitted cube a little smaller.
    assert softening.parameters["cubic_stiffness"][0] == pytest.approx(-WEIGHT / 6.0, rel=0.06)


# The equations show the friction, and the restoring torque is named beside it: above.
@pytest.mark.study
def test_a_released_pendulum_has_dry_friction_and_a_restoring_torque_like_a_sine() -> None:
    found = diagnose(*released())
    assert [(step.cause, step.location) for step in found.steps] == [
        ("coulomb_friction", "pivot"),
        ("softening_stiffness", "pivot"),
    ]
    friction, softening = found.steps
    assert friction.parameters["friction_force"][0] == pytest.approx(FRICTION, rel=0.02)
    assert softening.parameters["cubic_stiffness"][0] == pytest.approx(-WEIGHT / 6.0, rel=0.06)
