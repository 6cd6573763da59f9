"""The demo as a newcomer meets it: one command, a real port, and everything that it promises on disk."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from shortened import shortened

from isorig.rig.cli import main
from isorig.rig.files.recording import read, write
from isorig.rig.virtual import demo as virtual_demo
from isorig.rig.wire_bonder.description import THESIS

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal, which Windows has not")


@pytest.fixture(scope="module", params=[0.15, pytest.param(1.0, marks=pytest.mark.study)], ids=["a part of its length", "whole"])
def demo(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's folder, with runs of this share of their length."""
    folder = tmp_path_factory.mktemp("demo")
    plan = folder / "demo.toml"
    text = virtual_demo.PLAN.read_text(encoding="utf-8")
    lengths = re.compile(r"(?<=^seconds = )[\d.]+(?=$)", re.MULTILINE)
    plan.write_text(lengths.sub(lambda found: str(request.param * float(found[0])), text), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(virtual_demo, "PLAN", plan)
        assert main(["demo", "-o", str(folder / "demo-out")]) == 0
    return folder / "demo-out"


@pytest.mark.timeout(300)
def test_demo_measures_the_rig_s_parameters(demo: Path) -> None:
    campaign = read(demo / "campaign.h5")
    assert [(run.configuration, run.gain, run.excitation) for run in campaign.runs] == [
        ("unlocked", 70.0, "random"), ("unlocked", 70.0, "random"), ("unlocked", 35.0, "random"), ("unlocked", 7.0, "random"),
        ("unlocked", 70.0, "moves"), ("locked", 70.0, "random"), ("locked", 7.0, "random"),
    ]  # fmt: skip
    assert [run.repeat_of for run in campaign.runs] == [None, "u70", None, None, None, None, None]
    assert not any(run.gaps for run in campaign.runs)
    table = json.loads((demo / "parameters.json").read_text())["parameters"]
    for name, row in table.items():
        tolerance = 0.02 if name.endswith("damping") or name == "friction_force" else 0.005
        assert row["value"] == pytest.approx(THESIS[name], rel=tolerance)


def test_demo_writes_all_its_files(demo: Path) -> None:
    for name in ("report.html", "diagnosis/report.html", "isolation/isolation.png", "isolation/isolation.csv", "parameters.csv"):
        assert (demo / name).stat().st_size > 500, name
    assert len(list((demo / "frf").glob("*.csv"))) == 15
    findings = json.loads((demo / "diagnosis" / "findings.json").read_text())
    assert findings["verdict"] == "explained"
    assert [(step["cause"], step["location"]) for step in findings["steps"]] == [("coulomb_friction", "isolation")]
    assert findings["steps"][0]["parameters"]["friction_force"]["value"] == pytest.approx(THESIS["friction_force"], rel=0.02)
    # Without friction no stiffness makes the motor stick: the baseline's value is no sign of a wrong unit.
    assert findings["doubts"] == []
    assert not list(demo.glob("*.partial"))


def test_readme_example_runs(
    demo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    # The beginnings of two runs of the demo's recording.
    campaign = read(demo / "campaign.h5")
    two = tuple(run for run in campaign.runs if run.id in ("u70", "l7"))
    (tmp_path / "demo-out").mkdir()
    write(tmp_path / "demo-out" / "campaign.h5", shortened(replace(campaign, runs=two), 10.0))
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    assert len(code.strip().splitlines()) <= 12
    monkeypatch.chdir(tmp_path)
    exec(code, {})
    assert "friction_force" in capsys.readouterr().out
