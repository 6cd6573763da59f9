"""Sessions with analog outputs: every drive of a plan is played within its limits, and the output is at zero afterwards."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ramps import Watcher, acquire, plan_of

from isorig.drivers.errors import SettingError
from isorig.rig.files.recording import read

NI = {
    "kind": "nidaqmx", "inputs": [f"cDAQ1Mod1/ai{k}" for k in range(4)], "output": "cDAQ1Mod3/ao0", "drive_volts": 0.01,
    "full_scale": 1e9,
}  # fmt: skip
DRIVES = {
    "random": {"band": [0.5, 20.0]}, "multisine": {"band": [0.5, 20.0], "period": 1.0}, "sweep": {"band": [1.0, 20.0]},
    "moves": {}, "sine": {"frequency": 5.0}, "steps": {},
}  # fmt: skip


@pytest.fixture(autouse=True)
def far_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "drivers"))


@pytest.mark.parametrize("excitation", DRIVES)
def test_every_drive_is_played_by_the_output(excitation: str, tmp_path: Path) -> None:
    from ni_device import chassis

    run = {"id": "a", "gain": 5.0, "seconds": 3.0, "excitation": excitation, **DRIVES[excitation]}
    plan = plan_of(run, rate=1024.0, instrument=NI)
    with chassis() as device:
        acquire(plan, "cDAQ1", tmp_path / "c.h5", Watcher().operator, force=True)
    played = np.array(device.played)
    assert 0.0 < np.abs(played).max() <= 1.0
    # It starts and ends softly.
    assert played[0] == 0.0
    assert device.level == 0.0
    assert len(read(tmp_path / "c.h5").runs[0]) >= 3072


def test_a_drive_above_the_limit_ends_the_session_before_it_is_played(tmp_path: Path) -> None:
    from ni_device import chassis

    run = {"id": "a", "gain": 5000.0, "seconds": 3.0, "excitation": "random", **DRIVES["random"]}
    with chassis() as device, pytest.raises(SettingError, match="limited to 1 V"):
        acquire(plan_of(run, rate=1024.0, instrument=NI), "cDAQ1", tmp_path / "c.h5", Watcher().operator, force=True)
    assert not any(device.played)


def test_a_stopped_run_leaves_the_output_at_zero(tmp_path: Path) -> None:
    from ni_device import chassis

    run = {"id": "a", "gain": 5.0, "seconds": 60.0, "excitation": "sine", "frequency": 0.5}
    with chassis() as device:
        stopped = iter([False] * 20)
        acquire(
            plan_of(run, rate=1024.0, instrument=NI), "cDAQ1", tmp_path / "c.h5",
            replace(Watcher().operator, stopped=lambda: next(stopped, True)), force=True,
        )  # fmt: skip
    assert device.level == 0.0
    assert len(read(tmp_path / "c.h5").runs[0]) < 61_440
