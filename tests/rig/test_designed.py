"""rig design from its file to its folder, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from isorig.rig.cli import main

ROOT = Path(__file__).resolve().parents[2]
PROFILE = ROOT / "fixtures_data" / "moves.toml"


def test_folder(tmp_path: Path) -> None:
    table = {
        "motor_mass": {"value": 16.4, "std": 0.1},
        "friction_force": {"value": 20.0, "std": 1.0},
        "table_mass": {"value": None},
    }
    parameters = tmp_path / "parameters.json"
    parameters.write_text(json.dumps({"format": "rig-parameters", "parameters": table}))
    out = tmp_path / "out"
    words = ["design", str(PROFILE), "--parameters", str(parameters), "--points", "30", "--draws", "20", "-o", str(out)]
    assert main(words) == 0
    assert {path.name for path in out.iterdir()} == {
        "design.json", "strokes.csv", "moves.csv", "histories.csv", "strokes.png", "histories.png", "ratio.png", "offset.png",
        "moves.png", "bond.png",
    }  # fmt: skip
    told = json.loads((out / "design.json").read_text())
    without, with_friction = told["studies"]["without friction"], told["studies"]["with friction"]
    # Friction holds the motor where a move left it, so soft springs do not bring it back between moves.
    assert without["lowest_hz"] < with_friction["lowest_hz"]
    assert without["std_hz"] > 0.0
    # The thesis's worst case: 0.6 Hz for a head of 6 to 7 kg.
    assert without["lowest_hz"] == pytest.approx(0.6, abs=0.05)
    ratios = list(told["median_ratio_5_to_15_hz"].values())
    # Present, soft with friction, soft without it: springs alone do not isolate against friction.
    assert ratios[2] < 0.1 < ratios[1] < ratios[0]
    # The table's file gives three of ten values, and what stands in is said.
    assert "head_mass" not in told["assumed"]
    assert "table_mass" in told["assumed"]
    soft = list(told["bond"]["cases"].values())[2]
    assert soft["largest_m"] < 2e-6
    assert soft["settling_s"] == 0.0


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("limit = 0.005", "limit = -1.0", "limit"),
        ("repeat = 10", "repeat = 0", "moves"),
        ('shape = "sine"', 'shape = "square"', "shape"),
        ("frequencies = [0.3, 6.0]", "frequencies = [6.0, 0.3]", "low < high"),
        ("mass = 6.5", "mass = -6.5", "mass"),
        ("safety = 1.0", "speed = 1.0", "speed"),
        ("safety = 1.0", "shown = 60.0", "shown is 60"),
        ("[head]", "[bond]\nseconds = 0.0\n\n[head]", "bond.seconds"),
        ("[head]", "[head", "TOML"),
        ("acceleration = 166.7", "acceleration = 1e9", "samples"),
    ],
)
def test_refusals(tmp_path: Path, old: str, new: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = PROFILE.read_text()
    assert old in text
    path = tmp_path / "moves.toml"
    path.write_text(text.replace(old, new))
    assert main(["design", str(path), "--points", "5", "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_parameters_must_be_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = tmp_path / "p.json"
    for text in ("[]", "{", '{"format": "rig-parameters", "parameters": {}}', '{"format": "x"}'):
        bad.write_text(text)
        assert main(["design", str(PROFILE), "--parameters", str(bad), "-o", str(tmp_path / "out")]) == 2
        assert "parameter table" in capsys.readouterr().err
