"""General commands for a rig that is no wire bonder: no head, no lock, no Coulomb baseline."""

from __future__ import annotations

from pathlib import Path

import pytest
from strange_rigs import StrangeRig, campaign

import isorig as iso
from isorig.analysis.campaign import Campaign
from isorig.rig.cli import main
from isorig.rig.files.rigtext import description_text
from isorig.rig.view.snapshot import Board, Picture
from isorig.rig.view.sources import Reading

RIG = StrangeRig(masses=(4.0,), joints=((0, -1, 4e3, 12.0),), sensors=(("x", 0, "displacement"),), drive="shaker")


@pytest.fixture(scope="module")
def measured() -> Campaign:
    from dataclasses import replace

    return replace(campaign(RIG, (20.0,), seconds=12.0), description=description_text(RIG.description(), {}))


def test_the_reference_is_the_rigs_drive(measured: Campaign) -> None:
    (found,) = iso.frf(measured, resolution=1.0)
    assert (found.frf.reference, found.frf.response) == ("shaker", "x")


def test_the_configuration_is_the_rigs_first() -> None:
    from msgspec.structs import replace

    from isorig.analysis.model.rig_model import Configuration

    model = replace(RIG.description(), configurations={"as built": Configuration()})
    drive = iso.Excitation.prepare(campaign(RIG, (20.0,), seconds=2.0).runs[0].read("shaker"), 256.0)
    assert iso.simulate(model, drive).channels["x"].std() > 0.0
    assert iso.trace(model, drive).held == {}


def test_the_screen_has_no_ratio(measured: Campaign) -> None:
    shown: list[Picture] = []
    Board(judge=True).see(Reading(campaign=measured, whole=frozenset({"r0"})), shown.append)
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
