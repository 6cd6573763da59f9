"""What a session leaves: sensors, arrival times and drift beside the samples, and all that an earlier part had measured."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import msgspec
import numpy as np
import pytest
from plans import plan_text
from ramps import Watcher, acquire, plan_of, ramp_instrument

from isorig.drivers.errors import ConnectionLostError
from isorig.drivers.simulated.commanded import Faults
from isorig.rig.cli import main
from isorig.rig.errors import PlanError
from isorig.rig.files.recording import read


def test_metadata_of_a_recording(tmp_path: Path) -> None:
    output = tmp_path / "c.h5"
    plan = plan_of({"id": "a", "seconds": 1.5}, {"id": "b", "seconds": 1.0})
    head = msgspec.structs.replace(plan.channels["head"], sensor="352C33", place="motor head", direction="+y")
    instrument = msgspec.structs.replace(plan.instrument, usable_to=460.0)
    plan = msgspec.structs.replace(plan, channels={**plan.channels, "head": head}, instrument=instrument)
    with ramp_instrument(speed=1.0, rows=16) as (port, _):
        acquire(msgspec.structs.replace(plan, runs=plan.runs[:1]), port, output, Watcher().operator, force=True)
    with ramp_instrument(rows=16) as (port, _):
        acquire(plan, port, output, Watcher().operator, force=True, resume=True)
    with h5py.File(output) as file:
        for run, ticks in (("a", 1536), ("b", 1024)):
            about = dict(file[f"runs/{run}/head"].attrs)
            assert [about[key] for key in ("sensor", "place", "direction")] == [b"352C33", b"motor head", b"+y"]
            timing = file[f"runs/{run}/timing"]
            assert timing["tick"].tolist() == list(range(0, ticks, 16))
            assert (np.diff(timing["host_time"]) >= 0.0).all()
            np.testing.assert_allclose(timing["device_time"], timing["tick"] / 1024.0, atol=1e-6)
        assert {"clock_drift_ppm", "clock_drift_ppm_std"} <= set(file["runs/a"].attrs)
    assert [len(run) for run in read(output).runs] == [1536, 1024]
    assert [run.usable_to for run in read(output).runs] == [460.0, 460.0]


def test_resuming_keeps_an_interrupted_run_and_refuses_another_plan(tmp_path: Path) -> None:
    output, plan = tmp_path / "c.h5", plan_of({"id": "a", "seconds": 8.0})
    for cut in (5.0, 1.0):
        with ramp_instrument(Faults(unplug_after=cut), speed=8.0) as (port, _), pytest.raises(ConnectionLostError):
            acquire(plan, port, output, Watcher().operator, force=True, resume=output.exists())
        assert 2 * 1024 < len(read(output).runs[0]) <= 5 * 1024
    with pytest.raises(PlanError, match="the plan has no run 'b' to repeat; it has a"):
        acquire(plan, "nowhere", output, Watcher().operator, resume=True, again={"b"})
    other = plan_of({"id": "a", "seconds": 8.0, "configuration": "locked"})
    with pytest.raises(PlanError, match="was measured with configuration unlocked but the plan has locked"):
        acquire(other, "nowhere", output, Watcher().operator, resume=True)


def test_runs_keep_their_order_where_the_clock_is_set_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output, plan = (
        tmp_path / "c.h5",
        plan_of(*({"id": name, "seconds": 1.0} for name in "zyx")),
    )
    hours = iter(range(100, 0, -1))
    monkeypatch.setattr("time.time_ns", lambda: next(hours) * 3600 * 10**9)
    first = msgspec.structs.replace(plan, runs=plan.runs[:2])
    for part, resume in ((first, False), (plan, True)):
        with ramp_instrument() as (port, _):
            acquire(part, port, output, Watcher().operator, force=True, resume=resume)
    assert [run.id for run in read(output).runs] == ["z", "y", "x"]


def test_a_repeated_run_replaces_the_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "plan.toml").write_text(PLAN)
    call = ["acquire", str(tmp_path / "plan.toml"), "--yes", "--force", "-o", str(tmp_path / "c.h5")]
    assert main([*call, "--again", "b"]) == 2
    assert "together with --resume" in capsys.readouterr().err
    with ramp_instrument(Faults(overload=0.5, seed=1), rows=256) as (port, _):
        assert main([*call, "--port", port]) == 0
    assert "repeat while the rig is set up: --resume --again a --again b" in capsys.readouterr().out
    first = {run.id: run for run in read(tmp_path / "c.h5").runs}
    with ramp_instrument(rows=256) as (port, _):
        assert main([*call, "--port", port, "--resume", "--again", "b"]) == 0
    second = {run.id: run for run in read(tmp_path / "c.h5").runs}
    assert second["a"].started == first["a"].started
    assert second["b"].started > first["b"].started
    with h5py.File(tmp_path / "c.h5") as file:
        assert [bool(file[f"runs/{run}/timing"]["status"].any()) for run in "ab"] == [True, False]


PLAN = plan_text({"id": "a", "seconds": 1.0}, {"id": "b", "seconds": 1.0}, channels={"motor": 1})


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal, which Windows has not")
def test_what_a_killed_program_left_of_this_recording_is_removed(tmp_path: Path) -> None:
    output, saved = tmp_path / "c.h5", tmp_path / "saved.h5"
    kill = "import os, sys; from isorig.rig.files.output import replaced\nwith replaced(sys.argv[1]): os.kill(os.getpid(), 9)"
    others = [tmp_path / ".d.h5.abcdefgh", tmp_path / ".c.h5.abcdefghi", tmp_path / ".c.h5.ABCDEFGH", tmp_path / "c.h5.abcdefgh"]
    for path in others:
        path.write_text("somebody's")
    for path in (output, output.with_name("c.h5.partial"), saved):
        subprocess.run([sys.executable, "-c", kill, str(path)], check=False, timeout=60)
    assert len(list(tmp_path.iterdir())) == len(others) + 3
    with ramp_instrument(Faults(unplug_after=1.0), speed=8.0) as (port, _), pytest.raises(ConnectionLostError):
        acquire(plan_of({"id": "a", "seconds": 4.0}), port, output, Watcher().operator, force=True)
    assert len(list(tmp_path.iterdir())) == len(others) + 2  # the recording, and what is left of the other one
    working = tmp_path / "w.partial"
    plan = plan_of({"id": "a", "seconds": 0.5})
    with ramp_instrument(speed=8.0) as (port, _):

        def copied(_: object) -> None:
            working.write_bytes((tmp_path / "e.h5.partial").read_bytes())

        acquire(plan, port, tmp_path / "e.h5", replace(Watcher().operator, taken=copied), force=True)
    assert main(["recover", str(working), "-o", str(saved)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        "c.h5",
        "saved.h5",
        "e.h5",
        working.name,
        *(path.name for path in others),
    }
