"""A rig that is pulled and let go, recorded by its position alone: draft, import, diagnosis and what to measure next."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from isorig.analysis.campaign import FloatArray
from isorig.rig.cli import main
from isorig.rig.files.recording import read

RATE, SECONDS = 100.0, 8.0
MASS, STIFFNESS, DAMPING = 2.0, 300.0, 1.5
STARTS = {"far": 0.1, "near": 0.04}
DESCRIPTION = """
name = "cart"
free = ["links.spring.stiffness", "links.spring.damping"]
bodies = [{ name = "cart", mass = 2.0 }]
links = [{ name = "spring", a = "cart", stiffness = 280.0, damping = 1.0 }]
drive = { channel = "push", quantity = "force", pushes = { cart = 1.0 } }
sensors = [{ channel = "position_mm", body = "cart", quantity = "displacement" }]
[configurations.far]
initial_position = { cart = 0.1 }
[configurations.near]
initial_position = { cart = 0.04 }
"""
CHANNELS = """
description = "rig.toml"
[channels.position_mm]
source = "position_mm"
unit = "mm"
"""
RUN = """
[[runs]]
id = "{name}"
file = "{name}.csv"
configuration = "{name}"
gain = 1.0
excitation = "{excitation}"
sample_rate = 100.0
"""


def decay(start: float) -> FloatArray:
    """Position in mm of a damped oscillator that is let go, in closed form."""
    t = np.arange(round(RATE * SECONDS)) / RATE
    rate = DAMPING / (2.0 * MASS)
    turn = np.sqrt(STIFFNESS / MASS - rate**2)
    x = start * np.exp(-rate * t) * (np.cos(turn * t) + rate / turn * np.sin(turn * t))
    return 1e3 * x + np.random.default_rng(round(1e3 * start)).normal(0.0, 0.02, len(t))


def files(folder: Path, *excitations: str) -> Path:
    """Records, description and mapping; the mapping's path."""
    text = CHANNELS
    for (name, start), excitation in zip(STARTS.items(), excitations, strict=True):
        (folder / f"{name}.csv").write_text("position_mm\n" + "\n".join(f"{x:.6g}" for x in decay(start)) + "\n")
        text += RUN.format(name=name, excitation=excitation)
    (folder / "rig.toml").write_text(DESCRIPTION)
    (folder / "m.toml").write_text(text)
    return folder / "m.toml"


def test_a_drive_of_zero_is_recorded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "o.h5"
    assert main(["import", str(files(tmp_path, "free", "free")), "-o", str(out)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "no column is the drive 'push', and all runs are free: a drive of 0 N is recorded", str(out)
    ]  # fmt: skip
    for run in read(out).runs:
        assert run.repeat_of is None
        assert run.channels["push"].unit == "N"
        assert len(run.read("push")) == len(run)
        assert not run.read("push").any()


def test_a_driven_run_needs_its_drive(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", str(files(tmp_path, "free", "other")), "-o", str(tmp_path / "o.h5")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "has no channel 'push', which the description rig.toml names" in line
    assert line.endswith('add the channel, or write excitation = "free" in every run if nothing drove the rig')
    assert not (tmp_path / "o.h5").exists()
