"""A file whose units are read wrong: said first, in the terminal, the findings and the report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs
from strange_rigs import StrangeRig, campaign, dry, play

import isorig as iso
from isorig.analysis.model.rig_model import from_tree
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.excitation import random
from isorig.rig.cli import main
from isorig.rig.files.rigfile import description_text

RIG = """
name = "chain"
free = ["bodies.block.mass", "links.foot.stiffness", "links.foot.damping"]
bodies = [{ name = "block", mass = 10.0 }]
links = [{ name = "foot", a = "block", b = "ground", stiffness = 4e4, damping = 40.0 }]
drive = { channel = "force", quantity = "force", factor = 1.0, pushes = { block = 1.0 } }
sensors = [{ channel = "block", body = "block" }]
"""
MAPPING = """
description = "rig.toml"
[channels.force]
source = "force"
unit = "N"
[channels.block]
source = "block"
unit = "{unit}"
[[runs]]
id = "r"
file = "r.csv"
configuration = "unlocked"
gain = 1.0
time = "t"
excitation = "random"
band = [1.0, 60.0]
"""


@pytest.mark.parametrize(("unit", "said"), [("g", ""), ("m/s^2", "block were in g read as m/s^2")])
def test_g_read_as_metres(tmp_path: Path, unit: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    import tomllib

    rate = 512.0
    force = random(samples=4096, sample_rate=rate, rms=30.0, band=(1.0, 60.0), seed=1)
    rig = from_tree(tomllib.loads(RIG)).replace({"bodies.block.mass": 11.0})
    block = simulate(rig, Excitation.prepare(force, rate), configuration="unlocked").channels["block"]
    noise = np.random.default_rng(1).normal(0.0, 1e-3, len(block))
    table = np.column_stack([np.arange(len(force)) / rate, force, (block + noise) / 9.80665])
    np.savetxt(tmp_path / "r.csv", table, delimiter=",", header="t,force,block", comments="")
    (tmp_path / "rig.toml").write_text(RIG)
    (tmp_path / "m.toml").write_text(MAPPING.format(unit=unit))
    assert main(["import", str(tmp_path / "m.toml"), "-o", str(tmp_path / "c.h5")]) == 0
    capsys.readouterr()
    assert main(["diagnose", str(tmp_path / "c.h5"), "-o", str(tmp_path / "d")]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    findings = json.loads((tmp_path / "d" / "findings.json").read_text())
    page = (tmp_path / "d" / "report.html").read_text()
    assert bool(findings["doubts"]) == bool(said)
    assert ("Check units, channels and given values first" in page) == bool(said)
    if said:
        assert first.startswith("c: CHECK UNITS, CHANNELS AND GIVEN VALUES FIRST.")
        assert said in first
        assert findings["doubts"][0]["kind"] == "unit"
        assert findings["doubts"][0]["text"] in first
    else:
        assert first.startswith("c: adequate")


def test_no_cause_is_searched_for_in_wrong_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Play in the coupling of a rig whose force is in kN: the unit is the answer, and no candidate is fitted."""
    rig = StrangeRig(
        masses=(2.0, 3.0), joints=((0, -1, 6e3, 15.0), (1, 0, 9e3, 14.0)), laws={1: play(9e3, 4e-4)},
        sensors=(("a", 0, "acceleration"), ("b", 1, "acceleration")),
    )  # fmt: skip
    measured = campaign(rig, (25.0,), seconds=5.0)
    (run,) = measured.runs
    force = run.channels["force"]
    wrong = replace(run, channels={**run.channels, "force": replace(force, scale=1e-3 * force.scale)})
    given = description_text(rig.description({"links.l0.stiffness": 1.2, "links.l1.stiffness": 0.85}), {})
    iso.write(tmp_path / "c.h5", replace(measured, runs=(wrong,), description=given))
    assert main(["diagnose", str(tmp_path / "c.h5"), "-o", str(tmp_path / "d")]) == 0
    first, answer, *_ = capsys.readouterr().out.splitlines()
    assert "force were in kN read as N or a were in mm/s^2 read as m/s^2: check the unit of the drive channel force" in first
    assert "unexplained: no cause was searched for, because the records contradict the description" in answer
    findings = json.loads((tmp_path / "d" / "findings.json").read_text())
    assert all(candidate["holdout_error"] is None for candidate in findings["candidates"])


# Where nothing is wrong the whole search for causes follows; tests/analysis/test_wrong_scale.py has such records.
@pytest.mark.parametrize(
    ("described", "friction"),
    [("acceleration", 4.0), *(pytest.param("velocity", friction, marks=pytest.mark.study) for friction in (0.0, 4.0))],
)
def test_a_velocity_read_as_an_acceleration(
    described: str, friction: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With dry friction that the description lacks: the record's derivative is said first, and no cause is searched for."""
    rig = StrangeRig(
        masses=(2.0, 3.0), joints=((0, -1, 6e3, 15.0), (1, 0, 9e3, 14.0)), laws={1: dry(friction, 1e-3)},
        sensors=(("a", 0, "acceleration"), ("b", 1, "velocity")),
    )  # fmt: skip
    measured = campaign(rig, (25.0,), seconds=5.0)
    text = description_text(rig.description({"links.l0.stiffness": 1.2, "links.l1.stiffness": 0.85}), {})
    assert text.count('"velocity"') == 1
    (run,) = measured.runs
    if described == "acceleration":
        text = text.replace('"velocity"', '"acceleration"')
        read = replace(run.channels["b"], quantity="acceleration", unit="m/s^2")
        measured = replace(measured, runs=(replace(run, channels={**run.channels, "b": read}),))
    iso.write(tmp_path / "c.h5", replace(measured, description=text))
    assert main(["diagnose", str(tmp_path / "c.h5"), "-o", str(tmp_path / "d")]) == 0
    first, *others = capsys.readouterr().out.splitlines()
    findings = json.loads((tmp_path / "d" / "findings.json").read_text())
    assert [doubt["kind"] for doubt in findings["doubts"]] == (["derivative"] if described == "acceleration" else [])
    if described == "acceleration":
        assert first.startswith(
            "c: CHECK UNITS, CHANNELS AND GIVEN VALUES FIRST. In size and phase, b varies with frequency like a "
        )
        assert "like a velocity, but the description has an acceleration: check the unit in the mapping" in first
        assert "unexplained: no cause was searched for" in others[0]


@pytest.fixture(scope="module")
def rubbing() -> tuple[StrangeRig, iso.Campaign]:
    """A rig with dry friction, and its records."""
    rig = StrangeRig(
        masses=(2.0, 6.0), joints=((0, -1, 6e3, 15.0), (1, 0, 9e3, 14.0)), laws={1: dry(4.0, 1e-3)},
        sensors=(("a", 0, "acceleration"), ("b", 1, "acceleration")),
    )  # fmt: skip
    return rig, campaign(rig, (25.0,), seconds=5.0)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"sensors": "b"}, "b seems to be on m1 instead of m0: there, the linear rig leaves about "),
        ({"masses": "m0 and m1"}, "The given masses of m0 and m1 (6.6 and 1.9 kg) seem exchanged: with them"),
        ({"channels": "a/b"}, "a and b seem swapped"),
        *(pytest.param(each, "", marks=pytest.mark.study) for each in ({"none": "the masses are right"}, {})),
    ],
)  # fmt: skip
def test_what_is_exchanged_is_said_first(
    wrong: dict[str, str], said: str, rubbing: tuple[StrangeRig, iso.Campaign], tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """On a rig with dry friction that the description lacks: sensors, masses and channels."""
    rig, measured = rubbing
    # Of two wrong masses and the friction the search for causes takes half a minute.
    off = {} if "none" in wrong else {"bodies.m0.mass": 0.95, "bodies.m1.mass": 1.1}
    model = rig.description({"links.l0.stiffness": 1.2, **off})
    if "sensors" in wrong:
        model = structs.replace(model, sensors=(model.sensors[0], structs.replace(model.sensors[1], body="m0")))
    if "masses" in wrong:
        model = model.replace({"bodies.m0.mass": 6.6, "bodies.m1.mass": 1.9})
    if "channels" in wrong:
        (run,) = measured.runs
        a, b = run.channels["a"], run.channels["b"]
        run = replace(run, channels={**run.channels, "a": replace(b, name="a"), "b": replace(a, name="b")})
        measured = replace(measured, runs=(run,))
    iso.write(tmp_path / "c.h5", replace(measured, description=description_text(model, {})))
    assert main(["diagnose", str(tmp_path / "c.h5"), "-o", str(tmp_path / "d")]) == 0
    first, answer, *_ = capsys.readouterr().out.splitlines()
    doubts = json.loads((tmp_path / "d" / "findings.json").read_text())["doubts"]
    assert len(doubts) == bool(said)
    assert said in first
    if said:
        assert doubts[0]["kind"] == ("place" if "sensors" in wrong else "swapped")
        assert first.startswith("c: CHECK UNITS, CHANNELS AND GIVEN VALUES FIRST.")
        assert "no cause was searched for" in answer
