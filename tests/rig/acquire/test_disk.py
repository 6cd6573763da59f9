"""Disks that are full, files that are taken away: told in a sentence, and what was measured is kept."""

from __future__ import annotations

import resource
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ramps import CHANNELS, Watcher, acquire, plan_of, ramp_instrument, small_disk, ticks_of
from test_crash import PLAN

from isorig.analysis.campaign import Run
from isorig.drivers.block import Block, Input
from isorig.rig.acquire import journal
from isorig.rig.acquire.journal import Journal
from isorig.rig.acquire.recorder import RunWriter, recording_into, working_file
from isorig.rig.acquire.recover import working
from isorig.rig.errors import OutputError, RecordingError
from isorig.rig.files.recording import read


def all_as_sent(run: Run) -> bool:
    ticks = ticks_of(run)
    return all(np.array_equal(run.channels[name].samples[:], ticks * 4 + k) for k, name in enumerate(CHANNELS))


def rig(*arguments: object, limit: int | None = None) -> subprocess.CompletedProcess[str]:
    def limited() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    call = [sys.executable, "-m", "isorig", *map(str, arguments)]
    return subprocess.run(call, capture_output=True, text=True, timeout=60, check=False, preexec_fn=limited)


@pytest.mark.parametrize("limit", [100_000, 200_000, 400_000])
def test_a_limit_on_the_size_of_files_ends_the_session_in_a_sentence(tmp_path: Path, limit: int) -> None:
    (tmp_path / "plan.toml").write_text(PLAN)
    output = tmp_path / "c.h5"
    with ramp_instrument(rows=256) as (port, _):
        ended = rig("acquire", tmp_path / "plan.toml", "--port", port, "--force", "--yes", "-o", output, limit=limit)
    assert ended.returncode == 2, ended.stderr
    assert "Traceback" not in ended.stderr
    assert "File too large" in ended.stderr
    # Where the recording does not fit either the working file stays.
    partial = working_file(output)
    if partial.exists():
        refused = rig("recover", partial, "-o", tmp_path / "no.h5", limit=1000)
        assert (refused.returncode, refused.stderr.count("\n")) == (2, 1), refused.stderr
        assert "File too large" in refused.stderr
        assert not (tmp_path / "no.h5").exists()
        assert rig("recover", partial, "-o", output).returncode == 0
    runs = read(output).runs
    assert len(runs[0]) == 1024
    assert sum(len(run) for run in runs) * 16 > 0.5 * limit
    assert all(all_as_sent(run) for run in runs)


def test_a_recording_onto_a_full_disk_is_refused_in_a_sentence(tmp_path: Path) -> None:
    disk = small_disk(tmp_path, "64k")
    partial = tmp_path / "c.partial"
    measured(partial, 40_000)
    call = f"{sys.executable} -m isorig recover {partial} -o {disk.folder}/saved.h5; echo status $?; ls -A {disk.folder}"
    ended = disk.run(call)
    assert ended.stdout.splitlines() == ["status 2"]
    assert "No space left on device" in ended.stderr
    assert ended.stderr.count("\n") == 1


def measured(path: Path, ticks: int, *, rows: int = 1000) -> None:
    plan, inputs = plan_of({"id": "a"}), [Input(unit="V", per_count=1.0, full_scale=None, dtype="int32")] * 4
    with recording_into(path, plan, inputs) as file:
        writer = RunWriter(file, "a", period=None)
        for first in range(0, ticks, rows):
            values = np.arange(first, first + rows, dtype=np.int32)[:, None] * 4 + np.arange(4, dtype=np.int32)
            writer.put(Block(first_tick=first, samples=values, host_time=first / 1024.0))
        writer.finish(None)


def test_another_program_that_fills_the_disk_ends_the_session_and_costs_nothing(tmp_path: Path) -> None:
    disk = small_disk(tmp_path, "48m")
    (tmp_path / "plan.toml").write_text(PLAN)
    with ramp_instrument(rows=256, speed=400.0) as (port, _):
        call = f"{sys.executable} -m isorig acquire {tmp_path}/plan.toml --port {port} --force --yes -o {disk.folder}/c.h5"
        begun = f"[ $(stat -c %s {disk.folder}/c.h5.partial || echo 0) -gt 300000 ]"
        fill = f"(until {begun}; do sleep 0.05; done; head -c 100m /dev/zero > {disk.folder}/other) 2>/dev/null &"
        save = f"{sys.executable} -m isorig recover {disk.folder}/c.h5.partial -o {tmp_path}/saved.h5"
        script = f"{fill} {call}; echo status $?; {save}"
        ended = disk.run(script)
    assert "status 2" in ended.stdout, ended.stderr
    assert "Traceback" not in ended.stderr
    assert "the measured data are in" in ended.stderr
    runs = read(tmp_path / "saved.h5").runs
    assert len(runs[1]) > 10_000
    assert all(all_as_sent(run) for run in runs)


@pytest.mark.parametrize("other", [False, True])
def test_a_working_file_that_is_taken_away_is_put_back(tmp_path: Path, other: bool) -> None:
    output, watcher = tmp_path / "c.h5", Watcher()

    def take_away(live: object) -> None:
        watcher.seen.append(live)  # type: ignore[arg-type]
        if len(watcher.seen) == 3:
            if other:  # at once: what is written after the file is put back would be written into it
                (tmp_path / "other").write_text("somebody else's")
                (tmp_path / "other").replace(working_file(output))
            else:
                working_file(output).unlink()

    operator = type(watcher.operator)(lock=watcher.locks.append, watch=take_away, taken=watcher.runs.append)
    with (
        ramp_instrument(speed=4.0, rows=16) as (port, _),
        pytest.raises(
            RecordingError if other else OutputError, match="is not a session's working file" if other else "removed by another"
        ),
    ):
        acquire(plan_of({"id": "a", "seconds": 60.0}), port, output, operator, force=True)
    if not other:
        assert len(read(output).runs[0]) > 1024
        assert all_as_sent(read(output).runs[0])
        return
    assert working_file(output).read_text() == "somebody else's"
    with working(working_file(output).with_name("c.h5.partial.saved")) as (_, found):
        assert found[0].stored > 1024
        assert all_as_sent(found[0].run)


def test_a_failed_sync_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: Journal) -> None:
        if self._number > 10:
            raise OSError(5, "Input/output error")

    monkeypatch.setattr(Journal, "sync", fail)
    with ramp_instrument(speed=8.0, rows=16) as (port, _), pytest.raises(OutputError, match="Input/output error"):
        acquire(plan_of({"id": "a", "seconds": 60.0}), port, tmp_path / "c.h5", Watcher().operator, force=True, sync=0.1)
    assert all_as_sent(read(tmp_path / "c.h5").runs[0])


def test_syncs_come_as_often_as_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Whatever time the host takes: it waits as long as asked, and after each wait it syncs what was appended since the last sync.
    happened: list[str] = []
    waits: list[float | None] = []
    append, sync = Journal.append, Journal.sync

    class Waited(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            waits.append(timeout)
            closing = super().wait(timeout)
            happened.append("closing" if closing else "waited")
            return closing

    def appended(self: Journal, *content: Any) -> None:
        append(self, *content)
        happened.append("append")

    def synced(self: Journal) -> None:
        happened.append("sync")
        sync(self)
        happened.append("sync")

    monkeypatch.setattr(Journal, "append", appended)
    monkeypatch.setattr(Journal, "sync", synced)
    monkeypatch.setattr(journal, "threading", SimpleNamespace(**{**vars(threading), "Event": Waited}))
    with ramp_instrument(speed=1.0, rows=16) as (port, _):
        acquire(plan_of({"id": "a", "seconds": 2.0}), port, tmp_path / "c.h5", Watcher().operator, force=True, sync=0.2)
    assert set(waits) == {0.2}
    assert {"append", "sync", "waited"} <= set(happened)
    unsynced = overdue = False
    for event in happened:
        if event == "append":
            unsynced = True
        elif event == "sync":
            unsynced = overdue = False
        else:
            assert not overdue
            overdue = unsynced


PEAK = """
import resource, sys
from pathlib import Path
from isorig.rig.acquire.store import keep_recovered
keep_recovered(Path(sys.argv[1]), Path(sys.argv[2]))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def test_the_recording_is_made_in_memory_that_does_not_grow(tmp_path: Path) -> None:
    peaks = []
    for seconds in (1, 40):
        partial = tmp_path / f"{seconds}.partial"
        measured(partial, seconds * 51_200, rows=5120)
        told = subprocess.run(
            [sys.executable, "-c", PEAK, str(partial), str(tmp_path / f"{seconds}.h5")],
            capture_output=True,
            text=True,
            check=True,
        )
        peaks.append(int(told.stdout) / 1024.0)
    size = partial.stat().st_size / 2**20
    assert size > 30.0
    assert peaks[1] - peaks[0] < 8.0, (peaks, size)
    assert len(read(tmp_path / "40.h5").runs[0]) == 40 * 51_200
    assert (tmp_path / "40.h5").stat().st_size < 1.1 * partial.stat().st_size
