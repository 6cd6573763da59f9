"""Text files of measuring programs: sensitivities, dates, channels below each other, marks for missing values, headers."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from test_lab_files import ROWS, TIME, N, X, Y, check, drafted, said_of, table

from isorig.rig.cli import main
from isorig.rig.exchange.reading import read_foreign
from isorig.rig.exchange.units import known_unit, name_and_unit, sensitivity_in

VOLTS = [f"{t:.3f};{0.1 * x:.5f};{0.0112 * y:.7f}" for t, x, y in zip(TIME, X, Y, strict=True)]
PLAIN = [f"{x:.4f};{y:.4f}" for x, y in zip(X, Y, strict=True)]
BEGIN = datetime(2024, 3, 12, 23, 59, 59, 950000)
DATES = [BEGIN + timedelta(milliseconds=k) for k in range(N)]
DAYS = [f"{45363.5 + t / 86400.0:.11f}" for t in TIME]

HEADS = {
    "sensitivities in a line": ["t [s];a;b", "s;V;V", "Sensitivity;100 mV/(m/s²);11.2 mV/N", *VOLTS],
    "sensitivities in the names": ["t [s];a [V] (100 mV/(m/s^2));b [V] 11,2 mV/N", *VOLTS],
    "sensitivities of physical values": ["t [s];a [m/s^2] 100 mV/g;b [N] (11 mV/N)", *(row.replace(",", ";") for row in ROWS)],
    "their unit in the first cell": ["t [s];a [V];b [V]", "Sensitivity [V/(m/s^2)];0.1;0.0112", *VOLTS],
    "numbers of days": ["Date/Time;a;b", *(f"{d};{row}" for d, row in zip(DAYS, PLAIN, strict=True))],
    "the day first, past midnight": [
        "time;a;b", *(f"{d:%d/%m/%Y %H:%M:%S}.{d.microsecond // 1000:03d};{row}" for d, row in zip(DATES, PLAIN, strict=True)),
    ],
    "the month first, past midnight": [
        "time;a;b", *(f"{d:%m/%d/%Y %H:%M:%S}.{d.microsecond // 1000:03d};{row}" for d, row in zip(DATES, PLAIN, strict=True)),
    ],
    "an unknown word in place of the unit of time": ["time (unix);a;b", *(row.replace(",", ";") for row in ROWS)],
    "intervals and dates above the rows": [
        "time;a;b", "s;m/s^2;m/s^2", "0.001;0.001;0.001", "12.03.2024 10:11:12;12.03.2024 10:11:12;12.03.2024 10:11:12",
        *(row.replace(",", ";") for row in ROWS),
    ],
    "a header that is repeated": ["# of a day", "time,a,b", "s,-,-", *ROWS[:40], "time,a,b", "s,-,-", *ROWS[40:]],
    "each line in quotation marks": ['"time,a,b"', *(f'"{row}"' for row in ROWS)],
    "names with commas above columns with blanks": [
        "# Fs = 1000 Hz", "# a [m/s^2], b axis [m/s^2]", *(row.replace(";", " ") for row in PLAIN),
    ],
    "types below the names, and two rows of units": [
        "Input;a;b", "Type;Signal;Signal", "X Unit;s;s", "Y Unit;m/s²;m/s²", "Size;120;120", "X;a;b",
        *(row.replace(",", ";") for row in ROWS),
    ],
    "a rate in kHz with the other mark": ["Rate: x", "fs: 1.000 kHz", "a;b", *(row.replace(".", ",") for row in PLAIN)],
}  # fmt: skip


@pytest.mark.parametrize("kind", HEADS)
def test_each_head(tmp_path: Path, kind: str) -> None:
    (run,) = drafted(tmp_path, table(tmp_path / "m.csv", *HEADS[kind]))
    values = [run.read(name) for name in run.channels if name != "push"]
    for found, expected in zip(sorted(values, key=lambda v: abs(v - X).sum()), (X, Y), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-3 if "sens" in kind or "their" in kind else 1e-9)
    assert run.sample_rate == pytest.approx(1000.0, rel=1e-6)


def test_a_sensitivity_without_a_unit_is_reported(tmp_path: Path) -> None:
    found = read_foreign(table(tmp_path / "m.csv", "t [s];a;b", "Sens;10 mV/g;5 mV/N", *VOLTS))
    assert "column 'a' has no unit, so its sensitivity of 10 mV/(g) is not applied" in " ".join(found.remarks)
    assert {column.sensitivity for column in found.columns.values()} == {1.0}


def test_a_sensitivity_of_one_channel_is_reported(tmp_path: Path) -> None:
    """A list of channels above the table: the place of the cell is not that of the column; in a name it is."""
    listed = ["Channel 1: b, V, 11.2 mV/N", "Channel 2: a, V, 100 mV/(m/s^2)"]
    found = read_foreign(table(tmp_path / "m.csv", *listed, "t [s],a [V],b [V]", *(row.replace(";", ",") for row in VOLTS)))
    assert [column.sensitivity for column in found.columns.values()] == [1.0, 1.0, 1.0]
    assert "line 1 ('Channel 1: b, V, 11.2 mV/N') states a sensitivity, which is not applied" in " ".join(found.remarks)
    found = read_foreign(table(tmp_path / "n.csv", "t [s];a [V];b [V] 11.2 mV/N", *VOLTS))
    assert [column.sensitivity for column in found.columns.values()] == pytest.approx([1.0, 1.0, 0.0112])


@pytest.mark.parametrize("order", ["below each other", "in turns"])
def test_channels_named_in_each_row(tmp_path: Path, order: str, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [f"{t:.3f},{name},{x:.4f}" for name, values in (("left", X), ("right", Y)) for t, x in zip(TIME, values, strict=True)]
    rows = rows if order == "below each other" else [row for pair in zip(rows[:N], rows[N:], strict=True) for row in pair]
    (run,) = drafted(tmp_path, table(tmp_path / "m.csv", "time,channel,value", *rows))
    check(run, {"left": X, "right": Y})
    file = table(tmp_path / "n.csv", "time,channel,value", *rows[:-1])
    said = said_of(capsys, "--draft", file, "-o", tmp_path / "d.toml")
    assert "has the channels left, right below each other, as its column 'channel' says, but not with the same times" in said


@pytest.mark.parametrize("mark", ["-", "---", "#N/A", "#NV", "#DIV/0!"])
def test_marks_for_missing_values(tmp_path: Path, mark: str) -> None:
    rows = [f"{row[:5]},{mark},{row.rsplit(',', 1)[1]}" if k in (40, 41) else row for k, row in enumerate(ROWS)]
    found = read_foreign(table(tmp_path / "m.csv", "time,a,b", *rows))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.columns["a"].values)), [40, 41])
    np.testing.assert_array_equal(found.columns["b"].values, Y)
    assert "column 'a' has no value in 2 of 120 rows: they are stored as gaps" in found.remarks


@pytest.mark.parametrize(
    ("head", "rows"),
    [
        (["Frequency\tReal\tImaginary", "[ Hz ]\t[ m/s/N ]\t[ m/s/N ]"], [f"{f}\t0.6\t-0.8" for f in range(N)]),
        (["Hz\tdB\tdeg"], [f"{f}\t0.0\t-53.13010235" for f in range(N)]),
    ],
)
def test_parts_of_transfer_functions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], head: list[str], rows: list[str]
) -> None:
    file = table(tmp_path / "m.txt", *head, *rows)
    (spectrum,) = read_foreign(file).spectra
    assert spectrum.kind == "transfer_function"
    np.testing.assert_allclose(spectrum.values, 0.6 - 0.8j)
    assert f"or draw the transfer functions with rig frf {file}" in said_of(capsys, "--draft", file, "-o", tmp_path / "d.toml")


@pytest.mark.parametrize(
    "head",
    [
        "Messrate: 1000 Hz", "Fréquence d'échantillonnage (Hz): 1000", "Samples per second: 1000", "Δt = 0.001 s",
        "X increment: 1e-3", "dX: 1e-3", "f_sample: 1000", "Acquisition rate: 1 kHz",
    ],
)  # fmt: skip
def test_words_for_rates(tmp_path: Path, head: str) -> None:
    columns = read_foreign(table(tmp_path / "m.txt", head, "a;b", *PLAIN)).columns
    assert [column.sample_rate for column in columns.values()] == [1000.0, 1000.0]


@pytest.mark.parametrize(
    ("text", "unit"),
    [("ms^-2", "m/s^2"), ("m.s-2", "m/s^2"), ("m/s² RMS", "m/s^2"), ("g pk", "g"), ("mG", "mg"), ("ips", "in/s"), ("lbs", "lbf")],
)
def test_further_spellings(text: str, unit: str) -> None:
    assert known_unit(text) == unit
    assert name_and_unit(f"a [{text}]")[0] == "a"


def test_names_followed_by_units() -> None:
    assert name_and_unit("acc, g") == name_and_unit("acc in g") == name_and_unit("acc / g") == ("acc", "g")
    assert sensitivity_in("acc [V] 100 mV/g") == ("acc [V]", 100.0, "mV", "g")
    assert sensitivity_in("5 V/div") is None
    assert known_unit(name_and_unit("acc [g (9.81 m/s²)]")[1]) is None


@pytest.mark.parametrize("form", ["%d-%b-%Y %H:%M:%S.", "%Y.%m.%d %H:%M:%S.", "%d.%m.%Y, %H:%M:%S,", "%d/%m/%y %H:%M:%S."])
@pytest.mark.parametrize("zone", ["", " UTC"])
def test_forms_of_dates(tmp_path: Path, form: str, zone: str) -> None:
    rows = [f"{d.strftime(form)}{d.microsecond // 1000:03d}{zone};{row}" for d, row in zip(DATES, PLAIN, strict=True)]
    (run,) = drafted(tmp_path, table(tmp_path / "m.csv", "time;a;b", *rows))
    check(run, {"a": X, "b": Y})


def test_a_second_table_with_its_own_settings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = table(tmp_path / "m.csv", "Run,1", "time,a,b", *ROWS, "", "Run,2", "time,a,b", *ROWS)
    assert "line 124 has words below the numbers: if a second table begins there, save each" in said_of(
        capsys, "--draft", file, "-o", tmp_path / "d.toml"
    )


def test_a_gain_of_zero_is_not_proposed(tmp_path: Path) -> None:
    assert main(["import", "--draft", str(table(tmp_path / "u00.csv", "time,a,b", *ROWS)), "-o", str(tmp_path / "d.toml")]) == 0
    assert "gain = 1.0" in (tmp_path / "d.toml").read_text()
