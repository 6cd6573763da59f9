"""rig design of any rig: a plan names the parameters that may vary and the target."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from isorig.analysis.simulate.move_profile import Move, head_acceleration
from isorig.rig.cli import main
from isorig.rig.files.rigfile import read_rig
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.stroke import lowest_inside, stroke_study

VARY = '[[vary]]\nparameter = "{}"\nlow = {}\nhigh = {}\n'
STIFFER = VARY.format("links.absorber.stiffness", 1, 2)
#: An undamped platform with an absorber of a twentieth of its mass.
UNDAMPED = """
name = "platform"
bodies = [{ name = "platform", mass = 60.0 }, { name = "absorber", mass = 3.0 }]
links = [
  { name = "legs", a = "platform", b = "ground", stiffness = 150000.0 },
  { name = "absorber", a = "absorber", b = "platform", stiffness = 5000.0, damping = 10.0 },
]
drive = { channel = "shaker", quantity = "force", pushes = { platform = 1.0 } }
sensors = [{ channel = "x", body = "platform", quantity = "displacement" }]
usual = { excitation = "multisine", level = 60.0, band = [0.5, 60.0], seconds = 80.0, sample_rate = 256.0 }
"""


def designed(folder: Path, plan: str, *words: str) -> dict[str, object]:
    (folder / "plan.toml").write_text(plan)
    assert main(["design", str(folder / "plan.toml"), *words, "-o", str(folder / "o")]) == 0
    found: dict[str, object] = json.loads((folder / "o" / "design.json").read_text())
    return found


def test_the_best_absorber_is_that_of_theory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "rig.toml").write_text(UNDAMPED)
    vary = VARY.format("links.absorber.stiffness", 3000, 12000) + VARY.format("links.absorber.damping", 5, 150)
    found = designed(tmp_path, f'[target]\nwhat = "rms"\n{vary}', "--model", str(tmp_path / "rig.toml"), "--points", "32")
    said = capsys.readouterr().out
    assert "rms of x" in said
    assert "heatblock" not in said
    # Warburton (1982), Table 1: random force, smallest variance of the displacement.
    mu, omega = 0.05, 50.0
    tuned = omega * np.sqrt(1.0 + mu / 2.0) / (1.0 + mu)
    ratio = np.sqrt(mu * (1.0 + 0.75 * mu) / (4.0 * (1.0 + mu) * (1.0 + mu / 2.0)))
    best = {name: row["best"] for name, row in found["parameters"].items()}  # type: ignore[attr-defined]
    assert best["links.absorber.stiffness"] == pytest.approx(3.0 * tuned**2, rel=0.03)
    assert best["links.absorber.damping"] == pytest.approx(6.0 * ratio * tuned, rel=0.1)
    rewritten = read_rig(tmp_path / "o" / "designed.toml").model
    assert rewritten.get("links.absorber.stiffness") == pytest.approx(best["links.absorber.stiffness"], rel=1e-6)
    for name in ("sweeps.png", "response.png"):
        assert (tmp_path / "o" / name).stat().st_size > 10_000
    rows = np.genfromtxt(tmp_path / "o" / "sweep-links.absorber.stiffness.csv", delimiter=",", names=True)
    assert rows["target"].min() == pytest.approx(found["best"]["target"], rel=0.01)  # type: ignore[index]


def test_the_wire_bonder_is_one_of_the_rigs(tmp_path: Path) -> None:
    """The same limit and moves as in the study of moves: the limit is reached at the same lowest frequency."""
    moves = [Move(distance=0.003, acceleration=166.7, pause=0.05)] * 4
    study = stroke_study(
        [wire_bonder()], np.geomspace(0.5, 6.0, 60), head_acceleration(moves, 2048.0), 2048.0, limit=0.004, safety=1.25
    )
    plan = "safety = 1.25\n" + VARY.format("links.isolation.frequency", 0.5, 6.0)
    plan += "[[moves]]\ndistance = 0.003\nacceleration = 166.7\npause = 0.05\nrepeat = 4\n"
    plan += '[target]\nwhat = "ratio"\nresponse = "heatblock"\nband = [8.0, 50.0]\n[limits.stroke]\nisolation = 0.004\n'
    found = designed(tmp_path, plan, "--points", "60")
    row = found["parameters"]["links.isolation.frequency"]  # type: ignore[index]
    assert row["unit"] == "Hz"
    rows = np.genfromtxt(tmp_path / "o" / "sweep-links.isolation.frequency.csv", delimiter=",", names=True)
    share = rows["the_deflection_of_isolation"]
    assert lowest_inside(rows["value"], share, 1.0) == pytest.approx(study.lowest, rel=5e-3)
    inside = share <= 1.0
    assert found["best"]["inside"] is True  # type: ignore[index]
    assert found["best"]["target"] <= rows["target"][inside].min()  # type: ignore[index]


def test_uncertainties_and_bounds_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    row = {"value": 150000.0, "std": 3000.0, "unit": "N/m", "method": "joint fit", "note": ""}
    content = {"format": "rig-parameters", "format_version": 1, "parameters": {"links.legs.stiffness": row}}
    (tmp_path / "parameters.json").write_text(json.dumps(content))
    plan = VARY.format("links.absorber.damping", 100, 200) + "[drive]\nseconds = 5.0\n"
    words = ("--model", "absorber", "--parameters", str(tmp_path / "parameters.json"), "--points", "8", "--draws", "10")
    found = designed(tmp_path, plan, *words)
    assert "is at a bound of its range" in capsys.readouterr().out
    low, high = found["best_of_drawn"]  # type: ignore[misc]
    assert low < found["best"]["target"] < high  # type: ignore[index]
    plan += "[limits.stroke]\nabsorber = 1e-6\n"
    assert designed(tmp_path, plan, *words[:2], "--points", "4")["best"]["inside"] is False  # type: ignore[index]
    assert "keeps all limits" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        (VARY.format("links.absorbr.stiffness", 1, 2), "the rig has no parameter"),
        (VARY.format("links.absorber.stiffness", 2, 1), "0 < low < high"),
        (VARY.format("links.absorber.stiffness", -1, 1), "0 < low < high"),
        (VARY.format("sensors.platform.chain.gain", 1, 2), "not a property of the rig"),
        (STIFFER + "[target]\nresponse = 'motor'", "does not have; it has shaker, platform"),
        (STIFFER + "[target]\nwhat = 'ratio'\nconfigurations = ['locked']", "2 of unlocked"),
        (STIFFER + "[target]\nband = [5.0, 900.0]", "at most 256"),
        (STIFFER + "[limits.stroke]\nmotor = 1.0", "it has legs, absorber"),
        (STIFFER + "[drive]\nlevels = 1.0", "levels"),
        (STIFFER + "[[moves]]\ndistance = 1\nacceleration = 1\npause = 1", "shaker (force)"),
        ("safety = 0.5\n" + STIFFER, "safety is 0.5"),
        ("vary = []\n", "vary is empty"),
        ("limit = 1.0\n", "has no [[vary]]"),
    ],
)  # fmt: skip
def test_mistakes_are_said(plan: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "plan.toml").write_text(plan)
    assert main(["design", str(tmp_path / "plan.toml"), "--model", "absorber", "-o", str(tmp_path / "o")]) == 2
    error = capsys.readouterr().err
    assert said in " ".join(error.split())
    assert not (tmp_path / "o").exists()
