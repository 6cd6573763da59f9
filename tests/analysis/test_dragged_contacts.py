"""A contact that an imposed speed keeps sliding in one direction: a pad on a moving belt."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.equations.forms import solved_values
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import HOLDS, equations_of
from isorig.analysis.fitting.linear_spectra import DRAGS, drags, spectra_of
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate.sampling import Excitation
from isorig.analysis.simulate.simulation import simulate

RATE, SAMPLES, SEED = 500.0, 8000, 4700
TIME = np.arange(SAMPLES) / RATE
STIFFNESS, FRICTION = 1600.0, 2.1


def tribometer(friction: laws.FrictionLaw) -> RigModel:
    """A slider on a leaf spring, dragged by a belt whose speed is recorded."""
    return RigModel(
        name="tribometer",
        bodies=(Body(name="belt", mass=2.0), Body(name="slider", mass=0.43)),
        links=(Link(name="leaf", a="slider", stiffness=STIFFNESS, damping=0.6),),
        contacts=(Contact(name="pad", a="slider", b="belt", law=friction),),
        drive=Drive(channel="speed", factor=1.0, pushes={}, quantity="velocity", imposes="belt"),
        sensors=(
            Sensor(channel="laser", body="slider", quantity="displacement"),
            Sensor(channel="acc", body="slider", quantity="acceleration"),
        ),
        free=("links.leaf.stiffness", "links.leaf.damping", "contacts.pad.law.friction_force"),
    )


def dragged(rig: RigModel, *speeds: FloatArray, hum: float = 0.0) -> Campaign:
    """Recordings of the rig with these speeds of the belt; `hum` is its share of the laser's record."""
    draw, runs = np.random.default_rng(SEED), []
    units = {"speed": ("velocity", "m/s"), "laser": ("displacement", "m"), "acc": ("acceleration", "m/s^2")}
    for k, speed in enumerate(speeds):
        seen = simulate(rig, Excitation.prepare(speed, RATE, oversample=8), as_recorded=True).channels
        records = {"speed": speed, "laser": seen["laser"], "acc": seen["acc"]}
        records["laser"] = records["laser"] + hum * records["laser"].std() * np.sin(2.0 * np.pi * 50.0 * TIME)
        channels = {
            name: Channel(
                name=name, samples=values + 1e-3 * values.std() * draw.normal(size=SAMPLES), quantity=units[name][0],
                unit=units[name][1],
            )
            for name, values in records.items()
        }  # fmt: skip
        runs.append(Run(id=f"r{k}", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels))
    return Campaign(runs=tuple(runs), source="tribometer")


def steps() -> FloatArray:
    """Speeds of one direction, each for a second, from rest."""
    levels = np.random.default_rng(SEED).uniform(0.02, 0.1, len(TIME) // int(RATE))
    return np.concatenate([np.zeros(int(RATE)), np.repeat(levels, int(RATE))])[:SAMPLES]


def reversals() -> FloatArray:
    return 0.12 * np.sin(2.0 * np.pi * 0.43 * TIME)


def test_the_equation_of_a_dragged_slider_holds_with_its_own_values() -> None:
    rig = tribometer(laws.Coulomb(friction_force=FRICTION))
    equations = equations_of(dragged(rig, steps(), reversals()), rig)
    assert equations.residuals()["slider"] < HOLDS
    solved = solved_values(equations)
    assert solved["links.leaf.stiffness"] == pytest.approx(STIFFNESS, rel=0.03)
    assert solved["contacts.pad.law.friction_force"] == pytest.approx(FRICTION, rel=0.05)


def test_only_the_run_that_turns_back_tells_a_level_by_statistical_linearization() -> None:
    rig = tribometer(laws.Coulomb(friction_force=FRICTION))
    spectra = spectra_of(rig, dragged(rig, steps(), reversals()))
    assert [spectrum.run.id for spectrum in spectra] == ["r1"]


@pytest.mark.parametrize(("mean", "one_way"), [(0.99 * DRAGS, False), (1.01 * DRAGS, True)])
def test_a_speed_drags_from_a_mean_of_one_standard_deviation_on(mean: float, one_way: bool) -> None:
    swing = np.sqrt(2.0) * np.sin(2.0 * np.pi * np.arange(1000) / 100.0)
    assert drags(mean + swing) is one_way
    assert drags(-mean + swing) is one_way


def test_no_gain_solves_an_equation_whose_scale_is_that_record_alone() -> None:
    # With all forces unknown, a gain of zero leaves nothing of an equation that friction over velocity breaks.
    falling = laws.Stribeck(friction_force=FRICTION, static_force=1.8 * FRICTION, stribeck_velocity=0.05)
    equations = equations_of(dragged(tribometer(falling), reversals(), hum=0.004), tribometer(laws.Coulomb(friction_force=2.0)))
    found = ranking(equations)
    assert found.residuals["slider"] >= HOLDS
    gain = next((item for item in found.explanations if (item.place, item.what) == ("acc", "gain")), None)
    assert gain is None or gain.residuals["slider"] == found.residuals["slider"]
    best = next(item for item in found.explanations if item.kind != "sensor")
    assert (best.kind, best.place) == ("friction_shape", "pad")


def test_the_level_of_a_described_stribeck_friction_is_a_multiple_of_its_own() -> None:
    truth, described = (
        laws.Stribeck(friction_force=level, static_force=1.8 * level, stribeck_velocity=0.05)
        for level in (FRICTION, 0.5 * FRICTION)
    )
    solved = solved_values(equations_of(dragged(tribometer(truth), reversals()), tribometer(described)))
    assert solved["contacts.pad.law.friction_force"] == pytest.approx(FRICTION, rel=0.03)


def test_a_described_friction_without_one_level_has_no_solved_level() -> None:
    rig = tribometer(laws.Coulomb(friction_force=FRICTION))
    both = laws.Asymmetric(forward_force=FRICTION, backward_force=FRICTION)
    described = replace(rig, contacts=(replace(rig.contacts[0], law=both),), free=("links.leaf.stiffness",))
    solved = solved_values(equations_of(dragged(rig, reversals()), described))
    assert set(solved) <= {"links.leaf.stiffness", "links.leaf.damping"}
