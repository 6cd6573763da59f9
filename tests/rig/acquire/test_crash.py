"""Killed, unplugged, out of room, stopped: the file opens and tells what it has."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from plans import plan_text
from ramps import CHANNELS, Watcher, acquire, plan_of, ramp_instrument, small_disk, ticks_of

from isorig.drivers.errors import ConnectionLostError
from isorig.drivers.simulated.commanded import Faults
from isorig.rig.acquire.recorder import working_file
from isorig.rig.acquire.recover import working
from isorig.rig.cli import main
from isorig.rig.errors import OutputError
from isorig.rig.files.recording import read

KILLS = 24
RUNS = plan_of({"id": "a", "seconds": 1.0}, {"id": "b", "seconds": 60.0})
START = multiprocessing.get_context("forkserver")


def measure(port: str, output: Path) -> None:
    acquire(RUNS, port, output, Watcher().operator, force=True)


def waited(pid: int) -> float:
    """Seconds that a process's threads were ready to run and had no processor: on a busy machine that is no loss of ours."""
    seconds = 0.0
    for task in Path("/proc").glob(f"{pid}/task/*/schedstat"):
        # A thread may end meanwhile.
        with suppress(OSError):
            seconds += int(task.read_text().split()[1]) / 1e9
    return seconds


def lost_by_a_kill(output: Path, after: float) -> float:
    """Kill a session so many seconds after its first sample; the seconds of signal that the instrument took and nobody has.

    Some frames do not arrive.
    """
    with ramp_instrument(Faults(drop=0.02, seed=round(1e6 * after)), speed=1.0, rows=16) as (port, instrument):
        process = START.Process(target=measure, args=(port, output))
        process.start()
        assert process.pid is not None
        wait_for(lambda: instrument.sent > 0)
        time.sleep(max(after - 0.5, 0.0))
        before = waited(process.pid)
        time.sleep(min(after, 0.5))
        starved = max(waited(process.pid) - before, 0.0)
        run, ticks = instrument.runs, instrument.sent
        os.kill(process.pid, signal.SIGKILL)
        process.join()
    with working(working_file(output)) as (_, found):
        by_id = {item.id: item for item in found}
        for item in found:
            for k, name in enumerate(CHANNELS if item.run is not None else ()):
                np.testing.assert_array_equal(item.run.channels[name].samples[:], ticks_of(item.run) * 4 + k)
        # What the instrument had taken of the run that it was in, against what is saved of that run.
        current = by_id["a" if run == 1 else "b"]
        assert run == 1 or by_id["a"].finished
        return (ticks - current.stored - current.lost) / 1024.0 - starved


@pytest.mark.parametrize("kills", [KILLS, pytest.param(100, marks=pytest.mark.study)])
def test_a_killed_writer_loses_a_quarter_of_a_second_at_most(tmp_path: Path, kills: int) -> None:
    START.set_forkserver_preload(["isorig.rig.acquire.session", "ramps"])
    afters = np.random.default_rng(kills).uniform(0.0, 1.5, kills)
    # As many at a time as there are processors: the instruments share this process, and a late one counts samples as lost.
    with ThreadPoolExecutor(2) as pool:
        lost = list(pool.map(lost_by_a_kill, [tmp_path / f"{kill}.h5" for kill in range(kills)], afters))
    print(f"{kills} kills, at most {max(lost):.2f} s lost")
    assert max(lost) <= 0.25, lost


def test_recover_says_what_was_saved_and_resume_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "campaign.h5"
    with ramp_instrument(speed=20.0) as (port, instrument):
        process = START.Process(target=measure, args=(port, output))
        process.start()
        wait_for(lambda: instrument.sent > 20_000)
        assert process.pid is not None
        os.kill(process.pid, signal.SIGKILL)
        process.join()
    partial = working_file(output)
    assert main(["recover", str(partial), "-o", str(tmp_path / "saved.h5")]) == 0
    told = capsys.readouterr().out
    assert "a: complete, 1024 samples saved, none lost." in told
    saved = read(tmp_path / "saved.h5")
    assert f"b: incomplete, {len(saved.runs[1])} of 61440 samples saved, none lost." in told
    watcher = Watcher()
    with ramp_instrument() as (port, _):
        with pytest.raises(OutputError, match="--resume"):
            acquire(RUNS, port, output, watcher.operator)
        acquire(RUNS, port, output, watcher.operator, resume=True, force=True)
    assert [taken.id for taken in watcher.runs] == ["b"]
    assert [len(run) for run in read(output).runs] == [1024, 61440]
    assert not partial.exists()


def test_an_unplugged_instrument_leaves_what_it_gave(tmp_path: Path) -> None:
    output, watcher = tmp_path / "c.h5", Watcher()
    plan = plan_of({"id": "a", "seconds": 8.0})
    with ramp_instrument(Faults(unplug_after=3.0)) as (port, _), pytest.raises(ConnectionLostError, match="resume"):
        acquire(plan, port, output, watcher.operator, force=True)
    run = read(output).runs[0]
    assert 0 < len(run) <= 3 * 1024
    np.testing.assert_array_equal(run.channels["motor"].samples, ticks_of(run) * 4 + 1)
    with ramp_instrument() as (port, _):
        acquire(plan, port, output, watcher.operator, resume=True, force=True)
    assert len(read(output).runs[0]) == 8 * 1024


def test_ctrl_c_stops_the_drive_and_keeps_the_run(tmp_path: Path) -> None:
    output, watcher = tmp_path / "c.h5", Watcher()

    def stop(live: object) -> None:
        watcher.seen.append(live)  # type: ignore[arg-type]
        raise KeyboardInterrupt

    operator = type(watcher.operator)(lock=watcher.locks.append, watch=stop, taken=watcher.runs.append)
    with ramp_instrument(speed=8.0) as (port, instrument):
        with pytest.raises(KeyboardInterrupt):
            acquire(plan_of({"id": "a", "seconds": 60.0}), port, output, operator, force=True)
        wait_for(lambda: not instrument.running)
    assert 0 < len(read(output).runs[0]) < 60 * 1024


def test_a_full_disk_is_said_in_a_sentence_and_what_fitted_is_kept(tmp_path: Path) -> None:
    disk = small_disk(tmp_path, "24m")
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    with ramp_instrument(rows=1024) as (port, _):
        call = f"{sys.executable} -m isorig acquire {plan} --port {port} --force --yes -o {disk.folder}/c.h5"
        save = f"{sys.executable} -m isorig recover {disk.folder}/c.h5.partial -o {tmp_path}/saved.h5"
        script = f"{call}; echo status $?; {save}"
        ended = disk.run(script)
    assert "status 2" in ended.stdout
    assert "the disk is nearly full: the measured data are in" in ended.stderr
    assert "Traceback" not in ended.stderr
    saved = read(tmp_path / "saved.h5")
    assert [run.id for run in saved.runs] == ["a", "b"]
    assert len(saved.runs[0]) == 1024
    np.testing.assert_array_equal(saved.runs[1].channels["table"].samples, np.arange(len(saved.runs[1])) * 4 + 2)


PLAN = plan_text({"id": "a", "gain": 1.0, "seconds": 1.0}, {"id": "b", "gain": 1.0, "seconds": 2000.0})


def test_a_session_that_does_not_fit_is_not_begun(tmp_path: Path) -> None:
    plan = plan_of({"id": "a", "seconds": 86400.0, "repeats": 1000}, rate=51200.0)
    with pytest.raises(OutputError, match="MiB free but the session needs"):
        acquire(plan, "nowhere", tmp_path / "c.h5", Watcher().operator)


def wait_for(condition: object) -> None:
    assert callable(condition)
    end = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)
