"""Rigs by name and file, their faults in one sentence, and `rig simulate` as a user sees it."""

import copy
import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import RigModel, from_tree, to_tree
from isorig.rig.cli import main
from isorig.rig.errors import PlanError
from isorig.rig.files.recording import read
from isorig.rig.files.rigfile import read_rig, write_model
from isorig.rig.wire_bonder.description import BUILT_IN, three_mass

TOML = """
name = "slide"
bodies = [{ name = "carriage", mass = 2.0 }]
sensors = [{ channel = "position", body = "carriage", quantity = "displacement" }]

[[links]]
name = "rail"
a = "carriage"
stiffness = 800.0
damping = 4.0
laws = [{ law = "end_stop", stroke = 0.01, contact_stiffness = 5e4 }]

[[contacts]]
name = "rail"
a = "carriage"
law = { law = "stribeck", friction_force = 3.0, static_force = 5.0, stribeck_velocity = 0.01 }

[drive]
channel = "force"
quantity = "force"
factor = 1.0
pushes = { carriage = 1.0 }
"""


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_rigs_are_data_that_survive_their_file(name: str, tmp_path: Path) -> None:
    model = read_rig(name).model
    assert from_tree(to_tree(model)) == model
    assert read_rig(write_model(tmp_path / "model.json", model)).model == model


def test_a_description_in_toml(tmp_path: Path) -> None:
    path = tmp_path / "slide.toml"
    path.write_text(TOML)
    found = read_rig(path)
    assert found.description == TOML
    assert found.model.contact("rail").law.static_force == 5.0
    output = tmp_path / "slide.h5"
    assert main(["simulate", "--model", str(path), "--level", "20", "--seconds", "2", "-o", str(output)]) == 0
    campaign = read(output)
    assert campaign.description == TOML
    run = campaign.runs[0]
    assert set(run.channels) == {"force", "position", "rail_friction", "rail_held", "rail_force"}
    assert run.channels["rail_friction"].unit == "N"
    assert np.abs(run.read("rail_friction")).max() < 7.0


@pytest.mark.parametrize(
    ("where", "value", "said"),
    [
        (("links", 0, "stiffness"), "stiff", "links.table.stiffness is 'stiff', but must be a number; correct it"),
        (("links", 0, "stifness"), 3.0, "links.table has the key 'stifness' = 3.0"),
        (("bodies", 1, "mass"), None, "bodies.heatblock lacks the key 'mass'; add it"),
        (("bodies", 1, "mass"), -3, "body 'heatblock' has mass -3; give a finite mass above zero"),
        (("bodies", 1, "mass"), float("nan"), "body 'heatblock' has mass nan"),
        (
            ("contacts", 0, "law", "law"),
            "columb",
            "contacts.isolation.law.law is 'columb' (did you mean 'coulomb'?); allowed are arctan, asymmetric",
        ),
        (("contacts", 0, "law", "friction_force"), -2, "contacts.isolation.law: friction_force is -2"),
        (("contacts", 0, "b"), "tabel", "contact 'isolation' names body 'tabel', which does not exist"),
        (("links", 0, "laws"), [{"law": "backlash", "clearance": -1}], "links.table.laws.0: clearance is -1"),
        (("configurations", "locked", "rigid"), "isolation", "configurations.locked.rigid is 'isolation', but must be a list"),
        (("drive", "pushes", "motor"), "x", "drive.pushes.motor is 'x', but must be a number"),
        (("drive", "factor"), float("inf"), "drive.factor is inf; give a finite number"),
        (("drive", "chain"), {"gain": 0.0}, "the chain of channel 'force' has gain 0"),
        (("sensors", 0, "chain"), {"gain": float("nan")}, "sensors.table.chain.gain is nan; give a finite number"),
        (("links", 0, "arms"), {"table": float("inf")}, "links.table.arms.table is inf; give a finite number"),
        (("sensors", 0, "quantity"), "speed", "sensors.table.quantity is 'speed'; allowed are acceleration"),
        (("links", 0, "b"), "heatblock", "floats: no link or contact joins it to the ground"),
        (("free",), ["links.table.stifness"], "no parameter 'links.table.stifness'"),
    ],
    ids=str,
)
def test_a_fault_is_reported_with_key_value_and_remedy(where: tuple[str | int, ...], value: object, said: str) -> None:
    tree = copy.deepcopy(to_tree(three_mass()))
    node = tree
    for step in where[:-1]:
        node = node[step]
    if value is None:
        del node[where[-1]]
    else:
        node[where[-1]] = value
    with pytest.raises(ModelError) as found:
        from_tree(tree)
    assert said in str(found.value)


def test_a_body_without_a_link_is_refused_as_floating() -> None:
    tree = to_tree(three_mass())
    tree["bodies"].append({"name": "loose", "mass": 1.0})
    with pytest.raises(ModelError, match="body 'loose' floats"):
        from_tree(tree)


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_no_description_ends_in_a_traceback(data: st.DataObject) -> None:
    tree = copy.deepcopy(to_tree(three_mass()))
    values = st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
        max_leaves=6,
    )
    node: object = tree
    while True:
        keys = list(node) if isinstance(node, dict) else list(range(len(node))) if isinstance(node, list) else []
        key = data.draw(st.sampled_from(keys))
        inner = node[key]  # type: ignore[index]
        if not isinstance(inner, dict | list) or not inner or data.draw(st.booleans()):
            node[key] = data.draw(values)  # type: ignore[index]
            break
        node = inner
    said = ""
    try:
        assert isinstance(from_tree(tree), RigModel)
    except ModelError as error:
        said = str(error)
    assert "\n" not in said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("bodies = [", "is not TOML"),
        ("[[[[[", "is not TOML"),
        ("x = " + "[" * 3000 + "]" * 3000, "nested too deeply"),
        ("", "lacks"),
    ],
    ids=["open", "brackets", "deep", "empty"],
)
def test_a_file_that_is_no_description(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(PlanError, match=said):
        read_rig(path)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(PlanError, match=r"did you mean 'three-mass'.*or one of wire-bonder"):
        read_rig("three-masses")
    with pytest.raises(PlanError, match="does not exist"):
        read_rig(tmp_path / "none.toml")


@pytest.mark.parametrize("kind", ["random", "multisine", "sweep", "half-sine", "moves"])
def test_made_up_drives(kind: str, tmp_path: Path) -> None:
    output = tmp_path / "out.h5"
    assert main(["simulate", "--excitation", kind, "--seconds", "4", "-o", str(output)]) == 0
    run = read(output).runs[0]
    assert len(run) == 4096
    assert {"head", "motor", "table", "heatblock", "isolation_friction", "isolation_held", "isolation_force"} <= set(run.channels)
    drive = run.read("head")
    if kind in ("random", "multisine"):
        assert drive.std() == pytest.approx(3.8, rel=1e-6)
    else:
        assert np.abs(drive).max() == pytest.approx(12.5, rel=1e-2)
    assert run.read("motor").std() > 0.0


def test_stops_are_listed_in_a_table(tmp_path: Path) -> None:
    output, events = tmp_path / "out.h5", tmp_path / "stops.csv"
    call = ["simulate", "--model", "one-mass", "--excitation", "half-sine", "--seconds", "2", "--events", str(events)]
    assert main([*call, "-o", str(output)]) == 0
    with events.open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["slides"] for row in rows] == ["1", "0", "-1", "0", "1", "0", "-1", "0"]
    assert all(0.1 < float(row["time"]) < 0.6 for row in rows)
    run = read(output).runs[0]
    assert run.read("isolation_held")[-1] == 1.0


def test_a_recordings_drive_is_played_again(tmp_path: Path) -> None:
    first, again = tmp_path / "first.h5", tmp_path / "again.h5"
    assert main(["simulate", "--seconds", "2", "-o", str(first)]) == 0
    assert main(["simulate", "--drive", str(first), "-o", str(again)]) == 0
    a, b = read(first).runs[0], read(again).runs[0]
    assert all(np.array_equal(a.read(name), b.read(name)) for name in a.channels)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--seconds", "0.001"], "at least two are needed"),
        (["--sample-rate", "0"], "must be positive"),
        (["--seconds", "nan"], "must be positive"),
        (["--level", "-1"], "not negative"),
        (["--band", "30", "10"], "must ascend"),
        (["--configuration", "open"], "configuration 'open'"),
        (["--model", "four-mass"], "is not a rig"),
        (["--drive", "none.h5"], "none.h5"),
    ],
    ids=str,
)
def test_what_cannot_be_used_is_one_sentence_and_no_file(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "out.h5"
    assert main(["simulate", *words, "-o", str(output)]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_many_channels_are_listed_one_to_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    output = tmp_path / "out.h5"
    assert main(["simulate", "--excitation", "moves", "--seconds", "1", "-o", str(output)]) == 0
    assert main(["check", str(output)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.split()[0] == "isolation_friction" for line in lines if line.strip())
