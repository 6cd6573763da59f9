"""Files as laboratories have them: no sample is lost or scaled silently, and what cannot be read is refused in a sentence."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, RootObject, TdmsWriter
from scipy.io import savemat, wavfile

from isorig.analysis.campaign import FloatArray, Run
from isorig.rig.cli import main
from isorig.rig.exchange.reading import read_foreign
from isorig.rig.exchange.units import known_unit
from isorig.rig.files.recording import read

N, G = 120, 9.80665
TIME = np.arange(N) / 1000.0
X, Y = np.round(np.random.default_rng(8).normal(size=(2, N)), 4)
ROWS = [f"{t:.3f},{x:.4f},{y:.4f}" for t, x, y in zip(TIME, X, Y, strict=True)]


def drafted(folder: Path, file: Path) -> list[Run]:
    draft = folder / "draft.toml"
    (folder / "draft-rig.toml").unlink(missing_ok=True)
    assert main(["import", "--draft", str(file), "-o", str(draft)]) == 0
    assert main(["import", str(draft), "-o", str(folder / "out.h5")]) == 0, draft.read_text()
    return list(read(folder / "out.h5").runs)


def table(path: Path, *lines: str, end: str = "\n") -> Path:
    path.write_bytes((end.join(lines) + end).encode())
    return path


def said_of(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    capsys.readouterr()
    assert main(["import", *map(str, words)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


def check(run: Run, values: Mapping[str, FloatArray], rate: float | None = 1000.0) -> None:
    for name, expected in values.items():
        np.testing.assert_allclose(run.read(name), expected, atol=1e-9, err_msg=name)
    assert set(run.channels) - {"push"} == set(values)
    assert rate is None or run.sample_rate == pytest.approx(rate, rel=1e-9)


HEADS = {
    "a comment in the first row": ["time,a,b,Comment", f"{ROWS[0]},start", *(f"{row}," for row in ROWS[1:])],
    "a column of words": ["time,a,state,b", *(",OK,".join(row.rsplit(",", 1)) for row in ROWS)],
    "quoted names in two lines": ['"Time\n(s)","a\n(m/s^2)","b\n(m/s^2)"', *ROWS],
    "empty cells at the end of rows": ["time,a,b", *(f"{row}," for row in ROWS)],
    "empty cells at the end of all lines": ["time,a,b,,,,,,", *(f"{row},,,,,," for row in ROWS)],
    "settings below the names": ["time,a,b", "T0 = 01.02.2024,CH=1,CH=2", "SR = 1 kHz,SR = 1 kHz,SR = 1 kHz", *ROWS],
    "exponents of Fortran": ["time a b", *(" ".join(f"{float(v):.6E}" for v in r.split(",")).replace("E", "D") for r in ROWS)],
    "quoted decimal commas": ["time,a,b", *('"' + row.replace(",", '","').replace(".", ",") + '"' for row in ROWS)],
    "two copies of the clock": ["# Sample rate: 1000 Hz", "x-axis,a,b,clock of b", *(f"{r},{r[:5]}" for r in ROWS)],
    "a time with its zone": ["t,a,b", *(f"2024-02-01T10:11:12.{r[2:5]}+01:00{r[5:]}" for r in ROWS)],
    "a time before noon or after it": ["t,a,b", *(f"2/1/2024 12:59:59.{r[2:5]} PM{r[5:]}" for r in ROWS)],
    "milliseconds after a colon": ["t,a,b", *(f"10:11:12:{r[2:5]}{r[5:]}" for r in ROWS)],
    "minutes without hours": ["t,a,b", *(f"59:59.{r[2:5]}{r[5:]}" for r in ROWS)],
    "nanoseconds since 1970": ["timestamp,a,b", *(f"{1706782272250000000 + k * 1000000}{r[5:]}" for k, r in enumerate(ROWS))],
    "milliseconds since 1970": ["timestamp,a,b", *(f"{1706782272250 + k}{r[5:]}" for k, r in enumerate(ROWS))],
    "milliseconds beside the time of day": [
        "Date,Time,ms,a,b",
        *(f"2024-02-01,10:11:{12 + (950 + k) // 1000},{(950 + k) % 1000}{r[5:]}" for k, r in enumerate(ROWS)),
    ],
    "parts of a date": [
        "year,month,day,hour,minute,second,ms,a,b",
        *(f"2024,2,1,10,11,{12 + (950 + k) // 1000},{(950 + k) % 1000}{r[5:]}" for k, r in enumerate(ROWS)),
    ],
    "a counter of microseconds": ["micros,a,b", *(f"{7 + k * 1000}{r[5:]}" for k, r in enumerate(ROWS))],
}  # fmt: skip


HEADS |= {
    "bars between cells": ["time|a|b", *(row.replace(",", "|") for row in ROWS)],
    "places below the units": ["time,a,b", "s,m/s^2,m/s^2", "-,top,top", *ROWS],
    "factors below the units": ["time,a,b", "s,m/s^2,m/s^2", "Factor,1,1", *ROWS],
    "sensitivities below the names": ["time,a,b", "Sens.,100.2,10.5", *ROWS],
    "a time in ms": ["Zeit in ms,a,b", *(f"{k}{row[5:]}" for k, row in enumerate(ROWS))],
    "signs that touch numbers": [
        "time a b", *(f"{t:13.6E}{x:13.6E}{y:13.6E}" for t, x, y in zip(TIME, X, Y, strict=True)),
    ],
}  # fmt: skip


@pytest.mark.parametrize("kind", HEADS)
def test_every_sample_of_a_text(tmp_path: Path, kind: str) -> None:
    (run,) = drafted(tmp_path, table(tmp_path / "m.csv", *HEADS[kind]))
    check(run, {"a": X, "b": Y})


@pytest.mark.parametrize("end", ["\r", "\r\n", "\n"])
def test_ends_of_lines(tmp_path: Path, end: str) -> None:
    """A file may end in zeros, if its size was given in advance."""
    file = table(tmp_path / "m.csv", "time,a,b", *ROWS, end=end)
    file.write_bytes(file.read_bytes() + b"\0" * 700)
    (run,) = drafted(tmp_path, file)
    check(run, {"a": X, "b": Y})


def test_numbers_as_names_of_columns(tmp_path: Path) -> None:
    """pandas names the columns of an array 0, 1 ...: that line is no sample, unless all lines are whole numbers."""
    rows = [row.split(",", 1)[1] for row in ROWS]
    assert [len(c.values) for c in read_foreign(table(tmp_path / "a.csv", "0,1", *rows)).columns.values()] == [N, N]
    assert [
        len(c.values)
        for c in read_foreign(table(tmp_path / "b.csv", ",0,1", *(f"{k},{r}" for k, r in enumerate(rows)))).columns.values()
    ] == [N, N, N]
    counts = [f"{k},{k * k % 7}" for k in range(1, N)]
    assert [len(c.values) for c in read_foreign(table(tmp_path / "c.csv", "0,1", *counts)).columns.values()] == [N, N]


def test_one_column_with_decimal_commas(tmp_path: Path) -> None:
    values = read_foreign(table(tmp_path / "a.csv", "Weg [mm]", *(f"{x:.4f}".replace(".", ",") for x in X))).columns["Weg"]
    np.testing.assert_array_equal(values.values, X)
    assert values.unit == "mm"


SCOPES = {
    "settings beside the first rows": (
        [f"{head},,{t:018.12f},{x:9.4f}," for head, t, x in zip(
            ["Record Length,120", "Sample Interval,1.0e-03", "Source,CH1", *[","] * (N - 3)], TIME - 0.3, X, strict=True)],
        {"column4": X},
    ),
    "an increment below its name": (
        ["X,CH1,CH2,Start,Increment,", "Sequence,Volt,Volt,-3.0e-01,1.000000e-03", *(f"{k}{r[5:]}," for k, r in enumerate(ROWS))],
        {"ch1": X, "ch2": Y},
    ),
    "a list of names above lists of settings": (
        ['"Model","X"', '"TraceName","CH1","CH2"', '"SampleRate",1.0E+03,1.0E+03', '"Date","2024/02/01","2024/02/01"',
         '"Time","10:11:12.123","10:11:12.123"', "", *(f",{x},{y}" for x, y in zip(X, Y, strict=True))],
        {"ch1": X, "ch2": Y},
    ),
    "names, start times and intervals below each other": (
        ["channel names:\t\t", "ai0\tai1\t", "start times:\t\t", "2/1/2024 12:00:00.1\t2/1/2024 12:00:00.1\t",
         "dt:\t\t", "0.001\t0.001\t", "data:\t\t", *(f"{x}\t{y}" for x, y in zip(X, Y, strict=True))],
        {"ai0": X, "ai1": Y},
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", SCOPES)
def test_heads_of_oscilloscopes(tmp_path: Path, kind: str) -> None:
    lines, values = SCOPES[kind]
    (run,) = drafted(tmp_path, table(tmp_path / "m.csv", *lines))
    check(run, values)


@pytest.mark.parametrize(
    ("head", "rate"),
    [
        ("Sample rate: 51,200 Hz", 51200.0), ("Sampling rate: 1 MS/s", 1e6), ("Sampling rate (kHz): 2", 2000.0),
        ("Sample rate: 2.000 Hz", 2.0), ("Sample interval (ms): 0.5", 2000.0), ("Sampling interval [us]: 50", 20000.0),
        ("Sample time: 10 min", None), ("Sampling time: 30 s", None), ("fs = 1'024.5 Hz", 1024.5), ("x-axis delta: 1e-3", 1000.0),
    ],
)  # fmt: skip
def test_rates_of_a_head(tmp_path: Path, head: str, rate: float | None) -> None:
    columns = read_foreign(table(tmp_path / "m.txt", head, "a\tb", *(f"{x}\t{y}" for x, y in zip(X, Y, strict=True)))).columns
    assert {column.sample_rate for column in columns.values()} == {rate}


def test_the_decimal_mark_of_the_data_is_that_of_the_head(tmp_path: Path) -> None:
    rows = [f"{x};{y}".replace(".", ",") for x, y in zip(X, Y, strict=True)]
    columns = read_foreign(table(tmp_path / "m.txt", "Abtastrate: 2.000 Hz", "a;b", *rows)).columns
    assert {column.sample_rate for column in columns.values()} == {2000.0}


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([*ROWS, "", "time,v", *(row.rsplit(",", 1)[0] for row in ROWS)], "line 123 has words below the numbers: if a second"),
        ([f"{k};{1234567 + 1000 * k:,d};1.0".replace(",", ".") for k in range(N)], "'1.234.567', which seems to have"),
        ([f"{k};{1234567 + k:,d};1.0".replace(",", "\u202f") for k in range(N)], "which seems to have separators of thousands"),
        ([f"{k};34,34,{100 + k};1.0" for k in range(N)], "'34,34,100', which seems to have separators of thousands"),
        (["0.000,OVERLOAD,1.0", *ROWS[1:]], "line 2, column 2 contains 'OVERLOAD', which is not a number"),
        ([*ROWS[:50], "0.050,?,1.0", *ROWS[51:]], "line 52, column 2 contains '?', which is not a number; correct it, leave"),
        ([*(row.replace(",", ";") for row in ROWS), "0.120;1'234.5;1.0"], "seems to have separators of thousands"),
        ([f"{k};{1137 * k:,d}".replace(",", ".") for k in range(N)], "seems to separate thousands; export it without"),
    ],
)  # fmt: skip
def test_cells_that_are_no_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str], rows: list[str], said: str) -> None:
    file = table(tmp_path / "m.csv", "time;a;b" if ";" in rows[0] else "time,a,b", *rows)
    assert said in said_of(capsys, "--draft", file, "-o", tmp_path / "d.toml")


def test_a_step_of_a_thousandth_is_no_thousand(tmp_path: Path) -> None:
    values = np.arange(N) * 0.125 + 20.0
    columns = read_foreign(table(tmp_path / "m.csv", "k;a", *(f"{k};{v:g}" for k, v in enumerate(values)))).columns
    np.testing.assert_array_equal(columns["a"].values, values)


@pytest.mark.parametrize(("last", "ambiguous"), [("31.250", True), ("31.25", False), ("0.125", False)])
def test_a_point_that_may_separate_thousands(tmp_path: Path, last: str, ambiguous: bool) -> None:
    lines = [f"{k}\t{20.125 + k:.3f}" for k in range(N)]
    remarks = " ".join(read_foreign(table(tmp_path / "m.txt", "k\ta", *lines, f"{N}\t{last}")).remarks)
    assert ("if it separates thousands, write sensitivity = 0.001" in remarks) is ambiguous


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (["a,b", "100.2,10.5"], "line 2 ('100.2,10.5') has other numbers of decimals than all rows below it: if it numbers"),
        (["a,b", "7,12"], "line 2 ('7,12') has other numbers of decimals than all rows below it"),
        (["a,b", "g,N", "2.5"], "line 3 ('2.5') has 1 of 2 cells, so it is left out"),
        (["c,a,b", "Factor,1,0.5"], "line 2 ('Factor,1,0.5') has numbers for the columns, perhaps scales, which are not applied"),
    ],
)  # fmt: skip
def test_numbers_above_the_data(tmp_path: Path, head: list[str], said: str) -> None:
    rows = ROWS if head[0] == "c,a,b" else [f"{x:.4f},{y:.4f}" for x, y in zip(X, Y, strict=True)]
    remarks = read_foreign(table(tmp_path / "m.csv", *head, *rows)).remarks
    assert [remark for remark in remarks if said in remark]
    assert not read_foreign(table(tmp_path / "n.csv", head[0], *rows)).remarks


@pytest.mark.parametrize(
    ("rows", "end", "said"),
    [
        ([*ROWS[:-1], ROWS[-1][:-2]], "\n", True),
        ([f"{k},{k + 1000}" for k in range(N)] + ["120,11"], "", True),
        ([f"{k},{k + 1000}" for k in range(N)] + ["120,11"], "\n", False),
        (ROWS, "\n", False),
    ],
)  # fmt: skip
def test_a_last_number_that_may_be_cut(tmp_path: Path, rows: list[str], end: str, said: bool) -> None:
    (tmp_path / "m.csv").write_text("\n".join(rows) + end)
    assert ("has fewer digits than all before it" in " ".join(read_foreign(tmp_path / "m.csv").remarks)) is said


def test_one_channel_row_after_row(tmp_path: Path) -> None:
    """A record that changes slowly; channels that are alike, or have names, are no such record."""
    values = np.cumsum(np.random.default_rng(3).normal(size=(N, 5)))
    rows = [" ".join(f"{v:.4f}" for v in row) for row in values.reshape(N, 5)]
    assert "each row seems to continue the one before it" in " ".join(read_foreign(table(tmp_path / "m.txt", *rows)).remarks)
    alike = [" ".join(f"{v + noise:.4f}" for noise in (0.1, 0.2, 0.3)) for v in values[::5]]
    assert not read_foreign(table(tmp_path / "n.txt", *alike)).remarks
    assert not read_foreign(table(tmp_path / "o.txt", "a b c d e", *rows)).remarks


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-8-sig", "cp1252"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "m.csv").write_bytes("\n".join(["time,a [m/s²],b [m/s²]", *ROWS]).encode(encoding))
    (run,) = drafted(tmp_path, tmp_path / "m.csv")
    check(run, {"a": X, "b": Y})


@pytest.mark.parametrize(("bits", "step"), [(16, 2000), (16, 1000), (24, 200_000), (32, 1_000_000)])
@pytest.mark.parametrize("signed", [False, True])
def test_counters_that_begin_again(tmp_path: Path, bits: int, step: int, signed: bool) -> None:
    """A clock that is a counter of so many bits is one clock, not that of several runs."""
    count = (2**bits - 50 * step + step * np.arange(N)) % 2**bits - signed * 2 ** (bits - 1)
    (run,) = drafted(
        tmp_path, table(tmp_path / "m.csv", "time_ns,a,b", *(f"{c}{r[5:]}" for c, r in zip(count, ROWS, strict=True)))
    )
    check(run, {"a": X, "b": Y}, 1e9 / step)


@pytest.mark.parametrize(("cell", "said"), [("9.9E+37", "contains 9.9e+37 at sample 40"), ("-9.91E37", "contains -9.91e+37")])
def test_infinity_of_instruments(tmp_path: Path, capsys: pytest.CaptureFixture[str], cell: str, said: str) -> None:
    file = table(tmp_path / "m.csv", "time,a,b", *ROWS[:40], f"{ROWS[40][:5]},{cell},1.0", *ROWS[41:])
    assert main(["import", "--draft", str(file), "-o", str(tmp_path / "d.toml")]) == 0
    assert said in said_of(capsys, tmp_path / "d.toml", "-o", tmp_path / "o.h5")


@pytest.mark.parametrize(("rows", "said"), [((40, 41, 90), True), ((40,), False), (range(0, N, 2), False)])
def test_values_that_stand_for_lost_samples(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rows: list[int], said: bool
) -> None:
    """The same far value in several samples; a single one may be a hit."""
    lines = [f"{row[:5]},-9999,1.0" if k in rows else row for k, row in enumerate(ROWS)]
    drafted(tmp_path, table(tmp_path / "m.csv", "time,a,b", *lines))
    assert ("has the value -9999 m/s^2 in 3 samples of channel 'a', far from all others" in capsys.readouterr().out) is said


@pytest.mark.parametrize("head", [["k\ta"], []])
@pytest.mark.parametrize("mark", [".", ","])
def test_a_last_row_of_whole_numbers(tmp_path: Path, mark: str, head: list[str]) -> None:
    """It fits any decimal mark."""
    lines = [f"{k}\t{20.5 + k / 4}".replace(".", mark) for k in range(N)]
    found = read_foreign(table(tmp_path / "m.txt", *head, *lines, f"{N}\t8"))
    np.testing.assert_array_equal(list(found.columns.values())[1].values, [*(20.5 + np.arange(N) / 4), 8.0])


STACKED = {
    "a clock that starts again": ["time,a,b", *ROWS, "", *ROWS[:60], *ROWS],
    "a column of runs": ["trial,a,b", *(f"{k}{row[5:]}" for k, rows in enumerate((ROWS, ROWS[:60], ROWS), 1) for row in rows)],
    "both": ["Run No.,time,a,b", *(f"{k},{row}" for k, rows in enumerate((ROWS, ROWS[:60], ROWS), 1) for row in rows)],
}


@pytest.mark.parametrize("kind", STACKED)
def test_several_runs_in_one_file(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    """They are proposed as runs; a mapping that joins them is refused."""
    file = table(tmp_path / "m.csv", *STACKED[kind])
    draft = tmp_path / "draft.toml"
    assert main(["import", "--draft", str(file), "-o", str(draft)]) == 0
    text = draft.read_text().replace("# sample_rate = 1024.0 ", "sample_rate = 1000.0 ")
    draft.write_text(text)
    assert main(["import", str(draft), "-o", str(tmp_path / "out.h5")]) == 0
    first, second, third = read(tmp_path / "out.h5").runs
    check(first, {"a": X, "b": Y})
    check(second, {"a": X[:60], "b": Y[:60]})
    check(third, {"a": X, "b": Y})
    whole = text[: text.index("[[runs]]")] + '[[runs]]\nid = "m"\nfile = "m.csv"\ngain = 1.0\nsample_rate = 1000.0\n'
    draft.write_text(whole)
    assert "the first" in (said := said_of(capsys, draft, "-o", tmp_path / "o.h5"))
    assert "[0, 120]" in said


def test_an_empty_line_between_rows_is_reported(tmp_path: Path) -> None:
    file = table(tmp_path / "m.csv", "a,b", *(row[6:] for row in ROWS), "", *(row[6:] for row in ROWS))
    assert "an empty line follows 120 rows" in " ".join(read_foreign(file).remarks)
    assert not read_foreign(table(tmp_path / "n.csv", "a,b", *(row[6:] + "\n" for row in ROWS))).remarks


def test_clocks_of_different_rates(tmp_path: Path) -> None:
    rows = [
        f"{t:.3f},{x},{2.0 * t:.3f},{y}" if k < 60 else f"{t:.3f},{x},,"
        for k, (t, x, y) in enumerate(zip(TIME, X, Y, strict=True))
    ]
    slow, fast = sorted(
        drafted(tmp_path, table(tmp_path / "m.csv", "Time 1 (s),a,Time 2 (s),b", *rows)), key=lambda run: run.sample_rate
    )
    check(fast, {"a": X})
    check(slow, {"b": Y[:60]}, 500.0)


def test_a_clock_that_is_none_is_no_channel(tmp_path: Path) -> None:
    file = table(tmp_path / "m.csv", "time,a,b", *(f"{k // 40 * 0.04}{row[5:]}" for k, row in enumerate(ROWS)))
    assert main(["import", "--draft", str(file), "-o", str(tmp_path / "d.toml")]) == 0
    text = (tmp_path / "d.toml").read_text()
    assert "column 'time' does not ascend evenly, so it is no clock and left out" in text
    assert "[channels.time]" not in text


def test_units_of_other_quantities(tmp_path: Path) -> None:
    """A row of units is one, also if it has units that no channel is in; their columns are left out."""
    file = table(tmp_path / "m.csv", "Time,Accel,Temp,Bridge", "sec,g,degC,mV/V", *(f"{row},1.5" for row in ROWS))
    assert main(["import", "--draft", str(file), "-o", str(tmp_path / "d.toml")]) == 0
    text = (tmp_path / "d.toml").read_text()
    assert "column 'Temp' is in degC, which is no unit of a channel" in text
    assert 'source = "Accel"\nunit = "g"\n' in text
    assert "the file gives 'mV/V'" in text


@pytest.mark.parametrize("unit", ["g's", "gs", "m·s⁻²", "m s-2", "m*s^-2"])
def test_spellings_of_accelerations(unit: str) -> None:
    assert known_unit(unit) == ("g" if unit.startswith("g") else "m/s^2")


def test_names_that_are_the_same(tmp_path: Path) -> None:
    columns = read_foreign(table(tmp_path / "m.csv", "Operator,A", "Acc,Acc", *(row[6:] for row in ROWS))).columns
    assert list(columns) == ["Acc", "Acc[1]"]


@pytest.mark.parametrize("first", ["23:59:59", "10:11:12", "59"])
def test_a_clock_with_an_empty_cell(tmp_path: Path, first: str) -> None:
    """It is no midnight; the clock may have one."""
    rows = [f"{first}:{k // 1000:02d}.{k % 1000:03d}" if first == "59" else f"{first}.{k:03d}" for k in range(N)]
    rows[40] = ""
    (run,) = drafted(tmp_path, table(tmp_path / "m.csv", "t,a,b", *(f"{t}{row[5:]}" for t, row in zip(rows, ROWS, strict=True))))
    assert run.sample_rate == pytest.approx(1000.0)


def test_names_that_toml_must_quote(tmp_path: Path) -> None:
    (run,) = drafted(tmp_path, table(tmp_path / "m.csv", "time,Gehäuse [m/s²],Y[1]", *ROWS))
    check(run, {"gehäuse": X, "y_1": Y})


def test_a_column_with_the_rate(tmp_path: Path) -> None:
    (run,) = drafted(
        tmp_path,
        table(tmp_path / "m.csv", "u,y,Ts", f"{X[0]},{Y[0]},4", *(f"{x},{y}," for x, y in zip(X[1:], Y[1:], strict=True))),
    )
    check(run, {"u": X, "y": Y}, 0.25)


def test_a_run_begins_where_all_channels_have_values(tmp_path: Path) -> None:
    (run,) = drafted(
        tmp_path,
        table(tmp_path / "m.csv", "time,a,b", *(row if k > 20 else row.rsplit(",", 1)[0] + "," for k, row in enumerate(ROWS))),
    )
    check(run, {"a": X[21:], "b": Y[21:]})
    assert not run.gaps


@pytest.mark.parametrize("clock", ["\t", ""])
def test_lvm_with_a_short_line_of_channels(clock: str, tmp_path: Path) -> None:
    """Also where the headers have no cell for the clock of the second channel."""
    head = (
        f"LabVIEW Measurement\nSeparator\tTab\nX_Columns\tMulti\n***End_of_Header***\n\nChannels\t2\nSamples\t120{clock}\t120\n"
    )
    units = f"Y_Unit_Label\tm/s^2{clock}\tN\nDelta_X\t1.0E-3{clock}\t1.0E-3\n"
    units += "***End_of_Header***\nX_Value\tAcc\tX_Value\tForce\tComment"
    rows = [f"{t}\t{x}\t{t}\t{y}" for t, x, y in zip(TIME, X, Y, strict=True)]
    (run,) = drafted(tmp_path, table(tmp_path / "m.lvm", head + units, *rows))
    check(run, {"acc": X, "force": Y})
    assert [channel.unit for channel in run.channels.values()] == ["m/s^2", "N"]


LISTS: dict[str, Any] = {"data": np.stack([X, Y]), "channels": ["acc", "lower"], "units": ["g", "mm"], "fs": 1000.0}


@pytest.mark.parametrize("kind", ["attributes", "h5", "npz", "mat", "characters", "json"])
def test_lists_of_names_and_units(tmp_path: Path, kind: str) -> None:
    """The channels of an array have their names and units in lists next to it."""
    file = tmp_path / f"m.{kind}"
    if kind in ("attributes", "h5"):
        file = tmp_path / "m.h5"
        with h5py.File(file, "w") as hdf:
            hdf["data"] = LISTS["data"]
            if kind == "attributes":
                hdf["data"].attrs.update({key: value for key, value in LISTS.items() if key != "data"})
            else:
                hdf.attrs["fs"] = np.array([1000.0])
                hdf["channels"], hdf["units"] = LISTS["channels"], LISTS["units"]
    elif kind == "npz":
        np.savez(file, **LISTS)
    elif kind == "json":
        file.write_text(json.dumps({**LISTS, "data": LISTS["data"].tolist()}))
    else:
        file = tmp_path / "m.mat"
        cells = {key: np.array(LISTS[key], object if kind == "mat" else None) for key in ("channels", "units")}
        savemat(file, {**LISTS, **cells})
    (run,) = drafted(tmp_path, file)
    check(run, {"acc": X * G, "lower": Y * 1e-3})


@pytest.mark.parametrize("kind", ["npz", "mat", "h5", "json", "names"])
def test_fewer_samples_than_channels(tmp_path: Path, kind: str) -> None:
    """The times tell which axis of an array has the samples, or the names which one has the channels; otherwise it is asked."""
    values, times = np.stack([X + k for k in range(60)])[:, :24], TIME[:24]
    file = tmp_path / f"m.{'npz' if kind == 'names' else kind}"
    items: dict[str, Any] = {"data": values, "time": times}
    if kind == "names":
        np.savez(file, data=values, channels=[f"s{k}" for k in range(60)], fs=1000.0)
    elif kind == "npz":
        np.savez(file, **items)
    elif kind == "mat":
        savemat(file, items)
    elif kind == "json":
        file.write_text(json.dumps({name: each.tolist() for name, each in items.items()}))
    else:
        with h5py.File(file, "w") as hdf:
            hdf["data"], hdf["time"] = values.T, times[:, None]
    found = read_foreign(file)
    np.testing.assert_array_equal(found.columns["data[7]"].values, values[7])
    assert not found.remarks
    np.savez(tmp_path / "n.npz", data=values, fs=1000.0)
    asked = "nothing says which axis has the samples: 60 along axis 0 are assumed"
    assert asked in " ".join(read_foreign(tmp_path / "n.npz").remarks)
    np.savez(tmp_path / "o.npz", data=np.zeros((600, 3)), t=[0.0, 1.0, 2.0], fs=1000.0)
    assert len(read_foreign(tmp_path / "o.npz").columns["data[2]"].values) == 600
    np.savez(tmp_path / "o.npz", data=np.zeros((600, 60)), fs=1000.0)
    assert not read_foreign(tmp_path / "o.npz").remarks


def test_a_sound_file_has_its_samples_first(tmp_path: Path) -> None:
    wavfile.write(tmp_path / "m.wav", 1000, np.arange(50 * 64, dtype=np.int16).reshape(50, 64))
    np.testing.assert_array_equal(read_foreign(tmp_path / "m.wav").columns["channel[3]"].values, np.arange(50) * 64 + 3)


@pytest.mark.parametrize("form", ["h5", "mat"])
def test_channels_with_a_clock_each(tmp_path: Path, form: str) -> None:
    """Structures with one record and the same clock are the channels of a run."""
    if form == "h5":
        with h5py.File(tmp_path / "m.h5", "w") as hdf:
            for name, values in (("a", X), ("b", Y)):
                hdf[f"{name}/value"], hdf[f"{name}/time"] = values, TIME
    else:
        savemat(tmp_path / "m.mat", {"log": {name: {"Time": TIME, "Data": each} for name, each in (("a", X), ("b", Y))}})
    (run,) = drafted(tmp_path, tmp_path / f"m.{form}")
    check(run, {"a": X, "b": Y})


@pytest.mark.parametrize("ending", ["jsonl", "ndjson", "json"])
def test_an_object_in_each_line(tmp_path: Path, ending: str) -> None:
    rows = [json.dumps({"t": t, "of": {"a": x, "b": y}}) for t, x, y in zip(TIME, X.tolist(), Y.tolist(), strict=True)]
    file = table(tmp_path / f"m.{ending}", *rows)
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    (run,) = drafted(tmp_path, file)
    check(run, {"of_a": X, "of_b": Y})


def test_fields_of_fields(tmp_path: Path) -> None:
    values = np.zeros(N, dtype=[("time", "f8"), ("of", [("a", "f8"), ("b", "f8")])])
    values["time"], values["of"]["a"], values["of"]["b"] = TIME, X, Y
    np.save(tmp_path / "m.npy", values)
    (run,) = drafted(tmp_path, tmp_path / "m.npy")
    check(run, {"of_a": X, "of_b": Y})


def test_settings_alone_are_no_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "m.json").write_text(json.dumps({"fs": 1000, "range": [1, 2]}))
    assert "has columns of 2 values, but a time record has at least 16" in said_of(
        capsys, "--draft", tmp_path / "m.json", "-o", tmp_path / "d.toml"
    )


@pytest.mark.parametrize(
    ("place", "value", "rate"),
    [("meta/fs", 1000.0, 1000.0), ("info/rate/sample_rate_kHz", 2.0, 2000.0), ("fs", "1000 Hz", 1000.0), ("dt_ms", 0.5, 2000.0)],
)
def test_a_rate_elsewhere_in_a_file(tmp_path: Path, place: str, value: Any, rate: float) -> None:
    with h5py.File(tmp_path / "m.h5", "w") as hdf:
        hdf["data/a"], hdf["data/b"], hdf[place] = X, Y, value
    (run,) = drafted(tmp_path, tmp_path / "m.h5")
    check(run, {"a": X, "b": Y}, rate)


def test_a_rate_elsewhere_in_a_file_is_a_guess(tmp_path: Path) -> None:
    """Only one that the whole file agrees on is proposed, with a question mark."""
    for other, line in ((1000.0, "sample_rate = 1000.0    # ? the file states it as 'one/fs'"), (500.0, "# sample_rate = ")):
        with h5py.File(tmp_path / "m.h5", "w") as hdf:
            hdf["data/a"], hdf["one/fs"], hdf["other/fs"] = X, 1000.0, other
        assert main(["import", "--draft", str(tmp_path / "m.h5"), "-o", str(tmp_path / f"{other:g}.toml")]) == 0
        assert f"\n{line}" in (tmp_path / f"{other:g}.toml").read_text()


def test_packed_values_of_netcdf(tmp_path: Path) -> None:
    """The unit that the file states is that of the physical value, not of the stored one."""
    stored = np.round(X * 1000.0).astype(np.int16)
    stored[7] = -32768
    with h5py.File(tmp_path / "m.nc", "w") as hdf:
        hdf["time"], hdf["a"], hdf["b"] = TIME, stored, Y
        hdf["a"].attrs.update({"scale_factor": 0.002, "add_offset": 0.5, "_FillValue": np.int16(-32768), "units": "m/s^2"})
    values = read_foreign(tmp_path / "m.nc").columns["a"].values
    np.testing.assert_allclose(np.delete(values, 7), np.delete(stored * 0.002 + 0.5, 7))
    assert np.isnan(values[7])


def test_properties_of_tdms(tmp_path: Path) -> None:
    """Rates of the file, units of DAQmx, and a channel of times."""
    clock = np.datetime64("2024-02-01T10:11:12") + (np.arange(N) * 1000).astype("timedelta64[us]")
    unit = {"NI_UnitDescription": "g"}
    with TdmsWriter(tmp_path / "a.tdms") as file:
        file.write_segment(
            [RootObject({"SampleRate": 1000.0}), ChannelObject("Log", "Dev1/ai0", X, unit), ChannelObject("Log", "b", Y, unit)]
        )
    with TdmsWriter(tmp_path / "b.tdms") as file:
        file.write_segment([ChannelObject("Log", "Time", clock), ChannelObject("Log", "a", X), ChannelObject("Log", "b", Y)])
    (run,) = drafted(tmp_path, tmp_path / "a.tdms")
    check(run, {"log_dev1_ai0": X * G, "log_b": Y * G})
    (run,) = drafted(tmp_path, tmp_path / "b.tdms")
    check(run, {"a": X, "b": Y})


def test_objects_of_matlab_classes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with h5py.File(tmp_path / "m.mat", "w", userblock_size=512) as hdf:
        hdf["ts"] = np.array([[3707764736, 2, 1, 1, 1, 1]], np.uint32)
        hdf["ts"].attrs.update({"MATLAB_class": np.bytes_(b"timeseries"), "MATLAB_object_decode": np.int32(3)})
    with (tmp_path / "m.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    assert "save its values as plain arrays" in said_of(capsys, "--draft", tmp_path / "m.mat", "-o", tmp_path / "d.toml")


def test_json_of_pandas(tmp_path: Path) -> None:
    columns = {"t": TIME, "a": X, "b": Y}
    (tmp_path / "m.json").write_text(
        json.dumps({name: {str(k): v for k, v in enumerate(c.tolist())} for name, c in columns.items()})
    )
    (run,) = drafted(tmp_path, tmp_path / "m.json")
    check(run, {"a": X, "b": Y})


def test_scales_are_listed(tmp_path: Path) -> None:
    savemat(tmp_path / "m.mat", {"raw": np.round(X * 1000.0).astype(np.int16), "b": Y, "scale": 0.001, "fs": 1000.0})
    assert main(["import", "--draft", str(tmp_path / "m.mat"), "-o", str(tmp_path / "d.toml")]) == 0
    assert "further numbers of the file, perhaps scales of channels: scale = 0.001." in (tmp_path / "d.toml").read_text()


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("m.dat", b"MDF     4.10    ", "is an MDF file; export it as CSV, MATLAB or HDF5"),
        ("m.mf4", b"MDF     4.10    ", "is an MDF file; export it as CSV, MATLAB or HDF5"),
        ("m.feather", b"FEA1\0\0", "is a Feather file of version 1; save it as Parquet or CSV"),
        ("m.nc", b"CDF\x01" + bytes(40), "is a netCDF 3 file; convert it to netCDF 4"),
        ("m.rsp", b"FORMAT" + bytes(40), "so export it as one of these, or rename it to .csv if it is text"),
    ],
)
def test_formats_that_are_not_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes, said: str
) -> None:
    (tmp_path / name).write_bytes(content)
    assert said in said_of(capsys, "--draft", tmp_path / name, "-o", tmp_path / "d.toml")
