"""What is exported is read again by readers that this project and its writers do not share."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import fastparquet
import numpy as np
import pytest
from exchange_readers import read_58, read_mat5

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.rig.cli import main
from isorig.rig.exchange.reading import read_foreign
from isorig.rig.files.recording import write
from isorig.rig.frf.transfer import transfer_functions


def test_samples_as_mat(recording: Path, campaign: Campaign, tmp_path: Path) -> None:
    assert main(["export", str(recording), "-o", str(tmp_path / "a.mat")]) == 0
    found = read_mat5(tmp_path / "a.mat")
    for run in campaign.runs:
        there = found["runs"][run.id]
        assert there["sample_rate"] == run.sample_rate
        assert there["gain"] == run.gain
        assert there["configuration"] == run.configuration
        for name in run.channels:
            np.testing.assert_array_equal(there[name], run.read(name))
    assert found["rig"]["head_mass"] == 6.5
    assert found["units"]["motor"] == "m/s^2"


@pytest.mark.parametrize(("option", "digits"), [([], 0.0), (["--text"], 1e-10)])
def test_samples_as_universal_file(recording: Path, campaign: Campaign, tmp_path: Path, option: list[str], digits: float) -> None:
    assert main(["export", str(recording), "-o", str(tmp_path / "a.uff"), *option]) == 0
    sets = read_58(tmp_path / "a.uff")
    wanted = [(run, name) for run in sorted(campaign.runs, key=lambda run: run.id) for name in sorted(run.channels)]
    assert len(sets) == len(wanted)
    for item, (run, name) in zip(sets, wanted, strict=True):
        assert (item["type"], item["response"], item["unit"]) == (1, name, "m/s^2")
        assert item["told"].startswith(run.id)
        assert item["step"] == pytest.approx(1.0 / 1024.0, rel=1e-5)
        np.testing.assert_allclose(item["values"], run.read(name), rtol=digits)


def test_samples_as_tables(recording: Path, campaign: Campaign, tmp_path: Path) -> None:
    assert main(["export", str(recording), "-o", str(tmp_path / "a.csv"), "--run", "l7"]) == 0
    assert main(["export", str(recording), "-o", str(tmp_path / "a.parquet")]) == 0
    with (tmp_path / "a.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    run = campaign.runs[1]
    assert [float(row["table [m/s^2]"]) for row in rows] == run.read("table").tolist()
    assert not (tmp_path / "a-u70.csv").exists()
    frame = fastparquet.ParquetFile(tmp_path / "a-u70.parquet").to_pandas()
    np.testing.assert_array_equal(frame["motor [m/s^2]"], campaign.runs[0].read("motor"))
    np.testing.assert_array_equal(frame["time [s]"], np.arange(4096) / 1024.0)


def test_transfer_functions(recording: Path, campaign: Campaign, tmp_path: Path) -> None:
    truth = {item.name: item for item in transfer_functions(campaign, resolution=4.0)}
    for ending in ("mat", "uff", "parquet", "csv"):
        words = ["export", str(recording), "-o", str(tmp_path / f"f.{ending}"), "--what", "frf", "--resolution", "4"]
        assert main(words) == 0
    mat = read_mat5(tmp_path / "f.mat")["frf"]
    one = truth["table-over-head-unlocked-gain70"].frf
    np.testing.assert_array_equal(mat["table_unlocked_gain70"]["H"], one.value)
    np.testing.assert_array_equal(mat["table_unlocked_gain70"]["coherence"], one.coherence)
    sets = [s for s in read_58(tmp_path / "f.uff") if s["response"] == "table" and s["told"].startswith("unlocked")]
    assert [(s["type"], s["reference"], s["step"]) for s in sets] == [(4, "head", 4.0), (6, "head", 4.0)]
    np.testing.assert_allclose(sets[0]["values"], one.value, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(sets[1]["values"], one.coherence, rtol=1e-9, atol=1e-12)
    frame = fastparquet.ParquetFile(tmp_path / "f.parquet").to_pandas()
    rows = frame[(frame.response == "table") & (frame.configuration == "unlocked")]
    np.testing.assert_array_equal(rows.real + 1j * rows.imag, one.value)
    with (tmp_path / "f.csv").open(newline="") as stream:
        assert len(list(csv.DictReader(stream))) == len(frame) == 6 * len(one.frequency)


def test_names_nodes_directions_and_units_do_not_collide(tmp_path: Path) -> None:
    """Long names stay apart, each channel has its node and direction, a displacement over acceleration its own units."""
    generator = np.random.default_rng(3)
    about = {"acceleration_x": ("m/s^2", "x"), "acceleration_y": ("m/s^2", "-y"), "displacement_x": ("m", "+z")}
    channels = {
        name: Channel(
            name=name, samples=generator.normal(size=4096), unit=unit, about={"direction": direction},
            quantity="displacement" if unit == "m" else "acceleration",
        )
        for name, (unit, direction) in about.items()
    }  # fmt: skip
    runs = [
        Run(id=name, configuration="unlocked", sample_rate=1024.0, gain=1.0, channels=channels, excitation="random")
        for name in ("a", "b")
    ]
    write(tmp_path / "r.h5", Campaign(runs=tuple(runs)))
    assert main(["export", str(tmp_path / "r.h5"), "-o", str(tmp_path / "s.uff")]) == 0
    sets = read_58(tmp_path / "s.uff")
    assert [(s["response"], s["node"], s["direction"], s["types"], s["unit"]) for s in sets] == 2 * [
        ("accelerati", 1, 1, (12, 0), "m/s^2"), ("accelera~2", 2, -2, (12, 0), "m/s^2"), ("displaceme", 3, 3, (8, 0), "m"),
    ]  # fmt: skip
    words = ["--what", "frf", "--reference", "acceleration_x", "--resolution", "4"]
    assert main(["export", str(tmp_path / "r.h5"), "-o", str(tmp_path / "f.uff"), *words]) == 0
    sets = read_58(tmp_path / "f.uff")
    found = {(s["type"], s["node"]): (s["reference_node"], s["types"], s["unit"], s["below"]) for s in sets}
    assert found == {
        (4, 2): (1, (12, 12), "m/s^2", "m/s^2"), (4, 3): (1, (8, 12), "m", "m/s^2"),
        (6, 2): (1, (0, 0), "1", "NONE"), (6, 3): (1, (0, 0), "1", "NONE"),
    }  # fmt: skip
    back = read_foreign(tmp_path / "f.uff").spectra
    assert {(s.response, s.reference, s.unit) for s in back if s.kind == "transfer_function"} == {
        ("acceleration_y", "acceleration_x", "1"), ("displacement_x", "acceleration_x", "m/(m/s^2)"),
    }  # fmt: skip


def test_a_run_of_one_sample(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = Run(
        id="a", configuration="unlocked", sample_rate=10.0, gain=1.0, channels={"head": Channel(name="head", samples=np.ones(1))}
    )
    write(tmp_path / "r.h5", Campaign(runs=(run,)))
    assert main(["export", str(tmp_path / "r.h5"), "-o", str(tmp_path / "a.uff")]) == 2
    assert "run 'a' has one sample" in capsys.readouterr().err
    assert not (tmp_path / "a.uff").exists()


def test_parameter_table(tmp_path: Path) -> None:
    table = {
        "motor_mass": {"value": 16.4, "std": 0.0, "unit": "kg", "method": "given", "note": "weighed"},
        "friction_force": {"value": None, "std": None, "unit": "N", "method": "none", "note": "no friction"},
    }
    source = tmp_path / "parameters.json"
    source.write_text(json.dumps({"format": "rig-parameters", "format_version": 1, "parameters": table}))
    for ending in ("csv", "parquet", "mat"):
        assert main(["export", str(source), "-o", str(tmp_path / f"p.{ending}")]) == 0
    with (tmp_path / "p.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["name"], row["value"], row["unit"]) for row in rows] == [
        ("motor_mass", "16.4", "kg"),
        ("friction_force", "", "N"),
    ]
    assert fastparquet.ParquetFile(tmp_path / "p.parquet").to_pandas()["name"].tolist() == list(table)
    assert read_mat5(tmp_path / "p.mat")["parameters"]["motor_mass"]["value"] == 16.4


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["campaign.h5", "-o", "a.xlsx"], ".parquet"),
        (["campaign.h5", "-o", "a.mat", "--run", "zz"], "no run 'zz'"),
        (["absent.json", "-o", "a.csv"], "cannot be read"),
        (["empty.json", "-o", "a.csv"], "no parameter table"),
    ],
)
def test_refusals(recording: Path, words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    folder = recording.parent
    (folder / "empty.json").write_text("[]")
    before = sorted(folder.iterdir())
    assert main(["export", str(folder / words[0]), "-o", str(folder / words[2]), *words[3:]]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1
    assert sorted(folder.iterdir()) == before
