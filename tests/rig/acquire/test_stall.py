"""A disk that stands still for two seconds holds nobody up."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from ramps import Watcher, acquire, plan_of, ramp_instrument

from isorig.drivers.block import Block
from isorig.rig.acquire.policy import SessionWaits
from isorig.rig.acquire.recorder import BlockQueue, RunWriter
from isorig.rig.errors import OutputError
from isorig.rig.files.recording import read

RATE = 51200.0


def test_two_seconds_of_stall_at_the_full_rate_lose_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store, put = RunWriter._store, BlockQueue.put
    stalls, held_up = [], []

    def stalling(self: RunWriter, blocks: Any) -> None:
        store(self, blocks)
        if not stalls and self.tally.stored > RATE / 4:
            stalls.append(self.tally.stored)
            time.sleep(2.0)

    def watched(self: BlockQueue, block: Any, timeout: float) -> bool:
        held_up.append(self._samples >= self._most)
        return put(self, block, timeout)

    monkeypatch.setattr(RunWriter, "_store", stalling)
    monkeypatch.setattr(BlockQueue, "put", watched)
    plan = plan_of({"id": "a", "seconds": 4.0}, rate=RATE)
    names = [f"c{k}" for k in range(8)]
    plan = msgspec.structs.replace(
        plan, channels={n: msgspec.structs.replace(plan.channels["head"], input=k) for k, n in enumerate(names)}
    )
    watcher = Watcher()
    with ramp_instrument(speed=1.0, rows=64, inputs=8) as (port, instrument):
        acquire(plan, port, tmp_path / "c.h5", watcher.operator, force=True)
        assert instrument.sent == 204_800
    assert stalls
    # The reader was never held up, so the wire was emptied as it filled.
    assert not any(held_up)
    tally = watcher.runs[0].tally
    assert (tally.stored, tally.lost) == (204_800, 0)
    run = read(tmp_path / "c.h5").runs[0]
    np.testing.assert_array_equal(run.channels["c7"].samples, np.arange(204_800) * 4 + 7)


def test_a_disk_that_never_comes_back_ends_the_session_in_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stuck = threading.Event()
    waits = SessionWaits(disk=0.2, queue=0.5)
    store = RunWriter._store
    monkeypatch.setattr(RunWriter, "_store", lambda self, blocks: (stuck.wait(0.6), store(self, blocks)))
    with ramp_instrument(speed=8.0) as (port, instrument):
        with pytest.raises(OutputError, match=r"the disk has not written for 0\.2 s"):
            acquire(
                plan_of({"id": "a", "seconds": 60.0}), port, tmp_path / "c.h5", Watcher().operator, force=True, waits=waits
            )  # fmt: skip
        assert not instrument.running
    # What waited was written as soon as the disk went on.
    run = read(tmp_path / "c.h5").runs[0]
    np.testing.assert_array_equal(run.channels["motor"].samples, np.arange(len(run)) * 4 + 1)


def test_what_waits_is_bounded_and_kept_in_order() -> None:
    waiting = BlockQueue(100)
    blocks = [Block(first_tick=64 * k, samples=np.zeros((64, 1), np.int16), host_time=0.0) for k in range(3)]
    assert [waiting.put(block, 0.01) for block in blocks] == [True, True, False]
    assert [block.first_tick for block in waiting.get_all(0.01) or ()] == [0, 64]
    assert waiting.put(blocks[2], 0.01)
    waiting.end()
    assert [block.first_tick for block in waiting.get_all(10.0) or ()] == [128]
    assert waiting.get_all(10.0) is None
