"""A sled is pulled slowly over a rail by a spring whose other end moves as given: only positions are recorded.

The motion is integrated here, not by the engine. No force is recorded, so all forces are known up to the given mass of the sled.
"""

from __future__ import annotations

from math import exp

import msgspec
import numpy as np
import pytest

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.diagnose.causes.wrong_mass import WrongMass
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.equations.forms import fit_start, start_values
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import equations_of
from isorig.analysis.fitting.ladder import baseline_fit
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.score import signal_powers
from isorig.analysis.laws import Coulomb, Stribeck
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor

#: kg, N/m, N s/m of the spring and of the rail, and the rail's dry friction in N.
MASS, SPRING, DAMPING, RAIL, FRICTION = 2.0, 600.0, 1.5, 0.8, 5.0
#: Samples and steps of the integration per second, seconds of a run, and the count of the encoders in m.
RATE, FINE, SECONDS, COUNT = 500, 10_000, 10, 1e-5
#: Velocity in m/s over which Stribeck friction falls, and by how much in N.
FADES, EXTRA = 0.02, 2.5
RIG = RigModel(
    name="sled on a rail",
    bodies=(Body(name="carrier", mass=5.0), Body(name="sled", mass=MASS)),
    drive=Drive(channel="carrier", imposes="carrier", quantity="displacement"),
    links=(
        Link(name="spring", a="sled", b="carrier", stiffness=500.0, damping=1.7),
        Link(name="rail", a="sled", b="ground", damping=0.9),
    ),
    sensors=(Sensor(channel="sled", body="sled", quantity="displacement"),),
    free=("links.spring.stiffness", "links.spring.damping", "links.rail.damping"),
)


def pulled(speeds: tuple[float, ...], extra: float = 0.0, seconds: float = SECONDS) -> tuple[np.ndarray, np.ndarray]:
    """Positions of carrier and sled, counted, while the carrier moves at each of these speeds in m/s for an equal time.

    The rail holds the sled with `extra` N more than it brakes it in a fast motion (Stribeck friction, over `FADES` m/s).
    """
    steps, h = round(seconds * FINE), 1.0 / FINE
    pace = np.repeat(speeds, steps // len(speeds))
    carrier = np.cumsum(pace) * h
    sled, x, v = np.empty(steps), 0.0, 0.0
    for k, (at, speed) in enumerate(zip(carrier.tolist(), pace.tolist(), strict=True)):
        force = SPRING * (at - x) + DAMPING * (speed - v) - RAIL * v
        friction = FRICTION + extra * exp(-((v / FADES) ** 2))
        if v == 0.0 and abs(force) <= friction:
            after = 0.0
        else:
            after = v + h * (force - friction * np.copysign(1.0, v if v != 0.0 else force)) / MASS
            after = 0.0 if v * after < 0.0 else after
        v, x = after, x + h * after
        sled[k] = x
    counted = [np.round(values[:: FINE // RATE] / COUNT) * COUNT for values in (carrier, sled)]
    return counted[0], counted[1]


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    runs = []
    for name, speeds in {"slow": (0.01,), "back": (0.05, -0.03)}.items():
        channels = {
            channel: Channel(name=channel, samples=values, quantity="displacement", unit="m")
            for channel, values in zip(("carrier", "sled"), pulled(speeds), strict=True)
        }
        runs.append(Run(id=name, configuration="unlocked", sample_rate=float(RATE), gain=1.0, channels=channels))
    return Campaign(runs=tuple(runs), source="slow pulls")


def test_the_equation_gives_the_spring_beside_the_sliding_rail(campaign: Campaign) -> None:
    equations = equations_of(campaign, RIG)
    best = ranking(equations).explanations[0]
    assert (best.what, best.place) == ("dry friction", "rail")
    assert start_values(equations, best)["links.spring.stiffness"] == pytest.approx(SPRING, rel=0.06)


def test_the_drive_is_as_strong_as_the_spring_at_the_given_motion(campaign: Campaign) -> None:
    """The sled's friction stretches the spring by 8 mm, a few per cent of both travels."""
    seen = observe(campaign, RIG, prepare(campaign, RIG), RIG, RIG)
    assert seen.push > 0.8 * FRICTION


# Its force and place, with one that falls with velocity, are also named below.
@pytest.mark.study
def test_dry_friction_is_named_with_its_value(campaign: Campaign) -> None:
    found = diagnose(campaign, RIG)
    (step,) = found.steps
    assert (found.verdict, step.cause, step.location) == ("explained", "coulomb_friction", "rail")
    assert step.parameters["friction_force"][0] == pytest.approx(FRICTION, rel=0.06)


def test_no_motion_shows_the_mass_of_one_body_without_a_known_force(campaign: Campaign) -> None:
    trials = prepare(campaign, RIG)
    stiff = msgspec.structs.replace(RIG, free=RIG.free[1:])
    assert not WrongMass().candidates(RIG, observe(campaign, RIG, trials, RIG, RIG))
    assert {c.location for c in WrongMass().candidates(stiff, observe(campaign, stiff, trials, stiff, stiff))} >= {"sled"}


def test_errors_are_relative_to_the_imposed_motion(campaign: Campaign) -> None:
    """The carrier takes the sled along by up to a metre; only the stretch of the spring tells of the rig."""
    trials = prepare(campaign, RIG)
    for trial, (power,) in zip(trials, signal_powers(trials), strict=True):
        stretch = (trial.run.read("sled") - trial.run.read("carrier"))[trial.held_out]
        assert power == pytest.approx(float(np.mean(stretch**2)))


def test_a_fit_begins_with_the_given_values_where_those_are_closer(campaign: Campaign) -> None:
    """From a stiff spring and a small friction the fit ends at ten times the friction."""
    rubbing = Contact(name="rail", a="sled", law=Coulomb(friction_force=FRICTION))
    given = msgspec.structs.replace(RIG, contacts=(rubbing,), free=(*RIG.free, "contacts.rail.law.friction_force"))
    given = given.replace({"links.spring.stiffness": SPRING, "links.spring.damping": DAMPING, "links.rail.damping": RAIL})
    far = given.replace({"links.spring.stiffness": 3.0 * SPRING, "contacts.rail.law.friction_force": 0.1 * FRICTION})
    found = baseline_fit([far, given], prepare(campaign, given))
    assert found.values["contacts.rail.law.friction_force"] == pytest.approx(FRICTION, rel=0.01)


def stick_and_slip(seconds: float, *speeds: float) -> Campaign:
    """One run of so many seconds in which the sled sticks and slips, while the carrier moves at these speeds in m/s."""
    channels = {
        name: Channel(name=name, samples=values, quantity="displacement", unit="m")
        for name, values in zip(("carrier", "sled"), pulled(speeds, extra=EXTRA, seconds=seconds), strict=True)
    }
    run = Run(id="there and back", configuration="unlocked", sample_rate=float(RATE), gain=1.0, channels=channels)
    return Campaign(runs=(run,), source="a pull with stick and slip")


def test_friction_that_falls_with_velocity_is_named_where_dry_friction_alone_follows_no_slip() -> None:
    """The rig is described without any friction; the equations show dry friction, with which no simulation slips and sticks."""
    found = diagnose(stick_and_slip(SECONDS, 0.0, 0.06, 0.06, -0.04, -0.04), RIG)
    (step,) = found.steps
    assert (found.verdict, step.cause, step.location) == ("explained", "stribeck_friction", "rail")
    named = [step.parameters[name][0] for name in ("friction_force", "static_force", "stribeck_velocity", "exponent")]
    assert named == pytest.approx([FRICTION, FRICTION + EXTRA, FADES, 2.0], rel=0.05)


def test_a_described_friction_law_starts_from_its_recorded_force() -> None:
    """With values a sixth off, a simulation sticks where the sled slips: no gradient leads back."""
    campaign = stick_and_slip(5.0, 0.03, -0.02, 0.05, -0.04)
    law = Stribeck(friction_force=4.4, static_force=8.2, stribeck_velocity=0.017, exponent=2.0)
    values = ("friction_force", "static_force", "stribeck_velocity")
    rig = msgspec.structs.replace(
        RIG, contacts=(Contact(name="rail", a="sled", law=law),), free=(*RIG.free, *(f"contacts.rail.law.{v}" for v in values))
    )
    start = fit_start(equations_of(campaign, rig))
    assert [start.get(f"contacts.rail.law.{v}") for v in values] == pytest.approx([FRICTION, FRICTION + EXTRA, FADES], rel=0.05)
    found = baseline_fit((start, rig), prepare(campaign, rig)).values
    assert found["links.spring.stiffness"] == pytest.approx(SPRING, rel=0.01)
    assert [found[f"contacts.rail.law.{v}"] for v in values] == pytest.approx([FRICTION, FRICTION + EXTRA, FADES], rel=0.05)
