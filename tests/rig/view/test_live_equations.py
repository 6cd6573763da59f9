"""The equations of motion of a session that is running: on its page, and to end a run."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import pytest
from plans import plan_text

from isorig.drivers.kinds import kinds
from isorig.rig.acquire.live import EquationsReport
from isorig.rig.cli import main
from isorig.rig.files.recording import read
from isorig.rig.files.rigfile import write_model
from isorig.rig.view.equations_process import FIRST, LONGEST, equations_reports
from isorig.rig.view.messages import SessionState
from isorig.rig.view.snapshot import Snapshot
from isorig.rig.view.state import Subject, state_of
from isorig.rig.virtual.demo import virtual_instrument
from isorig.rig.wire_bonder.description import THESIS, wire_bonder

PLAN = plan_text({"id": "a", "excitation": "random", "band": [0.5, 40.0], "seconds": 300.0}, sensitivity=0.2)


def test_a_run_ends_when_its_equations_name_a_cause(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Play in the isolation; the run is planned for five minutes, and counts as complete when it ends."""
    (tmp_path / "plan.toml").write_text(PLAN, encoding="utf-8")
    output = tmp_path / "c.h5"
    # In real time: the equations are computed beside the run, also on a busy machine.
    rig = write_model(tmp_path / "rig.json", wire_bonder({**THESIS, "friction_force": 9.0}))
    with virtual_instrument(5, "--model", str(rig), "--hide", "backlash", "--speed", "1") as port:
        arguments = ["acquire", str(tmp_path / "plan.toml"), "--port", port, "--yes", "--json", "--until-known", "--force"]
        assert main([*arguments, "-o", str(output)]) == 0
    events = [json.loads(line) for line in capfd.readouterr().out.splitlines()]
    told = [event for event in events if event["event"] == "equations"]
    (taken,) = (event for event in events if event["event"] == "taken")
    (run,) = read(output).runs
    assert told[-1]["known"], [(event["seconds"], event["residuals"], event["text"]) for event in told]
    assert not any(event["known"] for event in told[:-1])
    assert "force over deflection (isolation)" in told[-1]["text"]
    assert told[-1]["seconds"] <= run.duration < 250.0
    assert taken["verdict"]["good"], taken["verdict"]["advice"]


def test_a_computer_that_cannot_follow_a_run_still_reads_records_that_confirm_each_other(tmp_path: Path) -> None:
    """The first reading finds a run that is already longer than the longest record."""
    assert main(["virtual", "campaign", "--hide", "backlash", "--seed", "5", "-o", str(tmp_path / "c.h5")]) == 0
    campaign = read(tmp_path / "c.h5")
    alone = replace(campaign, runs=campaign.runs[:1])
    assert alone.runs[0].duration > LONGEST
    messages = list(equations_reports(itertools.repeat(alone, 5)))
    assert messages[0].seconds == FIRST
    assert messages[-1].seconds <= LONGEST
    assert messages[-1].known
    assert "force over deflection (isolation)" in messages[-1].text


def test_analyzers_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = PLAN[PLAN.index("[[runs]]") :]
    analyzer = '[instrument]\nkind = "sr785"\nport = "/dev/none"\n' + kinds()["sr785"].example
    (tmp_path / "plan.toml").write_text(plan + analyzer, encoding="utf-8")
    assert main(["acquire", str(tmp_path / "plan.toml"), "--until-known", "-o", str(tmp_path / "c.h5")]) == 2
    assert "--until-known needs an instrument that streams samples" in capsys.readouterr().err
    assert not (tmp_path / "c.h5").exists()


def test_the_page_shows_a_bar_for_each_equation() -> None:
    told = EquationsReport(run="a", seconds=8.0, residuals={"motor": 40.0, "table": 0.4}, limit=2.0, known=True, text="a cause")
    state = state_of(Subject(title="c.h5", mode="session"), Snapshot(), SessionState(phase="measures", run="a", equations=told))
    assert state["equations"] == {
        "text": "a, from 8 s: a cause, certain", "limit": 2.0,
        "bars": [{"name": "motor", "residual": 40.0}, {"name": "table", "residual": 0.4}],
    }  # fmt: skip
    assert state_of(Subject(title="c.h5", mode="session"), Snapshot(), SessionState())["equations"] is None
