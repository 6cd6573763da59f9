"""Friction on the ground of a body that the description joins to other bodies only."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import eigh
from small_rigs import carts, chain, guessed, played, rubbing

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.diagnose import diagnosis
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.diagnose.guides import guide_of, with_guides
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.equations.system import equations_of
from isorig.analysis.model.rig_model import Body, Drive, Link, RigModel, Sensor


@pytest.mark.study
def test_friction_of_a_cart_that_its_description_does_not_join_to_the_ground() -> None:
    truth = rubbing(with_guides(carts()), guide_of("second"), 0.5)
    found = diagnose(played(truth, seed=11), guessed(carts(), 11))
    assert found.verdict == "explained"
    assert [(step.cause, step.location) for step in found.steps] == [("coulomb_friction", "second guide")]
    assert found.steps[0].parameters["friction_force"][0] == pytest.approx(0.5, rel=0.1)
    assert "has no second guide" in found.signs[0].text


def test_only_bodies_with_a_measured_position_and_no_joint_to_the_ground_get_a_guide() -> None:
    assert [link.name for link in with_guides(carts()).links] == ["wall", "between", "second guide"]
    assert with_guides(chain()) == chain()


@pytest.mark.parametrize(("share", "force", "passes"), [(0.99, 0.5, 1), (1.01, 0.5, 2), (1.01, 0.0, 1)])
def test_guides_are_tried_where_causes_leave_a_visible_error_and_the_equations_show_friction_there(
    share: float, force: float, passes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = rubbing(with_guides(carts()), guide_of("second"), force) if force else carts()
    tried: list[RigModel] = []

    def explained(campaign: Campaign, model: RigModel, *_: object) -> SimpleNamespace:
        tried.append(model)
        left = share * POLICY.guides * 0.4
        return SimpleNamespace(verdict="explained", baseline_error=0.4, extended_error=left, cut_short=False, steps=())

    monkeypatch.setattr(diagnosis, "_at_described_places", explained)
    diagnose(played(truth, seed=11), guessed(carts(), 11))
    assert len(tried) == passes


def test_the_equation_of_a_decaying_body_of_unknown_mass_has_no_scale() -> None:
    """Nothing pushes the upper floor and its mass is fitted: only zero solves its equation, so it shows no shape."""
    rate, stiffness, mass = 200.0, (4000.0, 6000.0), (8.0, 11.0)
    time = np.arange(int(20 * rate)) / rate
    springs = np.array([[sum(stiffness), -stiffness[1]], [-stiffness[1], stiffness[1]]])
    squares, shapes = eigh(springs, np.diag(mass))
    parts = np.linalg.solve(shapes, [0.01, 0.02])
    decay = np.exp(-0.02 * np.sqrt(squares) * time[:, None]) * np.cos(np.sqrt(squares) * time[:, None])
    floors = (decay * parts) @ shapes.T + np.random.default_rng(3).normal(0.0, 1e-5, (len(time), 2))
    channels = {f"x{k}": Channel(name=f"x{k}", samples=floors[:, k], quantity="displacement", unit="m") for k in range(2)}
    channels["push"] = Channel(name="push", samples=np.zeros(len(time)), quantity="force", unit="N")
    run = Run(id="r", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels, excitation="free")
    model = with_guides(
        RigModel(
            name="two floors",
            bodies=(Body(name="lower", mass=mass[0]), Body(name="upper", mass=mass[1])),
            links=(
                Link(name="legs", a="lower", stiffness=stiffness[0], damping=4.0),
                Link(name="neck", a="upper", b="lower", stiffness=stiffness[1], damping=4.0),
            ),
            drive=Drive(channel="push", quantity="force", pushes={"upper": 1.0}),
            sensors=tuple(
                Sensor(channel=f"x{k}", body=body, quantity="displacement") for k, body in enumerate(("lower", "upper"))
            ),
            free=("bodies.upper.mass", "links.legs.stiffness", "links.neck.stiffness"),
        )
    )
    equations = equations_of(Campaign(runs=(run,), source="two floors"), model)
    fitted = {each.name: equations.in_time(each, each.crossing[0][0], sliding=True) is not None for each in equations.balances}
    assert fitted == {"lower": True, "upper": False}
