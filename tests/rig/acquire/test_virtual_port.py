"""The port "virtual" serves every kind of instrument whose far end is simulated, also one that a user has added."""

from __future__ import annotations

from pathlib import Path

import pytest

from isorig.drivers import kinds as registry
from isorig.drivers import mti600
from isorig.rig.acquire.far_ends import simulated_kinds
from isorig.rig.cli import main
from isorig.rig.files.recording import read

HEAD = """
[rig]
head_mass = 6.5
[instrument]
kind = "{kind}"
port = "/dev/none"
sample_rate = {rate}
{more}
[channels.motor]
input = {input}
sensitivity = {sensitivity}
[[runs]]
id = "a"
configuration = "unlocked"
gain = 70.0
excitation = "other"
seconds = 3.0
"""
DRIVE = """
[channels.head]
input = 0
sensitivity = 0.2
"""
SHOWS = """
[[instrument.shows]]
trace = "{0}"
kind = "coherence"
channel = "motor"
reference = "head"
[[instrument.shows]]
trace = "{1}"
kind = "time"
channel = "motor"
unit = "V"
"""
PLANS = {
    "di1100": {"rate": 2000.0, "more": "full_scale = 10.0", "sensitivity": 0.2, "input": 3},
    "mti600": {"rate": 400.0, "more": "", "sensitivity": 1.0, "input": 1},
    "sr785": {"rate": 256.0, "more": SHOWS.format("0", "1"), "sensitivity": 0.2, "input": 3},
    "35670a": {"rate": 256.0, "more": SHOWS.format("XFR:POW:COH 1,2", "XTIM:VOLT 1"), "sensitivity": 0.2, "input": 3},
}


def test_every_kind_has_a_far_end() -> None:
    assert set(simulated_kinds()) == set(registry.kinds()) == {"framed", *PLANS}


@pytest.mark.parametrize("kind", PLANS)
def test_the_virtual_port_measures_with_any_kind(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mti600, "SETTLE", 0.0)
    plan = tmp_path / "plan.toml"
    text = HEAD.format(kind=kind, **PLANS[kind])
    plan.write_text(text if kind == "mti600" else text + DRIVE, encoding="utf-8")
    assert main(["acquire", str(plan), "--port", "virtual", "--yes", "--json", "-o", str(tmp_path / "c.h5")]) == 0
    (run,) = read(tmp_path / "c.h5").runs
    assert run.duration >= 3.0
    assert 0.3 < run.read("motor").std() < 5.0


def test_a_kind_without_a_far_end_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["virtual", "instrument", "--kind", "cassette", "--seconds", "1"]) == 2
    assert "the kind 'cassette' cannot be simulated; available are di1100, framed" in capsys.readouterr().err
