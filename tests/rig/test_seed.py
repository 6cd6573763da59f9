"""The parameter table seeds isolation, simulation and design, by the joint fit and by half-power."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from isorig.rig.cli import main
from isorig.rig.files.parameter_table import drive_levels, read_parameters
from isorig.rig.files.recording import read, write
from isorig.rig.virtual.levels import HEAD_PER_GAIN, MOVE_PER_GAIN
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.parameters import OF_THESIS, read_rig_values
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

#: A rig that is not the thesis's, so that a value of the thesis's shows where it does not belong.
OTHER = {**THESIS, "head_mass": 5.0, "table_mass": 110.0, "motor_frequency": 4.4, "friction_force": 9.0}
TAKES = (
    VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=24.0, start=0.0, per_gain=1.5 * HEAD_PER_GAIN),
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=16.0, start=40.0, band=(0.5, 400.0)),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=16.0, start=80.0, per_gain=1.5 * HEAD_PER_GAIN),
    VirtualRun(id="l7", configuration="locked", gain=7.0, seconds=16.0, start=120.0, band=(0.5, 400.0)),
    VirtualRun(id="um", configuration="unlocked", gain=70.0, seconds=6.0, start=160.0, excitation="moves"),
)
MOVES = Path(__file__).parents[2] / "fixtures_data" / "moves.toml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("seed")
    write(path / "campaign.h5", virtual_campaign(wire_bonder(OTHER), TAKES, seed=4))
    assert main(["characterize", str(path / "campaign.h5"), "-o", str(path / "parameters")]) == 0
    return path


@pytest.fixture
def table(folder: Path) -> Path:
    return folder / "parameters" / "parameters.json"


def test_the_joint_fit_seeds_the_rig_that_was_measured(table: Path) -> None:
    seed = read_rig_values(table)
    assert seed.assumed == ()
    for name, value in OTHER.items():
        assert seed.values[name] == pytest.approx(value, rel=0.01), name
    assert read_rig_values(None) is OF_THESIS
    drawn = list(seed.drawn(40, 1))
    spread = np.std([rig.body("table").mass for rig in drawn])
    assert spread == pytest.approx(seed.stds["table_mass"], rel=0.4)


def test_the_drive_was_measured_not_assumed(table: Path, folder: Path) -> None:
    file = read_parameters(table)
    by_kind = {(level.gain, level.excitation): level for level in file.levels}
    assert by_kind[70.0, "random"].value == pytest.approx(1.5 * 3.8, rel=0.02)
    assert 0.0 < by_kind[70.0, "random"].std < 0.2 * by_kind[70.0, "random"].value
    assert by_kind[70.0, "moves"].value == pytest.approx(70.0 * MOVE_PER_GAIN, rel=0.05)
    assert by_kind[70.0, "moves"].measure == "peak"
    assert drive_levels(read(folder / "campaign.h5"), "head") == file.levels
    seed = read_rig_values(table)
    assert seed.level(35.0, "random") == pytest.approx(0.5 * 1.5 * 3.8, rel=0.02)
    assert seed.level(35.0, "sweep") is None


def test_half_power_counts_friction_as_damping_and_says_what_stands_in(table: Path) -> None:
    joint, half = read_rig_values(table), read_rig_values(table, "half-power")
    assert half.values["motor_damping"] > 1.3 * joint.values["motor_damping"]
    assert half.values["heatblock_frequency"] == pytest.approx(THESIS["heatblock_frequency"], rel=0.01)
    refused = [note for note in half.remarks if "Half-power is not applicable" in note]
    file = read_parameters(table)
    assert len(refused) == sum(not item.half_power for item in file.read_off.values())
    assert file.surface is not None
    assert half.values["table_mass"] == file.surface[0][0]


def test_isolation_shows_both_with_the_measured_ratio(folder: Path, table: Path, tmp_path: Path) -> None:
    out = tmp_path / "iso"
    assert main(["isolation", str(folder / "campaign.h5"), "--parameters", str(table), "-o", str(out)]) == 0
    with (out / "isolation.csv").open() as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    low = [row for row in rows if 5.0 < row["frequency_hz"] < 15.0]
    off = {
        name: np.median([abs(np.log(row[f"ratio_{name}"] / row["ratio_measured"])) for row in low])
        for name in ("joint_fit", "half_power")
    }
    assert off["joint_fit"] < 0.01
    assert off["half_power"] > 5.0 * off["joint_fit"]
    told = json.loads((out / "isolation.json").read_text())
    assert set(told["isolated"]) == {"measured", "joint fit", "half-power"}
    measured = told["isolated"]["measured"]
    assert 0.0 < measured["share"] < 1.0
    assert told["isolated"]["joint fit"]["share"] == pytest.approx(measured["share"], abs=2.0 * measured["std"])
    one = tmp_path / "one"
    call = ["isolation", str(folder / "campaign.h5"), "--parameters", str(table), "--method", "half-power", "-o", str(one)]
    assert main(call) == 0
    assert set(json.loads((one / "isolation.json").read_text())["isolated"]) == {"measured", "half-power"}


def test_simulate_is_of_that_rig_at_that_level(table: Path, tmp_path: Path) -> None:
    path = tmp_path / "again.h5"
    call = ["simulate", "--parameters", str(table), "--gain", "70", "--seconds", "20", "--band", "0.5", "20", "-o", str(path)]
    assert main(call) == 0
    (run,) = read(path).runs
    assert run.read("head").std() == pytest.approx(1.5 * 3.8, rel=0.03)
    sliding = np.abs(run.read("isolation_friction"))[run.read("isolation_held") < 0.01]
    assert np.median(sliding) == pytest.approx(OTHER["friction_force"], rel=0.02)


def test_design_draws_from_the_table(table: Path, tmp_path: Path) -> None:
    profile = tmp_path / "moves.toml"
    text = MOVES.read_text()
    profile.write_text(text[: text.index("[head]")] + text[text.index("[[moves]]") :])
    call = ["design", str(profile), "--parameters", str(table), "--points", "5", "--draws", "2", "-o", str(tmp_path / "out")]
    assert main(call) == 0
    told = json.loads((tmp_path / "out" / "design.json").read_text())
    assert told["present_frequency_hz"] == pytest.approx(OTHER["motor_frequency"], rel=0.01)
    assert told["assumed"] == []
    cases = told["bond"]["cases"]
    assert len(cases) == 3
    assert all(case["largest_m"] < 2e-6 for case in cases.values())


def test_what_the_table_lacks_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "parameters.json"
    row = {"value": 16.4, "std": 0.1}
    path.write_text(json.dumps({"format": "rig-parameters", "parameters": {"motor_mass": row}}))
    seed = read_rig_values(path)
    assert "head_mass" in seed.assumed
    assert "motor_mass" not in seed.assumed
    assert main(["simulate", "--parameters", str(path), "--seconds", "2", "-o", str(tmp_path / "x.h5")]) == 0
    assert "the thesis's values are assumed: head mass 6.5" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (["simulate", "--parameters", "{table}", "--model", "one-mass", "-o", "{out}"], "--model and --parameters"),
        (["simulate", "--parameters", "{bad}", "--method", "half-power", "-o", "{out}"], "half-power needs"),
        (["isolation", "{file}", "--method", "half-power", "-o", "{out}"], "--parameters"),
        (["isolation", "{file}", "--parameters", "{file}", "-o", "{out}"], "parameter table"),
    ],
)
def test_refusals(
    folder: Path, table: Path, tmp_path: Path, call: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    bad, out = tmp_path / "bad.json", tmp_path / "out"
    bad.write_text(json.dumps({"format": "rig-parameters", "parameters": {"motor_mass": {"value": 1.0, "std": 0.1}}}))
    places = {"table": table, "file": folder / "campaign.h5", "bad": bad, "out": out}
    assert main([word.format(**places) for word in call]) == 2
    told = capsys.readouterr().err.strip()
    assert named in told
    assert len(told.splitlines()) == 1
    assert not out.exists()


@pytest.mark.study
def test_without_a_head_mass_the_table_has_it_fitted(folder: Path, tmp_path: Path) -> None:
    campaign = read(folder / "campaign.h5")
    known = {name: value for name, value in campaign.known.items() if name != "head_mass"}
    path = tmp_path / "unweighed.h5"
    write(path, replace(campaign, known=known, runs=campaign.runs[:4:3]))
    assert main(["characterize", str(path), "-o", str(tmp_path / "p")]) == 0
    seed = read_rig_values(tmp_path / "p" / "parameters.json")
    assert seed.values["head_mass"] == pytest.approx(OTHER["head_mass"], rel=2e-3)
    assert seed.stds["head_mass"] > 0.0
