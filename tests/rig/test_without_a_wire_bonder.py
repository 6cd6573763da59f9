"""General commands for a rig that is no wire bonder: no head, no lock, no Coulomb baseline."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from strange_rigs import StrangeRig, campaign

import isorig as iso
from isorig.analysis.campaign import Campaign
from isorig.rig.cli import main
from isorig.rig.files.rigfile import description_text
from isorig.rig.view.snapshot import Snapshot, SnapshotBuilder
from isorig.rig.view.sources import Reading

RIG = StrangeRig(masses=(4.0,), joints=((0, -1, 4e3, 12.0),), sensors=(("x", 0, "displacement"),), drive="shaker")


@pytest.fixture(scope="module")
def measured() -> Campaign:
    return replace(campaign(RIG, (20.0,), seconds=12.0), description=description_text(RIG.description(), {}))


def test_the_reference_is_the_rigs_drive(measured: Campaign) -> None:
    (found,) = iso.frf(measured, resolution=1.0)
    assert (found.frf.reference, found.frf.response) == ("shaker", "x")


def test_the_configuration_is_the_rigs_first() -> None:
    from isorig.analysis.model.rig_model import Configuration

    model = msgspec.structs.replace(RIG.description(), configurations={"as built": Configuration()})
    drive = iso.Excitation.prepare(campaign(RIG, (20.0,), seconds=2.0).runs[0].read("shaker"), 256.0)
    assert iso.simulate(model, drive).channels["x"].std() > 0.0
    assert iso.trace(model, drive).held == {}


def test_the_screen_has_no_ratio(measured: Campaign) -> None:
    shown: list[Snapshot] = []
    SnapshotBuilder(judge=True).see(Reading(campaign=measured, whole=frozenset({"r0"})), shown.append)
    assert shown[-1].isolated == ""


def test_the_baseline_is_the_description(measured: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    iso.write(tmp_path / "a.h5", measured)
    assert main(["check", str(tmp_path / "a.h5")]) == 0
    assert "unlocked" not in capsys.readouterr().out
    assert main(["diagnose", str(tmp_path / "a.h5"), "-o", str(tmp_path / "d")]) == 0
    assert '"name":"description"' in (tmp_path / "d" / "findings.json").read_text().replace(" ", "")


def test_one_configuration_needs_no_name(measured: Campaign, tmp_path: Path) -> None:
    (found,) = iso.frf(measured, resolution=1.0)
    assert found.label == "gain 20"
    iso.write(tmp_path / "a.h5", measured)
    assert main(["report", str(tmp_path / "a.h5"), "-o", str(tmp_path / "r")]) == 0
    pages = "".join(page.read_text() for page in tmp_path.rglob("*.html"))
    assert "at gain 20" in pages
    assert "unlocked, gain" not in pages
    assert "Unlocked at gain" not in pages


#: Words of the wire bonder. Stored data name every run's configuration, and the catalogue has Coulomb friction.
ITS_WORDS = re.compile(r"\b(un)?locked\b|\bhead\b|bonder|heatblock|\bthesis\b|single configuration", re.IGNORECASE)
MAPPING = """
description = "rig.toml"
[channels.shaker]
source = "F"
unit = "N"
[channels.x]
source = "x"
unit = "m"
[[runs]]
id = "first"
file = "a.csv"
gain = 20.0
excitation = "random"
band = [0.5, 40.0]
time = "t"
"""


def seen(page: str) -> str:
    """What a reader of a page sees: its text, and the data of its charts."""
    text = re.sub(r"<style.*?</style>", " ", page, flags=re.DOTALL)
    text = re.sub(r"<script(?![^>]*application/json).*?</script>", " ", text, flags=re.DOTALL)
    return re.sub(r"<[^>]*>", " ", text)


def test_no_command_speaks_of_a_wire_bonder(
    measured: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """From columns of numbers to an answer and the next run, with a rig that has no locks."""
    monkeypatch.setattr(sys, "argv", ["rig"])  # pages contain the command, here the name of this file
    (run,) = measured.runs
    rows = zip((k / run.sample_rate for k in range(len(run))), run.read("shaker"), run.read("x"), strict=True)
    (tmp_path / "a.csv").write_text("t,F,x\n" + "\n".join(f"{t:.9g},{f:.9g},{x:.9g}" for t, f, x in rows))
    (tmp_path / "m.toml").write_text(MAPPING)
    (tmp_path / "rig.toml").write_text(measured.description or "")
    out = tmp_path / "out"
    out.mkdir()
    c, d = str(tmp_path / "c.h5"), str(out / "d")
    for words in (
        ["import", "--draft", str(tmp_path / "a.csv"), "-o", str(out / "draft.toml")],
        ["import", str(tmp_path / "m.toml"), "-o", c], ["check", c], ["describe", str(tmp_path / "rig.toml")],
        ["characterize", c, "-o", str(out / "p")], ["frf", c, "-o", str(out / "f")], ["isolation", c, "-o", str(out / "i")],
        ["modes", c, "--band", "1", "20", "-o", str(out / "modes")], ["export", c, "-o", str(out / "x.csv")],
        ["report", c, "-o", str(out / "r")], ["diagnose", c, "-o", d], ["next", d, "-o", str(out / "n.toml")],
    ):  # fmt: skip
        assert main(words) == 0, words
    said = capsys.readouterr()
    told = {"terminal": said.out + said.err}
    told |= {str(file.relative_to(out)): str(file.relative_to(out)) for file in out.rglob("*")}
    told |= {
        f"{file.name}:": file.read_text() for end in ("csv", "toml") for file in out.rglob(f"*.{end}") if file.name != "n.toml"
    }
    told |= {f"{file.parent.name}/{file.name}": seen(file.read_text()) for file in out.rglob("*.html")}
    found = {name: text[max(at.start() - 40, 0) : at.end() + 40] for name, text in told.items() if (at := ITS_WORDS.search(text))}
    assert not found
    assert not ITS_WORDS.search(repr(run))


def test_a_rig_with_locks_needs_the_configuration_of_every_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "m.toml").write_text(MAPPING.replace('description = "rig.toml"', ""))
    assert main(["import", str(tmp_path / "m.toml"), "-o", str(tmp_path / "c.h5")]) == 2
    assert "run 'first' states no configuration; wire bonder has unlocked, locked" in capsys.readouterr().err
