"""Friction on the ground of a body that the description joins to other bodies only."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from small_rigs import carts, chain, guessed, played, rubbing

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose import diagnosis
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.diagnose.guides import guide_of, with_guides
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.model.rig_model import RigModel


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
