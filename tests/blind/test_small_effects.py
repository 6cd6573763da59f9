"""Sealed envelopes with effects that the equations of motion do not show, or that look like wrong cables, units or noise."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from envelopes import draw_envelope
from other_envelopes import draw_other
from study_other import described
from unlike_bonders import draw_bonder

from isorig.analysis.equations.system import HOLDS, equations_of
from isorig.rig.cli import main
from isorig.rig.files.recording import read, write
from isorig.rig.model.baseline import baseline_model


def findings_of(recording: Path, folder: Path) -> dict[str, object]:
    assert main(["diagnose", str(recording), "-o", str(folder)]) == 0
    return json.loads((folder / "findings.json").read_text())  # type: ignore[no-any-return]


@pytest.mark.study
@pytest.mark.timeout(300)
def test_a_whole_motion_shows_what_its_moments_do_not(tmp_path: Path) -> None:
    """Drag in a chain of three masses: every equation holds within its noise, and the simulation misfits."""
    envelope = draw_other("quadratic_damping", 0.33, 860023, soil=0.0, rest=True)
    last = envelope.campaign.runs[3:]
    write(tmp_path / "sealed.h5", replace(envelope.campaign, runs=last, description=described(envelope)))
    campaign = read(tmp_path / "sealed.h5")
    assert max(equations_of(campaign, baseline_model(campaign)).residuals().values()) < HOLDS
    found = findings_of(tmp_path / "sealed.h5", tmp_path / "out")
    assert [(step["cause"], step["location"]) for step in found["steps"]] == [("quadratic_damping", "l2")]
    assert found["verdict"] == "explained"


@pytest.mark.study
@pytest.mark.timeout(300)
def test_an_imperfect_lock_is_no_exchange_of_channels(tmp_path: Path) -> None:
    envelope = draw_envelope("imperfect_lock", 1.0, 700047)
    write(tmp_path / "sealed.h5", envelope.campaign)
    found = findings_of(tmp_path / "sealed.h5", tmp_path / "out")
    assert [(step["cause"], step["location"]) for step in found["steps"]] == list(envelope.truth)
    assert found["doubts"] == []


@pytest.mark.study
@pytest.mark.timeout(300)
def test_friction_that_holds_two_carts_together_is_no_wrong_unit(tmp_path: Path) -> None:
    """The records agree with a link a thousand times as stiff; the equations with friction give the described stiffness."""
    envelope = draw_other("stribeck_friction", 0.33, 870011, soil=0.0, rest=True)
    write(tmp_path / "sealed.h5", replace(envelope.campaign, description=described(envelope)))
    found = findings_of(tmp_path / "sealed.h5", tmp_path / "out")
    assert found["doubts"] == []
    assert {(step["kind"], step["location"]) for step in found["steps"]} == {("friction_shape", "between")}


@pytest.mark.study
@pytest.mark.timeout(300)
def test_a_cause_that_amplifies_noise_leaves_the_baseline_inadequate(tmp_path: Path) -> None:
    """Play in a chain: noise on the drive soon changes its motion as much as the whole cause does.

    Whether a simulation follows long enough to confirm the play is chance; the equations show its kind and place.
    """
    envelope = draw_other("backlash", 1.0, 870019, soil=0.02, rest=False)
    write(tmp_path / "sealed.h5", replace(envelope.campaign, description=described(envelope)))
    found = findings_of(tmp_path / "sealed.h5", tmp_path / "out")
    assert found["verdict"] != "adequate"
    if found["verdict"] == "unexplained":
        assert found["pointed"] == {"kind": "spring_shape", "location": "l1"}
    else:
        assert [(step["cause"], step["location"]) for step in found["steps"]] == [("backlash", "l1")]


@pytest.mark.study
@pytest.mark.timeout(300)
def test_gains_that_differ_only_by_their_ratio_are_indistinguishable_beside_another_cause(tmp_path: Path) -> None:
    """Two carts, one with a wrong gain, and a hardening spring: the link between them only sees the ratio of both gains."""
    envelope = draw_other("two", 1.0, 870057, soil=0.0, rest=False)
    assert {(cause, place) for cause, _, place in envelope.truth} == {("hardening_stiffness", "wall"), ("sensor_gain", "x1")}
    write(tmp_path / "sealed.h5", replace(envelope.campaign, description=described(envelope)))
    found = findings_of(tmp_path / "sealed.h5", tmp_path / "out")
    assert {(step["cause"], step["location"]) for step in found["steps"]} >= {("hardening_stiffness", "wall")}
    (alike,) = found["indistinguishable"]
    assert {(one["cause"], one["location"]) for one in alike} == {("sensor_gain", "x0"), ("sensor_gain", "x1")}


@pytest.mark.study
@pytest.mark.timeout(300)
def test_a_bent_sensor_is_named_although_a_rocking_body_repairs_more_of_its_equation(tmp_path: Path) -> None:
    """No simulation follows the best explanation, so the free shapes of the others are tried."""
    envelope = draw_bonder("bent sensor", 1.0, 950090, soil=0.0, rest=False)
    write(tmp_path / "sealed.h5", envelope.campaign)
    found = findings_of(tmp_path / "sealed.h5", tmp_path / "out")
    assert {(step["kind"], step["location"]) for step in found["steps"]} == {("sensor", "motor")}


@pytest.mark.study
@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    ("kind", "size", "seed", "named"),
    [
        ("uneven friction", 1.0, 870048, {("friction_shape", "l1")}),
        ("end_stop", 1.0, 880015, {("spring_shape", "l0")}),
        ("two", 0.33, 880065, {("friction_shape", "l0"), ("spring_shape", "l0")}),
        ("uneven friction", 1.0, 881048, {("friction_shape", "wall")}),
    ],
)
def test_causes_that_hold_a_chain_or_hide_behind_another_one(
    kind: str, size: float, seed: int, named: set[tuple[str, str]], tmp_path: Path
) -> None:
    """Friction that mostly sticks, a stop of which only a curve shows the stroke, and second causes that add little."""
    envelope = draw_other(kind, size, seed, soil=0.0, rest=kind == "two")
    write(tmp_path / "sealed.h5", replace(envelope.campaign, description=described(envelope)))
    found = findings_of(tmp_path / "sealed.h5", tmp_path / "out")
    assert found["verdict"] == "explained"
    assert {(step["kind"], step["location"]) for step in found["steps"]} == named
