"""What files say reaches terminals and spreadsheets as text only."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_recording import example

from isorig.analysis.campaign import Channel
from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import from_tree, to_tree
from isorig.rig.cli import main
from isorig.rig.files.output import cell, displayable
from isorig.rig.files.recording import VALUE_MOST, write
from isorig.rig.wire_bonder.description import wire_bonder

ESCAPE = "\x1b]0;owned\x07\x1b[31mred"
Change = Callable[[h5py.File], None]


def text(place: str, key: str) -> Change:
    def change(file: h5py.File) -> None:
        file[place].attrs[key] = ESCAPE

    return change


TEXTS: dict[str, Change] = {
    "configuration": text("runs/u70", "configuration"), "excitation": text("runs/u70", "excitation"),
    "repeat_of": text("runs/u70", "repeat_of"), "unit": text("runs/u70/motor", "unit"),
    "place of a sensor": text("runs/u70/motor", "place"), "format": text("/", "format"), "start": text("runs/u70", "started"),
}  # fmt: skip


@pytest.mark.parametrize("kind", TEXTS)
def test_an_escape_sequence_is_refused_and_not_printed(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.h5"
    write(path, example())
    with h5py.File(path, "a") as file:
        TEXTS[kind](file)
    assert main(["check", str(path)]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert "owned" in told.err
    assert "\x1b" not in told.err
    assert told.err.count("\n") == 1


def test_an_escape_sequence_in_a_description_is_not_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tree = to_tree(wire_bonder())
    for name in ("bodies", "links", "contacts"):
        changed = {**tree, name: [{**tree[name][0], "name": ESCAPE}, *tree[name][1:]]}
        with pytest.raises(ModelError, match="cannot be displayed"):
            from_tree(changed)
    with pytest.raises(ModelError, match="cannot be displayed"):
        from_tree({**tree, "name": ESCAPE})
    path = tmp_path / "a.h5"
    write(path, example())
    with h5py.File(path, "a") as file:
        file["rig"].attrs["description"] = 'name = "\\u001b[31mred"\nbodies = []\n'
    assert main(["check", str(path)]) == 0
    assert "\x1b" not in capsys.readouterr().out


@given(st.text())
def test_any_text_becomes_one_displayable_line(words: str) -> None:
    shown = displayable(words)
    assert shown.isprintable()
    assert len(shown) == len(words)


@given(st.one_of(st.text(), st.sampled_from("=+-@\t\r\n").flatmap(lambda first: st.text().map(lambda rest: first + rest))))
def test_no_cell_begins_like_a_formula(words: str) -> None:
    shown = cell(words)
    if shown.startswith(("=", "+", "-", "@", "\t", "\r", "\n")):
        float(shown)
    assert shown.removeprefix("'") == words.removeprefix("'")
    assert cell(-1.5) == -1.5


def test_names_reach_a_table_as_text(tmp_path: Path) -> None:
    formula = "=cmd|'#c calc'!A0"
    campaign = example()
    runs = tuple(
        replace(run, channels={**run.channels, formula: replace(run.channels["motor"], name=formula)}) for run in campaign.runs
    )
    write(tmp_path / "a.h5", replace(campaign, runs=runs))
    for what, more in (("samples", []), ("frf", ["--resolution", "20"])):
        assert main(["export", str(tmp_path / "a.h5"), "--what", what, "-o", str(tmp_path / f"{what}.csv"), *more]) == 0
    tables = [path.read_text(encoding="utf-8") for path in tmp_path.glob("*.csv")]
    assert len(tables) >= 2
    cells = [word for table in tables for row in csv.reader(table.splitlines()) for word in row]
    assert sum(word.startswith("'=cmd") for word in cells) >= 2
    for word in cells:
        if word.startswith(("=", "+", "-", "@")):
            float(word)


@pytest.mark.parametrize(("scale", "refused"), [(1e308, True), (1.0001 * VALUE_MOST / 100, True), (VALUE_MOST / 100, False)])
def test_counts_whose_values_are_too_large_are_refused(
    tmp_path: Path, scale: float, refused: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    path, run = tmp_path / "a.h5", example().runs[0]
    write(path, replace(example(), runs=(run,)))
    with h5py.File(path, "a") as file:
        counts = np.r_[np.zeros(299, np.int32), np.int32(-100)]
        del file[f"runs/{run.id}/motor"]
        file[f"runs/{run.id}/motor"] = np.resize(counts, len(run))
        file[f"runs/{run.id}/motor"].attrs["scale"] = scale
    for call in (["check", str(path)], ["export", str(path), "-o", str(tmp_path / "out.csv")]):
        assert main(call) == (2 if refused else 0)
        told = capsys.readouterr().err
        assert ("correct its scale and offset" in told) == refused
        assert told.count("\n") == refused
    assert (tmp_path / "out.csv").exists() != refused


def test_what_a_reader_refuses_is_not_written(tmp_path: Path) -> None:
    run = example().runs[0]
    huge = {name: Channel(name=name, samples=np.full(300, 1e99), scale=1e9) for name in run.channels}
    with pytest.raises(ValueError, match="correct its scale"):
        write(tmp_path / "a.h5", replace(example(), runs=(replace(run, channels=huge),)))
    assert not list(tmp_path.iterdir())
