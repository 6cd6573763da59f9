"""Two sampling rates in one recording: the commands take it as they take one of a single rate."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from isorig.rig.cli import main
from isorig.rig.files.recording import read, write
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.session import SESSION, virtual_campaign

SLOW = {"u70b", "l70"}


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some runs at 1024 samples/s, their repeat and the locked one at 2000."""
    takes = [replace(take, seconds=10.0) for take in SESSION if take.id in {"u70a", "u70b", "u7", "l70", "l7"}]
    fast = virtual_campaign(wire_bonder(), [take for take in takes if take.id not in SLOW], seed=1)
    slow = virtual_campaign(wire_bonder(), [take for take in takes if take.id in SLOW], seed=2, sample_rate=2000.0)
    path = tmp_path_factory.mktemp("mixed") / "mixed.h5"
    write(path, replace(fast, runs=fast.runs + slow.runs))
    return path


def test_quick_commands(mixed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(mixed)]) == 0
    told = capsys.readouterr().out
    assert " 1024 " in told
    assert " 2000 " in told
    assert main(["frf", str(mixed), "-o", str(tmp_path / "frf")]) == 0
    found = json.loads((tmp_path / "frf" / "frf.json").read_text())
    assert not found["faults"]
    averaged = [
        item["runs"] for item in found["transfer_functions"] if item["gain"] == 70.0 and item["configuration"] == "unlocked"
    ]
    assert averaged == [["u70a", "u70b"]] * 3
    assert main(["isolation", str(mixed), "-o", str(tmp_path / "isolation")]) == 0
    for ending in ("mat", "uff"):
        assert main(["export", str(mixed), "-o", str(tmp_path / f"samples.{ending}")]) == 0
    assert main(["import", "--draft", str(tmp_path / "samples.uff"), "-o", str(tmp_path / "m.toml")]) == 0
    assert main(["import", str(tmp_path / "m.toml"), "-o", str(tmp_path / "back.h5")]) == 0
    assert sorted(run.sample_rate for run in read(tmp_path / "back.h5").runs) == [1024.0] * 3 + [2000.0] * 2


@pytest.mark.study
def test_fits(mixed: Path, tmp_path: Path) -> None:
    """The virtual rig's own values come out of characterize, and nothing is left for a diagnosis."""
    assert main(["characterize", str(mixed), "-o", str(tmp_path / "c")]) == 0
    table = json.loads((tmp_path / "c" / "parameters.json").read_text())["parameters"]
    assert table["motor_frequency"]["value"] == pytest.approx(5.06, rel=1e-3)
    assert table["friction_force"]["value"] == pytest.approx(20.0, rel=1e-3)
    assert main(["diagnose", str(mixed), "-o", str(tmp_path / "d")]) == 0
    findings = json.loads((tmp_path / "d" / "findings.json").read_text())
    assert (findings["verdict"], findings["doubts"]) == ("adequate", [])
    assert main(["predict", str(tmp_path / "c" / "model.json"), str(mixed), "-o", str(tmp_path / "p.h5")]) == 0
    assert main(["report", str(mixed), "-o", str(tmp_path / "r")]) == 0
