"""Mistakes that a newcomer makes with files of their own: each is reported by rig import in one sentence with the way out.

The rig is simulated with scipy: two masses in a row, a force, a displacement and an acceleration. Its description is up to a
quarter off.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from strange_rigs import StrangeRig, noise

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.rig.cli import main
from isorig.rig.files.recording import write

RIG = StrangeRig(
    masses=(4.0, 2.0), joints=((0, -1, 4e3, 12.0), (1, 0, 3e3, 6.0)),
    sensors=(("low", 0, "displacement"), ("top", 1, "acceleration")),
)  # fmt: skip
RATE, SECONDS = 256.0, 12.0
DESCRIPTION = """
name = "stage"
free = ["links.foot.stiffness", "links.foot.damping", "links.upper.stiffness", "links.upper.damping"]
bodies = [{ name = "table", mass = 4.2 }, { name = "device", mass = 1.9 }]
links = [
  { name = "foot", a = "table", b = "ground", stiffness = 4700.0, damping = 9.0 },
  { name = "upper", a = "device", b = "table", stiffness = 2600.0, damping = 8.0 },
]
drive = { channel = "force", quantity = "force", factor = 1.0, pushes = { table = 1.0 } }
sensors = [
  { channel = "low", body = "table", quantity = "displacement" },
  { channel = "top", body = "device" },
]
"""
MAPPING = """
description = "rig.toml"
[channels.force]
source = "F"
unit = "N"
[channels.low]
source = "x"
unit = "mm"
[channels.top]
source = "a"
unit = "m/s^2"
[[runs]]
id = "first"
file = "first.csv"
configuration = "unlocked"
gain = 1.0
excitation = "random"
band = [0.5, 40.0]
time = "t"
"""


@cache
def records() -> dict[str, FloatArray]:
    drive = noise(SECONDS, RATE, 20.0, (0.5, 40.0), 5)
    found = RIG.recorded(drive, RATE)
    draw = np.random.default_rng(1)
    noisy = {name: values + draw.normal(0.0, 3e-3 * values.std(), len(values)) for name, values in found.items()}
    return {"t": np.arange(len(drive)) / RATE, "F": noisy["force"], "x": 1e3 * noisy["low"], "a": noisy["top"]}


@dataclass(frozen=True)
class Files:
    """What the newcomer has: columns, the text above them, mapping and description."""

    columns: dict[str, FloatArray] = field(default_factory=lambda: dict(records()))
    head: str = ""
    mapping: str = MAPPING
    description: str = DESCRIPTION
    end: str = ""

    def write(self, folder: Path) -> None:
        rows = zip(*self.columns.values(), strict=True)
        text = "\n".join(",".join(f"{value:.9g}" for value in row) for row in rows)
        (folder / "first.csv").write_text(f"{self.head}{','.join(self.columns)}\n{text}\n{self.end}")
        (folder / "m.toml").write_text(self.mapping)
        if self.description:
            (folder / "rig.toml").write_text(self.description)


Mistake = Callable[[Files], Files]


def times(column: str, factor: float) -> Mistake:
    return lambda files: replace(files, columns={**files.columns, column: factor * files.columns[column]})


def swap(one: str, other: str) -> Mistake:
    """The two columns are exchanged, with the units that the operator expects of them."""
    return lambda files: replace(files, columns={**files.columns, one: files.columns[other], other: files.columns[one]})


def mapped(old: str, new: str) -> Mistake:
    assert old in MAPPING
    return lambda files: replace(files, mapping=files.mapping.replace(old, new))


def described(*pairs: tuple[str, str]) -> Mistake:
    def wrong(files: Files) -> Files:
        text = files.description
        for old, new in pairs:
            assert old in text
            text = text.replace(old, new)
        return replace(files, description=text)

    return wrong


def headed(text: str) -> Mistake:
    return lambda files: replace(files, head=text)


def without(column: str) -> Mistake:
    return lambda files: replace(files, columns={name: values for name, values in files.columns.items() if name != column})


def cut(samples: int) -> Mistake:
    return lambda files: replace(files, columns={name: values[:samples] for name, values in files.columns.items()})


def ended(text: str) -> Mistake:
    return lambda files: replace(files, end=text)


def holed(files: Files) -> Files:
    values = files.columns["a"].copy()
    values[100] = np.inf
    return replace(files, columns={**files.columns, "a": values})


def of_another_run(files: Files) -> Files:
    values = np.random.default_rng(3).normal(0.0, files.columns["a"].std(), len(files.columns["a"]))
    return replace(files, columns={**files.columns, "a": values})


def backwards(files: Files) -> Files:
    return replace(files, columns={name: v if name == "t" else v[::-1] for name, v in files.columns.items()})


def clipped(files: Files) -> Files:
    most = 0.5 * files.columns["a"].std()
    return replace(files, columns={**files.columns, "a": np.clip(files.columns["a"], -most, most)})


def repeated(files: Files) -> Files:
    rows = np.repeat(np.arange(len(files.columns["t"])), [2 if 300 <= k < 310 else 1 for k in range(len(files.columns["t"]))])
    return replace(files, columns={name: values[rows] for name, values in files.columns.items()})


def both(*mistakes: Mistake) -> Mistake:
    def wrong(files: Files) -> Files:
        for mistake in mistakes:
            files = mistake(files)
        return files

    return wrong


def undescribed(files: Files) -> Files:
    return replace(files, description="")


#: What a draft gives a link.
DRAFTED = "stiffness = 1000.0, damping = 1.0"
#: Each with a part of its sentence: what was found, and the way out.
MISTAKES: dict[str, tuple[Mistake, str]] = {
    # units of channels
    "force in kN": (times("F", 1e-3), "force were in kN read as N: check the unit of the drive channel force"),
    "force in lbf": (times("F", 1.0 / 4.448), "force were in lbf read as N: check the unit of the drive channel force"),
    "force in kgf": (times("F", 1.0 / 9.807), "force were in kgf read as N: check the unit of the drive channel force"),
    "displacement in m": (times("x", 1e-3), "low were in m read as mm, and the others are not: check the unit of low"),
    "displacement in um": (times("x", 1e3), "low were in um read as mm, and the others are not: check the unit of low"),
    "displacement in inches": (times("x", 1.0 / 25.4), "low were in in read as mm"),
    "mm mapped as m": (mapped('unit = "mm"', 'unit = "m"'), "low were in mm read as m"),
    "acceleration in g": (times("a", 1.0 / 9.807), "top were in g read as m/s^2"),
    "m/s^2 mapped as g": (mapped('"m/s^2"', '"g"'), "top were in m/s^2 read as g"),
    "acceleration in mm/s^2": (times("a", 1e3), "top were in mm/s^2 read as m/s^2"),
    "sensitivity a hundredth": (mapped('"m/s^2"', '"m/s^2"\nsensitivity = 0.01'), "check the unit, the sensitivity and"),
    # units of given values
    "one stiffness in N/mm": (described(("4700.0", "4.7")), "stiffness of foot is about 0.001 times what the records show"),
    "all in N/mm": (described(("4700.0", "4.7"), ("2600.0", "2.6")), "between N/mm and N/m: give them in N/m"),
    "stiffness in lbf/in": (described(("4700.0", "26.8"), ("2600.0", "14.8")), "between lbf/in and N/m: give them in N/m"),
    "masses in g": (described(("mass = 4.2", "mass = 4200.0"), ("mass = 1.9", "mass = 1900.0")), "between g and kg: give them"),
    "masses in lb": (described(("mass = 4.2", "mass = 9.2"), ("mass = 1.9", "mass = 4.2")), "between lb and kg: give them in kg"),
    "drafted values": (
        described(
            ("mass = 4.2", "mass = 1.0"), ("mass = 1.9", "mass = 1.0"), ("stiffness = 4700.0, damping = 9.0", DRAFTED),
            ("stiffness = 2600.0, damping = 8.0", DRAFTED),
        ),
        "The description still has the drafted values of table and device and foot and upper: give the rig's own masses",
    ),
    "damping ratios": (
        described(("damping = 9.0", "damping = 0.05"), ("damping = 8.0", "damping = 0.05"), ("foot.damping", "foot.stiffness"),
                  ("upper.damping", "upper.stiffness")),
        "The given damping of foot and upper, 0.05 and 0.05 N s/m, is far below what the records show, but agrees with them as a",
    ),
    # signs
    "inverted sensor": (times("a", -1.0), "top has the opposite sign of what the given rig predicts: check the direction"),
    "inverted force": (times("F", -1.0), "All responses have the opposite sign of what the given rig predicts"),
    # swaps
    "swapped columns": (swap("x", "a"), "low and top seem swapped"),
    "force and acceleration": (swap("F", "a"), "force and top seem swapped"),
    "force and displacement": (swap("F", "x"), "force and low seem swapped"),
    # places
    "drive on another body": (described(("pushes = { table", "pushes = { device")), "force seems to act on table instead of"),
    "sensors on each other's body": (
        described(('body = "table", quantity', 'body = "@", quantity'), ('"top", body = "device"', '"top", body = "table"'),
                  ('body = "@"', 'body = "device"')),
        "low seems to be on table instead of device and top seems to be on device instead of table",
    ),
    # types of values
    "a text for a number": (mapped("gain = 1.0", 'gain = "low"'), "runs.first.gain is 'low', but must be a number"),
    "no channels": (lambda files: replace(files, mapping='description = "rig.toml"\n'), "the file lacks the key 'channels'"),
    # sample rates
    "band beyond the rate": (mapped("band = [0.5, 40.0]", "band = [0.5, 400.0]"), "256 samples/s contain only frequencies up to"),
    "rows repeated": (repeated, "split the run where rows are missing or repeated, or resample it evenly"),
    "rate against the time column": (mapped('time = "t"', "sample_rate = 512.0"), "256 Hz by the time column 't' of the file"),
    "rate against the header": (headed("Sample rate: 1024 Hz\n"), "but 1024 Hz by the file itself"),
    "rate and time": (mapped('time = "t"', 'time = "t"\nsample_rate = 128.0'), "sample_rate = 128 Hz in the mapping, but 256 Hz"),
    "twice the rate": (lambda files: without("t")(mapped('time = "t"', "sample_rate = 512.0")(files)), "check the sample rate"),
    "half the rate": (lambda files: without("t")(mapped('time = "t"', "sample_rate = 128.0")(files)), "check the sample rate"),
    "no rate": (lambda files: without("t")(mapped('time = "t"\n', "")(files)), "give sample_rate in Hz, or time"),
    "a time column in the wrong unit": (mapped('time = "t"', 'time = "t"\ntime_unit = "ms"'), "sample rate, time_unit and band"),
    "times in ms": (times("t", 1e3), "sample rate, time_unit or band (if the times are in ms, write time_unit = 'ms')"),
    "times in ms, without a band": (
        both(times("t", 1e3), mapped("band = [0.5, 40.0]\n", "")),
        "0.256 samples per second by its time column 't' in s; if the times are in ms, write time_unit = 'ms'",
    ),
    "times in us": (times("t", 1e6), "if the times are in us, write time_unit = 'us'"),
    "times in ms beside the rate": (
        both(times("t", 1e3), mapped('time = "t"', 'time = "t"\nsample_rate = 256.0')),
        "0.256 Hz by its time column 't': its times look like ms, so write time_unit = 'ms'",
    ),
    # excitations
    "noise as a sweep": (mapped('"random"', '"sweep"'), "states the excitation sweep, but its drive 'force' has all of its"),
    "noise as free": (mapped('"random"', '"free"'), "states the excitation free, but its drive 'force' and all responses are as"),
    # values of zero
    "gain of 0": (mapped("gain = 1.0", "gain = 0.0"), "run 'first' has gain 0, but is driven; give the amplifier's setting"),
    "factor of 0": (described(("factor = 1.0", "factor = 0.0")), "the drive has factor 0, so it drives nothing"),
    "gain of 0 in a chain": (
        described(('"top", body = "device"', '"top", body = "device", chain = { gain = 0.0 }')), "channel 'top' has gain 0, which"
    ),
    # records
    "dead": (times("x", 0.0), "low is dead (constant 0 m); check its cable and its supply"),
    "clipped": (clipped, "top seems clipped"),
    "reversed in time": (backwards, "agree with the given rig only if time runs backwards: their samples are in reverse order"),
    "of another run": (of_another_run, "top has a coherence of"),
    "another quantity": (
        mapped('"mm"', '"mm/s"'), "'low' is recorded in m/s, but the description has it as displacement (m): correct the unit"
    ),
    # writing
    "decimal comma": (mapped("gain = 1.0", "gain = 1,0"), "write numbers with a decimal point"),
    "backslashes": (mapped('"first.csv"', '"C:\\data\\first.csv"'), "write / in place of \\ in paths"),
    "no quotes": (mapped('"first.csv"', "first.csv"), "write texts in quotes"),
    "single brackets": (mapped("[[runs]]", "[runs]"), "may be several: write its head as [[runs]]"),
    # columns
    "column misspelt": (mapped('source = "F"', 'source = "f"'), "'f', which is absent (did you mean 'F'?)"),
    "column missing": (without("a"), "column 'a', which is absent"),
    "time column missing": (mapped('time = "t"', 'time = "tme"'), "'tme', which is absent"),
    "a value that is none": (holed, "contains inf at sample 100"),
    "a word in a column": (ended("12.0,1.0,bad,1.0\n"), "contains 'bad', which is not a number"),
    # spelling
    "key of a channel": (mapped('unit = "N"', 'units = "N"'), "key 'units' = 'N', which is unknown there (did you mean 'unit'?)"),
    "key of a run": (mapped("excitation", "exitation"), "= 'random', which is unknown there (did you mean 'excitation'?)"),
    "unit": (mapped('unit = "N"', 'unit = "Nwt"'), "has unit 'Nwt' (did you mean 'newton'?); known are"),
    "key of a link": (described(("stiffness = 4700.0", "stifness = 4700.0")), "(did you mean 'stiffness'?)"),
    "free parameter": (
        described(('"links.foot.stiffness"', '"links.foot.stifness"')), "'stifness' is not there (did you mean 'stiffness'?)"
    ),
    "body": (described(('a = "device"', 'a = "devise"')), "body 'devise', which does not exist (did you mean 'device'?)"),
    "quantity": (described(('quantity = "displacement"', 'quantity = "position"')), "'position'; allowed are acceleration, "),
    "configuration": (mapped('"unlocked"', '"unlock"'), "has the configuration 'unlock'"),
    "channel": (mapped("channels.top", "channels.tpo"), "no channel 'top' (did you mean 'tpo'?)"),
    # missing
    "no description": (undescribed, "rig.toml does not exist; give the file of a rig's description"),
    "no file": (mapped("first.csv", "frist.csv"), "frist.csv does not exist (did you mean 'first.csv'?)"),
    "no sensor in the description": (
        described(
            ('{ channel = "low", body = "table", quantity = "displacement" },', ""),
            ('{ channel = "top", body = "device" },', ""),
        ),
        "describes the rig 'stage' without a sensor, but a rig needs at least one recorded response; add it to sensors",
    ),
    "no sensor in the mapping": (mapped('[channels.low]\nsource = "x"\nunit = "mm"\n', ""), "no channel 'low'"),
    # short
    "hardly a record": (cut(40), "Run 'first' has 40 samples, 0.156 s, but fits need at least 256: record longer runs"),
    "too short": (cut(200), "Run 'first' has 200 samples, 0.781 s, but fits need at least 256: record longer runs"),
    "truncated": (ended("12.0,1.0\n"), "has 2 of 4 cells: it was truncated"),
    "empty": (cut(0), "has no columns of numbers"),
}  # fmt: skip


def imported(folder: Path, files: Files, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """What rig import reports, without the path that it prints."""
    files.write(folder)
    main(["import", str(folder / "m.toml"), "-o", str(folder / "o.h5")])
    said = capsys.readouterr()
    return [line for line in (said.out + said.err).splitlines() if line != str(folder / "o.h5")]


def test_there_are_forty() -> None:
    assert len(MISTAKES) >= 40


@pytest.mark.parametrize("name", MISTAKES)
def test_one_sentence(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mistake, said = MISTAKES[name]
    lines = imported(tmp_path, mistake(Files()), capsys)
    assert len(lines) == 1, lines
    assert said in lines[0]
    assert not re.search(r"Traceback|\bnan\b|Error", lines[0])


def test_no_mistake(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert imported(tmp_path, Files(), capsys) == []


COMMANDS = {
    "describe": ["describe", "rig.toml"],
    "simulate": ["simulate", "--model", "rig.toml", "-o", "s.h5"],
    "diagnose": ["diagnose", "o.h5", "-o", "d"],
    "characterize": ["characterize", "o.h5", "-o", "c"],
    "report": ["report", "o.h5", "-o", "r"],
    "frf": ["frf", "o.h5", "-o", "f"],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_rig_without_sensors(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Descriptions and recordings whose only channel is taken as the drive are refused in one sentence."""
    files = MISTAKES["no sensor in the description"][0](Files())
    files.write(tmp_path)
    drive = Channel(name="force", samples=records()["F"], quantity="force", unit="N")
    run = Run(
        id="first", configuration="unlocked", sample_rate=RATE, gain=1.0, channels={"force": drive}, excitation="random",
        band=(0.5, 40.0),
    )  # fmt: skip
    write(tmp_path / "o.h5", Campaign(runs=(run,), description=files.description))
    monkeypatch.chdir(tmp_path)
    assert main(COMMANDS[name]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert ("without a sensor" if name != "frf" else "has only the channel of the drive, force; record at least one") in line


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("two-cart", "two-cart is not a rig (did you mean 'two-carts'?); give a description in .toml, a model.json that"),
        ("first.csv", "first.csv is not a rig; give a description in .toml, a model.json that rig diagnose wrote, or one of"),
    ],
)
def test_what_is_no_rig(
    given: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    Files().write(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(["describe", given]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


@pytest.mark.parametrize("command", ["diagnose", "characterize", "report", "frf", "isolation", "investigate", "design"])
def test_a_file_is_no_folder_for_results(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is refused before the work begins: the recording is not even there."""
    Files().write(tmp_path)
    assert main([command, str(tmp_path / "o.h5"), "-o", str(tmp_path / "first.csv")]) == 2
    assert "It is a file; give the name of a folder" in " ".join(capsys.readouterr().err.replace("│", " ").split())
