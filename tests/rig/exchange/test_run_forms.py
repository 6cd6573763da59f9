"""Runs, channels and times in the forms of other programs: axes of arrays, cells, parts of benchmarks, datasets, workbooks."""

from __future__ import annotations

import json
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
from nptdms import ChannelObject, TdmsWriter
from openpyxl import Workbook
from scipy.io import savemat
from test_lab_files import ROWS, TIME, N, X, Y, check, drafted, said_of, table

from isorig.analysis.campaign import FloatArray, Run
from isorig.rig.cli import main
from isorig.rig.exchange.reading import read_foreign

RUNS = [(X + k, Y - k) for k in range(3)]
DATES = [(datetime(2024, 3, 12, 23, 59, 59, 950000) + timedelta(milliseconds=k)).isoformat(" ", "milliseconds") for k in range(N)]


def check_runs(runs: list[Run], names: tuple[str, str]) -> None:
    assert len(runs) == len(RUNS)
    for run, values in zip(runs, RUNS, strict=True):
        check(run, dict(zip(names, values, strict=True)))


CUBE = np.moveaxis(np.array(RUNS), (0, 1, 2), (2, 1, 0))  # samples x channels x runs


@pytest.mark.parametrize("form", ["mat", "npz", "h5"])
def test_runs_along_the_third_axis(tmp_path: Path, form: str) -> None:
    """The names of the channels say which axis they are along; MATLAB's HDF5 has the axes in reverse order."""
    file = tmp_path / f"m.{form}"
    if form == "mat":
        savemat(file, {"data": CUBE, "t": TIME[:, None], "channels": np.array(["a", "b"], object)})
    elif form == "npz":
        np.savez(file, data=CUBE, t=TIME, channels=["a", "b"])
    else:
        with h5py.File(file, "w") as hdf:
            hdf["data"], hdf["t"] = CUBE.T, TIME
            hdf["data"].attrs["channels"] = ["a", "b"]
    check_runs(drafted(tmp_path, file), ("a", "b"))


def test_runs_of_two_arrays(tmp_path: Path) -> None:
    """Input and output of a benchmark: samples, one channel, runs."""
    savemat(tmp_path / "m.mat", {"u": CUBE[:, :1], "y": CUBE[:, 1:], "fs": 1000.0})
    check_runs(drafted(tmp_path, tmp_path / "m.mat"), ("u", "y"))
    np.savez(tmp_path / "n.npz", data=CUBE, fs=1000.0)
    assert len(drafted(tmp_path, tmp_path / "n.npz")) == 1


def test_parts_of_a_benchmark(tmp_path: Path) -> None:
    """Names that end in est alone are no such parts."""
    savemat(tmp_path / "m.mat", {"uEst": X, "yEst": Y, "uVal": X[:60], "yVal": Y[:60], "fs": 1000.0})
    first, second = drafted(tmp_path, tmp_path / "m.mat")
    check(first, {"u": X, "y": Y})
    check(second, {"u": X[:60], "y": Y[:60]})
    savemat(tmp_path / "n.mat", {"y": X, "y_est": Y, "fs": 1000.0})
    assert len(drafted(tmp_path, tmp_path / "n.mat")) == 1


@pytest.mark.parametrize("form", ["run{}_{}", "{1}_run{0}", "{1} run {0}"])
def test_runs_in_names(tmp_path: Path, form: str) -> None:
    """Their clock may be a common one."""
    names = [form.format(k, name) for k in range(3) for name in ("a", "b")]
    rows = zip(TIME, *(values for run in RUNS for values in run), strict=True)
    lines = [",".join(map(str, row)) for row in rows]
    check_runs(drafted(tmp_path, table(tmp_path / "m.csv", ",".join(["time", *names]), *lines)), ("a", "b"))
    assert len(drafted(tmp_path, table(tmp_path / "n.csv", "time,test1_a,test2_b", *ROWS))) == 1


@pytest.mark.parametrize("form", ["h5", "json"])
def test_runs_of_channels_with_a_structure_each(tmp_path: Path, form: str) -> None:
    file = tmp_path / f"m.{form}"
    if form == "h5":
        with h5py.File(file, "w") as hdf:
            for k, values in enumerate(RUNS):
                for name, each in zip("ab", values, strict=True):
                    hdf[f"tests/run{k}/{name}/data"] = each
            hdf.attrs["fs"] = 1000.0
    else:
        runs = [
            {"id": f"run{k}", "fs": 1000.0, "channels": {n: {"data": v.tolist()} for n, v in zip("ab", run, strict=True)}}
            for k, run in enumerate(RUNS)
        ]
        file.write_text(json.dumps({"runs": runs}))
    found = drafted(tmp_path, file)
    assert [run.id for run in found] == ["run0", "run1", "run2"]
    check_runs(found, ("a", "b"))


def test_cells_with_a_run_each(tmp_path: Path) -> None:
    cells = np.empty((3, 1), object)
    for k, (x, y) in enumerate(RUNS):
        cells[k, 0] = np.stack([TIME, x, y], 1)
    savemat(tmp_path / "m.mat", {"data": cells})
    check_runs(drafted(tmp_path, tmp_path / "m.mat"), ("channel_1", "channel_2"))


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_words_that_name_the_runs(tmp_path: Path, form: str) -> None:
    a, b = (np.concatenate([run[k] for run in RUNS]) for k in (0, 1))
    frame = pd.DataFrame({"run": np.repeat(["x", "y", "z"], N), "fs": 1000.0, "a": a, "b": b})
    frame.to_csv(tmp_path / "m.csv", index=False)
    frame.drop(columns="fs").assign(dt=1e-3).to_parquet(tmp_path / "m.parquet")
    assert main(["import", "--draft", str(tmp_path / f"m.{form}"), "-o", str(tmp_path / "d.toml")]) == 0
    text = (tmp_path / "d.toml").read_text()
    assert text.count("[[runs]]") == 3
    assert "column 'run' numbers the runs, so it is no channel and left out" in text
    frame = frame.assign(run=np.where(a > 0.0, "high", "low"))
    frame.to_csv(tmp_path / "n.csv", index=False)
    assert "column 'run' contains words" in " ".join(read_foreign(tmp_path / "n.csv").remarks)


def test_names_of_testlab(tmp_path: Path) -> None:
    signals = {
        f"Signal_{k}": {
            "x_values": {"start_value": 0.0, "increment": 1e-3, "number_of_values": N},
            "y_values": {"values": values[:, None], "quantity": {"label": "N"}},
            "function_record": {"name": name},
        }
        for k, (name, values) in enumerate((("left", X), ("right", Y)))
    }
    savemat(tmp_path / "m.mat", signals)
    (run,) = drafted(tmp_path, tmp_path / "m.mat")
    check(run, {"left": X, "right": Y})


def test_lists_of_sensitivities_are_reported(tmp_path: Path) -> None:
    """They may be those of the sensors whose voltages the array has."""
    savemat(tmp_path / "m.mat", {"data": np.stack([X, Y], 1), "sensitivity": [0.01, 0.1], "fs": 1000.0})
    assert main(["import", "--draft", str(tmp_path / "m.mat"), "-o", str(tmp_path / "d.toml")]) == 0
    assert "perhaps scales of channels: sensitivity = [0.01, 0.1]" in (tmp_path / "d.toml").read_text()
    with TdmsWriter(tmp_path / "m.tdms") as file:
        properties = {"wf_increment": 1e-3, "Sensitivity": 10.2, "Slot": 3}
        file.write_segment([ChannelObject("Log", "a", X, properties), ChannelObject("Log", "b", Y, properties)])
    assert set(read_foreign(tmp_path / "m.tdms").numbers.values()) == {10.2}


def test_cells_with_lists_of_names(tmp_path: Path) -> None:
    cells = np.empty((1, 2), object)
    cells[0, 0], cells[0, 1] = X[:, None], Y[:, None]
    lists = {"names": np.array(["acc", "lower"], object), "variableUnits": np.array(["mm/s^2", "N"], object)}
    savemat(tmp_path / "m.mat", {"data": cells, "fs": 1000.0, **lists})
    (run,) = drafted(tmp_path, tmp_path / "m.mat")
    check(run, {"acc": X * 1e-3, "lower": Y})


@pytest.mark.parametrize("form", ["ndjson", "h5", "parquet", "npz"])
def test_times_in_words(tmp_path: Path, form: str) -> None:
    file = tmp_path / f"m.{form}"
    if form == "ndjson":
        file.write_text("\n".join(json.dumps({"time": d, "a": x, "b": y}) for d, x, y in zip(DATES, X, Y, strict=True)))
    elif form == "h5":
        with h5py.File(file, "w") as hdf:
            hdf["time"], hdf["a"], hdf["b"] = DATES, X, Y
    elif form == "parquet":
        pd.DataFrame({"time": DATES, "a": X, "b": Y}).to_parquet(file)
    else:
        np.savez(file, time=DATES, a=X, b=Y)
    (run,) = drafted(tmp_path, file)
    check(run, {"a": X, "b": Y})


@pytest.mark.parametrize("form", ["parquet", "ndjson"])
def test_channels_below_each_other(tmp_path: Path, form: str) -> None:
    frame = pd.DataFrame({"time": np.repeat(TIME, 2), "channel": ["a", "b"] * N, "value": np.stack([X, Y], 1).ravel()})
    if form == "parquet":
        frame.to_parquet(tmp_path / "m.parquet")
    else:
        frame.to_json(tmp_path / "m.ndjson", orient="records", lines=True, double_precision=15)
    (run,) = drafted(tmp_path, tmp_path / f"m.{form}")
    check(run, {"a": X, "b": Y})


def test_days_since_the_year_zero(tmp_path: Path) -> None:
    savemat(tmp_path / "m.mat", {"time": 738000.5 + TIME[:, None] / 86400.0, "a": X[:, None], "b": Y[:, None]})
    (run,) = drafted(tmp_path, tmp_path / "m.mat")
    assert run.sample_rate == pytest.approx(1000.0, rel=1e-3)


def test_a_scale_of_whole_numbers(tmp_path: Path) -> None:
    """The unit is that of the scaled values; a scale of other values is only listed."""
    with h5py.File(tmp_path / "m.h5", "w") as hdf:
        hdf["a"], hdf["b"] = np.round(X * 1000.0).astype(np.int16), Y
        for name in ("a", "b"):
            hdf[name].attrs.update({"scale": 0.002, "offset": 0.5, "unit": "N", "fs": 1000.0})
    found = read_foreign(tmp_path / "m.h5")
    np.testing.assert_allclose(found.columns["a"].values, np.round(X * 1000.0) * 0.002 + 0.5)
    np.testing.assert_array_equal(found.columns["b"].values, Y)
    assert {name: number for name, number in found.numbers.items() if "scale" in name} == {"b#/scale": 0.002}


def dataset(values: FloatArray, kind: int, unit: str, node: int, run: int) -> str:
    """Dataset 58 with a time record, after the description of the universal file format."""
    lines = [
        f"{-1:6d}", f"{58:6d}", "NONE", "NONE", "12-Mar-24 10:11:12", f"Run {run}", "NONE",
        f"{1:5d}{run:10d}{1:5d}{0:10d} {'NONE':10}{node:10d}{3:4d} {'NONE':10}{1:10d}{3:4d}",
        f"{4:10d}{N:10d}{1:10d}{0.0:13.5e}{1e-3:13.5e}{0.0:13.5e}",
        f"{17:10d}{0:5d}{0:5d}{0:5d} {'Time':20} {'s':20}", f"{kind:10d}{0:5d}{0:5d}{0:5d} {'NONE':20} {unit:20}",
        *[f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20} {'NONE':20}"] * 2,
        *("".join(f"{v:20.12e}" for v in values[k : k + 4]) for k in range(0, N, 4)), f"{-1:6d}",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def test_runs_of_a_universal_file(tmp_path: Path) -> None:
    """Force and acceleration at the driving point are two channels, and their repetitions are runs."""
    (tmp_path / "m.uff").write_text(
        "".join(
            dataset(values, kind, unit, 1, run)
            for run, each in enumerate(RUNS, 1)
            for values, kind, unit in zip(each, (13, 12), ("N", "m/s^2"), strict=True)
        )
    )
    check_runs(drafted(tmp_path, tmp_path / "m.uff"), ("channel_1_z_force", "channel_1_z_acceleration"))


@pytest.mark.parametrize(("length", "unit", "size"), [(1.0, "g", 9.80665), (1.0, "mm/s^2", 1e-3), (1000.0, "mm/s^2", None)])
def test_a_label_that_contradicts_the_unit_system(tmp_path: Path, length: float, unit: str, size: float | None) -> None:
    system = f"{-1:6d}\n{164:6d}\n{1:10d}{'system':20}{2:10d}\n{length:25.16e}{1.0:25.16e}{1.0:25.16e}\n{0.0:25.16e}\n{-1:6d}\n"
    (tmp_path / "m.uff").write_text(system + dataset(X, 12, unit, 1, 1))
    remarks = read_foreign(tmp_path / "m.uff").remarks
    assert (f"if its values are in the unit system, write sensitivity = {size or 0:g}" in " ".join(remarks)) is (size is not None)


def workbook(path: Path, sheets: dict[str, list[list[Any]]]) -> Path:
    book = Workbook()
    book.remove(book.worksheets[0])
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(path)
    return path


def test_sheets_of_a_workbook(tmp_path: Path) -> None:
    """Sheets with the same columns are runs; one with settings may have their sample rate."""
    sheets: dict[str, list[list[Any]]] = {
        f"Run {k}": [["a [mm/s²]", "b [N]"], *([float(x), float(y)] for x, y in zip(*values, strict=True))]
        for k, values in enumerate(RUNS)
    }
    file = workbook(tmp_path / "m.xlsx", {"Info": [["Setting", "Value"], ["Fs", 1000]], **sheets})
    runs = drafted(tmp_path, file)
    assert [run.id for run in runs] == ["Run 0", "Run 1", "Run 2"]
    for run, (x, y) in zip(runs, RUNS, strict=True):
        check(run, {"a": x * 1e-3, "b": y})


def test_dates_of_a_workbook(tmp_path: Path) -> None:
    rows = [[datetime.fromisoformat(d), float(x), float(y)] for d, x, y in zip(DATES, X, Y, strict=True)]
    (run,) = drafted(tmp_path, workbook(tmp_path / "m.xlsx", {"S": [["A title"], [], ["Zeit", "a", "b"], *rows]}))
    check(run, {"a": X, "b": Y})


def test_workbooks_that_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = workbook(tmp_path / "m.xlsx", {"S": [["A title"]]})
    assert "contains no numeric records (sheet 'S' is left out" in said_of(capsys, "--draft", file, "-o", tmp_path / "d.toml")
    file.rename(tmp_path / "m.csv")
    assert "contains an Excel workbook, not text; rename it to m.xlsx" in said_of(
        capsys, "--draft", tmp_path / "m.csv", "-o", tmp_path / "d.toml"
    )
    np.savez(tmp_path / "n.npz", a=X)
    (tmp_path / "n.npz").rename(tmp_path / "n.xlsx")
    assert "contains a .npz file, not an Excel workbook; rename it to n.npz" in said_of(
        capsys, "--draft", tmp_path / "n.xlsx", "-o", tmp_path / "d.toml"
    )


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("m.blf", b"LOGG" + bytes(40)),
        ("m.trc", b";$FILEVERSION=2.1\n;"),
        ("m.asc", b"date Tue Mar 12 10:11:12.000 am 2024\r\nbase hex  timestamps absolute\r\n"),
    ],
)
def test_logs_of_can_messages(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    assert "decode it with its database (DBC)" in said_of(capsys, "--draft", tmp_path / name, "-o", tmp_path / "d.toml")


def test_the_unit_of_one_record(tmp_path: Path) -> None:
    rows = [f"{k}\t{t:.3f}\t{x}" for k, (t, x) in enumerate(zip(TIME, X, strict=True), 1)]
    found = read_foreign(table(tmp_path / "m.txt", "X-axis unit: s", "Amplitude unit: mm/s²", *rows))
    assert [column.unit for column in found.columns.values()] == ["", "", "mm/s²"]
    both = [f"{x}\t{y}" for x, y in zip(X, Y, strict=True)]
    found = read_foreign(table(tmp_path / "m.txt", "Amplitude unit: mm/s²", *both))
    assert [column.unit for column in found.columns.values()] == ["", ""]


def test_what_may_be_a_clock_or_a_rate(tmp_path: Path) -> None:
    """Whole numbers that rise evenly, and a frequency in the name of the file, are proposed only in words."""
    file = table(tmp_path / "run_2,5kHz.csv", *(f"{2 * k}{row[5:]}" for k, row in enumerate(ROWS)))
    assert main(["import", "--draft", str(file), "-o", str(tmp_path / "d.toml")]) == 0
    text = (tmp_path / "d.toml").read_text()
    assert "column 'column0' rises evenly from row to row: if it is a clock, write time = 'column0' and its time_unit" in text
    assert "\n# sample_rate = 2500.0    # ? not given by the file except perhaps in its name, '2,5kHz'; required" in text


@pytest.mark.parametrize(("head", "unit"), [("v_mm/s", "mm/s"), ("acc_mm_s2", "mm/s^2"), ("acc_mps2", "m/s^2"), ("v_m_s", "m/s")])
def test_units_at_the_end_of_a_name(tmp_path: Path, head: str, unit: str) -> None:
    file = table(tmp_path / "m.csv", f"time,{head},b", *ROWS)
    assert main(["import", "--draft", str(file), "-o", str(tmp_path / "d.toml")]) == 0
    assert f'unit = "{unit}"' in (tmp_path / "d.toml").read_text()


def test_a_clock_of_each_channel(tmp_path: Path) -> None:
    lines = [f"{t:.3f}\t{x}\t{t:.3f}\t{y}" for t, x, y in zip(TIME, X, Y, strict=True)]
    head = "Time - Voltage_0\tAmplitude - Voltage_0\tTime - Voltage_1\tAmplitude - Voltage_1"
    (run,) = drafted(tmp_path, table(tmp_path / "m.txt", head, *lines))
    check(run, {"amplitude_voltage_0": X, "amplitude_voltage_1": Y})
