"""The counts of whole diagnoses of foreign campaigns: what is right, and a table that continues where it ended."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from diagnosed import COLUMNS, Line, append, diagnosed, group_of, judged, lines_of, table
from foreign_campaign import Setting, draw

from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.rig.files.recording import read
from isorig.rig.model.baseline import baseline_model

HARDENING = {"effect": "fifth power", "cause": None, "kinds": ["spring_shape"], "place": "l0"}
GAIN = {"effect": "sensor_gain", "cause": "sensor_gain", "kinds": ["sensor"], "place": "a1"}


@pytest.mark.parametrize(
    ("effects", "steps", "verdict", "outcome"),
    [
        ([], [], "adequate", "right"),
        ([], [], "unexplained", "no name"),
        ([], [[("friction_shape", "rail")]], "explained", "disturbance"),
        ([], [[("sensor", "a1")]], "explained", "wrong"),
        ([HARDENING], [[("spring_shape", "l0")]], "explained", "right"),
        ([HARDENING], [[("memory", "l0"), ("spring_shape", "l0")]], "explained", "right"),
        ([HARDENING], [[("spring_shape", "l1")]], "explained", "wrong"),
        ([HARDENING], [[("friction_shape", "rail")]], "partly explained", "disturbance"),
        ([HARDENING], [], "unexplained", "no name"),
        ([HARDENING, GAIN], [[("spring_shape", "l0")], [("sensor", "a1")]], "explained", "right"),
        ([HARDENING, GAIN], [[("sensor", "a1")]], "partly explained", "one of two"),
        ([HARDENING, GAIN], [[("sensor", "a1")], [("added_motion", "m0")]], "explained", "wrong"),
    ],
)
def test_what_is_right(
    effects: list[dict[str, object]], steps: list[list[tuple[str, str]]], verdict: str, outcome: str
) -> None:  # fmt: skip
    truth: dict[str, object] = {"effects": effects, "disturbances": [["friction_shape", "rail"]]}
    assert judged(truth, steps, verdict) == outcome


def test_lines_are_read_again_and_counted_by_group(tmp_path: Path) -> None:
    truth: dict[str, object] = {"severity": 1 / 3, "soiled": True, "effects": [HARDENING]}
    lines = [
        Line(
            seed=seed, family="chain", group=group_of(truth), outcome=outcome, hidden="fifth power at l0", verdict="explained",
            named="end_stop at l0", processor_s=9.5,
        )
        for seed, outcome in ((1, "right"), (2, "wrong"), (3, "right"))
    ]  # fmt: skip
    for line in lines:
        append(tmp_path / "study.csv", COLUMNS, vars(line))
    assert lines_of(tmp_path / "study.csv") == lines
    group, *counts = table(lines).splitlines()[1].rsplit(maxsplit=5)
    assert (group.strip(), counts) == ("one cause, a third, 2 % of disturbances", ["2", "0", "0", "0", "1"])


@pytest.mark.study
@pytest.mark.timeout(600)
def test_a_wrong_gain_beside_play_is_not_taken_for_a_wrong_mass(tmp_path: Path) -> None:
    """A stage in a frame: the gain of the stage's sensor and the stage's mass change the frame's equation by a twelfth."""
    assert draw("stage", 1949, Setting(severity=None, soiled=None, effects=None), tmp_path) is not None
    line = diagnosed(tmp_path / "1949.h5", tmp_path / "1949.json")
    assert line.hidden == "backlash at rail; sensor_gain at x"
    assert line.outcome == "right"


def test_play_whose_motion_no_simulation_can_follow_is_named(tmp_path: Path) -> None:
    """A large play below a shaken stage: the true rig's simulation leaves the record within three periods."""
    assert draw("base", 2665, Setting(severity=None, soiled=None, effects=None), tmp_path) is not None
    campaign, truth = read(tmp_path / "2665.h5"), json.loads((tmp_path / "2665.json").read_text())
    found = diagnose(campaign, baseline_model(campaign))
    assert [(step.cause, step.location) for step in found.steps] == [("backlash", "lower")]
    assert found.verdict == "explained"
    value, std, _ = found.steps[0].parameters["clearance"]
    true = truth["effects"][0]["parameters"]["clearance"]
    assert abs(value - true) < 5e-4 * true
    assert abs(value - true) < 4.0 * std
    assert found.required_force is not None
    assert found.required_force.after < 0.01 < found.required_force.before
