"""Sessions with instruments of all kinds: what is looked at before, what is played, and a new kind as one file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plans import plan_text
from ramps import RampPlant, Watcher, acquire, plan_of, ramp_instrument

from isorig import drivers
from isorig.drivers.errors import SettingError
from isorig.drivers.kinds import kinds
from isorig.drivers.simulated.commanded import Faults
from isorig.drivers.simulated.framed import SimulatedFramed
from isorig.drivers.simulated.served import served
from isorig.rig.acquire.plan_check import read_plan
from isorig.rig.acquire.simulated_instruments import far_end
from isorig.rig.errors import PlanError
from isorig.rig.files.recording import read
from isorig.rig.wire_bonder.description import wire_bonder

RANDOM = {"excitation": "random", "band": [0.5, 20.0], "seconds": 2.0}


def test_an_analyzer_is_checked_before_a_run_and_its_record_before_it_is_stored(tmp_path: Path) -> None:
    shows = [{"trace": "1", "kind": "time", "channel": "motor", "unit": "V"}]
    plan = plan_of({"id": "a", "excitation": "other"}, rate=512.0, instrument={"kind": "sr785", "shows": shows}, sensitivity=0.2)
    rig = wire_bonder()
    with served(far_end("sr785", rig, noise=1e-3, seed=0, speed=1.0, seconds=1.0, faults=Faults(overload=1.0))) as port:
        with pytest.raises(PlanError, match="the analyzer reports an overload"):
            acquire(plan, port, tmp_path / "c.h5", Watcher().operator)
        watcher = Watcher()
        acquire(plan, port, tmp_path / "forced.h5", watcher.operator, force=True)
        assert watcher.runs[0].tally.overloads == 1
    sound = far_end("sr785", rig, noise=1e-3, seed=0, speed=1.0, seconds=1.0)
    with served(sound) as port, pytest.raises(PlanError, match="sample rate is 256 Hz, not 512 Hz"):
        acquire(plan, port, tmp_path / "c.h5", Watcher().operator)
    assert not (tmp_path / "c.h5").exists()


LAMP = """
import time
import numpy as np
from isorig.drivers.block import Block, Input
from isorig.drivers.kinds import Settings, StreamKind

class Lamp:
    identity = "a lamp"
    inputs = ()
    def __init__(self, port, settings, waits):
        self.height = settings.height
    def prepare(self, *, sample_rate, channels):
        self.inputs = (Input(unit="V", per_count=1.0, full_scale=None, dtype="int16"),) * 4
        self.rate = sample_rate
        return sample_rate
    def start(self):
        self.tick = 0
    def read(self, timeout):
        if self.tick >= 4096:
            return None
        self.tick += 256
        samples = np.random.default_rng(self.tick).integers(-self.height, self.height, (256, 4)).astype(np.int16)
        return Block(first_tick=self.tick - 256, samples=samples, host_time=self.tick / self.rate)
    def stop(self):
        return self.tick
    def close(self):
        pass

class Height(Settings, frozen=True):
    height: int

KIND = StreamKind(name="lamp", open=Lamp, settings=Height)
"""
LAMPS = {"channels": {"motor": 1}, "sensitivity": 0.2, "kind": "lamp"}
RUN = {"id": "a", "excitation": "other", "seconds": 3.0}


def test_an_instrument_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a_lamp.py").write_text(LAMP)
    monkeypatch.setattr(drivers, "__path__", [*drivers.__path__, str(tmp_path)])
    kinds.cache_clear()
    try:
        (tmp_path / "plan.toml").write_text(plan_text(RUN, **LAMPS, height=100))
        acquire(read_plan(tmp_path / "plan.toml"), "wall", tmp_path / "c.h5", Watcher().operator)
        assert len(read(tmp_path / "c.h5").runs[0]) >= 3072
        (tmp_path / "plan.toml").write_text(plan_text(RUN, **LAMPS))
        with pytest.raises(PlanError, match=r"kind lamp: .*lacks the key 'height'"):
            read_plan(tmp_path / "plan.toml")
    finally:
        kinds.cache_clear()


class Playing(RampPlant):
    """A plant that keeps the drives that it was given."""

    def __init__(self) -> None:
        super().__init__()
        self.drives: list[np.ndarray] = []

    def play(self, drive: np.ndarray, *, sample_rate: float, gain: float, configuration: str) -> np.ndarray:
        self.drives.append(np.asarray(drive))
        return super().play(drive, sample_rate=sample_rate, gain=gain, configuration=configuration)


def test_nothing_is_played_in_a_run_that_is_driven_by_other_means(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plant = Playing()
    monkeypatch.setattr("ramps.RampPlant", lambda inputs: plant)
    plan = plan_of({"id": "a", **RANDOM}, {"id": "b", "excitation": "free", "seconds": 2.0})
    with ramp_instrument() as (port, _):
        acquire(plan, port, tmp_path / "c.h5", Watcher().operator, force=True)
    assert [float(drive.std()) > 0.0 for drive in plant.drives[:2]] == [True, False]
    assert not any(drive.any() for drive in plant.drives[1:])
    assert len(read(tmp_path / "c.h5").runs[1]) >= 2048


def test_an_instrument_without_an_output_is_refused_for_a_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answered = SimulatedFramed._answered
    monkeypatch.setattr(
        SimulatedFramed, "_answered", lambda self, words, drive: "DRIVE none" if drive else answered(self, words, drive)
    )
    with ramp_instrument() as (port, _), pytest.raises(SettingError, match=r"needs a drive and .* plays none"):
        acquire(plan_of({"id": "a", **RANDOM}), port, tmp_path / "c.h5", Watcher().operator)
    assert list(tmp_path.iterdir()) == []
