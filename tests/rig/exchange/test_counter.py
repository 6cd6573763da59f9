"""A column that counts the samples is no channel; rows that it shows to be missing are reported; a clock may have any name."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from isorig.rig.cli import main
from isorig.rig.exchange.clock import BREAKS_MOST, CYCLE_LEAST, sample_counter
from isorig.rig.exchange.table import Column
from isorig.rig.files.recording import read

N, RATE = 600, 500.0
#: Rows of a file that lost some in two places.
KEPT = np.delete(np.arange(N), np.r_[100:120, 400:403])


def drafted(folder: Path, columns: dict[str, np.ndarray]) -> tuple[str, dict[str, dict[str, object]]]:
    """The mapping that is proposed for a file with these columns, a force and a displacement: its text and its content."""
    records = np.random.default_rng(3).normal(size=(2, len(next(iter(columns.values())))))
    columns = columns | {"force_N": records[0], "x_mm": records[1]}
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    (folder / "a.csv").write_text("\n".join(lines), encoding="utf-8")
    assert main(["import", "--draft", str(folder / "a.csv"), "-o", str(folder / "m.toml")]) == 0
    text = (folder / "m.toml").read_text(encoding="utf-8")
    return text, tomllib.loads(text)


def imported(folder: Path, keys: str) -> int:
    """Import according to the proposed mapping with further keys of its run."""
    mapping = (folder / "m.toml").read_text(encoding="utf-8")
    (folder / "n.toml").write_text(f"{mapping}\n{keys}\n", encoding="utf-8")
    return main(["import", str(folder / "n.toml"), "-o", str(folder / "o.h5")])


@pytest.mark.parametrize(
    ("counter", "said"),
    [
        (np.arange(N), "counts the samples from 0 to 599, so"),
        (np.arange(1, N + 1), "counts the samples from 1 to 600, so"),
        (np.arange(N) + 0.0, "counts the samples from 0 to 599, so"),
        (np.arange(N) % 256, "counts the samples from 0 to 87, and again after 255, so"),
        ((np.arange(N) + 7) % CYCLE_LEAST, "counts the samples from 7 to 14, and again after 15, so"),
    ],
)
@pytest.mark.parametrize("time", [True, False])
def test_a_counter_is_left_out(tmp_path: Path, counter: np.ndarray, said: str, time: bool) -> None:
    text, mapping = drafted(tmp_path, ({"time": np.arange(N) / RATE} if time else {}) | {"n": counter})
    assert list(mapping["channels"]) == ["force", "x"]
    assert f"# a.csv: column 'n' {said} it is no channel and left out.\n" in text
    assert imported(tmp_path, "" if time else f"sample_rate = {RATE}") == 0
    assert read(tmp_path / "o.h5").runs[0].sample_rate == RATE


@pytest.mark.parametrize("cycle", [None, 256, 64])
def test_rows_that_a_counter_shows_to_be_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str], cycle: int | None) -> None:
    """They are reported with the draft, refused by the import, and a part without them can be imported."""
    text, mapping = drafted(tmp_path, {"n": KEPT % (cycle or N)})
    assert list(mapping["channels"]) == ["force", "x"]
    said = "it skips 20 numbers from row 100 to row 101 (so in 2 places, 23 numbers in all)"
    assert said in text
    assert imported(tmp_path, f"sample_rate = {RATE}") == 2
    refusal = capsys.readouterr().err
    assert said in refusal
    assert refusal.count("\n") == 1
    part = re.search(r"samples = \[100, 380\]", refusal)
    assert part is not None
    assert imported(tmp_path, f"sample_rate = {RATE}\n{part[0]}") == 0
    assert len(read(tmp_path / "o.h5").runs[0]) == 280
    assert imported(tmp_path, f'sample_rate = {RATE}\nrate_from = "mapping"') == 0


def test_a_repeated_row(tmp_path: Path) -> None:
    text, _ = drafted(tmp_path, {"n": np.insert(np.arange(N), 50, 49)})
    assert "it does not rise from row 50 to row 51: rows are missing or repeated there" in text


@pytest.mark.parametrize(
    "values",
    [
        np.arange(N) % (CYCLE_LEAST - 1),  # a command in steps
        np.arange(0, 2 * N, 2),
        np.arange(N)[::-1],
        np.arange(N) // 2,
        np.arange(N) / 10.0,
        np.round(np.arange(N) + np.random.default_rng(1).normal(size=N)),  # an encoder at constant speed
        np.full(N, 3),
        np.full(N, np.nan),
        np.arange(N) * 1e300,
        np.array([str(k) for k in range(N)]),
    ],
)
def test_records_that_are_no_counter(values: np.ndarray) -> None:
    assert sample_counter(Column(values=values)) is None


@pytest.mark.parametrize(("count", "found"), [(int(BREAKS_MOST * 2000), True), (int(BREAKS_MOST * 2000) + 1, False)])
def test_boundary_of_missing_rows(count: int, found: bool) -> None:
    steps = np.ones(2001, np.int64)
    steps[10 : 10 + 60 * count : 60] = 4
    counter = sample_counter(Column(values=np.cumsum(steps)))
    assert (counter is not None) is found


@pytest.mark.parametrize("name", ["a", "", "Kanal 1"])
def test_a_clock_may_have_any_name(tmp_path: Path, name: str) -> None:
    text, mapping = drafted(tmp_path, {name: np.arange(N) / RATE})
    assert list(mapping["channels"]) == ["force", "x"]
    assert re.search(
        r'time = ".+"    # \? its values rise evenly\ntime_unit = "s"    # \? then the sample rate is 500 Hz\n', text
    )
    assert imported(tmp_path, "") == 0
    assert read(tmp_path / "o.h5").runs[0].sample_rate == RATE


@pytest.mark.parametrize("name", ["position", "ramp_mm"])
def test_a_ramp_of_another_quantity_is_no_clock(tmp_path: Path, name: str) -> None:
    _, mapping = drafted(tmp_path, {name: np.arange(N) / RATE})
    assert list(mapping["channels"]) == [name.removesuffix("_mm"), "force", "x"]


def test_a_file_with_a_counter_only_keeps_it(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("n\n" + "\n".join(map(str, range(N))), encoding="utf-8")
    assert main(["import", "--draft", str(tmp_path / "a.csv"), "-o", str(tmp_path / "m.toml")]) == 0
    assert list(tomllib.loads((tmp_path / "m.toml").read_text(encoding="utf-8"))["channels"]) == ["n"]


@pytest.mark.parametrize(
    ("name", "whole", "unit"), [("motor_counts", True, "rad"), ("motor_counts", False, "m/s^2"), ("encoder_position", True, "m")]
)
def test_counts_of_an_encoder_are_no_acceleration(tmp_path: Path, name: str, whole: bool, unit: str) -> None:
    turning = np.round(900.0 * np.sin(np.arange(N) / 40.0)) + (0.0 if whole else 0.25)
    text, mapping = drafted(tmp_path, {"time": np.arange(N) / RATE, name: turning})
    assert mapping["channels"][name]["unit"] == unit
    assert ("# ? counts of an encoder: rad, or m if it is straight" in text) is whole
