"""A plant whose samples tell their own tick, so that every stored sample can be checked, and plans to measure it."""

from __future__ import annotations

import math
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from isorig.drivers.simulated.commanded import Faults, Simulation
from isorig.drivers.simulated.framed import SimulatedFramed
from isorig.drivers.simulated.served import served
from isorig.drivers.waits import Waits
from isorig.rig.acquire import session
from isorig.rig.acquire.live import LiveState
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.plan import plan_of as plan_of_tree
from isorig.rig.acquire.policy import SessionWaits
from isorig.rig.acquire.rig_operator import MeasuredRun, Operator

CHANNELS = ("head", "motor", "table", "heatblock")
#: A wire that is gone stays gone here: it is waited for as long as it takes to see that.
SHORT = SessionWaits(reconnection=0.8, drivers=Waits(adapter=0.0))
acquire = partial(session.acquire, waits=SHORT)


@dataclass(frozen=True)
class SmallDisk:
    """A disk of a few bytes, which exists within one script only."""

    folder: Path
    mount: str

    def run(self, script: str) -> subprocess.CompletedProcess[str]:
        """Run a script with the disk in its folder."""
        return _alone(f"{self.mount} && {script}", timeout=60)


def small_disk(tmp_path: Path, size: str) -> SmallDisk:
    """A disk of that size; the test is skipped where none can be mounted."""
    disk = SmallDisk(tmp_path / "disk", f"mount -t tmpfs -o size={size} none {tmp_path}/disk")
    disk.folder.mkdir()
    if _alone(disk.mount, timeout=20).returncode:
        pytest.skip("a small disk cannot be mounted here")
    return disk


def _alone(script: str, timeout: float) -> subprocess.CompletedProcess[str]:
    call = ["unshare", "-Urm", "sh", "-c", script]
    return subprocess.run(call, capture_output=True, text=True, timeout=timeout, check=False)


class RampPlant:
    """Input k counts tick * 4 + k, so that a sample says where it belongs."""

    identity = "ramp"

    def __init__(self, inputs: int = 4) -> None:
        self.inputs = (inputs, "V", 1e-6, 4000.0)

    def play(self, drive: Any, *, sample_rate: float, gain: float, configuration: str) -> Any:
        ticks = np.arange(len(drive), dtype=np.int32)[:, None]
        return ticks * 4 + np.arange(self.inputs[0], dtype=np.int32)


@contextmanager
def ramp_instrument(
    faults: Faults | None = None, *, speed: float | None = None, rows: int = 64, inputs: int = 4
) -> Iterator[tuple[str, SimulatedFramed]]:
    plant = RampPlant(inputs)
    if speed != 1.0:
        # Its time is not the host's, and it says so.
        plant.identity = "virtual ramp"
    asked = Simulation(speed=math.inf if speed is None else speed, faults=faults or Faults())
    instrument = SimulatedFramed(plant, asked, rows=rows)
    with served(instrument) as port:
        yield port, instrument


def plan_of(
    *runs: dict[str, Any], rate: float = 1024.0, instrument: dict[str, Any] | None = None, sensitivity: float = 1.0
) -> Plan:
    tree = {
        "rig": {"head_mass": 6.5},
        "instrument": {"kind": "framed", "port": "virtual", "sample_rate": rate} | (instrument or {}),
        "channels": {name: {"input": k, "sensitivity": sensitivity} for k, name in enumerate(CHANNELS)},
        "runs": [{"configuration": "unlocked", "gain": 70.0, "excitation": "moves", "seconds": 4.0, **run} for run in runs],
    }
    return plan_of_tree(tree)


class Watcher:
    """An operator that keeps what it is told."""

    def __init__(self) -> None:
        self.locks: list[str] = []
        self.seen: list[LiveState] = []
        self.runs: list[MeasuredRun] = []
        self.operator = Operator(lock=self.locks.append, watch=self.seen.append, taken=self.runs.append)


def ticks_of(run: Any) -> Any:
    """The instrument's tick of every stored sample, from the gaps."""
    ticks = np.arange(len(run))
    for gap in run.gaps:
        ticks[ticks >= gap.first_tick] += gap.count
    return ticks
