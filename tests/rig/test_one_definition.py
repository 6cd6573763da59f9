"""One noise floor and one uncertainty of a value: report, characterize, diagnosis and fleet say the same of one recording."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

import isorig as iso
from isorig.analysis.wording import noise_alone
from isorig.rig.cli import main
from isorig.rig.files.recording import write
from isorig.rig.files.rigfile import read_rig
from isorig.rig.virtual.simulated_recording import described_campaign


@pytest.mark.parametrize("calibration", [0.0, 0.01])
def test_every_command_states_the_same(calibration: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = read_rig("two-carts")
    campaign = described_campaign(given, seed=4, seconds=20.0, truth=given.model)
    known = {**campaign.known, "calibration_std": calibration} if calibration else campaign.known
    (tmp_path / "data").mkdir()
    path = tmp_path / "data" / "a.h5"
    write(path, replace(campaign, known=known))
    assert main(["characterize", str(path), "-o", str(tmp_path / "c")]) == 0
    printed_table = capsys.readouterr().out
    assert main(["report", str(path), "-o", str(tmp_path / "r")]) == 0
    capsys.readouterr()
    assert main(["diagnose", str(path), "-o", str(tmp_path / "d")]) == 0
    said = capsys.readouterr().out
    tables = [json.loads((tmp_path / folder / "parameters.json").read_text())["parameters"] for folder in ("c", "r")]
    found = json.loads((tmp_path / "d" / "findings.json").read_text())
    diagnosed = found["baseline"]["parameters"]
    assert set(diagnosed) <= set(tables[0])
    for name, row in diagnosed.items():
        for table in tables:
            assert table[name]["value"] == pytest.approx(row["value"], abs=0.02 * row["std"]), name
            assert table[name]["std"] == pytest.approx(row["std"], rel=0.01), name
    if calibration:
        assert diagnosed["drive.factor"]["std"] > 0.005 * diagnosed["drive.factor"]["value"]
    # A value that was given has no uncertainty rather than one of zero.
    (row,) = re.findall(r"bodies.first.mass +(.*)", printed_table)
    assert tables[0]["bodies.first.mass"]["method"] == "given"
    assert row.split()[1:3] == ["kg", "given"]
    # The noise floor in a sentence of each.
    floor = 100.0 * found["holdout"]["noise_floor"]
    (told,) = re.findall(r"noise alone is (about [0-9.]+ %)", said)
    (printed,) = set(re.findall(r"noise alone (about [0-9]+[.][0-9]+ %)", (tmp_path / "r" / "report.html").read_text()))
    assert told == printed == noise_alone(found["holdout"]["noise_floor"])
    assert 100.0 * iso.characterize(iso.read(path)).floor == pytest.approx(floor, rel=0.01)
