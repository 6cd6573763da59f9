"""What the thesis states of its first figures, and what its own way of integrating makes of them."""

import numpy as np
import pytest

from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import Drive, RigModel
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.excitation import random
from isorig.rig.wire_bonder.description import one_mass, three_mass, two_mass, wire_bonder
from thesis.friction import LITERAL_PULSE, PICTURES, PULSE, START, literal, reversals, struck
from thesis.printed_law import literal_run


def test_with_200_newton_the_mass_stays_where_it_went() -> None:
    found = struck(one_mass(friction=200.0))
    x = found.response.channels["motor"]
    assert found.changes[-1].slides == 0
    assert found.changes[-1].time < START + 2.1 * PULSE
    assert np.ptp(x[-1000:]) < 1e-9
    # It stays at its largest, and a longer pulse would carry it so far that the spring pulls it back.
    assert x[-1] > 0.999 * x.max() > 5e-3
    longer = struck(one_mass(friction=200.0), 2.0 * PULSE).response.channels["motor"]
    assert longer[-1] < 0.7 * longer.max()
    # What holds it is the pull of the spring.
    k = one_mass().link("isolation").stiffness
    assert found.friction["isolation"][-100] == pytest.approx(-k * x[-1], rel=1e-6)
    assert k * x[-1] < 200.0


def test_with_20_newton_it_swings_some_tenths_of_a_second_and_rests() -> None:
    found = struck(one_mass(friction=20.0))
    x = found.response.channels["motor"]
    rests = found.changes[-1].time - START
    assert found.changes[-1].slides == 0
    assert 0.2 < rests < 0.6
    assert x.min() < -1e-3
    # It rests where friction holds against the spring.
    assert abs(x[-1]) * one_mass().link("isolation").stiffness <= 20.0
    assert np.ptp(x[-1000:]) < 1e-9


@pytest.mark.parametrize("build", [two_mass, three_mass])
def test_relative_velocity_without_chatter(build: type[RigModel]) -> None:
    found = struck(build(), LITERAL_PULSE)
    # Out and back twice: breakaway, three reversals by way of rest, and the last rest.
    assert [change.slides for change in found.changes] == [1, 0, -1, 0, 1, 0, -1, 0]
    assert np.diff([change.time for change in found.changes][::2]).min() > 0.09
    slip = found.response.channels["motor"] - found.response.channels["table"]
    after = int((found.changes[-1].time + 0.01) * 2048)
    assert np.ptp(slip[after:]) < 1e-12
    # Three while it slides, and what holds it at the end pulls the other way again.
    assert reversals(found.friction["isolation"]) == 4


def test_the_thesiss_law_chatters_by_relative_velocity_and_crawls() -> None:
    relative, own = literal("relative"), literal("own")
    assert reversals(relative.friction) > 100
    assert reversals(own.friction) < 10
    assert relative.evaluations > 10 * own.evaluations
    # In this run, whose table is heavy, both come near all the same.
    right = struck(three_mass(), LITERAL_PULSE).response.channels["motor"]
    for found in (relative, own):
        assert np.abs(found.states[:, 2] - right).max() < 2e-3 * np.abs(right).max()


def test_how_large_the_shortcuts_error_is() -> None:
    """By the motor's own velocity the table of the rig as identified is wrong by more than half, at 60 N rms."""
    from msgspec.structs import replace

    push = Drive(channel="force", factor=1.0, pushes={"motor": 1.0}, quantity="force")
    sensors = tuple(replace(sensor, quantity="velocity") for sensor in wire_bonder().sensors)
    model = replace(wire_bonder(), drive=push, sensors=sensors, free=())
    force = random(samples=2048, sample_rate=2048.0, rms=60.0, band=(1.0, 250.0), seed=60)
    right = simulate(model, Excitation.prepare(force, 2048.0, oversample=1)).channels["table"]

    def error(velocity: str) -> float:
        run = literal_run(model, force, 2048.0, velocity="own" if velocity == "own" else "relative", between="straight")
        return float(np.std(run.states[:, 3] - right) / np.std(right))

    assert error("own") > 0.5
    assert error("relative") < 0.05


def test_the_literal_law_is_for_one_coulomb_contact() -> None:
    with pytest.raises(ModelError, match="other laws"):
        literal_run(wire_bonder(friction=False), np.ones(10), 1024.0)


@pytest.mark.parametrize("name", ["laws", "links", "fig7", "fig10"])
def test_pictures_are_drawn(name: str) -> None:
    figure = PICTURES[name]()
    assert all(axis.lines or axis.collections for axis in figure.axes)
