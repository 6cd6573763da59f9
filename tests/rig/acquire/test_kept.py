"""What a session leaves: sensors, arrival times and drift beside the samples, and all that an earlier part had measured."""

from __future__ import annotations

from pathlib import Path

import h5py
import msgspec
import numpy as np
import pytest
from ramps import Watcher, plan_of, ramp_instrument

from drivers.errors import ConnectionLostError
from drivers.simulated.faults import Faults
from rig.acquire.session import acquire
from rig.cli import main
from rig.errors import PlanError
from rig.recording import read


def test_what_a_recording_tells_beside_its_samples(tmp_path: Path) -> None:
    output = tmp_path / "c.h5"
    plan = plan_of({"id": "a", "seconds": 1.5}, {"id": "b", "seconds": 1.0})
    head = msgspec.structs.replace(plan.channels["head"], sensor="352C33", place="motor head", direction="+y")
    plan = msgspec.structs.replace(plan, channels={**plan.channels, "head": head})
    with ramp_instrument(speed=1.0, rows=16) as (port, _):
        acquire(msgspec.structs.replace(plan, runs=plan.runs[:1]), port, output, Watcher().operator, force=True)
    with ramp_instrument(rows=16) as (port, _):
        acquire(plan, port, output, Watcher().operator, force=True, resume=True)
    with h5py.File(output) as file:
        for run, ticks in (("a", 1536), ("b", 1024)):
            about = dict(file[f"runs/{run}/head"].attrs)
            assert [about[key] for key in ("sensor", "place", "direction")] == ["352C33", "motor head", "+y"]
            timing = file[f"runs/{run}/timing"]
            assert timing["tick"].tolist() == list(range(0, ticks, 16))
            assert (np.diff(timing["host_time"]) >= 0.0).all()
            np.testing.assert_allclose(timing["device_time"], timing["tick"] / 1024.0, atol=1e-6)
        assert {"clock_drift_ppm", "clock_drift_ppm_std"} <= set(file["runs/a"].attrs)
    assert [len(run) for run in read(output).runs] == [1536, 1024]


def test_resuming_keeps_what_was_broken_off_and_refuses_another_plan(tmp_path: Path) -> None:
    output, plan = tmp_path / "c.h5", plan_of({"id": "a", "seconds": 8.0})
    for cut in (5.0, 1.0):
        with ramp_instrument(Faults(unplug_after=cut), speed=8.0) as (port, _), pytest.raises(ConnectionLostError):
            acquire(plan, port, output, Watcher().operator, force=True, resume=output.exists())
        assert 2 * 1024 < len(read(output).runs[0]) <= 5 * 1024
    with pytest.raises(PlanError, match="the plan has no run 'b' to take again; it has a"):
        acquire(plan, "nowhere", output, Watcher().operator, resume=True, again={"b"})
    other = plan_of({"id": "a", "seconds": 8.0, "configuration": "locked"})
    with pytest.raises(PlanError, match="was taken with configuration unlocked and the plan says locked"):
        acquire(other, "nowhere", output, Watcher().operator, resume=True)


def test_a_run_is_taken_again_and_replaces_the_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "plan.toml").write_text(PLAN)
    call = ["acquire", str(tmp_path / "plan.toml"), "--yes", "--force", "-o", str(tmp_path / "c.h5")]
    assert main([*call, "--again", "b"]) == 2
    assert "together with --resume" in capsys.readouterr().err
    with ramp_instrument(Faults(overload=0.5, seed=1), rows=256) as (port, _):
        assert main([*call, "--port", port]) == 0
    assert "worth taking again while the rig stands: --resume --again a --again b" in capsys.readouterr().out
    first = {run.id: run for run in read(tmp_path / "c.h5").runs}
    with ramp_instrument(rows=256) as (port, _):
        assert main([*call, "--port", port, "--resume", "--again", "b"]) == 0
    second = {run.id: run for run in read(tmp_path / "c.h5").runs}
    assert second["a"].started == first["a"].started
    assert second["b"].started > first["b"].started
    with h5py.File(tmp_path / "c.h5") as file:
        assert [bool(file[f"runs/{run}/timing"]["status"].any()) for run in "ab"] == [True, False]


PLAN = """
[instrument]
kind = "framed"
port = "by hand"
sample_rate = 1024.0
[channels]
motor = {input = 1, sensitivity = 1.0}
[[runs]]
id = "a"
configuration = "unlocked"
gain = 70.0
excitation = "moves"
seconds = 1.0
[[runs]]
id = "b"
configuration = "unlocked"
gain = 70.0
excitation = "moves"
seconds = 1.0
"""
