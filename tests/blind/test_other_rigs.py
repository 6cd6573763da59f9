"""Rigs that are no wire bonder, measured by others: a carriage on a guide, and an electronic mass on a hardening spring."""

import json
from pathlib import Path

import numpy as np
import pytest
from shortened import shortened

from isorig.rig.cli import main
from isorig.rig.files.recording import read, write
from isorig.rig.files.rigfile import read_model
from isorig.rig.model.prediction import predicted

ROOT = Path(__file__).parents[2]
MEASURED = ROOT.parent / "shared" / "measured"
MAPPINGS = ROOT / "fixtures_data" / "mappings"
pytestmark = pytest.mark.skipif(not MEASURED.is_dir(), reason="the measured data of other rigs are not on this machine")


def diagnosed(name: str, folder: Path, seconds: float = np.inf) -> dict[str, object]:
    """The findings in at most so many seconds of each run."""
    recording = folder / f"{name}.h5"
    assert main(["import", str(MAPPINGS / f"{name}.toml"), "--data", str(MEASURED / name), "-o", str(recording)]) == 0
    if seconds < np.inf:
        write(recording, shortened(read(recording), seconds))
    assert main(["diagnose", str(recording), "-o", str(folder / "out")]) == 0
    return json.loads((folder / "out" / "findings.json").read_text())


@pytest.mark.timeout(300)
@pytest.mark.parametrize("seconds", [8.0, pytest.param(np.inf, marks=pytest.mark.study)])
def test_positioning_system(seconds: float, tmp_path: Path) -> None:
    """Dry friction that depends on the direction, and nothing after that; published: 17.0 / 16.9, 4.04 / 5.95, 3.06 / 5.34 %."""
    findings = diagnosed("emps", tmp_path, seconds)
    steps = findings["steps"]
    assert [step["cause"] for step in steps] == ["asymmetric_friction"]
    assert findings["verdict"] in ("explained", "partly explained")
    assert steps[0]["holdout_error_before"] == pytest.approx(0.17, abs=0.005)
    forces = [steps[0]["parameters"][f"{way}_force"]["value"] for way in ("forward", "backward")]
    assert np.mean(forces) == pytest.approx(20.4, abs=0.6)
    # A third of the runs has fewer samples for the fit.
    assert findings["holdout"]["extended"] < 0.5 * (0.031 + 0.054) + (0.0005 if seconds == np.inf else 0.003)
    model, _, _ = read_model(tmp_path / "out" / "model.json")
    law = model.contact("guide").law
    assert model.body("carriage").mass == pytest.approx(95.15, rel=0.005)
    assert model.link("guide").damping + law.backward_viscosity == pytest.approx(240.4, rel=0.02)
    assert model.link("guide").damping + law.forward_viscosity == pytest.approx(166.7, rel=0.02)


@pytest.mark.study
@pytest.mark.timeout(300)
def test_silverbox(tmp_path: Path) -> None:
    """A hardening spring and nothing else; published free-run errors on the arrow: linear 14.2 mV, cubic 0.38 mV."""
    findings = diagnosed("silverbox", tmp_path)
    assert findings["verdict"] == "explained"
    assert [(step["cause"], step["location"]) for step in findings["steps"]] == [("hardening_stiffness", "spring")]
    campaign = read(tmp_path / "silverbox.h5")
    model, origin, _ = read_model(tmp_path / "out" / "model.json")
    said = predicted(model, campaign, origin=origin, as_recorded=True)
    arrow, guess = (next(run for run in c.runs if run.id == "arrow").read("position") for c in (campaign, said))
    assert np.sqrt(np.mean((arrow - guess) ** 2)) < 0.6e-3


@pytest.mark.timeout(300)
@pytest.mark.parametrize("seconds", [14.0, pytest.param(np.inf, marks=pytest.mark.study)])
def test_friction_damper(seconds: float, tmp_path: Path) -> None:
    """Play, a spring and friction in a row; a model of the three made by hand leaves 13 to 21 % of the force."""
    findings = diagnosed("brfd", tmp_path, seconds)
    assert findings["verdict"] == "explained"
    assert [(step["cause"], step["kind"]) for step in findings["steps"]] == [("play_and_friction", "memory")]
    assert findings["holdout"]["baseline"] > 0.7
    assert findings["holdout"]["extended"] < 0.2
    model, _, _ = read_model(tmp_path / "out" / "model.json")
    (row,) = model.link("damper").laws
    assert 0.001 < row.clearance < 0.004
    assert 9e3 < row.slip_force < 11e3
