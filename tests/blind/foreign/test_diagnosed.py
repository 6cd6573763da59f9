"""The counts of whole diagnoses of foreign campaigns: what is right, and a table that continues where it ended."""

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from diagnosed import COLUMNS, Line, append, diagnosed, group_of, judged, lines_of, table
from foreign_campaign import Setting, draw

from isorig.analysis.diagnose import diagnosis, required_force
from isorig.analysis.diagnose.required_force import shown_by_force
from isorig.analysis.diagnose.search import Job
from isorig.analysis.diagnose.step import Found
from isorig.analysis.equations.forms import ElementForce
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


def test_the_share_of_a_force_that_a_cause_removes_is_one_of_mean_squares() -> None:
    """Half of the force without the cause, a tenth with it: a twenty-fifth of the mean square is left."""
    shown = required_force.ShownByForce(found=cast(Found, None), before=0.5, after=0.1, noise=0.0, reason="")
    assert shown.share == pytest.approx(1.0 - 1.0 / 25.0)


@dataclass(frozen=True)
class Sensitive:
    """A campaign that no simulation can follow: its play in m, its diagnosis, and the job whose force is asked for the cause."""

    clearance: float
    found: diagnosis.Diagnosis
    job: Job


@pytest.fixture(scope="module")
def sensitive(tmp_path_factory: pytest.TempPathFactory) -> Sensitive:
    """A large play below a shaken stage, and half of that: the true rig's simulation soon leaves the record."""
    folder = tmp_path_factory.mktemp("sensitive")
    assert draw("base", 2665, Setting(severity=None, soiled=None, effects=None), folder) is not None
    truth = json.loads((folder / "2665.json").read_text())
    campaign, jobs = read(folder / "2665.h5"), []
    campaign = replace(campaign, runs=campaign.runs[:2])

    def shown(job: Job, *, searched: bool) -> required_force.ShownByForce | None:
        jobs.append(job)
        return shown_by_force(job, searched=searched)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(diagnosis, "shown_by_force", shown)
        found = diagnosis.diagnose(campaign, baseline_model(campaign))
    return Sensitive(float(truth["effects"][0]["parameters"]["clearance"]), found, jobs[0])


def test_play_whose_motion_no_simulation_can_follow_is_named(sensitive: Sensitive) -> None:
    found, true = sensitive.found, sensitive.clearance
    assert [(step.cause, step.location) for step in found.steps] == [("backlash", "lower")]
    assert found.verdict == "explained"
    value, std, _ = found.steps[0].parameters["clearance"]
    assert abs(value - true) < 5e-4 * true
    assert abs(value - true) < 4.0 * std < 2e-3 * true
    assert found.required_force is not None
    assert found.required_force.after < 0.01 < found.required_force.before


def test_the_required_force_must_show_enough(sensitive: Sensitive, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the thresholds: of the noise floor, of the force that the baseline leaves, and of that which the cause leaves."""
    job = sensitive.job
    shown = shown_by_force(job, searched=False)
    assert shown is not None
    assert job.suspects is not None
    begun = job.suspects.started(shown.found.entry.candidate, job.current.free)[0]
    floor = float(np.median(job.allowed(begun)))
    limits = {"VISIBLE": shown.before, "REMAINS": shown.after / min(shown.before, 1.0), "SENSITIVE": floor}
    for name, at in limits.items():
        kept, lost = (0.9, 1.1) if name != "REMAINS" else (1.1, 0.9)
        for factor in (kept, lost):
            with monkeypatch.context() as changed:
                changed.setattr(required_force, name, factor * at)
                assert (shown_by_force(job, searched=False) is not None) is (factor == kept), name


@pytest.mark.parametrize("early", [True, False])
def test_samples_of_one_part_of_the_runs_measure_no_gain(
    sensitive: Sensitive, early: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Near reversals of a sliding contact no samples count, and in a fast part of a sweep reversals follow each other closely."""
    monkeypatch.setattr(ElementForce, "until", lambda self, share: np.full(len(self.force), early))
    assert shown_by_force(sensitive.job, searched=False) is None
