"""A disk that stands still for two seconds holds nobody up."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from ramps import Watcher, plan_of, ramp_instrument

from rig.acquire.recorder import RunWriter
from rig.acquire.session import acquire
from rig.acquire.waiting import Waiting
from rig.recording import read

RATE = 51200.0


def test_two_seconds_of_stall_at_the_full_rate_lose_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store, put = RunWriter._store, Waiting.put
    stalls, held_up = [], []

    def stalling(self: RunWriter, blocks: Any) -> None:
        store(self, blocks)
        if not stalls and self.tally.stored > RATE / 4:
            stalls.append(self.tally.stored)
            time.sleep(2.0)

    def watched(self: Waiting, block: Any, timeout: float) -> bool:
        held_up.append(self._samples >= self._most)
        return put(self, block, timeout)

    monkeypatch.setattr(RunWriter, "_store", stalling)
    monkeypatch.setattr(Waiting, "put", watched)
    plan = plan_of({"id": "a", "seconds": 4.0}, rate=RATE)
    names = [f"c{k}" for k in range(8)]
    plan = msgspec.structs.replace(
        plan, channels={n: msgspec.structs.replace(plan.channels["head"], input=k) for k, n in enumerate(names)}
    )
    watcher = Watcher()
    with ramp_instrument(speed=1.0, rows=64, inputs=8) as (port, instrument):
        acquire(plan, port, tmp_path / "c.h5", watcher.operator, force=True)
        assert instrument.count.ticks == 204_800
    assert stalls
    # The reader was never held up, so the wire was emptied as it filled.
    assert not any(held_up)
    tally = watcher.runs[0].tally
    assert (tally.stored, tally.lost) == (204_800, 0)
    run = read(tmp_path / "c.h5").runs[0]
    np.testing.assert_array_equal(run.channels["c7"].samples, np.arange(204_800) * 4 + 7)
