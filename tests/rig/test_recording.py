"""The recording format: what is written comes back, and damage is refused in one sentence."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray
from pyuff import UFF, prepare_58
from scipy.io import savemat, wavfile

from isorig.analysis.campaign import Campaign, Channel, Gap, Run, Spectrum
from isorig.rig.cli import main
from isorig.rig.errors import RecordingError
from isorig.rig.files.recording import open_recording, read, write

SPECTRUM = Spectrum(
    name="motor over head", kind="transfer_function", response="motor", reference="head", frequency=np.arange(5.0),
    values=np.arange(5.0) * (1.0 + 2.0j), averages=20, window="hann",
)  # fmt: skip


def example() -> Campaign:
    channels = {
        name: Channel(name=name, samples=np.arange(300, dtype=np.int32), scale=1e-3, offset=0.5, full_scale=50.0)
        for name in ("head", "motor", "table", "heatblock")
    }
    run = Run(
        id="u70", configuration="unlocked", sample_rate=1024.0, gain=70.0, channels=channels, excitation="random",
        started=datetime(2026, 1, 2, tzinfo=UTC), band=(0.5, 20.0), period=100, use="holdout", usable_to=400.0,
        gaps=(Gap(first_tick=10, count=3),), spectra=(SPECTRUM,),
    )  # fmt: skip
    return Campaign(runs=(run,), known={"head_mass": 6.5}, description=None)


def test_round_trip(tmp_path: Path) -> None:
    write(tmp_path / "a.h5", example())
    got, want = read(tmp_path / "a.h5"), example()
    assert got.known == want.known
    for name in (
        "id",
        "configuration",
        "sample_rate",
        "gain",
        "excitation",
        "started",
        "band",
        "period",
        "use",
        "usable_to",
        "gaps",
    ):
        assert getattr(got.runs[0], name) == getattr(want.runs[0], name)
    spectrum = got.runs[0].spectra[0]
    assert np.array_equal(spectrum.frequency, SPECTRUM.frequency)
    assert np.array_equal(spectrum.values, SPECTRUM.values)
    for name in ("name", "kind", "response", "reference", "unit", "averages", "window"):
        assert getattr(spectrum, name) == getattr(SPECTRUM, name)
    for name, channel in want.runs[0].channels.items():
        assert np.array_equal(got.runs[0].read(name), channel.read())
        assert got.runs[0].channels[name].full_scale == 50.0


Damage = Callable[[h5py.File], None]


def attribute(where: str, key: str, value: object) -> Damage:
    def damage(file: h5py.File) -> None:
        if value is None:
            del file[where].attrs[key]
        else:
            file[where].attrs[key] = value

    return damage


def dataset(name: str, values: np.ndarray) -> Damage:
    def damage(file: h5py.File) -> None:
        del file[f"runs/u70/{name}"]
        file[f"runs/u70/{name}"] = values

    return damage


def remove(where: str) -> Damage:
    def damage(file: h5py.File) -> None:
        del file[where]

    return damage


def no_samples(file: h5py.File) -> None:
    for name in ("head", "motor", "table", "heatblock"):
        dataset(name, np.zeros(0))(file)


def gain_alone(file: h5py.File) -> None:
    for name in ("head", "motor", "table", "heatblock"):
        del file[f"runs/u70/{name}"]
    file["runs/u70/gain"] = np.ones(300)


def dangling(file: h5py.File) -> None:
    remove("runs/u70/motor")(file)
    file["runs/u70/motor"] = h5py.SoftLink("/nowhere")


def spectrum(part: str, values: np.ndarray | None) -> Damage:
    def damage(file: h5py.File) -> None:
        del file[f"runs/u70/spectra/motor over head/{part}"]
        if values is not None:
            file[f"runs/u70/spectra/motor over head/{part}"] = values

    return damage


def run_as_dataset(file: h5py.File) -> None:
    file["runs/second"] = np.arange(3.0)


DAMAGES: dict[str, tuple[Damage, str]] = {
    "no format": (attribute("/", "format", None), "format"),
    "other format": (attribute("/", "format", "tdms"), "tdms"),
    "no version": (attribute("/", "format_version", None), "format_version"),
    "unknown version": (attribute("/", "format_version", 2), "2"),
    "version as text": (attribute("/", "format_version", "1"), "format_version"),
    "no runs": (remove("runs"), "runs"),
    "runs empty": (remove("runs/u70"), "runs"),
    "no configuration": (attribute("runs/u70", "configuration", None), "configuration"),
    "no rate": (attribute("runs/u70", "sample_rate", None), "sample_rate"),
    "no gain": (attribute("runs/u70", "gain", None), "gain"),
    "zero rate": (attribute("runs/u70", "sample_rate", 0.0), "sample_rate 0"),
    "negative rate": (attribute("runs/u70", "sample_rate", -1.0), "-1"),
    "rate not finite": (attribute("runs/u70", "sample_rate", np.inf), "inf"),
    "rate as text": (attribute("runs/u70", "sample_rate", "fast"), "fast"),
    "gain is NaN": (attribute("runs/u70", "gain", np.nan), "nan"),
    "configuration a number": (attribute("runs/u70", "configuration", 3.0), "configuration"),
    "started without offset": (attribute("runs/u70", "started", "2026-01-02T00:00:00"), "offset"),
    "started not a date": (attribute("runs/u70", "started", "yesterday"), "yesterday"),
    "band reversed": (attribute("runs/u70", "band", [20.0, 0.5]), "band"),
    "band of one": (attribute("runs/u70", "band", [20.0]), "band"),
    "usable band of zero": (attribute("runs/u70", "usable_to", 0.0), "usable_to 0 Hz"),
    "usable band above half the rate": (attribute("runs/u70", "usable_to", 512.1), "usable_to 512.1 Hz"),
    "period zero": (attribute("runs/u70", "period", 0), "period"),
    "period of one sample": (attribute("runs/u70", "period", 1), "period 1; it is a whole number of samples above 1"),
    "period that is not whole": (attribute("runs/u70", "period", 2.5), "period 2.5"),
    "band without width": (attribute("runs/u70", "band", [2.0, 2.0]), "low < high"),
    "serial number not UTF-8": (attribute("runs/u70/motor", "serial_number", np.bytes_(b"\xff")), "UTF-8"),
    "unknown use": (attribute("runs/u70", "use", "test"), "use"),
    "unknown unit": (attribute("runs/u70/motor", "unit", "furlong"), "furlong"),
    "unknown quantity": (attribute("runs/u70/motor", "quantity", "smell"), "smell"),
    "scale zero": (attribute("runs/u70/motor", "scale", 0.0), "scale"),
    "scale NaN": (attribute("runs/u70/motor", "scale", np.nan), "scale"),
    "offset infinite": (attribute("runs/u70/motor", "offset", np.inf), "offset"),
    "NaN sample": (dataset("motor", np.array([1.0, np.nan] * 150)), "nan"),
    "infinite sample": (dataset("motor", np.array([1.0, np.inf] * 150)), "inf"),
    "unequal lengths": (dataset("motor", np.arange(299)), "unequal"),
    "two dimensions": (dataset("motor", np.zeros((300, 2))), "dimensions"),
    "text samples": (dataset("motor", np.array([b"x"] * 300)), "numbers"),
    "range negative": (attribute("runs/u70/motor", "range", -50.0), "range"),
    "offset as list": (attribute("runs/u70/motor", "offset", [0.0, 1.0]), "offset"),
    "configuration not UTF-8": (attribute("runs/u70", "configuration", np.bytes_(b"\xff\xfe")), "UTF-8"),
    "gap of no ticks": (dataset("gaps", np.array([(10, 0)], dtype=[("first_tick", "i8"), ("count", "i8")])), "gap"),
    "gap before the start": (dataset("gaps", np.array([(-1, 3)], dtype=[("first_tick", "i8"), ("count", "i8")])), "gap"),
    "gaps without columns": (dataset("gaps", np.array([1, 2])), "first_tick"),
    "no samples": (no_samples, "no samples"),
    "gain alone": (gain_alone, "no channel"),
    "channel leads nowhere": (dangling, "links to data"),
    "run is a dataset": (run_as_dataset, "not a group"),
    "description a number": (attribute("rig", "description", 3.0), "description"),
    "spectrum without values": (spectrum("values", None), "values"),
    "spectrum of two lengths": (spectrum("values", np.ones(4)), "equally long"),
    "spectrum with NaN": (spectrum("values", np.full(5, np.nan)), "finite"),
    "spectrum unsorted": (spectrum("frequency", np.arange(5.0)[::-1]), "ascend"),
    "spectrum of text": (spectrum("values", np.array([b"x"] * 5)), "numbers"),
    "mass of zero": (attribute("rig", "head_mass", 0.0), "head_mass"),
}


@pytest.mark.parametrize("kind", DAMAGES)
def test_damage_is_refused(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bad.h5"
    write(path, example())
    damage, named = DAMAGES[kind]
    with h5py.File(path, "a") as file:
        damage(file)
    refused(path, tmp_path, named, capsys)


def refused(path: Path, folder: Path, named: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(folder.rglob("*"))
    assert main(["check", str(path)]) == 2
    told = capsys.readouterr().err
    assert named in told
    assert told.count("\n") == 1
    assert "Traceback" not in told
    assert main(["diagnose", str(path), "-o", str(folder / "out")]) == 2
    assert sorted(folder.rglob("*")) == before
    capsys.readouterr()


def test_files_that_are_no_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = tmp_path / "whole.h5"
    write(whole, example())
    content = whole.read_bytes()
    for name, data, named in (
        ("empty.h5", b"", "empty"),
        ("text.h5", b"time,head\n0,1\n", "not an HDF5"),
        ("cut.h5", content[: len(content) // 2], "truncated"),
        ("headless.h5", content[64:], "not an HDF5"),
    ):
        path = tmp_path / name
        path.write_bytes(data)
        refused(path, tmp_path, named, capsys)
    refused(tmp_path / "absent.h5", tmp_path, "does not exist", capsys)
    refused(Path(__file__), tmp_path, "not a recording; give a recording, or import a file that ends in", capsys)


@pytest.mark.parametrize("suffix", [".csv", ".mat", ".uff", ".tdms", ".wav", ".toml"])
def test_files_of_other_programs_are_refused_with_the_commands_that_import_them(
    suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, values = tmp_path / f"run{suffix}", np.random.default_rng(0).normal(size=(2, 512))
    if suffix == ".csv":
        np.savetxt(path, np.column_stack([np.arange(512) / 256.0, *values]), delimiter=",", header="time,head,table", comments="")
    elif suffix == ".mat":
        savemat(path, {"head": values[0], "table": values[1], "fs": 256.0})
    elif suffix == ".uff":
        record = prepare_58(
            func_type=1, rsp_node=1, rsp_dir=1, ref_node=0, ref_dir=0, data=values[0], binary=0, x=np.arange(512) / 256.0,
            id1="head", abscissa_spec_data_type=17, abscissa_spacing=1, abscissa_inc=1 / 256.0, abscissa_min=0.0,
            ordinate_spec_data_type=12, orddenom_spec_data_type=0, ord_data_type=4, num_pts=512,
        )  # fmt: skip
        UFF(str(path)).write_sets(record, "add")
    elif suffix == ".tdms":
        with TdmsWriter(path) as writer:
            writer.write_segment(
                [ChannelObject("g", n, v, {"wf_increment": 1 / 256.0}) for n, v in zip("ab", values, strict=True)]
            )
    elif suffix == ".wav":
        wavfile.write(path, 256, values.T.astype(np.float32))
    else:
        path.write_text("[channels]\n")
    way = f"rig import {path} -o run.h5" if suffix == ".toml" else f"rig import --draft {path} -o mapping.toml"
    for command in (["check"], ["diagnose"], ["frf"]):
        assert main([*command, str(path), *(["-o", str(tmp_path / "out")] if command != ["check"] else [])]) == 2
        told = capsys.readouterr().err
        assert way in told
        assert told.count("\n") == 1
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    if suffix != ".toml":
        assert main(["import", "--draft", str(path), "-o", str(tmp_path / "mapping.toml")]) == 0


def test_no_permission(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "secret.h5"
    write(path, example())
    path.chmod(0)
    root = hasattr(os, "geteuid") and os.geteuid() == 0
    try:
        if root:
            os.seteuid(65534)  # root may read every file; nobody may not
        assert main(["check", str(path)]) == 2
    finally:
        if root:
            os.seteuid(0)
    assert "cannot be read" in capsys.readouterr().err


def test_flipped_byte(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "flipped.h5"
    write(path, example())
    with h5py.File(path) as file:
        place = file["runs/u70/table"].id.get_chunk_info(0).byte_offset
    content = bytearray(path.read_bytes())
    content[place + 5] ^= 0x10
    path.write_bytes(bytes(content))
    refused(path, tmp_path, "'/runs/u70/table' cannot be read", capsys)


KILLED = """
import h5py, os, signal, sys
file = h5py.File(sys.argv[1], "w", libver="latest")
file.attrs["format"] = "rig-recording"
file["runs/u70/head"] = range(1000)
file.swmr_mode = True
file.flush()
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_recorder_was_killed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "killed.h5"
    subprocess.run([sys.executable, "-c", KILLED, str(path)], check=False)
    refused(path, tmp_path, "never closed", capsys)


def test_what_a_reader_refuses_is_not_written(tmp_path: Path) -> None:
    whole = example()
    run = whole.runs[0]

    class OnDisk:
        """Samples that are read while they are written."""

        shape = (2,)

        def __getitem__(self, key: slice, /) -> NDArray[np.float64]:
            return np.array([0.0, np.nan])[key]

    spoiled = replace(run, channels={"head": Channel(name="head", samples=OnDisk())})
    for bad in ((spoiled,), (replace(run, id="a/b"),), (run, run), (replace(run, band=(-1.0, 5.0)),)):
        with pytest.raises(RecordingError):
            write(tmp_path / "bad.h5", replace(whole, runs=bad))
    assert not list(tmp_path.iterdir())


def test_streamed_gain_and_unknown_parts(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    write(path, example())
    with h5py.File(path, "a") as file:
        file["runs/u70/gain"] = np.linspace(69.0, 71.0, 300)
        file["runs/u70"].attrs["operator"] = "somebody"
        file["notes"] = "warm day"
    run = read(path).runs[0]
    assert run.channels["gain"].quantity == "gain"
    assert run.read("gain")[-1] == 71.0
    assert set(run.channels) == {"head", "motor", "table", "heatblock", "gain"}
    assert run.use == "holdout"


def test_a_steady_gain_costs_next_to_nothing(tmp_path: Path) -> None:
    n = 200_000
    channels = {
        "head": Channel(name="head", samples=np.random.default_rng(1).integers(-9999, 9999, n).astype(np.int32)),
        "gain": Channel(name="gain", samples=np.full(n, 70.0), quantity="gain", unit="1"),
    }
    run = Run(id="u70", configuration="unlocked", sample_rate=1024.0, gain=70.0, channels=channels)
    write(tmp_path / "with.h5", Campaign(runs=(run,)))
    write(tmp_path / "without.h5", Campaign(runs=(replace(run, channels=run.sensors),)))
    assert np.all(read(tmp_path / "with.h5").runs[0].read("gain") == 70.0)
    assert (tmp_path / "with.h5").stat().st_size < 1.03 * (tmp_path / "without.h5").stat().st_size


def test_opened_recording_reads_what_is_asked(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    write(path, example())
    with open_recording(path) as campaign:
        assert np.allclose(campaign.runs[0].channels["motor"].read(10, 13), [0.51, 0.511, 0.512])


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0.0, 1.0), byte=st.integers(0, 255), cut=st.booleans())
def test_any_damage_ends_in_an_answer_or_a_refusal(tmp_path: Path, place: float, byte: int, cut: bool) -> None:
    whole, path = tmp_path / "whole.h5", tmp_path / "damaged.h5"
    if not whole.exists():
        write(whole, example())
    content = bytearray(whole.read_bytes())
    at = min(int(place * len(content)), len(content) - 1)
    content[at] = byte
    path.write_bytes(bytes(content[:at] if cut else content))
    with contextlib.suppress(RecordingError):
        read(path)


def test_check_shows_rates_and_whole_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ("2024-03-12_level_sweep_unlocked_gain70_after_the_new_bearing_was_fitted_0001", "b")
    channels = {name: Channel(name=name, samples=np.arange(100.0)) for name in ("head", "motor", "table", "heatblock")}
    runs = tuple(
        Run(id=name, configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels)
        for name, rate in zip(names, (25600.0, 1652.3), strict=True)
    )
    write(tmp_path / "r.h5", Campaign(runs=runs))
    assert main(["check", str(tmp_path / "r.h5")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(names[0] in line and " 25600 " in line for line in lines)
    assert any(line.split()[:1] == ["b"] and " 1652.3 " in line for line in lines)
