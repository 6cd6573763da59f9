"""Statements of mapping, file and description that contradict each other are refused; names and repeats are kept."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import pyuff
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat
from strange_rigs import noise

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.fitting.linear_spectra import SHORTEST
from isorig.analysis.spectra.overload import FREQUENT
from isorig.rig.cli import main
from isorig.rig.exchange.clock import BREAK, BREAKS_MOST, breaks, is_uneven_time
from isorig.rig.exchange.formats.text import read_text
from isorig.rig.exchange.importing import RATE_AGREES, STEADY, shortcomings
from isorig.rig.exchange.table import Column
from isorig.rig.files.recording import read
from isorig.rig.help import COMMANDS

ROOT = Path(__file__).resolve().parents[3]
N, RATE = 512, 1024.0
X = np.random.default_rng(1).normal(size=N)
RIG = """
name = "stage"
free = ["links.foot.stiffness"]
bodies = [{ name = "block", mass = 10.0 }]
links = [{ name = "foot", a = "block", b = "ground", stiffness = 4e4, damping = 40.0 }]
drive = { channel = "force", quantity = "force", factor = 1.0, pushes = { block = 1.0 } }
sensors = [{ channel = "block", body = "block" }]
"""
MAPPING = """
description = "rig.toml"
[channels.force]
source = "force"
unit = "N"
[channels.block]
source = "block"
unit = "m/s^2"
"""


def run(text: str = "", name: str = "a", file: str = "a.csv") -> str:
    return f'[[runs]]\nid = "{name}"\nfile = "{file}"\nconfiguration = "unlocked"\ngain = 1.0\n{text}\n'


def written(
    folder: Path, *, rate: float = RATE, head: str = "", name: str = "a.csv", time: str = "t", response: float = 0.1
) -> None:
    (folder / "rig.toml").write_text(RIG)
    rows = [f"{k / rate!r},{x!r},{response * x!r}" for k, x in enumerate(X.tolist())]
    (folder / name).write_text(head + f"{time},force,block\n" + "\n".join(rows) + "\n")


def imported(folder: Path, mapping: str) -> int:
    (folder / "m.toml").write_text(mapping)
    return main(["import", str(folder / "m.toml"), "-o", str(folder / "o.h5")])


@pytest.mark.parametrize(
    ("keys", "head", "said"),
    [
        ("sample_rate = 2048.0", "", "sample_rate = 2048 Hz in the mapping, but 1024 Hz by the time column 't' of the file"),
        ('time = "t"\nsample_rate = 2048.0', "", "2048 Hz in the mapping, but 1024 Hz by its time column 't'"),
        ('time = "t"', "Sample rate: 512 Hz\n", "1024 Hz by its time column 't', but 512 Hz by the file itself"),
        ("sample_rate = 1024.0", "fs = 512\n", "sample_rate = 1024 Hz in the mapping, but 512 Hz by the file itself"),
    ],
)
def test_sample_rates_that_differ(tmp_path: Path, capsys: pytest.CaptureFixture[str], keys: str, head: str, said: str) -> None:
    written(tmp_path, head=head)
    assert imported(tmp_path, MAPPING + run(keys)) == 2
    text = capsys.readouterr().err
    assert said in text
    assert "rate_from" in text
    assert text.count("\n") == 1
    assert not (tmp_path / "o.h5").exists()
    assert imported(tmp_path, MAPPING + run(keys + '\nrate_from = "time"')) == 0
    assert read(tmp_path / "o.h5").runs[0].sample_rate == pytest.approx(RATE)
    assert imported(tmp_path, MAPPING + run('rate_from = "mapping"')) == 2
    assert "no such sample rate" in capsys.readouterr().err


@pytest.mark.parametrize(("off", "status"), [(0.9, 0), (1.1, 2)])
def test_boundary_of_a_rate(tmp_path: Path, off: float, status: int) -> None:
    written(tmp_path)
    assert imported(tmp_path, MAPPING + run(f"sample_rate = {RATE * (1.0 + off * RATE_AGREES)!r}")) == status


@pytest.mark.parametrize("keys", ['time = "{}"', "sample_rate = 1024.0"])
@pytest.mark.parametrize("time", ["t", "stamp", "t (ms)"])
@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([*range(300), *range(302, N)], "differs by 0.00293 from row 300 to row 301 of its values, elsewhere by 0.0009766"),
        ([*range(201), *range(200, N)], "differs by 0 from row 201 to row 202"),
        ([*range(90), *range(95, 180), *range(170, N)], "from row to row (so in 2 places): rows are missing or repeated there"),
    ],
)
def test_rows_that_are_missing_or_repeated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rows: list[int], said: str, time: str, keys: str
) -> None:
    """They are told, and a part of the file without them can be imported."""
    written(tmp_path, time=time)
    head, *lines = (tmp_path / "a.csv").read_text().splitlines()
    (tmp_path / "a.csv").write_text("\n".join([head, *(lines[k] for k in rows)]) + "\n")
    keys = keys.format(time.removesuffix(" (ms)"))
    assert imported(tmp_path, MAPPING + run(keys)) == 2
    text = capsys.readouterr().err
    assert said in text
    assert text.count("\n") == 1
    part = re.search(r"samples = \[\d+, \d+\]", text)
    assert part is not None
    if time != "t (ms)":
        assert imported(tmp_path, MAPPING + run(f"{keys}\n{part[0]}")) == 0
    assert imported(tmp_path, MAPPING + run('sample_rate = 1024.0\nrate_from = "mapping"')) == 0


@pytest.mark.parametrize("rate", [1000.0, 1005.0, 1024.0, 1651.6, 51200.0])
@pytest.mark.parametrize("start", [0.0, 1000.0])
@pytest.mark.parametrize("written_as", ["%.3f", "%.4f", "%.6g", "%.7g", "single"])
def test_rounded_clocks_have_no_break(rate: float, start: float, written_as: str) -> None:
    time = start + np.arange(round(10.5 * rate))[:60_000] / rate
    rounded = time.astype(np.float32) if written_as == "single" else np.array([float(written_as % each) for each in time])
    assert not is_uneven_time("stamp", Column(values=rounded))


@pytest.mark.parametrize(
    "values",
    [
        np.tile(np.arange(100.0), 10),  # a sawtooth
        np.cumsum(1.0 + 0.1 * np.random.default_rng(2).normal(size=1000)),  # a distance
        np.where(np.arange(1000) == 500, 7.0, 0.0),
        np.repeat(np.arange(500.0), 2),
    ],
)
def test_records_that_are_no_clock(values: np.ndarray) -> None:
    assert not is_uneven_time("stamp", Column(values=values))


@pytest.mark.parametrize(("count", "told"), [(int(BREAKS_MOST * 2000), True), (int(BREAKS_MOST * 2000) + 1, False)])
def test_boundary_of_breaks(count: int, told: bool) -> None:
    intervals = np.ones(2000)
    intervals[10 : 10 + 60 * count : 60] = 1.0 + 1.01 * BREAK
    assert len(breaks(intervals)) == (count if told else 0)
    intervals[10 : 10 + 60 * count : 60] = 1.0 + 0.99 * BREAK
    assert not len(breaks(intervals))


@pytest.mark.parametrize(("samples", "said"), [(SHORTEST - 1, True), (SHORTEST, False)])
def test_boundary_of_a_short_run(tmp_path: Path, capsys: pytest.CaptureFixture[str], samples: int, said: bool) -> None:
    written(tmp_path)
    assert imported(tmp_path, MAPPING + run(f'time = "t"\nsamples = [0, {samples}]')) == 0
    assert ("fits need at least" in capsys.readouterr().out) == said


def test_missing_channels_and_typing_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A similar name is proposed for channels, columns, keys, configurations and runs."""
    written(tmp_path)
    for wrong, said in (
        (MAPPING.replace("channels.block", "channels.blok") + run('time = "t"'), "no channel 'block' (did you mean 'blok'?)"),
        (MAPPING.replace('source = "force"', 'source = "forse"') + run('time = "t"'), "absent (did you mean 'force'?)"),
        (MAPPING.replace('unit = "N"', 'unti = "N"') + run('time = "t"'), "unknown there (did you mean 'unit'?)"),
        (MAPPING + run('time = "t"\nchannels = ["force", "blocks"]'), "did you mean 'block'?"),
        (MAPPING + run('time = "t"\nexcitaton = "random"'), "did you mean 'excitation'?"),
        (MAPPING + run('time = "t"\nrepeat_of = "b"'), "give the id of a run before it"),
        (MAPPING + run('time = "t"').replace("unlocked", "unlokced"), "did you mean 'unlocked'?"),
    ):  # fmt: skip
        assert imported(tmp_path, wrong) == 2, said
        text = capsys.readouterr().err
        assert said in text
        assert text.count("\n") == 1
    for key, meant in (("stiffnes", "stiffness"), ("mas", "mass")):
        (tmp_path / "rig.toml").write_text(RIG.replace(meant, key))
        assert imported(tmp_path, MAPPING + run('time = "t"')) == 2
        assert meant in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('unit = "N"', 'unit = "newtn"', "unit 'newtn' (did you mean 'newton'?); known are m/s^2"),
        ('unit = "m/s^2"', 'unit = "M/S^2"', "(did you mean 'm/s^2'?)"),
        ('unit = "m/s^2"', 'unit = "m/s^3"', "(did you mean 'm/s^2'?)"),
        ('unit = "m/s^2"', 'unit = "Pa"', "unit 'Pa'; known are"),
        ('unit = "m/s^2"', 'unit = "m/sec2"', ""),
        ('unit = "N"', 'unit = "Newtons"', ""),
        (
            "gain = 1.0",
            'gain = 1.0\nexcitation = "randm"',
            "excitation is 'randm' (did you mean 'random'?); allowed are random, ",
        ),
        ("gain = 1.0", 'gain = 1.0\nrate_from = "header"', "runs.a.rate_from is 'header'; allowed are mapping, time, file"),
        ('unit = "N"', 'unit = "N"\nquantity = "forces"', "is 'forces' (did you mean 'force'?); allowed are acceleration, "),
        ("rig.toml", "rigs.toml", "rigs.toml does not exist; give the file of a rig's description"),
        ("a.csv", "aa.csv", "aa.csv does not exist (did you mean 'a.csv'?); give the path of a file"),
        ('source = "force"', 'source = "block 2"', "absent (did you mean 'block'?); the file has t, force, block"),
        ('source = "force"', 'source = "load"', "absent; the file has t, force, block"),
    ],
)
def test_words_that_are_unknown(tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, said: str) -> None:
    written(tmp_path)
    assert imported(tmp_path, (MAPPING + run('time = "t"')).replace(old, new)) == (2 if said else 0)
    text = capsys.readouterr().err
    assert said in text
    assert text.count("\n") == bool(said)
    assert "Errno" not in text


def test_repeats(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run with the same drive is a repeat by the mapping or by itself, and reported."""
    written(tmp_path)
    written(tmp_path, name="b.csv", response=0.1001)
    assert imported(tmp_path, MAPPING + run('time = "t"') + run('time = "t"', "b", "b.csv")) == 0
    assert "run 'b' has the drive of run 'a' and is stored as its repeat" in capsys.readouterr().out
    assert [each.repeat_of for each in read(tmp_path / "o.h5").runs] == [None, "a"]
    (tmp_path / "b.csv").write_text((tmp_path / "b.csv").read_text().replace(",-", ","))
    assert imported(tmp_path, MAPPING + run('time = "t"') + run('time = "t"', "b", "b.csv")) == 0
    assert [each.repeat_of for each in read(tmp_path / "o.h5").runs] == [None, None]
    assert imported(tmp_path, MAPPING + run('time = "t"') + run('time = "t"\nrepeat_of = "a"', "b", "b.csv")) == 0
    assert [each.repeat_of for each in read(tmp_path / "o.h5").runs] == [None, "a"]


def test_a_copy_of_a_run_is_no_repeat(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path)
    assert imported(tmp_path, MAPPING + run('time = "t"') + run('time = "t"', "b")) == 0
    text = capsys.readouterr().out
    assert "Run 'b' has exactly the samples of run 'a': it is a copy and not a repeat" in text
    assert "stored as its repeat" not in text
    assert read(tmp_path / "o.h5").runs[1].repeat_of is None


@pytest.mark.parametrize(("response", "said"), [(1.0, True), (1.0 + 1e-12, False), (0.0, False)])
def test_two_channels_with_the_same_samples(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], response: float, said: bool
) -> None:
    written(tmp_path, response=response)
    assert imported(tmp_path, MAPPING + run('time = "t"')) == 0
    text = capsys.readouterr().out
    assert ("Run 'a' has exactly the same samples in the channels 'force' and 'block', but the noise of two" in text) == said


@pytest.mark.parametrize(("least", "said"), [(0.99 * STEADY, False), (1.01 * STEADY, True)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_boundary_of_a_lasting_acceleration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], least: float, sign: float, said: bool
) -> None:
    written(tmp_path, response=0.1 * sign)
    block = f'source = "block"\noffset = {float(sign * (least - 0.1 * X.min()))!r}'
    assert imported(tmp_path, MAPPING.replace('source = "block"', block) + run('time = "t"')) == 0
    assert ("Run 'a' has never less than 10.9 m/s^2 in channel 'block', more than gravity" in capsys.readouterr().out) == said


@pytest.mark.parametrize(("gain", "said"), [(1.0, True), (3.0, False)])
def test_several_levels_at_one_gain(tmp_path: Path, capsys: pytest.CaptureFixture[str], gain: float, said: bool) -> None:
    written(tmp_path)
    rows = [line.split(",") for line in (tmp_path / "a.csv").read_text().splitlines()]
    louder = [f"{t},{3.0 * float(x)!r},{0.3 * float(x)!r}" for t, x, _ in rows[1:]]
    (tmp_path / "b.csv").write_text("\n".join([",".join(rows[0]), *louder]) + "\n")
    second = run('time = "t"\nexcitation = "random"', "b", "b.csv").replace("gain = 1.0", f"gain = {gain}")
    assert imported(tmp_path, MAPPING + run('time = "t"\nexcitation = "random"') + second) == 0
    text = capsys.readouterr().out
    assert ("The runs at gain 1 differ in level: the rms of force is " in text) == said
    assert ("state the levels as gains" in text) == said


def test_one_column_for_two_channels(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path)
    assert imported(tmp_path, MAPPING.replace('source = "block"', 'source = "force"') + run('time = "t"')) == 2
    text = capsys.readouterr().err
    assert "column 'force' to the channels 'force' and 'block', but a column is the record of one channel" in text
    assert text.count("\n") == 1
    assert not (tmp_path / "o.h5").exists()


@pytest.mark.parametrize(("lowest", "status"), [(RATE / 2.0 - 0.1, 0), (RATE / 2.0, 2)])
def test_boundary_of_a_band(tmp_path: Path, capsys: pytest.CaptureFixture[str], lowest: float, status: int) -> None:
    written(tmp_path)
    assert imported(tmp_path, MAPPING + run(f'time = "t"\nband = [{lowest!r}, 600.0]')) == status
    assert ("1024 samples per second contain at most 512 Hz" in capsys.readouterr().err) == (status == 2)


@pytest.mark.parametrize(
    ("period", "said"),
    [
        ("256.0", ""),
        ("2", ""),
        ("1", "period = 1, which is not a whole number of samples, 2 or more"),
        ("0.25", "give the period of the drive in samples: if it is 0.25 s, write period = 256"),
        ("8.5", "if it is 8.5 s, write period = 8704"),
        ("8\nband = [1.0, 128.0]", ""),
        ("8\nband = [1.0, 127.0]", "repeat 128 times per second, above the band up to 127 Hz"),
        ("nan", "not a whole number"),
    ],
)
def test_a_period_is_in_samples(tmp_path: Path, capsys: pytest.CaptureFixture[str], period: str, said: str) -> None:
    written(tmp_path)
    assert imported(tmp_path, MAPPING + run(f'time = "t"\nexcitation = "multisine"\nperiod = {period}')) == (2 if said else 0)
    text = capsys.readouterr().err
    assert said in text
    assert text.count("\n") == bool(said)
    if not said:
        assert read(tmp_path / "o.h5").runs[0].period == float(period.partition("\n")[0])


def test_clock_in_milliseconds_that_is_read_as_seconds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path, rate=RATE / 1000.0)
    assert imported(tmp_path, MAPPING + run('time = "t"\nband = [1.0, 200.0]')) == 2
    assert "correct the sample rate, time_unit or band" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("excitation", "response", "silent", "said"),
    [("random", 0.0, "", "block"), ("random", 1e-9, "", ""), ("free", 0.1, "force", ""), ("other", 0.1, "force", "force")],
)
def test_constant_channels(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], excitation: str, response: float, silent: str, said: str
) -> None:
    """A sensor that is not connected; the silent drive of a released rig is none."""
    written(tmp_path, response=response)
    if silent:
        rows = [line.split(",") for line in (tmp_path / "a.csv").read_text().splitlines()]
        (tmp_path / "a.csv").write_text("\n".join([",".join(rows[0]), *(f"{t},0.1,{x}" for t, _, x in rows[1:])]) + "\n")
    offset = 'unit = "N"\noffset = -0.1' if silent else 'unit = "N"'
    assert imported(tmp_path, MAPPING.replace('unit = "N"', offset) + run(f'time = "t"\nexcitation = "{excitation}"')) == 0
    text = capsys.readouterr().out
    assert ("is dead" in text) == bool(said)
    assert (f"Run 'a': {said} is dead (constant 0 " in text) == bool(said)
    assert ('or state excitation = "free"' in text) == (said == "force")


@pytest.mark.parametrize(("samples", "said"), [(FREQUENT, True), (FREQUENT - 1, False)])
def test_boundary_of_a_clipped_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, samples: int, said: bool
) -> None:
    # The limit is reached by single samples, as noise leaves it at once.
    clipped = np.tanh(X)
    clipped[10 : 10 + 20 * samples : 20] = 1.2
    monkeypatch.setattr(sys.modules[__name__], "X", clipped)
    written(tmp_path)
    assert imported(tmp_path, MAPPING + run('time = "t"')) == 0
    text = capsys.readouterr().out
    assert [f"Run 'a': {name} seems clipped, " in text for name in ("force", "block")] == [said, said]


@pytest.mark.parametrize("steps", [3.0, 40.0, 2000.0])
def test_rounded_sine_is_not_clipped(steps: float) -> None:
    for phase in np.linspace(0.0, 1.0, 11):
        sine = np.round((steps + phase) * np.sin(2.0 * np.pi * 7.3 / 51200.0 * np.arange(51200)))
        channel = Channel(name="block", samples=sine, quantity="acceleration")
        campaign = Campaign(
            runs=(Run(id="a", configuration="unlocked", sample_rate=51200.0, gain=1.0, channels={"block": channel}),)
        )
        assert shortcomings(campaign) == []


def test_sensor_that_mostly_rests_is_not_clipped() -> None:
    rest = np.concatenate([np.zeros(1000), [1.0, 3.0, 2.0, 1.0]])
    channels = {"block": Channel(name="block", samples=rest, quantity="acceleration")}
    assert (
        shortcomings(Campaign(runs=(Run(id="a", configuration="unlocked", sample_rate=1e3, gain=1.0, channels=channels),))) == []
    )


def test_a_streamed_gain_may_be_constant(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(tmp_path)
    rows = (tmp_path / "a.csv").read_text().splitlines()
    (tmp_path / "a.csv").write_text("\n".join([rows[0] + ",setting", *(row + ",0.7" for row in rows[1:])]) + "\n")
    gain = '[channels.gain]\nsource = "setting"\nunit = "1"\nquantity = "gain"\n'
    assert imported(tmp_path, MAPPING + gain + run('time = "t"')) == 0
    assert "is dead" not in capsys.readouterr().out


def drafted(folder: Path, name: str) -> str:
    draft = folder / f"{name}.toml"
    assert main(["import", "--draft", str(folder / name), "-o", str(draft)]) == 0
    text = draft.read_text()
    assert main(["import", str(draft), "-o", str(folder / "o.h5")]) == 0, text
    return text


def test_names_of_the_file(tmp_path: Path) -> None:
    """ID lines of universal files, names in MATLAB structures, groups of untitled TDMS channels."""
    uff = pyuff.UFF(str(tmp_path / "a.uff"))
    for node, name, entity in ((1, "Shaker force", "Shaker for"), (12, "Top plate", "NONE"), (3, "Gyro A [deg/s]", "NONE")):
        part = {
            "type": 58, "binary": 0, "func_type": 1, "rsp_node": node, "rsp_dir": 3, "ref_node": 0, "ref_dir": 0, "data": X,
            "x": np.arange(N) / RATE, "id1": name, "id2": "NONE", "id3": "NONE", "id4": "NONE", "id5": "NONE",
            "abscissa_spacing": 1, "abscissa_inc": 1.0 / RATE, "abscissa_spec_data_type": 17, "num_pts": N, "abscissa_min": 0.0,
            "ordinate_spec_data_type": {1: 13, 12: 12, 3: 0}[node], "orddenom_spec_data_type": 0, "ord_data_type": 4,
            "ver_num": 0, "load_case_id": 0, "rsp_ent_name": entity, "ref_ent_name": "NONE",
        }  # fmt: skip
        uff.write_sets(part, "add")
    struct = np.array([{"name": n, "values": X, "unit": u, "fs": RATE} for n, u in (("force", "N"), ("top", "g"))], dtype=object)
    savemat(tmp_path / "b.mat", {"data": struct})
    with TdmsWriter(tmp_path / "c.tdms") as writer:
        for group in ("Force", "Top"):
            writer.write_segment([ChannelObject(group, "Untitled", X, {"wf_increment": 1.0 / RATE})])
    assert "[channels.shaker_force]" in drafted(tmp_path, "a.uff")
    text = (tmp_path / "a.uff.toml").read_text()
    assert "[channels.top_plate]" in text
    assert text.split("[channels.gyro_a]")[1].split("\n")[2].startswith('unit = "deg/s"')
    assert {"[channels.force]", "[channels.top]"} <= {line.split("   ")[0] for line in drafted(tmp_path, "b.mat").splitlines()}
    text = drafted(tmp_path, "c.tdms")
    assert "[channels.force]" in text
    assert "[channels.top]" in text
    assert text.count("[[runs]]") == 1
    with TdmsWriter(tmp_path / "sweep.tdms") as writer:
        writer.write_segment([ChannelObject("Untitled", name, X, {"wf_increment": 1.0 / RATE}) for name in ("force", "top")])
    assert 'id = "sweep"' in drafted(tmp_path, "sweep.tdms")


@pytest.mark.parametrize(("separator", "mark"), [(";", "."), (";", ","), ("\t", "."), ("  ", ",")])
def test_a_drive_that_begins_late_after_whole_zeros(separator: str, mark: str, tmp_path: Path) -> None:
    """The first rows have no decimal mark."""
    rows = [["t", "force", "top"], *([str(k), "0", "0"] for k in range(300))]
    rows += [[str(k), f"{x:.6f}".replace(".", mark), f"{2.0 * x:.6f}".replace(".", mark)] for k, x in enumerate(X, 300)]
    (tmp_path / "a.txt").write_text("\n".join(separator.join(row) for row in rows))
    assert "[channels.force]    # " in drafted(tmp_path, "a.txt")
    columns = read_text(tmp_path / "a.txt").columns
    np.testing.assert_allclose(columns["top"].values[300:], 2.0 * X, atol=1e-6)


def test_units_in_names(tmp_path: Path) -> None:
    rows = "\n".join(f"{k / RATE},{x},{x},{x}" for k, x in enumerate(X))
    (tmp_path / "a.csv").write_text(f"t,force_kN,encoder_angle_deg,acc_A\n{rows}\n")
    text = drafted(tmp_path, "a.csv")
    assert 'unit = "kN"    # ? by the column\'s name' in text
    # A channel is recorded in SI, whatever its column is in.
    assert re.findall(r"\[channels\.(\w+)\]", text) == ["force", "encoder_angle", "acc_a"]
    assert 'unit = "deg"' in text
    assert 'unit = "m/s^2"    # ? not given by the file' in text


@pytest.mark.parametrize(
    ("name", "unit"), [("u_V", "V"), ("i_A", "A"), ("x_m", "m"), ("a_V", "m/s^2"), ("base_A", "m/s^2"), ("voltage_V", "V")]
)
def test_a_letter_after_a_symbol_is_its_unit(name: str, unit: str, tmp_path: Path) -> None:
    """After other names it may be an axis or a second channel."""
    rows = "\n".join(f"{k / RATE},{x},{2.0 * x}" for k, x in enumerate(X))
    (tmp_path / "a.csv").write_text(f"t,force_kN,{name}\n{rows}\n")
    assert f'source = "{name}"\nunit = "{unit}"' in drafted(tmp_path, "a.csv")


def test_a_wrong_unit_is_reported_at_the_import(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A force in kN under a header that says N."""
    from scipy.signal import lsim

    force, time = noise(4.0, RATE, 30.0, (1.0, 60.0), 2), np.arange(4096) / RATE
    _, block, _ = lsim(([[0.0, 1.0], [-4e3, -4.0]], [[0.0], [0.1]], [[-4e3, -4.0]], [[0.1]]), force, time)
    (tmp_path / "rig.toml").write_text(RIG)
    rows = "\n".join(f"{t},{f / 1000.0},{b}" for t, f, b in zip(time, force, block, strict=True))
    (tmp_path / "a.csv").write_text(f"t,force [N],block\n{rows}\n")
    assert imported(tmp_path, MAPPING + run('time = "t"\nexcitation = "random"')) == 0
    said = capsys.readouterr().out
    assert said.startswith("CHECK UNITS, CHANNELS AND GIVEN VALUES FIRST.")
    assert "force were in kN read as N" in said
    assert main(["check", str(tmp_path / "o.h5")]) == 0
    assert "force were in kN read as N" in capsys.readouterr().out


def test_the_readme_has_every_command() -> None:
    text = (ROOT / "README.md").read_text()
    assert [name for name in COMMANDS if f"`rig {name}" not in text] == []
