"""Memory does not grow with the length of a session: neither while it records nor while it is made a recording."""

from __future__ import annotations

import threading
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from ramps import Watcher

from isorig.drivers.block import Block, Input
from isorig.rig.acquire.measure_run import measure_run
from isorig.rig.acquire.plan import Plan, plan_of
from isorig.rig.acquire.policy import SESSION_WAITS
from isorig.rig.acquire.recorder import RunWriter, recording_into, working_file
from isorig.rig.acquire.remarks import Remarks
from isorig.rig.acquire.store import keep_session

RATE, INPUTS, ROWS = 51200.0, 8, 512


class Ramps:
    """A stream that sends as fast as it is read, and measures what the program has allocated."""

    identity = "virtual ramps"
    inputs = (Input(unit="V", per_count=1.0, full_scale=None, dtype="int32"),) * INPUTS

    def __init__(self, ticks: int) -> None:
        self._ticks, self._next = ticks, 0
        self.allocated: list[int] = []

    def prepare(self, *, sample_rate: float, channels: object) -> float:
        return sample_rate

    def start(self) -> None:
        self._next = 0

    def read(self, timeout: float) -> Block | None:
        if self._next >= self._ticks:
            return None
        first, self._next = self._next, self._next + ROWS
        if first % (64 * ROWS) == 0:
            self.allocated.append(tracemalloc.get_traced_memory()[0])
        return Block(first_tick=first, samples=np.full((ROWS, INPUTS), first, np.int32), host_time=first / RATE, gain=1.0)

    def stop(self) -> int:
        return self._ticks

    def close(self) -> None:
        """Nothing to close."""


def plan(seconds: float, repeats: int = 1) -> Plan:
    return plan_of({
        "instrument": {"kind": "framed", "port": "-", "sample_rate": RATE},
        "channels": {f"c{k}": {"input": k, "sensitivity": 1.0} for k in range(INPUTS)},
        "runs": [{
            "id": "a", "configuration": "unlocked", "gain": 1.0, "excitation": "other", "seconds": seconds, "repeats": repeats,
        }],
    })  # fmt: skip


def test_a_long_run_needs_a_fraction_of_its_samples_in_memory(tmp_path: Path) -> None:
    planned = plan(120.0)
    stream = Ramps(round(120.0 * RATE))
    path = working_file(tmp_path / "c.h5")
    with recording_into(path, planned, stream.inputs, real_time=False) as file:
        tracemalloc.start()
        try:
            (run,) = planned.runs
            measure_run(stream, file, planned, run, 0, Watcher().operator, Remarks(RATE))
        finally:
            tracemalloc.stop()
    # The samples are 197 MB. The queue, what the writer took from it, a copy of that, and what the display sums up in a quarter
    # of a second may be in memory.
    queue = SESSION_WAITS.queue * RATE * INPUTS * 4
    assert max(stream.allocated) < 10.0 * queue


@contextmanager
def highest() -> Iterator[list[float]]:
    """The largest anonymous memory of this process while this lasts, MiB; the first value is that before."""

    def now() -> float:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) / 1024.0 for line in lines if line.startswith("RssAnon:"))

    seen, over = [now()], threading.Event()

    def look() -> None:
        while not over.wait(0.01):
            seen.append(now())

    thread = threading.Thread(target=look)
    thread.start()
    try:
        yield seen
    finally:
        over.set()
        thread.join()


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the system has no /proc")
def test_a_session_is_made_a_recording_without_all_of_it_in_memory(tmp_path: Path) -> None:
    def keep(name: str, repeats: int) -> float:
        planned, stream = plan(4.0, repeats), Ramps(round(4.0 * RATE))
        path = working_file(tmp_path / name)
        with recording_into(path, planned, stream.inputs, real_time=False) as file:
            for run in planned.runs[0].ids():
                writer = RunWriter(file, run, period=None)
                stream.start()
                while (block := stream.read(0.1)) is not None:
                    writer.put(block)
                writer.finish(None)
        with highest() as seen:
            keep_session(path, tmp_path / name, add=False)
        return max(seen) - seen[0]

    keep("few.h5", 2)
    # 105 MB of samples.
    assert keep("many.h5", 16) < 32.0
