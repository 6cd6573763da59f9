"""A file whose units are read wrong: said first, in the terminal, the findings and the report."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from isorig.analysis.model.rig_model import from_tree
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.excitation import random
from isorig.rig.cli import main

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
