"""rig demo --investigate: from nothing measured to the name of what is hidden, through a real port."""

import json
from pathlib import Path

import pytest

from isorig.rig.cli import main
from isorig.rig.files.recording import read


def test_a_folder_with_other_content_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "investigation").mkdir()
    (tmp_path / "investigation" / "notes.txt").write_text("mine")
    assert main(["demo", "--investigate", "-o", str(tmp_path)]) == 2
    assert "is not an investigation" in capsys.readouterr().err
    assert (tmp_path / "investigation" / "notes.txt").read_text() == "mine"


@pytest.mark.study
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", [1, 2])
def test_the_demo_finds_what_it_hides(seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--investigate", "--seed", str(seed), "-o", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "Identified cause: end stop at isolation." in said
    folder = tmp_path / "investigation"
    state = json.loads((folder / "investigation.json").read_text())
    runs = [run["plan"]["id"] for stage in state["stages"] for run in stage["runs"]]
    assert [run.id for run in read(folder / "recording.h5").runs] == runs
    assert len(runs) <= 6
    page = (folder / "report.html").read_text()
    assert "Identified cause: end stop at isolation." in page
    assert all(run in page for run in runs)
