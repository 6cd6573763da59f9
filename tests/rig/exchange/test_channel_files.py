"""Files with one channel each are proposed as the runs that their names tell; they are imported only if they are simultaneous."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from isorig.rig.cli import main
from isorig.rig.exchange.draft import runs_of
from isorig.rig.files.recording import read

N = 120
TIME = np.arange(N) / 1000.0
X, Y, Z, W = np.round(np.random.default_rng(9).normal(size=(4, N)), 4)


def write(path: Path, name: str, values: np.ndarray, time: np.ndarray = TIME) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join([f"time,{name}", *(f"{t:.6f},{x}" for t, x in zip(time, values, strict=False))]) + "\n")
    return path


def drafted(folder: Path, *files: Path) -> str:
    assert main(["import", "--draft", *map(str, files), "-o", str(folder / "draft.toml")]) == 0
    return (folder / "draft.toml").read_text(encoding="utf-8")


def values_in(folder: Path) -> dict[str, dict[str, np.ndarray]]:
    assert main(["import", str(folder / "draft.toml"), "-o", str(folder / "out.h5")]) == 0
    runs = read(folder / "out.h5").runs
    assert {run.sample_rate for run in runs} == {1000.0}
    return {run.id: {name: run.read(name) for name in run.channels} for run in runs}


@pytest.mark.parametrize("heads", [("force [N]", "acc [g]"), ("value", "value")])
@pytest.mark.parametrize("place", ["{run}_{channel}.csv", "{channel}/{run}.csv", "{channel}-{run}.txt"])
def test_runs_by_the_names_of_files(tmp_path: Path, place: str, heads: tuple[str, str]) -> None:
    records = {("run1", "force"): X, ("run1", "acc"): Y, ("run2", "force"): Z, ("run2", "acc"): W}
    files = [
        write(tmp_path / place.format(run=run, channel=channel), heads[channel == "acc"], values)
        for (run, channel), values in records.items()
    ]
    assert "# ? of one run, by their names" in drafted(tmp_path, *files)
    found = values_in(tmp_path)
    for (run, channel), values in records.items():
        scale = 9.80665 if channel == "acc" and heads[1] == "acc [g]" else 1.0
        np.testing.assert_allclose(found[run][channel], values * scale)


def test_sound_files_of_channels(tmp_path: Path) -> None:
    for k, values in enumerate((X, Y), 1):
        wavfile.write(tmp_path / f"rec_ch{k}.wav", 1000, np.round(values * 1000.0).astype(np.int16))
    drafted(tmp_path, tmp_path / "rec_ch1.wav", tmp_path / "rec_ch2.wav")
    np.testing.assert_array_equal(values_in(tmp_path)["rec"]["ch2"], np.round(Y * 1000.0))


@pytest.mark.parametrize("words", [("1", "2"), ("a", "b"), ("locked", "unlocked")])
def test_repeats_are_runs(tmp_path: Path, words: tuple[str, str]) -> None:
    files = [write(tmp_path / f"decay_{word}.csv", "position [m]", values) for word, values in zip(words, (X, Y), strict=True)]
    assert len(tomllib.loads(drafted(tmp_path, *files))["runs"]) == 2


def test_records_that_are_not_simultaneous(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They are not proposed as one run; a mapping that joins them is refused."""
    force, short = write(tmp_path / "a_force.csv", "force [N]", X), write(tmp_path / "a_acc.csv", "acc [g]", Y[:-3], TIME[:-3])
    text = drafted(tmp_path, force, short)
    assert "it seems to be of one run with a_acc.csv, but differs in length, rate or clock, so each is a run" in text
    write(short, "acc [g]", Y)
    text = drafted(tmp_path, force, short)
    for time, said in (
        (TIME * 2.0, "a_force.csv has 1000 Hz, but a_acc.csv has 500 Hz; import them as two runs"),
        (TIME + 0.01, "a_force.csv begins at 0 s, but a_acc.csv at 0.01 s; cut them to the same time"),
    ):
        write(short, "acc [g]", Y, time)
        capsys.readouterr()
        assert main(["import", str(tmp_path / "draft.toml"), "-o", str(tmp_path / "o.h5")]) == 2
        assert said in capsys.readouterr().err
    (tmp_path / "draft.toml").write_text(text.replace('acc = "a_acc', 'acd = "a_acc'))
    assert main(["import", str(tmp_path / "draft.toml"), "-o", str(tmp_path / "o.h5")]) == 2
    assert "gives a file for 'acd', which is not a channel" in capsys.readouterr().err


def test_a_word_means_one_record() -> None:
    """A word is no channel if files with it have several records, and a run may lack a channel."""
    names = ["u70_acc.csv", "u70_force.csv", "u80_acc.csv"]
    assert runs_of([Path(name) for name in names], [{"a"}, {"f"}, {"a"}], ("force",)) == {
        "u70": {"acc": 0, "force": 1},
        "u80": {"acc": 2},
    }
    assert runs_of([Path(name) for name in names], [{"a"}, {"a"}, {"f"}], ("force",)) == {}
    assert runs_of([Path("acc.csv"), Path("run_force.csv")], [{"a"}, {"f"}], ()) == {}
    assert runs_of([Path("one.csv"), Path("two.csv")], [{"a", "b"}, {"c"}], ()) == {"run": {"one": 0, "two": 1}}
    assert runs_of([Path("one.csv"), Path("two.csv")], [{"a", "b"}, {"a", "b", "c"}], ()) == {}


def test_several_channels_in_a_file(tmp_path: Path) -> None:
    """Also with a clock in one file, and the rate in the other one."""
    rows = [f"{t:.6f},{x},{y}" for t, x, y in zip(TIME, X, Y, strict=True)]
    (tmp_path / "r1_acc.csv").write_text("\n".join(["time,top,base", *rows]) + "\n")
    wavfile.write(tmp_path / "r1_force.wav", 1000, np.round(Z * 1000.0).astype(np.int16))
    drafted(tmp_path, tmp_path / "r1_acc.csv", tmp_path / "r1_force.wav")
    found = values_in(tmp_path)["r1"]
    np.testing.assert_array_equal(found["top"], X)
    np.testing.assert_array_equal(found["force"], np.round(Z * 1000.0))
