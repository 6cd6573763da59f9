"""A rig that is pulled and let go, recorded by its position alone: draft, import, diagnosis and what to measure next."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from isorig.analysis.campaign import FloatArray
from isorig.rig.cli import main
from isorig.rig.files.findings import read_findings
from isorig.rig.files.recording import read
from isorig.rig.files.rigfile import read_rig

RATE, SECONDS = 100.0, 8.0
MASS, STIFFNESS, DAMPING = 2.0, 300.0, 1.5
FRICTION, ZERO = 0.6, 0.3
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


def rubbed(start: float) -> FloatArray:
    """Position in mm of the oscillator with dry friction in closed form, by a sensor whose zero is not that of the spring."""
    t = np.arange(round(RATE * SECONDS)) / RATE
    rate, half = DAMPING / (2.0 * MASS), FRICTION / STIFFNESS
    turn = np.sqrt(STIFFNESS / MASS - rate**2)
    x, begin, way = np.full(len(t), start), 0.0, 1.0
    while abs(start) > half:  # from one reversal to the next the friction is constant
        at = t - begin
        later = at >= 0.0
        decayed = np.exp(-rate * at[later]) * (np.cos(turn * at[later]) + rate / turn * np.sin(turn * at[later]))
        x[later] = way * half + (start - way * half) * decayed
        start = way * half - (start - way * half) * np.exp(-rate * np.pi / turn)
        begin, way = begin + np.pi / turn, -way
    x[t >= begin] = start
    return 1e3 * x + ZERO + np.random.default_rng(round(1e3 * start)).normal(0.0, 0.02, len(t))


def files(folder: Path, *excitations: str, motion: Callable[[float], FloatArray] = decay) -> Path:
    """Records, description and mapping; the mapping's path."""
    text = CHANNELS
    for (name, start), excitation in zip(STARTS.items(), excitations, strict=True):
        (folder / f"{name}.csv").write_text("position_mm\n" + "\n".join(f"{x:.6g}" for x in motion(start)) + "\n")
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


def test_the_draft_of_one_position_can_be_imported(tmp_path: Path) -> None:
    files(tmp_path, "free", "free")
    mapping = tmp_path / "d.toml"
    assert main(["import", "--draft", str(tmp_path / "far.csv"), str(tmp_path / "near.csv"), "-o", str(mapping)]) == 0
    model = read_rig(tmp_path / "d-rig.toml").model
    assert [(sensor.channel, sensor.body, sensor.quantity) for sensor in model.sensors] == [
        ("position", "body_position", "displacement")
    ]  # fmt: skip
    assert (model.drive.channel, model.drive.quantity) == ("push", "force")
    note = (tmp_path / "d-rig.toml").read_text()
    assert "# ? no column is a drive: if body_position was pulled and let go" in note
    assert "initial_position" in note
    text = mapping.read_text().replace(
        "# sample_rate = 1024.0    # ? not given by the file; required for the import", "sample_rate = 100.0"
    )
    mapping.write_text(text)
    assert text.count('excitation = "free"') == 2
    starts = {name: setup.initial_position["body_position"] for name, setup in model.configurations.items()}
    assert starts == pytest.approx(STARTS, abs=1e-4)
    assert main(["import", str(mapping), "-o", str(tmp_path / "o.h5")]) == 0
    assert sorted(read(tmp_path / "o.h5").runs[0].channels) == ["position", "push"]


def test_a_single_release_has_one_configuration(tmp_path: Path) -> None:
    files(tmp_path, "free", "free")
    assert main(["import", "--draft", str(tmp_path / "near.csv"), "-o", str(tmp_path / "d.toml")]) == 0
    ((name, setup),) = read_rig(tmp_path / "d-rig.toml").model.configurations.items()
    assert name == "unlocked"
    assert setup.initial_position["body_position"] == pytest.approx(STARTS["near"], abs=1e-4)
    assert "configuration = " not in (tmp_path / "d.toml").read_text()


def test_an_acceleration_says_nothing_about_where_the_rig_starts(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("acc [g]\n" + "\n".join(f"{x:.6g}" for x in decay(0.1)) + "\n")
    assert main(["import", "--draft", str(tmp_path / "a.csv"), "-o", str(tmp_path / "d.toml")]) == 0
    assert not read_rig(tmp_path / "d-rig.toml").model.configurations["unlocked"].initial_position


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("torque_Nm,motor_rad,load_rad", ["that it pushes body_load is a guess"]),
        (
            "motor_rad,load_rad",
            ["that it pushes body_load is a guess", "if the rig was pulled and let go"],
        ),
        ("one [V],other [V]", ["that it pushes body_other is a guess", "no unit is that of a motion"]),
    ],
)
def test_guesses_of_a_draft_are_marked(tmp_path: Path, head: str, words: list[str]) -> None:
    rows = np.random.default_rng(1).normal(size=(300, head.count(",") + 1))
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=head, comments="")
    assert main(["import", "--draft", str(tmp_path / "a.csv"), "-o", str(tmp_path / "d.toml")]) == 0
    text = (tmp_path / "d-rig.toml").read_text()
    said = " ".join(line.removeprefix("# ") for line in text.splitlines())
    assert all(word in said for word in words)
    assert read_rig(tmp_path / "d-rig.toml").model.sensors


def test_the_findings_state_that_no_run_was_driven(tmp_path: Path) -> None:
    out = tmp_path / "o.h5"
    assert main(["import", str(files(tmp_path, "free", "free")), "-o", str(out)]) == 0
    assert main(["diagnose", str(out), "-o", str(tmp_path / "d")]) == 0
    found = read_findings(tmp_path / "d")
    assert not found.driven
    assert found.verdict == "adequate"


def test_a_sensor_whose_zero_is_not_that_of_the_spring_is_no_asymmetric_friction(tmp_path: Path) -> None:
    """Friction holds the cart anywhere within 2 mm, so nobody knows that zero."""
    out = tmp_path / "o.h5"
    assert main(["import", str(files(tmp_path, "free", "free", motion=rubbed)), "-o", str(out)]) == 0
    assert main(["diagnose", str(out), "-o", str(tmp_path / "d")]) == 0
    (step,) = read_findings(tmp_path / "d").steps
    assert (step.cause, step.location) == ("coulomb_friction", "spring")
    assert step.parameters["friction_force"].value == pytest.approx(FRICTION, rel=0.02)
