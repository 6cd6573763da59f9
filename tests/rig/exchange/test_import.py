"""Foreign files become recordings: right values, right units, or one sentence."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat, wavfile

from isorig.analysis.campaign import Campaign, Channel
from isorig.rig.cli import main
from isorig.rig.exchange.units import UNITS, known_unit
from isorig.rig.files.recording import read, write
from isorig.rig.model.baseline import baseline_model

ROOT = Path(__file__).resolve().parents[3]
N, RATE = 600, 512.0
HEAD = np.random.default_rng(1).normal(size=N)
TABLE = 0.3 * np.roll(HEAD, 2)
TIME = np.arange(N) / RATE

MAPPING = """
[rig]
head_mass = 6.5
[channels.head]
source = "{head}"
unit = "g"
sensitivity = 0.5
place = "motor head"
[channels.table]
source = "{table}"
unit = "mm/s^2"
offset = 2.0
[[runs]]
id = "u70"
file = "{file}"
configuration = "unlocked"
gain = 70.0
usable_to = {usable_to}
{rate}
"""


def write_foreign(folder: Path, kind: str) -> tuple[str, str, str, str]:  # noqa: PLR0911
    """A file of that kind: its name, its two columns, and how its rate is told."""
    time = 'time = "t"'
    if kind == "mat5":
        savemat(folder / "a.mat", {"t": TIME, "h": HEAD, "more": {"table": TABLE}, "note": "text", "k": 3.0})
        return "a.mat", "h", "more.table", time
    if kind == "mat7.3":
        with h5py.File(folder / "a.mat", "w", userblock_size=512) as file:
            for name, values in (("t", TIME), ("h", HEAD), ("more/table", TABLE)):
                file[name] = values[None, :]  # MATLAB's column is HDF5's row
                file[name].attrs["MATLAB_class"] = np.bytes_("double")
            file["#refs#/a"] = np.ones(4)
        return "a.mat", "h", "more.table", time
    if kind == "matrix":
        savemat(folder / "a.mat", {"data": np.column_stack([TIME, HEAD, TABLE])})
        return "a.mat", "data[1]", "data[2]", 'time = "data[0]"'
    if kind == "csv":
        rows = [f"{t!r},{h!r},{v!r}" for t, h, v in zip(TIME.tolist(), HEAD.tolist(), TABLE.tolist(), strict=True)]
        (folder / "a.csv").write_text("# made by hand\nt [s],h [g],table [mm/s²]\n" + "\n".join(rows) + "\n", encoding="utf-8")
        return "a.csv", "h", "table", time
    if kind == "german":
        rows = [f"{t};{h};{v}".replace(".", ",") for t, h, v in zip(TIME, HEAD, TABLE, strict=True)]
        (folder / "a.txt").write_text("Kanäle\r\nt;h;table\r\n" + "\r\n".join(rows), encoding="latin-1")
        return "a.txt", "h", "table", time
    if kind == "blanks":
        np.savetxt(folder / "a.dat", np.column_stack([TIME, HEAD, TABLE]))
        return "a.dat", "column1", "column2", 'time = "column0"'
    if kind == "tdms":
        with TdmsWriter(folder / "a.tdms") as writer:
            about = {"wf_increment": 1.0 / RATE, "unit_string": "V"}
            writer.write_segment([ChannelObject("daq", "h", HEAD, about), ChannelObject("daq", "table", TABLE, about)])
        return "a.tdms", "daq/h", "daq/table", ""
    wavfile.write(folder / "a.wav", int(RATE), np.column_stack([HEAD, TABLE]).astype(np.float32))
    return "a.wav", "channel[0]", "channel[1]", ""


KINDS = ("mat5", "mat7.3", "matrix", "csv", "german", "blanks", "tdms", "wav")


@pytest.mark.parametrize("kind", KINDS)
def test_values_and_units(tmp_path: Path, kind: str) -> None:
    file, head, table, rate = write_foreign(tmp_path, kind)
    (tmp_path / "m.toml").write_text(MAPPING.format(usable_to=0.4 * RATE, file=file, head=head, table=table, rate=rate))
    assert main(["import", str(tmp_path / "m.toml"), "-o", str(tmp_path / "out.h5")]) == 0
    campaign = read(tmp_path / "out.h5")
    run = campaign.runs[0]
    assert campaign.known == {"head_mass": 6.5}
    assert (run.id, run.configuration, run.gain) == ("u70", "unlocked", 70.0)
    assert run.sample_rate == pytest.approx(RATE, rel=1e-12)
    assert run.usable_to == 0.4 * RATE
    close = 1e-6 if kind == "wav" else 1e-14
    np.testing.assert_allclose(run.read("head"), HEAD / 0.5 * 9.80665, rtol=close, atol=1e-6 if kind == "wav" else 0)
    np.testing.assert_allclose(run.read("table"), (TABLE + 2.0) * 1e-3, rtol=close)
    assert run.channels["head"].unit == "m/s^2"
    with h5py.File(tmp_path / "out.h5") as stored:
        assert stored["runs/u70/head"].attrs["place"] == b"motor head"


@pytest.mark.parametrize("kind", KINDS)
def test_draft_can_be_imported(tmp_path: Path, kind: str) -> None:
    file, *_ = write_foreign(tmp_path, kind)
    draft = tmp_path / "draft.toml"
    assert main(["import", "--draft", str(tmp_path / file), "-o", str(draft)]) == 0
    assert main(["import", str(draft), "-o", str(tmp_path / "out.h5")]) == 0
    run = read(tmp_path / "out.h5").runs[0]
    assert len(run) == N
    assert run.sample_rate == pytest.approx(RATE)
    assert any(np.allclose(run.read(name), TABLE * (1e-3 if kind == "csv" else 1.0), atol=1e-6) for name in run.channels)


@pytest.mark.parametrize("ending", ["mat", "uff"])
def test_export_comes_back(recording: Path, campaign: Campaign, tmp_path: Path, ending: str) -> None:
    there, draft, back = (tmp_path / name for name in (f"u70.{ending}", "d.toml", "back.h5"))
    assert main(["export", str(recording), "-o", str(there), "--run", "u70"]) == 0
    assert main(["import", "--draft", str(there), "-o", str(draft)]) == 0
    assert main(["import", str(draft), "-o", str(back)]) == 0
    run = read(back).runs[0]
    assert (run.sample_rate, run.configuration, run.gain) == (1024.0, "unlocked", 70.0)
    for name in campaign.runs[0].channels:
        np.testing.assert_array_equal(run.read(name), campaign.runs[0].read(name))


@pytest.mark.parametrize("ending", ["mat", "uff", "csv"])
def test_a_streamed_gain_comes_back(campaign: Campaign, tmp_path: Path, ending: str) -> None:
    file, there, draft, back = (tmp_path / name for name in ("a.h5", f"u70.{ending}", "d.toml", "back.h5"))
    gain = np.where(np.arange(4096) < 3000, 70.0, 77.0)
    streamed = Channel(name="gain", samples=gain, quantity="gain", unit="1")
    run = campaign.runs[0]
    write(file, replace(campaign, runs=(replace(run, channels={**run.channels, "gain": streamed}),)))
    assert main(["export", str(file), "-o", str(there)]) == 0
    assert main(["import", "--draft", str(there), "-o", str(draft)]) == 0
    assert main(["import", str(draft), "-o", str(back)]) == 0
    found = read(back).runs[0]
    assert set(found.sensors) == set(run.channels)
    np.testing.assert_array_equal(found.read("gain"), gain)
    assert found.channels["gain"].quantity == "gain"


def test_spectra_come_along(recording: Path, tmp_path: Path) -> None:
    both = tmp_path / "both.uff"
    assert main(["export", str(recording), "-o", str(tmp_path / "s.uff"), "--run", "u70"]) == 0
    assert main(["export", str(recording), "-o", str(tmp_path / "f.uff"), "--what", "frf", "--run", "u70"]) == 0
    both.write_bytes((tmp_path / "s.uff").read_bytes() + (tmp_path / "f.uff").read_bytes())
    assert main(["import", "--draft", str(both), "-o", str(tmp_path / "d.toml")]) == 0
    assert main(["import", str(tmp_path / "d.toml"), "-o", str(tmp_path / "back.h5")]) == 0
    spectra = read(tmp_path / "back.h5").runs[0].spectra
    assert {(s.kind, s.response, s.reference) for s in spectra} >= {("transfer_function", "table", "head")}
    # f.uff alone has no samples
    assert main(["import", "--draft", str(tmp_path / "f.uff"), "-o", str(tmp_path / "no.toml")]) == 2


def test_published_benchmarks(shared: Path, tmp_path: Path) -> None:
    """Values as `measured/README.md` tells them."""
    for name in ("emps", "silverbox"):
        mapping = ROOT / "fixtures_data" / "mappings" / f"{name}.toml"
        words = ["import", str(mapping), "--data", str(shared / "measured" / name), "-o", str(tmp_path / f"{name}.h5")]
        assert main(words) == 0
    emps, silver = read(tmp_path / "emps.h5"), read(tmp_path / "silverbox.h5")
    assert {run.id: run.use for run in emps.runs} == {"estimation": "fit", "validation": "holdout"}
    for run in emps.runs:
        assert len(run) == 24841
        assert run.sample_rate == pytest.approx(1000.0, rel=1e-4)
        assert run.channels["force"].unit == "N"
        assert run.channels["force"].scale == pytest.approx(35.15, rel=1e-4)
    assert {run.id: (run.use, run.sample_rate) for run in silver.runs} == {
        "arrow": ("holdout", pytest.approx(610.35, rel=1e-5)), "multisines": ("fit", pytest.approx(610.35, rel=1e-5)),
    }  # fmt: skip
    assert baseline_model(emps).body("carriage").mass == 95.0
    assert baseline_model(silver).drive.channel == "input"


BAD = {
    "column": ('source = "h"', 'source = "zz"', "'zz', which is absent"),
    "unit": ('unit = "g"', 'unit = "furlong"', "furlong"),
    "sensitivity": ("sensitivity = 0.5", "sensitivity = 0.0", "sensitivity"),
    "file": ('file = "a.mat"', 'file = "b.mat"', "b.mat"),
    "ending": ('file = "a.mat"', 'file = "a.xls"', ".xls"),
    "key": ("gain = 70.0", "gain = 70.0\nspeed = 3", "speed"),
    "rate": ('time = "t"', "", "sample rate"),
    "samples": ('time = "t"', 'time = "t"\nsamples = [0, 9999]', "9999"),
    "time": ('time = "t"', 'time = "h"', "must ascend|strays"),
    "toml": ("[rig]", "[rig", "TOML"),
    "gain": ("[channels.table]", "[channels.gain]", "channels.gain measures acceleration"),
}


@pytest.mark.parametrize("kind", BAD)
def test_refusals(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    file, head, table, rate = write_foreign(tmp_path, "mat5")
    old, new, told = BAD[kind]
    text = MAPPING.format(usable_to=0.4 * RATE, file=file, head=head, table=table, rate=rate)
    assert old in text
    (tmp_path / "m.toml").write_text(text.replace(old, new))
    before = sorted(tmp_path.iterdir())
    assert main(["import", str(tmp_path / "m.toml"), "-o", str(tmp_path / "out.h5")]) == 2
    said = capsys.readouterr().err
    assert any(part in said for part in told.split("|"))
    assert said.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("kind", ["mat5", "mat7.3", "csv", "tdms", "wav", "uff"])
def test_damaged_files_are_refused_or_read(tmp_path: Path, recording: Path, kind: str) -> None:
    if kind == "uff":
        main(["export", str(recording), "-o", str(tmp_path / "a.uff")])
        file = "a.uff"
    else:
        file = write_foreign(tmp_path, kind)[0]
    whole = (tmp_path / file).read_bytes()

    @settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
    @given(place=st.floats(0.0, 1.0), byte=st.integers(0, 255), cut=st.booleans())
    def damage(place: float, byte: int, cut: bool) -> None:
        content = bytearray(whole)
        at = min(int(place * len(content)), len(content) - 1)
        content[at] = byte
        hurt = tmp_path / f"hurt{Path(file).suffix}"
        hurt.write_bytes(bytes(content[:at] if cut else content))
        assert main(["import", "--draft", str(hurt), "-o", str(tmp_path / "d.toml")]) in (0, 2)

    damage()


def test_text_in_a_table_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.csv").write_text("t,h\n0.0,1\n0.1,2\n0.2,broken\n")
    assert main(["import", "--draft", str(tmp_path / "a.csv"), "-o", str(tmp_path / "d.toml")]) == 2
    assert "broken" in capsys.readouterr().err


@given(st.sampled_from(sorted(UNITS)))
def test_units_are_found_as_written(name: str) -> None:
    assert known_unit(f" [{name}] ") == name
    assert known_unit(name.replace("^2", "²")) == name


def test_a_time_beyond_single_precision(tmp_path: Path) -> None:
    """A damaged number in a time column is refused in one sentence, or read as what it is not: a time."""
    time = np.arange(600) / 512.0
    time[300] = 1e60
    savemat(tmp_path / "a.mat", {"time": time, "force": HEAD, "a": TABLE})
    assert main(["import", "--draft", str(tmp_path / "a.mat"), "-o", str(tmp_path / "d.toml")]) in (0, 2)


@pytest.mark.parametrize(
    ("names", "setups"),
    [
        (("u70", "l70"), ["unlocked", "locked"]),
        (("up_L1", "down_L2"), ["unlocked", "unlocked"]),  # levels
        (("free", "motor_locked"), ["unlocked", "locked"]),
        (("unlocked", "b"), ["unlocked", "unlocked"]),
    ],
)
def test_configurations_by_the_names_of_files(names: Sequence[str], setups: Sequence[str], tmp_path: Path) -> None:
    files = [tmp_path / f"{name}.csv" for name in names]
    for file in files:
        rows = (f"{k / 500:.3f},{np.sin(0.3 * k):.6f},{np.cos(0.2 * k):.6f}" for k in range(2000))
        file.write_text("\n".join(["time (s),force (N),a (m/s^2)", *rows]))
    draft = tmp_path / "d.toml"
    assert main(["import", "--draft", *map(str, files), "-o", str(draft)]) == 0
    runs = {run["id"]: run.get("configuration", "unlocked") for run in tomllib.loads(draft.read_text())["runs"]}
    assert [runs[name] for name in names] == setups
