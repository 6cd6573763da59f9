"""Files as other programs write them, odd ones too: the right values and rates, or a sentence that names the file."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import pyuff
from nptdms import ChannelObject, TdmsWriter
from scipy.io import loadmat, savemat, wavfile

from isorig.analysis.campaign import FloatArray, Run
from isorig.rig.cli import main
from isorig.rig.exchange.reading import read_foreign
from isorig.rig.exchange.table import ForeignTable
from isorig.rig.files.recording import read

N, RATE = 400, 512.0
TIME = np.arange(N) / RATE
X = np.random.default_rng(1).normal(size=N)
Y = np.roll(X, 3) / 3.0
F = np.arange(65) * 4.0
H = 1.0 / (100.0**2 - F**2 + 2j * 0.02 * 100.0 * F)


def drafted(folder: Path, *files: Path) -> list[Run]:
    """The runs of a recording that is imported with the proposed mapping as it is."""
    draft, out = folder / "draft.toml", folder / "out.h5"
    (folder / "draft-rig.toml").unlink(missing_ok=True)
    assert main(["import", "--draft", *map(str, files), "-o", str(draft)]) == 0, draft
    assert main(["import", str(draft), "-o", str(out)]) == 0, draft.read_text()
    return sorted(read(out).runs, key=lambda run: run.id)


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    capsys.readouterr()
    assert main(list(words)) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "/tmp" not in said.replace(words[-3], "").replace(str(Path(words[-3]).parent), "")
    return said


def refused_draft(capsys: pytest.CaptureFixture[str], file: Path) -> str:
    said = refused(capsys, "import", "--draft", str(file), "-o", str(file.parent / "d.toml"))
    assert file.name in said
    return said


def dataset(**keys: Any) -> dict[str, Any]:
    values = keys.pop("data", X)
    plain: dict[str, Any] = {
        "type": 58, "func_type": 1, "rsp_node": 1, "rsp_dir": 0, "ref_node": 0, "ref_dir": 0, "rsp_ent_name": "head",
        "abscissa_spacing": 1, "abscissa_spec_data_type": 17, "abscissa_axis_units_lab": "s", "ordinate_spec_data_type": 12,
        "ordinate_axis_units_lab": "NONE", "orddenom_spec_data_type": 0, "data": values, "x": TIME[: len(values)],
        "num_pts": len(values), "z_axis_value": 0.0, "id1": "NONE",
    }  # fmt: skip
    return plain | keys


def uff(path: Path, *sets: dict[str, Any]) -> Path:
    pyuff.UFF(str(path)).write_sets(list(sets), "add")
    return path


# -- universal files


def test_uneven_abscissa_is_not_taken_for_even(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    uneven = dataset(abscissa_spacing=0, x=TIME**1.5)
    said = refused_draft(capsys, uff(tmp_path / "uneven.uff", uneven))
    assert "uneven abscissa" in said
    both = uff(tmp_path / "both.uff", uneven, dataset(rsp_ent_name="table", abscissa_spacing=0, data=Y))
    (run,) = drafted(tmp_path, both)
    assert list(run.channels) == ["push", "table"]
    np.testing.assert_allclose(run.read("table"), Y)
    assert run.sample_rate == pytest.approx(RATE, rel=1e-5)
    assert "uneven" in (tmp_path / "draft.toml").read_text()


def test_function_types(tmp_path: Path) -> None:
    """Type 0 over frequency is a spectrum, over time a record; 9, 12 and 5 are spectra; over rpm it is neither."""
    over = {"abscissa_spec_data_type": 18, "abscissa_axis_units_lab": "Hz", "x": F, "data": np.abs(H), "num_pts": len(F)}
    path = uff(
        tmp_path / "a.uff", dataset(func_type=0, **over), dataset(func_type=0, rsp_ent_name="table"),
        dataset(func_type=9, rsp_ent_name="motor", **over), dataset(func_type=4, **{**over, "data": H}),
        dataset(func_type=0, rsp_ent_name="speed", abscissa_spec_data_type=19, abscissa_axis_units_lab="rpm"),
        dataset(rsp_ent_name="slow", abscissa_axis_units_lab="ms", x=1e3 * TIME),
    )  # fmt: skip
    table = read_foreign(path)
    assert {name: column.sample_rate for name, column in table.columns.items()} == {"table": RATE, "slow": RATE}
    assert [spectrum.kind for spectrum in table.spectra] == ["spectrum", "power_spectral_density", "transfer_function"]
    np.testing.assert_allclose(table.spectra[2].values, H, rtol=1e-9)
    assert len(table.remarks) == 1
    assert "speed" in table.remarks[0]


@pytest.mark.parametrize(
    ("code", "length", "force", "names"), [(5, 1e3, 1e3, "mm"), (7, 39.37007874015748, 0.2248089431, "inch")]
)
def test_units_of_dataset_164(tmp_path: Path, code: int, length: float, force: float, names: str) -> None:
    units = pyuff.prepare_164(units_code=code, units_description=names, temp_mode=1, length=length, force=force, temp=1.0,
                              temp_offset=0.0)  # fmt: skip
    push = dataset(rsp_ent_name="force", ordinate_spec_data_type=13, data=force * Y)
    in_g = dataset(rsp_ent_name="table", ordinate_axis_units_lab="g", data=Y / 9.80665)
    (run,) = drafted(tmp_path, uff(tmp_path / "a.uff", units, dataset(data=length * X), push, in_g))
    np.testing.assert_allclose(run.read("head"), X, rtol=1e-9)
    np.testing.assert_allclose(run.read("force"), Y, rtol=1e-9)
    np.testing.assert_allclose(run.read("table"), Y, rtol=1e-9)
    assert run.channels["force"].unit == "N"


def test_two_lengths_are_two_runs(tmp_path: Path) -> None:
    """Neither is dropped, and each keeps its rate."""
    slow = dataset(rsp_ent_name="table", data=Y[:100], x=np.arange(100) / 100.0)
    runs = drafted(tmp_path, uff(tmp_path / "a.uff", dataset(), slow))
    assert [(len(run), run.sample_rate, list(run.channels)) for run in runs] == [(N, RATE, ["head"]), (100, 100.0, ["table"])]
    np.testing.assert_allclose(runs[1].read("table"), Y[:100], rtol=1e-9)


def test_names_at_several_nodes(tmp_path: Path) -> None:
    sets = [dataset(rsp_ent_name="Mic", rsp_node=k, rsp_dir=k, data=k * X) for k in (1, 2, 3)]
    assert list(read_foreign(uff(tmp_path / "a.uff", *sets)).columns) == ["Mic 1+x", "Mic 2+y", "Mic 3+z"]


def test_a_cut_file_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = uff(tmp_path / "whole.uff", dataset()).read_text().splitlines()
    cut = tmp_path / "cut.uff"
    cut.write_text("\n".join([*text[:60], "    -1", ""]))
    assert "function 1 (head) has" in refused_draft(capsys, cut)


@pytest.mark.parametrize(
    ("form", "lines", "said"),
    [
        (0, 5, "dataset 2 ends in its header"),
        (0, 13, f"dataset 2 ends after 0 lines of its {N} values"),
        (0, 15, f"dataset 2 ends after 2 lines of its {N} values"),
        (1, 15, "dataset 2 has no line -1 at its end"),
    ],
)
def test_a_dataset_without_its_end_is_named(
    form: int, lines: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first dataset is whole."""
    one, two = (dataset(rsp_ent_name=name, binary=form, data=Y) for name in ("head", "table"))
    whole, first = uff(tmp_path / "whole.uff", one, two).read_bytes(), uff(tmp_path / "first.uff", one).read_bytes()
    cut = tmp_path / "cut.uff"
    cut.write_bytes(first + b"".join(whole[len(first) :].splitlines(keepends=True)[:lines]))
    assert f"{said}: the file was truncated; copy it again from its source" in refused_draft(capsys, cut)


def test_a_dataset_with_half_a_header_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = uff(tmp_path / "whole.uff", dataset()).read_text().splitlines()
    (tmp_path / "half.uff").write_text("\n".join([*text[:8], "    -1", ""]))
    assert "dataset 1 cannot be read" in refused_draft(capsys, tmp_path / "half.uff")


def test_an_interval_that_is_no_interval(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = uff(tmp_path / "a.uff", dataset())
    stated = f"{TIME[1]:13.5e}"
    content = path.read_text()
    assert content.count(stated) == 1
    path.write_text(content.replace(stated, f"{1e-320:13.5e}"))
    assert "function 1 (head) has the sample interval" in refused_draft(capsys, path)


def test_peer_files(shared: Path) -> None:
    """Values, abscissae and units as the package pyuff has them; a file without functions is refused by its name."""
    for name in ("Sample_UFF58_ascii.uff", "Sample_UFF58b_bin.uff"):
        path = shared / "peers" / "pyuff" / name
        sets = pyuff.UFF(str(path)).read_sets()
        sets = [item for item in (sets if isinstance(sets, list) else [sets]) if item["type"] == 58]
        table = read_foreign(path)
        assert len(table.columns) + len(table.spectra) == len(sets)
        for item, column in zip((s for s in sets if s["func_type"] == 1), table.columns.values(), strict=False):
            np.testing.assert_array_equal(column.values, item["data"])
            assert column.sample_rate == pytest.approx(1.0 / item["abscissa_inc"], rel=1e-5)
            assert column.unit == item["ordinate_axis_units_lab"].strip()
        for item, spectrum in zip((s for s in sets if s["func_type"] != 1), table.spectra, strict=False):
            np.testing.assert_array_equal(spectrum.values, item["data"])
            np.testing.assert_allclose(spectrum.frequency, item["x"])


# -- MATLAB


def v73(path: Path, write: Callable[[h5py.File], None]) -> Path:
    with h5py.File(path, "w", userblock_size=512) as file:
        write(file)
    return path


def test_strings_of_v73_are_no_channels(tmp_path: Path) -> None:
    """Text, cells, struct arrays and complex values as MATLAB writes them in version 7.3."""

    def write(file: h5py.File) -> None:
        for name, values in (("t", TIME), ("acc", X)):
            file[name] = values[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["note"] = np.array([[ord(c) for c in "a" * N]], dtype=np.uint16)
        file["note"].attrs["MATLAB_class"] = np.bytes_("char")
        file["#refs#/a"], file["#refs#/b"] = X[None, :], Y[None, :]
        group = file.create_group("runs")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        group["force"] = np.array([[file["#refs#/a"].ref], [file["#refs#/b"].ref]], dtype=h5py.ref_dtype)
        pair = np.empty((1, N), dtype=[("real", "f8"), ("imag", "f8")])
        pair["real"], pair["imag"] = X, Y
        file["z"] = pair

    table = read_foreign(v73(tmp_path / "a.mat", write))
    assert set(table.columns) == {"t", "acc", "runs[0].force", "runs[1].force"}
    np.testing.assert_array_equal(table.columns["runs[1].force"].values, Y)
    assert any("'z' is complex" in remark for remark in table.remarks)
    (run,) = drafted(tmp_path, tmp_path / "a.mat")
    assert run.sample_rate == RATE
    assert len(run.channels) == 3


def test_struct_arrays_and_many_axes(tmp_path: Path) -> None:
    """Structs with their own rate and unit, a struct array, and an array of three axes (samples, sensors, hits)."""
    cube = np.arange(N * 3 * 2, dtype=float).reshape(N, 3, 2)
    elements = np.empty(2, dtype=[("value", object), ("fs", object), ("unit", object)])
    for k, values in enumerate((X, Y)):
        elements[k] = (values, 1000.0, "g")
    savemat(tmp_path / "a.mat", {"s": elements, "cube": cube, "dt": 1.0 / RATE, "log": {"acc": Y, "fs": 2000.0}, "name": "run 1"})
    table = read_foreign(tmp_path / "a.mat")
    assert table.columns["s[0].value"].unit == "g"
    assert {name: table.columns[name].sample_rate for name in ("s[1].value", "cube[2,1]", "log.acc")} == {
        "s[1].value": 1000.0, "cube[2,1]": RATE, "log.acc": 2000.0,
    }  # fmt: skip
    np.testing.assert_array_equal(table.columns["cube[2,1]"].values, cube[:, 2, 1])
    runs = drafted(tmp_path, tmp_path / "a.mat")
    assert sorted((run.sample_rate, len(run.channels)) for run in runs) == [(RATE, 6), (1000.0, 2), (2000.0, 1)]
    scaled = next(run for run in runs if run.sample_rate == 1000.0)
    np.testing.assert_allclose(next(iter(scaled.channels.values())).read(), X * 9.80665)


def test_complex_values_over_frequency(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    savemat(tmp_path / "a.mat", {"frf": {"f": F, "H": np.column_stack([H, 2 * H]), "reference": "hammer"}})
    table = read_foreign(tmp_path / "a.mat")
    assert [(s.response, s.reference, s.kind) for s in table.spectra] == [
        ("frf.H[0]", "hammer", "transfer_function"), ("frf.H[1]", "hammer", "transfer_function"),
    ]  # fmt: skip
    np.testing.assert_allclose(table.spectra[1].values, 2 * H)
    np.testing.assert_allclose(table.spectra[1].frequency, F)
    assert "2 transfer functions" in refused_draft(capsys, tmp_path / "a.mat")
    savemat(tmp_path / "p.mat", {"f": F, "Pxx": np.abs(H) ** 2})
    assert "without phase" in refused_draft(capsys, tmp_path / "p.mat")


def test_a_logger_of_a_vibration_laboratory(shared: Path, tmp_path: Path) -> None:
    """The abscissae as the peer's package states them: rfftfreq of npts at freq; a second column within 0 and 1 is coherence."""
    folder = shared / "peers" / "pydvma"
    ruler = read_foreign(folder / "ruler_grid_acc_3.mat")
    raw = loadmat(folder / "ruler_grid_acc_3.mat")["yspec"]
    assert [s.kind for s in ruler.spectra] == ["transfer_function"] * 10
    np.testing.assert_array_equal(np.stack([s.values for s in ruler.spectra], axis=1), raw)
    np.testing.assert_allclose(ruler.spectra[0].frequency, np.arange(16385) * 20000 / 32768)
    assert [s.kind for s in read_foreign(folder / "jw_tf_coh.mat").spectra] == ["transfer_function", "coherence"]
    assert main(["import", "--draft", str(folder / "ruler_grid_acc_3.mat"), "-o", str(tmp_path / "d.toml")]) == 2
    (run,) = drafted(tmp_path, folder / "jw_time.mat")
    assert (run.sample_rate, len(run)) == (8000.0, 2000)


# -- text


def csv(path: Path, head: str, rows: FloatArray | list[str], sep: str = ",") -> Path:
    lines = rows if isinstance(rows, list) else [sep.join(f"{v:.6f}" for v in row) for row in rows]
    path.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("head", "scale"),
    [
        ("Sec,acc\n", 1.0), ("Zeit [ms],acc\n", 1e3), ("Time (us),acc\n", 1e6), ("t_ms,acc\n", 1e3), ("Zeit/ms,acc / g\n", 1e3),
        ("Time,acc\nms,g\n", 1e3), ("Sensor A\nTime,acc\n[s],[g]\n", 1.0), ("Elapsed Time (sec),acc\n", 1.0),
        ('"Time","acc, upper"\n"ms","g"\n', 1e3), ("# t acc\n", 1.0),
    ],
)  # fmt: skip
def test_clocks_and_rows_of_units(tmp_path: Path, head: str, scale: float) -> None:
    (run,) = drafted(tmp_path, csv(tmp_path / "a.csv", head, np.column_stack([scale * TIME, X])))
    assert run.sample_rate == pytest.approx(RATE, rel=1e-6)
    assert len(run.channels) == 2
    response, drive = run.channels.values()
    assert not drive.read().any()
    np.testing.assert_allclose(
        response.read(), X * (9.80665 if "g" in head.split("\n", 1)[0][-1:] + head[-4:] else 1.0), atol=2e-5
    )


@pytest.mark.parametrize("rate", [512.0, 1024.0, 2048.0, 997.0, 1652.3])
@pytest.mark.parametrize("rounding", [np.round, np.floor])
def test_a_clock_in_whole_milliseconds(tmp_path: Path, rate: float, rounding: Callable[[FloatArray], FloatArray]) -> None:
    clock = rounding(1e3 * np.arange(20000) / rate)
    rows = [f"{t:.0f};{v:.4f}" for t, v in zip(clock, np.resize(X, 20000), strict=True)]
    (run,) = drafted(tmp_path, csv(tmp_path / "a.csv", "Zeit [ms];a\n", rows))
    assert run.sample_rate == pytest.approx(rate, rel=1e-9 if rate == round(rate) else 1e-6)


def test_a_lost_row_is_not_taken_for_rounding(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ticks = np.delete(np.arange(1000), 500)
    path = csv(tmp_path / "a.csv", "Zeit [ms],a\n", [f"{t},{t % 7}" for t in ticks])
    assert main(["import", "--draft", str(path), "-o", str(tmp_path / "d.toml")]) == 0
    (tmp_path / "d.toml").write_text(
        '[channels.a]\nsource = "a"\nunit = "N"\n[[runs]]\nid = "r"\nfile = "a.csv"\nconfiguration = "unlocked"\ngain = 1.0\n'
        'time = "Zeit"\n'
    )
    said = refused(capsys, "import", str(tmp_path / "d.toml"), "-o", str(tmp_path / "o.h5"))
    assert "a.csv" in said
    assert "differs by 2 from row 500 to row 501" in said


def test_times_of_the_day(tmp_path: Path) -> None:
    seconds = 86390.0 + np.arange(4000) / 200.0
    clock = [f"{int(s // 3600) % 24:02d}:{int(s // 60) % 60:02d}:{s % 60:06.3f}" for s in seconds]
    rows = [f"{t};{v:.4f}" for t, v in zip(clock, np.resize(X, 4000), strict=True)]
    (run,) = drafted(tmp_path, csv(tmp_path / "a.csv", "Uhrzeit;a\n", rows))
    assert run.sample_rate == 200.0


def test_raw_text_with_a_head(tmp_path: Path) -> None:
    head = "Logger 7\nDate: 2020-05-06\nSample rate: 2.048 kHz\nChannel: upper\n\n"
    (run,) = drafted(tmp_path, csv(tmp_path / "a.txt", head, X[:, None]))
    assert run.sample_rate == 2048.0
    np.testing.assert_allclose(next(iter(run.channels.values())).read(), X, atol=1e-6)
    (run,) = drafted(tmp_path, csv(tmp_path / "b.asc", "Delta T = 0.5 ms\n", np.column_stack([X, Y]), sep=" "))
    assert (run.sample_rate, len(run.channels)) == (2000.0, 2)


def test_empty_cells_are_gaps(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"{t:.6f},{x:.6f},{y:.6f}" for t, x, y in zip(TIME, X, Y, strict=True)]
    rows[10] = f"{TIME[10]:.6f},,1.0"
    rows[200] = f"{TIME[200]:.6f},1.0,"
    rows[201] = f"{TIME[201]:.6f},,"
    (run,) = drafted(tmp_path, csv(tmp_path / "a.csv", "t,a,b\n", rows))
    assert "samples without a value in the file: 3, in gaps: 2; they count as lost" in capsys.readouterr().out
    assert [(gap.first_tick, gap.count) for gap in run.gaps] == [(10, 1), (200, 2)]
    assert run.sample_rate == pytest.approx(RATE, rel=1e-6)
    np.testing.assert_allclose(run.read("a"), np.delete(X, [10, 200, 201]), atol=1e-6)


def test_slower_and_shorter_columns(tmp_path: Path) -> None:
    """A value in every eighth row is a record of an eighth of the rate; empty cells at the end make a shorter one."""
    rows = [f"{t:.6f},{x:.6f},{f'{y:.6f}' if k % 8 == 0 else ''},{'1.5' if k < 300 else ''}"
            for k, (t, x, y) in enumerate(zip(TIME, X, Y, strict=True))]  # fmt: skip
    runs = drafted(tmp_path, csv(tmp_path / "a.csv", "t,a,slow,short\n", rows))
    assert sorted((len(run), round(run.sample_rate, 3), *run.channels) for run in runs) == [
        (50, 64.0, "slow"), (300, 512.0, "short"), (400, 512.0, "a"),
    ]  # fmt: skip


CUT = {
    "cells": (lambda text: text[: text.rstrip().rindex(",")] + "\n", "line 401, the last, has 2 of 3 cells"),
    "digits": (lambda text: text.rstrip()[:-2], "line 401, the last, ends within a number"),
    "word": (lambda text: text.replace(text.splitlines()[7], "0.1,broken,2"), "line 8, column 2 contains 'broken'"),
    "more": (lambda text: text.replace(text.splitlines()[7], text.splitlines()[7] + ",4,5"), "line 8 has 5 cells"),
    "fewer": (lambda text: text.replace(text.splitlines()[7], "0.1,0.2"), "line 8 has 2 of 3 cells"),
}  # fmt: skip


@pytest.mark.parametrize("kind", CUT)
def test_a_spoilt_text_names_its_line(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = csv(tmp_path / "half.csv", "t,a,b\n", np.column_stack([TIME, X, Y]))
    spoil, told = CUT[kind]
    path.write_text(spoil(path.read_text()))
    assert f"half.csv, {told}" in refused_draft(capsys, path)


def test_a_last_line_without_an_end_is_whole(tmp_path: Path) -> None:
    """Whole numbers of fewer digits in the last line, or numbers written as short as they are, say nothing."""
    for rows in (
        [f"{t:.6f},{k % 90 + 10}" for k, t in enumerate(TIME)] + [f"{N / RATE:.6f},9"],
        [f"{t!r},{t!r}" for t in TIME.tolist()],
    ):
        (tmp_path / "a.csv").write_text("t,a\n" + "\n".join(rows))
        assert len(read_foreign(tmp_path / "a.csv").columns["a"].values) == len(rows)


def test_a_value_that_is_not_finite_names_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    savemat(tmp_path / "a.mat", {"t": TIME, "a": np.where(np.arange(N) == 7, np.nan, X)})
    assert main(["import", "--draft", str(tmp_path / "a.mat"), "-o", str(tmp_path / "d.toml")]) == 0
    said = refused(capsys, "import", str(tmp_path / "d.toml"), "-o", str(tmp_path / "o.h5"))
    assert "a.mat" in said
    assert "column 'a' contains nan at sample 7" in said


def test_a_table_over_frequency(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for head, first, second in (
        ("Frequency [Hz],Real,Imag\n", H.real, H.imag), ("f,magnitude,phase [deg]\n", np.abs(H), np.degrees(np.angle(H))),
    ):  # fmt: skip
        rows = [f"{f:.12g},{a:.12g},{b:.12g}" for f, a, b in zip(F, first, second, strict=True)]
        np.testing.assert_allclose(read_foreign(csv(tmp_path / "a.csv", head, rows)).spectra[0].values, H, rtol=1e-9)
    psd = csv(tmp_path / "c.csv", "frequency [Hz],PSD\n", np.column_stack([F, 1e4 * np.abs(H)]))
    assert "without phase" in refused_draft(capsys, psd)


# -- other formats


LVM = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t,
Multi_Headings\tYes
X_Columns\t{columns}
Time_Pref\tRelative
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\t{n}\t{n}\t
Y_Unit_Label\tNewtons\tm/s^2\t
X_Dimension\tTime\tTime\t
X0\t0,0000000000000000E+0\t0,0000000000000000E+0\t
Delta_X\t{step}\t{step}\t
***End_of_Header***\t\t\t
X_Value\tExcitation\tResponse\tComment
{rows}
"""


@pytest.mark.parametrize(
    ("columns", "rate", "step"), [("One", 2048.0, "0,000488"), ("No", 25600.0, "3,906250E-5"), ("No", 1024.0, "0,000977")]
)
def test_lvm(tmp_path: Path, columns: str, rate: float, step: str) -> None:
    """The interval in the head has six digits: the rate is the clock's, or the one whole number that the interval allows."""
    clock = [f"{k / rate:.6f}" if columns == "One" else "" for k in range(N)]
    rows = "\n".join(f"{t}\t{x:.6f}\t{y:.6f}" for t, x, y in zip(clock, X, Y, strict=True)).replace(".", ",")
    (tmp_path / "a.lvm").write_text(LVM.format(columns=columns, n=N, step=step, rows=rows))
    (run,) = drafted(tmp_path, tmp_path / "a.lvm")
    assert run.sample_rate == rate
    assert [channel.unit for channel in run.channels.values()] == ["N", "m/s^2"]
    np.testing.assert_allclose(run.read("response"), Y, atol=1e-6)
    assert not list(tmp_path.glob("*.pkl"))


def test_lvm_that_does_not_say_its_rate_or_is_cut(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "\n".join(f"\t{x:.6f}\t{y:.6f}" for x, y in zip(X, Y, strict=True)).replace(".", ",")
    (tmp_path / "a.lvm").write_text(LVM.format(columns="No", n=N, step="0,000488", rows=rows))
    assert main(["import", "--draft", str(tmp_path / "a.lvm"), "-o", str(tmp_path / "d.toml")]) == 0
    assert "is rounded" in (tmp_path / "d.toml").read_text()
    assert "has no common sample rate" in refused(capsys, "import", str(tmp_path / "d.toml"), "-o", str(tmp_path / "o.h5"))
    text = (tmp_path / "a.lvm").read_text()
    (tmp_path / "a.lvm").write_text(text[: text.rstrip().rindex("\t")])
    assert "has 2 of 3 cells" in refused_draft(capsys, tmp_path / "a.lvm")


def test_tdms_without_samples(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([ChannelObject("daq", "x", np.array([]), {"wf_increment": 0.001})])
    assert "its channels daq/x are empty" in refused_draft(capsys, tmp_path / "a.tdms")
    with TdmsWriter(tmp_path / "b.tdms") as writer:
        writer.write_segment([ChannelObject("daq", "x", np.array([])), ChannelObject("daq", "y", Y, {"wf_increment": 0.001}),
                              ChannelObject("daq", "word", ["a", "b"])])  # fmt: skip
    (run,) = drafted(tmp_path, tmp_path / "b.tdms")
    assert (run.sample_rate, list(run.channels)) == (1000.0, ["push", "y"])


@pytest.mark.parametrize("bits", [16, 24, 32])
def test_a_step_of_a_converter_is_one(tmp_path: Path, bits: int) -> None:
    """WAV written by hand from its description: 24 bits come with the same steps as 16 and 32."""
    ticks = np.array([-3, -1, 0, 1, 2, 2**14, -(2**15)] * 20)
    raw = b"".join(int(v).to_bytes(bits // 8, "little", signed=True) for v in ticks)
    form = struct.pack("<4sIHHIIHH", b"fmt ", 16, 1, 1, 8000, 1000 * bits, bits // 8, bits)
    whole = struct.pack("<4sI4s", b"RIFF", 36 + len(raw), b"WAVE") + form + struct.pack("<4sI", b"data", len(raw)) + raw
    (tmp_path / "a.wav").write_bytes(whole)
    np.testing.assert_array_equal(read_foreign(tmp_path / "a.wav").columns["channel"].values, ticks)


def test_a_cut_wav_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wavfile.write(tmp_path / "a.wav", 8000, X.astype(np.float32))
    (tmp_path / "a.wav").write_bytes((tmp_path / "a.wav").read_bytes()[:-400])
    assert "EOF" in refused_draft(capsys, tmp_path / "a.wav")


JSON: dict[str, Any] = {
    "by name": {"time": TIME.tolist(), "force": X.tolist(), "table": Y.tolist(), "rig": {"mass": 3.0, "name": "a"}},
    "rate": {"fs": RATE, "force": X.tolist(), "table": Y.tolist()},
    "rows": [{"time": t, "force": x, "table": y} for t, x, y in zip(TIME.tolist(), X.tolist(), Y.tolist(), strict=True)],
    "channels": {"dt": 1.0 / RATE, "channels": [{"name": "force", "unit": "N", "data": X.tolist()},
                                                {"name": "table", "unit": "g", "data": (Y / 9.80665).tolist()}]},
}  # fmt: skip


@pytest.mark.parametrize("kind", JSON)
def test_json(tmp_path: Path, kind: str) -> None:
    (tmp_path / "a.json").write_text(json.dumps(JSON[kind]))
    (run,) = drafted(tmp_path, tmp_path / "a.json")
    assert run.sample_rate == pytest.approx(RATE, rel=1e-9)
    values = [channel.read() for channel in run.channels.values()]
    assert len(values) == 2
    np.testing.assert_allclose(values, [X, Y], rtol=1e-12)


def test_json_that_is_cut(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.json").write_text(json.dumps(JSON["rate"])[:-40])
    assert "cannot be read as JSON (Input data was truncated)" in refused_draft(capsys, tmp_path / "a.json")


def test_numpy_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.savez(tmp_path / "a.npz", fs=RATE, force=X, force_unit="N", table=Y)
    (run,) = drafted(tmp_path, tmp_path / "a.npz")
    assert (run.sample_rate, run.channels["force"].unit) == (RATE, "N")
    np.testing.assert_array_equal(run.read("table"), Y)
    table = np.rec.fromarrays([TIME, X], names="time,top")
    np.save(tmp_path / "b.npy", np.asarray(table))
    (run,) = drafted(tmp_path, tmp_path / "b.npy")
    np.testing.assert_array_equal(run.read("top"), X)
    np.save(tmp_path / "c.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    assert "plain numbers" in refused_draft(capsys, tmp_path / "c.npy")


def test_hdf5_of_others(tmp_path: Path, recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        group = file.create_group("2020/test 1")
        group.attrs["sample_rate"] = RATE
        group["force"], group["table"] = X, np.column_stack([X, Y])
        group["force"].attrs["units"] = "N"
    (run,) = drafted(tmp_path, tmp_path / "a.hdf5")
    assert run.sample_rate == RATE
    assert next(iter(run.channels.values())).unit == "N"
    assert len(run.channels) == 3
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["x"], file["y"] = X, Y[:200]
        file["x"].attrs["fs"], file["y"].attrs["dt"] = 2000.0, 0.01
    assert sorted(run.sample_rate for run in drafted(tmp_path, tmp_path / "b.h5")) == [100.0, 2000.0]
    assert "recording already" in refused_draft(capsys, recording)


# -- mappings


def mapped(folder: Path, **keys: str) -> list[str]:
    text = f"""
    {keys.get("top", "")}
    [channels.force]
    source = "force"
    unit = "{keys.get("unit", "N")}"
    {keys.get("channel", "")}
    [[runs]]
    id = "r"
    file = "a.csv"
    configuration = "{keys.get("configuration", "unlocked")}"
    gain = 1.0
    {keys.get("run", 'time = "t"')}
    """
    csv(folder / "a.csv", "t [s],force [N]\n", np.column_stack([TIME, X]))
    (folder / "m.toml").write_text(text)
    return ["import", str(folder / "m.toml"), "-o", str(folder / "o.h5")]


def test_another_unit_than_the_file_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, *mapped(tmp_path, unit="kN"))
    assert "a.csv" in said
    assert "has unit 'kN', but the file gives 'N'" in said
    assert "sensitivity = 0.001" in said
    assert main(mapped(tmp_path, unit="kN", channel="sensitivity = 1000")) == 0
    np.testing.assert_allclose(read(tmp_path / "o.h5").runs[0].read("force"), X, atol=1e-6)


def test_configurations_of_the_description(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "has unlocked, locked" in refused(capsys, *mapped(tmp_path, configuration="half open"))
    (tmp_path / "rig.toml").write_text(
        'name = "pendulum"\nfree = []\nbodies = [{ name = "bob", mass = 1.0 }]\n'
        'links = [{ name = "rod", a = "bob", b = "ground", stiffness = 100.0 }]\n'
        'drive = { channel = "push", quantity = "force", factor = 1.0, pushes = { bob = 1.0 } }\n'
        'sensors = [{ channel = "force", force_in = "links.rod", quantity = "force" }]\n'
        '[configurations.free]\n[configurations.clamped]\nrigid = ["rod"]\n'
    )
    top, run = 'description = "rig.toml"', 'time = "t"\nexcitation = "free"'
    said = refused(capsys, *mapped(tmp_path, top=top, run=run, configuration="unlocked"))
    assert "pendulum has free, clamped" in said
    assert main(mapped(tmp_path, top=top, run=run, configuration="clamped")) == 0


def test_units_of_time_in_a_mapping(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(mapped(tmp_path, run='time = "t"\ntime_unit = "ms"')) == 0
    assert read(tmp_path / "o.h5").runs[0].sample_rate == pytest.approx(1e3 * RATE, rel=1e-6)
    assert "time_unit" in refused(capsys, *mapped(tmp_path, run='time = "t"\ntime_unit = "N"'))


def test_readers_return_the_same_content(tmp_path: Path) -> None:
    """The same two records through all readers that keep every bit."""
    savemat(tmp_path / "a.mat", {"fs": RATE, "x": X, "y": Y})
    np.savez(tmp_path / "a.npz", fs=RATE, x=X, y=Y)
    (tmp_path / "a.json").write_text(json.dumps({"fs": RATE, "x": X.tolist(), "y": Y.tolist()}))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["fs"], file["x"], file["y"] = RATE, X, Y
    tables: list[ForeignTable] = [read_foreign(tmp_path / f"a.{ending}") for ending in ("mat", "npz", "json", "h5")]
    for table in tables:
        assert {name: column.sample_rate for name, column in table.columns.items()} == {"x": RATE, "y": RATE}
        np.testing.assert_array_equal(table.columns["y"].values, Y)


def damaged(folder: Path, kind: str) -> Path:
    path = folder / f"a.{kind}"
    if kind == "lvm":
        rows = "\n".join(f"\t{x:.6f}\t{y:.6f}" for x, y in zip(X, Y, strict=True)).replace(".", ",")
        path.write_text(LVM.format(columns="No", n=N, step="3,906250E-5", rows=rows))
    elif kind == "json":
        path.write_text(json.dumps(JSON["channels"]))
    elif kind == "npz":
        np.savez(path, fs=RATE, x=X)
    elif kind == "npy":
        np.save(path, np.column_stack([TIME, X]))
    elif kind == "mat":
        savemat(path, {"s": {"x": X, "name": "a", "z": X + 1j * Y}, "f": F, "H": H})
    elif kind == "uff":
        uff(path, pyuff.prepare_164(units_code=1, temp_mode=1, length=1.0, force=1.0, temp=1.0, temp_offset=0.0), dataset())
    else:
        with h5py.File(path, "w") as file:
            file["g/x"], file["g"].attrs["fs"] = X, RATE
    return path


@pytest.mark.parametrize("kind", ["lvm", "json", "npz", "npy", "h5", "mat", "uff"])
def test_damaged_files_end_in_a_sentence(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = damaged(tmp_path, kind)
    whole, generator = path.read_bytes(), np.random.default_rng(2)
    for _ in range(30):
        content = bytearray(whole)
        for _ in range(3):
            content[generator.integers(min(len(content), 3000))] = generator.integers(256)
        path.write_bytes(bytes(content[: generator.integers(len(content))] if generator.random() < 0.3 else content))
        capsys.readouterr()
        status = main(["import", "--draft", str(path), "-o", str(tmp_path / "d.toml")])
        said = capsys.readouterr().err
        assert (status, said.count("\n")) in {(0, 0), (2, 1)}, said


@pytest.mark.parametrize("odd", ['"a\rb",2.0', '"' + 200_000 * "x" + ",2.0"], ids=["lone carriage return", "endless quotation"])
def test_a_quoted_cell_that_no_reader_takes_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], odd: str
) -> None:
    lines = ["time,head", *(f"{0.01 * k:.2f},{k}" for k in range(30)), odd, "0.31,4"]
    (tmp_path / "log.csv").write_bytes("\n".join(lines).encode())
    assert main(["import", "--draft", str(tmp_path / "log.csv"), "-o", str(tmp_path / "mapping.toml")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("rig: ")
    assert said.count("\n") == 1
    assert "line 32" in said
