"""Descriptions of rigs: the page has every field, those that ship simulate, indistinguishable parameters are reported."""

from __future__ import annotations

import io
import re
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

from isorig.analysis.campaign import SI_UNIT
from isorig.analysis.fitting.identifiability import INFLATED, NO_EFFECT, from_sensitivity
from isorig.analysis.laws import CONTACT_LAWS, SPRING_LAWS
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import (
    Body,
    Chain,
    Configuration,
    Contact,
    Drive,
    Link,
    RigModel,
    Sensor,
    Usual,
    from_tree,
    to_tree,
)
from isorig.rig.cli import main
from isorig.rig.describe.questions import asked
from isorig.rig.errors import PlanError
from isorig.rig.files.recording import read
from isorig.rig.files.rigfile import SHIPPED, description_text, read_rig
from isorig.rig.wire_bonder.description import wire_bonder

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "describe.md").read_text(encoding="utf-8")
#: Headings of the page, and the part of a rig that each is of.
PARTS = {
    "## The rig": RigModel, "`bodies`": Body, "`links`": Link, "`contacts`": Contact, "`drive`": Drive, "`sensors`": Sensor,
    "`chain`": Chain, "`configurations`": Configuration, "`limits`": Limits, "`usual`": Usual,
}  # fmt: skip


def table_under(heading: str) -> dict[str, list[str]]:
    """Rows of the table under a heading by the field's name: unit, meaning, default."""
    (title,) = [line for line in PAGE.splitlines() if line.startswith("#") and line.endswith(heading)]
    part = PAGE.split(f"{title}\n", 1)[1].split("\n#", 1)[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in part.splitlines() if line.startswith("| `")]
    return {row[0].strip("`"): row[1:] for row in rows}


@pytest.mark.parametrize("heading", PARTS)
def test_the_page_has_every_field_with_its_default(heading: str) -> None:
    rows = table_under(heading)
    fields = msgspec.structs.fields(PARTS[heading])
    assert set(rows) == {field.name for field in fields}
    for field in fields:
        unit, _, default = rows[field.name]
        said = default.strip("`").strip('"')
        if field.default is msgspec.NODEFAULT and field.default_factory is msgspec.NODEFAULT:
            assert said == "must be given", field.name
        elif isinstance(field.default, float):
            assert float(said) == field.default, field.name
            assert unit, field.name
        elif isinstance(field.default, str) and field.default:
            assert said == field.default, field.name
        else:
            assert said != "must be given", field.name


def test_the_page_has_every_law_with_its_units() -> None:
    for kinds, of in ((SPRING_LAWS, "link"), (CONTACT_LAWS, "contact")):
        for kind in kinds:
            named = ", ".join(f"`{name}` {parameter.unit}" for name, parameter in kind.parameters.items())
            assert f"| `{kind.__struct_config__.tag}` | {of} | {named} |" in PAGE, "docs/describe.md has this row"


def test_the_page_names_what_ships() -> None:
    section = PAGE.split("## What comes with the package", 1)[1]
    assert set(re.findall(r"^\| `([\w-]+)` \|", section, re.MULTILINE)) == set(SHIPPED)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_description_is_shown_and_simulated(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = read_rig(SHIPPED[name]).model
    assert model.note
    assert from_tree(to_tree(model)) == model
    assert main(["describe", name, "-o", str(tmp_path / "rig.svg")]) == 0
    said = capsys.readouterr().out
    for part in (*model.bodies, *model.links, *model.contacts):
        assert part.name in said
    for sensor in model.sensors:
        assert f"● {sensor.channel}: {sensor.quantity.replace('_', ' ')}" in said
    for drive in model.drives:
        assert f"{drive.channel}: {drive.quantity}, {SI_UNIT[drive.quantity]}" in said
    assert "The sensors determine all of them." in said
    assert all(path in said for path in model.free)
    picture = (tmp_path / "rig.svg").read_text(encoding="utf-8")
    assert picture.startswith("<svg")
    assert model.drive.channel in picture
    configuration = list(model.configurations)[-1]
    call = ["simulate", "--model", name, "--seconds", "4", "--configuration", configuration, "-o", str(tmp_path / "a.h5")]
    assert main(call) == 0
    run = read(tmp_path / "a.h5").runs[0]
    assert run.sample_rate == model.usual.sample_rate
    for sensor in model.sensors:
        assert run.channels[sensor.channel].unit == SI_UNIT[sensor.quantity]
        assert np.ptp(run.read(sensor.channel)) > 0.0
    if name != "wire-bonder":
        for word in ("heatblock", "isolation", "motor_mass"):
            assert word not in said


def test_the_wire_bonder_is_a_description_among_others() -> None:
    assert msgspec.structs.replace(read_rig(SHIPPED["wire-bonder"]).model, note="") == wire_bonder()


@pytest.mark.parametrize("name", SHIPPED)
def test_the_text_of_a_model_is_the_model(name: str, tmp_path: Path) -> None:
    model = read_rig(SHIPPED[name]).model
    (tmp_path / "again.toml").write_text(description_text(model), encoding="utf-8")
    assert read_rig(tmp_path / "again.toml").model == model


def test_masses_and_springs_that_scale_together_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (
        SHIPPED["two-carts"]
        .read_text(encoding="utf-8")
        .replace('"bodies.second.mass"', '"bodies.second.mass", "bodies.first.mass"')
    )
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    assert main(["describe", str(tmp_path / "rig.toml")]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "cannot distinguish" in line]
    # A force in volts alone fixes no scale: all masses, springs and dampers may grow together with the factor.
    for path in (*read_rig(tmp_path / "rig.toml").model.free,):
        assert path in line
    assert "give its value" in line


def test_indistinguishable_and_correlated_at_the_boundary() -> None:
    def two(angle: float) -> np.ndarray:
        # Two columns of length 1e4 with this angle between them.
        return 1e4 * np.array([[1.0, np.cos(angle)], [0.0, np.sin(angle)], [0.0, 0.0]])

    # The smaller singular value over the larger of two unit columns is tan(angle / 2).
    angle = 2.0 * np.arctan(NO_EFFECT)
    assert from_sensitivity(two(0.9 * angle), ("a", "b")).indistinguishable == (("a", "b"),)
    assert from_sensitivity(two(1.1 * angle), ("a", "b")).indistinguishable == ()
    # Known to 1/sin(angle) times what it is alone; said where that is poor too.
    angle = float(np.arcsin(1.0 / INFLATED))
    assert from_sensitivity(two(0.9 * angle) / 500.0, ("a", "b")).correlated == ("a", "b")
    assert from_sensitivity(two(1.1 * angle) / 500.0, ("a", "b")).correlated == ()
    assert from_sensitivity(two(0.9 * angle), ("a", "b")).correlated == ()
    assert from_sensitivity(np.array([[1.0, 0.0], [0.0, 100.0]]), ("a", "b")).without_effect == ("a",)


def test_angles_are_simulated_as_angles() -> None:
    model = read_rig("belt-pair").model
    straight = msgspec.structs.replace(
        model,
        bodies=tuple(msgspec.structs.replace(body, motion="straight") for body in model.bodies),
        sensors=tuple(
            msgspec.structs.replace(s, quantity={"angle": "displacement", "angular_velocity": "velocity"}[s.quantity])
            for s in model.sensors
        ),
    )
    from isorig.analysis.simulate import Excitation, simulate

    drive = Excitation.prepare(0.2 * np.random.default_rng(0).normal(size=500), 1000.0)
    one, other = simulate(model, drive).channels, simulate(straight, drive).channels
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('quantity = "displacement" },', 'quantity = "force" },', "is not a motion of a body"),
        ('quantity = "displacement" },', 'quantity = "angle" },', 'give that body motion = "rotation"'),
        ("band = [0.1, 8.0]", "band = [0.1, 800.0]", "at most half of usual.sample_rate"),
        ("seconds = 30.0", "seconds = 0.0", "usual.seconds is 0"),
    ],
)
def test_what_is_not_simulated_is_refused_by_name(
    old: str, new: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = SHIPPED["two-carts"].read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "rig.toml").write_text(text.replace(old, new, 1), encoding="utf-8")
    assert main(["describe", str(tmp_path / "rig.toml")]) == 2
    assert said in capsys.readouterr().err


ANSWERS = """pair
frame 40 kg, stage 2 kg
ground
9 Hz
0.03

nonsense
frame
5 Hz
25 N s/m
1.5

coil current stage
coil current stage 18
a1 frame acceleration
x stage displacement

stage
n
"""


def test_questions_make_a_description(tmp_path: Path) -> None:
    output = tmp_path / "rig.toml"
    call = [sys.executable, "-m", "isorig", "describe", "--new", "-o", str(output)]
    done = subprocess.run(
        call, input=ANSWERS.replace("\n\nnonsense", "\n0\n\nnonsense"), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    model = read_rig(output).model
    assert model.link("frame").stiffness == pytest.approx((2 * np.pi * 9) ** 2 * 40)
    assert model.link("frame").damping == pytest.approx(2 * 0.03 * 2 * np.pi * 9 * 40)
    assert (model.link("stage_frame").damping, model.contact("stage_frame").b) == (25.0, "frame")
    assert model.drive == Drive(channel="coil", quantity="current", factor=18.0, pushes={"stage": 1.0})
    assert {"drive.factor", "bodies.stage.mass", "contacts.stage_frame.law.friction_force"} <= set(model.free)


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        ("a\nb 1\n", "the answers end before the question 'What is b joined to (ground)? [ground]'"),
        ("a\n", "if it turns'; answer all of them"),
    ],
)
def test_answers_that_end_leave_no_file(
    answers: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(answers))
    assert main(["describe", "--new", "-o", str(tmp_path / "rig.toml")]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_questions_overwrite_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "rig.toml").write_text("mine", encoding="utf-8")
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    assert main(["describe", "--new", "-o", str(tmp_path / "rig.toml")]) == 2
    assert (tmp_path / "rig.toml").read_text(encoding="utf-8") == "mine"


def test_answers_that_are_never_usable_end_the_questions() -> None:
    with pytest.raises(PlanError, match="no usable answer after 5 tries"):
        asked(lambda question: "rig" if "called" in question else "?")


def test_a_draft_of_another_rigs_file_proposes_its_description(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "\n".join(f"{k / 200},{np.sin(k)},{k % 7},{k % 5}" for k in range(600))
    (tmp_path / "carts.csv").write_text(f"time [s],u [V],x1 [mm],motor_angle [deg]\n{rows}\n", encoding="utf-8")
    draft = tmp_path / "map.toml"
    assert main(["import", "--draft", str(tmp_path / "carts.csv"), "-o", str(draft)]) == 0
    assert "map-rig.toml is proposed as the rig's description" in capsys.readouterr().out
    model = read_rig(tmp_path / "map-rig.toml").model
    assert (model.drive.channel, model.drive.quantity) == ("u", "voltage")
    assert {(s.channel, s.quantity) for s in model.sensors} == {("x1", "displacement"), ("motor_angle", "angle")}
    assert main(["import", str(draft), "-o", str(tmp_path / "a.h5")]) == 0
    campaign = read(tmp_path / "a.h5")
    assert campaign.description is not None
    assert "head_mass" not in draft.read_text(encoding="utf-8")
    # A description that was corrected is not written over.
    (tmp_path / "map-rig.toml").write_text("mine", encoding="utf-8")
    assert main(["import", "--draft", str(tmp_path / "carts.csv"), "-o", str(draft)]) == 0
    assert (tmp_path / "map-rig.toml").read_text(encoding="utf-8") == "mine"
