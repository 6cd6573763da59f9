"""A spring with another stiffness in each direction: its period by a closed formula, its candidates, and a diagnosis."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest
from small_rigs import guessed, played, stage, with_law

import isorig as iso
from isorig.analysis import laws
from isorig.analysis.diagnose.causes.base import WeakestSizes
from isorig.analysis.diagnose.causes.bilinear_stiffness import BilinearStiffness
from isorig.analysis.model.rig_model import Body, Configuration, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation, simulate
from isorig.rig.wire_bonder.description import wire_bonder

RATE, MASS, STIFFNESS, MORE = 2000.0, 2.0, 5000.0, 1500.0


class Swings:
    deflection: ClassVar = {"table": 1e-3, "heatblock": 1e-5, "isolation": 2e-3}
    speed: ClassVar = {"table": 0.1, "heatblock": 1e-3, "isolation": 0.2}


def test_half_a_period_has_the_frequency_of_its_direction() -> None:
    """T = pi sqrt(m / (k + s)) + pi sqrt(m / (k - s)), whatever the amplitude (Shaw and Holmes, J. Sound Vib. 90, 1983)."""
    period = np.pi * (np.sqrt(MASS / (STIFFNESS + MORE)) + np.sqrt(MASS / (STIFFNESS - MORE)))
    model = RigModel(
        name="pulled", bodies=(Body(name="m", mass=MASS),),
        drive=Drive(channel="f", factor=1.0, pushes={"m": 1.0}, quantity="force"),
        links=(Link(name="spring", a="m", stiffness=STIFFNESS, laws=(laws.Bilinear(stiffness_difference=MORE),)),),
        sensors=(Sensor(channel="x", body="m", quantity="displacement"),),
        configurations={"unlocked": Configuration(initial_position={"m": 0.01})},
    )  # fmt: skip
    drive = Excitation.prepare(np.zeros(round(20.2 * period * RATE)), RATE, oversample=4)
    x = simulate(model, drive).channels["x"]
    rising = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossing = rising - x[rising] / (x[rising + 1] - x[rising])
    assert np.diff(crossing) / RATE == pytest.approx(period, rel=1e-4)
    stretched, pressed = x.max(), -x.min()  # the same energy in both
    assert (STIFFNESS + MORE) * stretched**2 == pytest.approx((STIFFNESS - MORE) * pressed**2, rel=1e-3)


@pytest.mark.parametrize(("share", "pulls_back"), [(-1.0, False), (-0.99, True), (0.99, True), (1.0, False)])
def test_one_that_does_not_pull_back_is_no_spring(share: float, pulls_back: bool) -> None:
    model = wire_bonder()
    (found,) = (c for c in BilinearStiffness().candidates(model, Swings()) if c.location == "isolation")
    fitted = found.starts[0].replace({found.free[0].path: share * model.link("isolation").stiffness})
    assert found.plausible(fitted) == pulls_back


def test_the_weakest_differs_by_a_tenth_of_the_stiffness() -> None:
    found = BilinearStiffness().sized(wire_bonder(), Swings(), "isolation", 1.0, WeakestSizes())
    difference = found.parameters["stiffness_difference"]
    assert abs(difference) == pytest.approx(0.1 * wire_bonder().link("isolation").stiffness)


def test_it_is_named() -> None:
    hidden = with_law(stage(), "rail", laws.Bilinear(stiffness_difference=0.2 * stage().get("links.rail.stiffness")))
    found = iso.diagnose(played(hidden, seed=11), guessed(stage(), 12))
    (step,) = found.steps
    assert (found.verdict, step.cause, step.location) == ("explained", "bilinear_stiffness", "rail")
    value, std, _ = step.parameters["stiffness_difference"]
    assert abs(value - 0.2 * stage().get("links.rail.stiffness")) <= 3.0 * std
