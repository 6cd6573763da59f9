"""A fleet kept up to date by real processes, whatever happens to them."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import dask
import numpy as np
import pandas as pd
import psutil
import pytest
from recorded import TAKES, drawn_rig
from some_findings import findings, named, value

from isorig.analysis import deadline
from isorig.analysis.diagnose import diagnosis
from isorig.analysis.diagnose.diagnosis import KEPT, diagnose
from isorig.rig.cli import main
from isorig.rig.diagnose.many import program_version
from isorig.rig.errors import RigError
from isorig.rig.files import inputs
from isorig.rig.files.findings import write_findings
from isorig.rig.files.recording import write
from isorig.rig.fleet import job as answering
from isorig.rig.fleet.catalogue import Catalogue, StoredAnswer
from isorig.rig.fleet.job import DiagnosisJob, answer_job, from_findings
from isorig.rig.fleet.recordings import recordings_under
from isorig.rig.fleet.update import work_of
from isorig.rig.wire_bonder.session import virtual_campaign

RIG = [sys.executable, "-m", "isorig", "fleet"]
LIMIT = 250.0


def fleet(*words: object) -> int:
    return main(["fleet", *map(str, words)])


def started(*words: object) -> subprocess.Popen[str]:
    return subprocess.Popen([*RIG, *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def stamps_of(folder: Path) -> dict[str, int]:
    return {str(f.relative_to(folder)): f.stat().st_mtime_ns for f in sorted(folder.rglob("*")) if f.is_file()}


def answers(catalogue: Path) -> pd.DataFrame:
    return Catalogue(catalogue).answers().drop_duplicates(["content", "version"])


def test_every_recording_once(tmp_path: Path, measured: Path, pool: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    store = tmp_path / "fleet"
    torn = measured / "rig-b" / "torn.h5"
    torn.write_bytes(pool[4].read_bytes()[:5000])
    (measured / "rig-a" / "again.h5").write_bytes(pool[0].read_bytes())
    (measured / ".hidden.h5").write_bytes(b"")
    assert fleet("add", measured, "-c", store) == 0
    assert "6 recordings of 2 rigs" in capsys.readouterr().out
    assert fleet("update", "-c", store) == 2  # the torn one, after all others were done
    said = capsys.readouterr()
    assert "1 of 5 recordings gave no answer" in said.err
    assert "is the same recording as" in said.out
    found = answers(store)
    assert sorted(zip(found.rig, found.campaign, found.verdict, strict=True)) == [
        ("rig-a", "again", "adequate"), ("rig-a", "w2", "adequate"), ("rig-b", "torn", "refused"), ("rig-b", "w1", "adequate"),
        ("rig-b", "w2", "adequate"),
    ]  # fmt: skip

    # What is done is not done again, by whatever name and time of modification; the rest is put right.
    before = stamps_of(store)
    assert fleet("update", "-c", store) == 0
    assert stamps_of(store) == before
    assert "5 recordings had an answer, 0 were processed now" in capsys.readouterr().out
    diagnosed = stamps_of(store / "diagnoses")
    (measured / "rig-c").mkdir()
    (measured / "rig-b" / "w2.h5").rename(measured / "rig-c" / "w9.h5")
    (measured / "rig-a" / "again.h5").unlink()
    os.utime(measured / "rig-a" / "w2.h5")
    assert fleet("update", "-c", store) == 0
    assert stamps_of(store / "diagnoses") == diagnosed
    found = answers(store)
    assert {"rig-a w1", "rig-a w2", "rig-b w1", "rig-c w9"} <= set(found.rig + " " + found.campaign)

    # A damaged recording that was copied again counts no more.
    torn.write_bytes(pool[4].read_bytes())
    assert fleet("update", "-c", store) == 0
    found = answers(store)
    assert sorted(found[found.campaign == "torn"].verdict) == ["adequate", "superseded"]
    assert sorted(pd.read_parquet(store / "answers").parameter.unique())[0] == ""


def test_interrupted_at_any_time(tmp_path: Path, measured: Path) -> None:
    store = tmp_path / "fleet"
    shutil.rmtree(measured / "rig-b")
    # One that takes longer: it is being diagnosed when the other one has its answer.
    write(measured / "rig-a" / "w2.h5", virtual_campaign(drawn_rig(np.random.default_rng(0)), TAKES[1::2], seed=0))
    assert fleet("add", measured, "-c", store) == 0
    with started("update", "-c", store) as running:
        assert running.stdout is not None
        assert "adequate" in running.stdout.readline()
        running.kill()
    done = stamps_of(store / "answers")
    assert done
    assert all(Path(name).suffix == ".parquet" for name in done)
    assert fleet("update", "-c", store) == 0
    assert len(answers(store)) == 2
    assert done.items() <= stamps_of(store / "answers").items()


@pytest.mark.study
def test_two_at_once_share_the_work(tmp_path: Path, measured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = tmp_path / "fleet"
    assert fleet("add", measured, "-c", store) == 0
    pair = [started("update", "-c", store) for _ in range(2)]
    said = [process.communicate(timeout=LIMIT) for process in pair]
    assert [process.returncode for process in pair] == [0, 0], said
    lines = [line for out, _ in said for line in out.splitlines() if line.endswith("adequate")]
    assert len(answers(store)) == 4
    # One that the other has just finished when it is looked at is read, not diagnosed, and so may be told by both.
    assert sorted(set(lines)) == ["rig-a w1: adequate", "rig-a w2: adequate", "rig-b w1: adequate", "rig-b w2: adequate"]
    assert fleet("update", "-c", store) == 0
    assert "4 recordings had an answer, 0 were processed now" in capsys.readouterr().out


def test_a_recording_that_another_works_on_is_left_to_it(tmp_path: Path, measured: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Catalogue(tmp_path / "fleet")
    store.add_folder(measured / "rig-a", None)
    job = work_of(store, "coulomb").jobs[0]
    begun, go_on, calls = threading.Event(), threading.Event(), []
    whole = answering.diagnose_file

    def slow(*words: object, **more: object) -> object:
        calls.append(words)
        begun.set()
        assert go_on.wait(LIMIT)
        return whole(*words, **more)

    monkeypatch.setattr(answering, "diagnose_file", slow)
    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(answer_job, job)
        assert begun.wait(LIMIT)
        assert answer_job(job) is None
        go_on.set()
        told = first.result(LIMIT)
    assert told is not None
    assert told.verdict == "adequate"
    assert answer_job(job) == told  # read, not diagnosed
    assert len(calls) == 1
    assert len(work_of(store, "coulomb").jobs) == 1
    assert len(work_of(store, "linear").jobs) == 2
    monkeypatch.setattr("isorig.rig.fleet.update.program_version", lambda: "9.9")
    assert len(work_of(store, "coulomb").jobs) == 2  # another version answers anew


def test_a_copy_that_arrives_does_not_take_the_place_of_its_original(tmp_path: Path, measured: Path) -> None:
    store = Catalogue(tmp_path / "fleet")
    original, copy = measured / "rig-a" / "w1.h5", measured / "rig-b" / "copy.h5"
    content = hashlib.sha256(original.read_bytes()).hexdigest()
    stat = original.stat()
    store.put(
        StoredAnswer(
            rig="rig-a", campaign="w1", content=content, version=program_version(), baseline="coulomb", path=str(original),
            size=stat.st_size, modified=stat.st_mtime_ns, verdict="adequate",
        )
    )  # fmt: skip
    copy.write_bytes(original.read_bytes())
    arrived = [r for r in recordings_under({measured / "rig-b": None}) if r.path == str(copy)]
    work = work_of(store, "coulomb", only=arrived)
    assert work.jobs == ()
    assert work.notes == (f"{copy} is the same recording as {original}, which is used; remove one of them",)
    original.unlink()
    assert work_of(store, "coulomb", only=arrived).notes == ()
    assert store.answers()[["rig", "campaign", "path"]].to_numpy().tolist() == [["rig-b", "copy", str(copy)]]


class Cluster:
    """A Dask scheduler and its workers, each a process of its own on this machine."""

    def __init__(self, folder: Path) -> None:
        file, self._log = folder / "scheduler.json", (folder / "dask.log").open("w")
        self.processes = [self._run("distributed.cli.dask_scheduler", "--port", "0", "--scheduler-file", file)]
        self.file = file
        for _ in range(2):
            words = ("--scheduler-file", file, "--death-timeout", "60", "--no-nanny", "--nthreads", "1")
            self.processes.append(self._run("distributed.cli.dask_worker", *words))

    def _run(self, module: str, *words: object) -> subprocess.Popen[bytes]:
        call = [sys.executable, "-m", module, "--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0", *map(str, words)]
        return subprocess.Popen(call, stdout=self._log, stderr=self._log)

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        # The scheduler ends its workers; one that gets a signal of its own meanwhile may hang.
        self.processes[0].terminate()
        for process in self.processes:
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.kill()
        self._log.close()


@pytest.mark.study
def test_two_workers_give_the_same_bytes_though_one_is_killed(tmp_path: Path, measured: Path) -> None:
    alone, shared = tmp_path / "alone", tmp_path / "shared"
    for store in (alone, shared):
        assert fleet("add", measured, "-c", store) == 0
    assert fleet("update", "-c", alone) == 0
    with Cluster(tmp_path) as cluster:
        with started("update", "-c", shared, "--scheduler", cluster.file) as running:
            assert running.stdout is not None
            assert "adequate" in running.stdout.readline()
            cluster.processes[1].send_signal(signal.SIGKILL)
            rest = running.stdout.read()
            assert running.wait(LIMIT) == 0, running.stderr and running.stderr.read()
        listening = {
            c.laddr.ip
            for p in cluster.processes
            if p.poll() is None
            for c in psutil.Process(p.pid).net_connections()
            if c.status == psutil.CONN_LISTEN
        }
    assert listening == {"127.0.0.1"}
    assert "4 were processed now" in rest
    assert files_of(shared) == files_of(alone)


@pytest.mark.skipif(shutil.which("unshare") is None, reason="no unshare on this machine")
@pytest.mark.study
def test_a_full_disk_loses_nothing(tmp_path: Path, measured: Path) -> None:
    """The catalogue is on a file system of its own that is full after an answer or two, and then gets more room."""
    store = tmp_path / "fleet"
    store.mkdir()
    rig = " ".join(RIG)
    script = f"""
        mount -t tmpfs -o size=48k none {store} || exit 77
        {rig} add {measured} -c {store}
        {rig} update -c {store}
        echo "status $?"
        find {store}/answers -name '*.parquet' | wc -l
        find {store} -name '.*' -type f -not -name '*.lock' | wc -l
        mount -o remount,size=10m {store}
        {rig} update -c {store} && {rig} update -c {store}
        find {store}/answers -name '*.parquet' | wc -l
        find {store} -name '.*' -type f | wc -l
    """
    done = subprocess.run(["unshare", "-rm", "bash", "-c", script], capture_output=True, text=True, timeout=LIMIT, check=False)
    if done.returncode == 77 or "unshare:" in done.stderr:
        pytest.skip(f"no file system of its own may be mounted here: {done.stderr.strip()}")
    assert "status 2" in done.stdout, done.stdout + done.stderr
    assert re.search(r"rig: .*(No space left|could not be written|cannot be written)", done.stderr), done.stderr
    assert "Traceback" not in done.stderr
    lines = done.stdout.split("status 2\n")[1].splitlines()
    assert 0 <= int(lines[0]) < 4
    assert lines[1] == "0"  # no half file; the lock of a process that was ended holds nobody up
    assert lines[-3].endswith("4 recordings had an answer, 0 were processed now")
    assert lines[-2:] == ["4", "0"]


def test_values_without_a_fit_are_not_followed(tmp_path: Path, measured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = tmp_path / "fleet"
    shutil.rmtree(measured / "rig-b")
    assert fleet("add", measured, "-c", store) == 0
    assert fleet("update", "-c", store, "--seconds", 1e-6) == 0
    assert "the time limit of 1e-06 s ended the search" in capsys.readouterr().out
    assert set(Catalogue(store).answers().parameter) == {"time_limit"}
    assert fleet("update", "-c", store, "--seconds", 1e-6) == 0  # it would take as long again
    assert "0 were processed now" in capsys.readouterr().out
    assert fleet("update", "-c", store, "--seconds", 100) == 0
    assert list(answers(store).verdict) == ["adequate"] * 2


def test_a_search_cut_short_is_reported_and_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    store = tmp_path / "fleet"
    short = [replace(take, seconds=5.0) for take in TAKES[1::2]]
    write(tmp_path / "rig-a" / "w1.h5", virtual_campaign(drawn_rig(np.random.default_rng(0)), short, seed=0))
    assert fleet("add", tmp_path / "rig-a", "-c", store) == 0
    # A clock that goes on by a second with each stage, of which preparing is one: at 1.5 s the baseline is fitted and no
    # cause was looked for yet.
    early, later = (1.0 + (end - 1.0) / (1.0 - KEPT) for end in (1.5, 1.7))
    stages: list[str] = []
    monkeypatch.setattr(deadline, "time", SimpleNamespace(process_time=lambda: float(len(stages))))
    monkeypatch.setattr(
        diagnosis, "diagnose", lambda *given, progress, **options: diagnose(*given, progress=stages.append, **options)
    )
    told = "rig-a w1: unexplained; the time limit of {:g} s ended the search for causes before all were tried"
    assert fleet("update", "-c", store, "--baseline", "linear", "--seconds", early) == 0
    assert told.format(early) in capsys.readouterr().out
    found = Catalogue(store).answers()
    assert {"links.isolation.stiffness", "time_limit"} < set(found.parameter)
    assert fleet("update", "-c", store, "--baseline", "linear", "--seconds", early) == 0
    assert "0 were processed now" in capsys.readouterr().out  # it would come as far again
    assert fleet("update", "-c", store, "--baseline", "linear", "--seconds", later) == 0
    assert told.format(later) in capsys.readouterr().out


def test_a_form_and_its_kind_are_alike(tmp_path: Path) -> None:
    """A campaign that names the kind of a thing and one that names its form tell of no new cause."""
    form = named(cause="clipping", kind="sensor", form="clipping", location="motor", parameters={})
    kind = named(cause="friction_shape", kind="friction_shape", form=None, level="kind", location="isolation", parameters={})
    before = {"links.a.stiffness": value(90.0), "contacts.a.law.friction_force": value(3.0)}
    after = {"links.a.stiffness": value(100.0), "links.a.laws.0.stroke": value(0.1)}
    write_findings(
        tmp_path,
        findings(steps=[form, kind], baseline={"name": "linear", "parameters": before}, extended={"parameters": after}),
    )
    (tmp_path / "baseline.json").write_text("{}")
    blank = StoredAnswer(
        rig="a", campaign="b", content="0" * 64, version="1", baseline="linear", path="", size=1, modified=1, verdict=""
    )  # fmt: skip
    answer = from_findings(tmp_path, blank)
    assert answer.cause == "clipping at motor + friction_shape at isolation"
    # The values are those of the model with the causes, as far as the baseline has them.
    assert [(one.name, one.value) for one in answer.parameters] == [("links.a.stiffness", 100.0)]
    assert set(answer.alike.split(" + ")) == {
        "sensor at motor", "coulomb_friction at isolation", "stribeck_friction at isolation", "asymmetric_friction at isolation"
    }  # fmt: skip


def test_a_worker_of_another_version_is_refused(tmp_path: Path, pool: list[Path]) -> None:
    blank = StoredAnswer(
        rig="a",
        campaign="b",
        content="0" * 64,
        version="0.0.0",
        baseline="coulomb",
        path=str(pool[0]),
        size=1,
        modified=1,
        verdict="",
    )
    with pytest.raises(RigError, match=r"not 0\.0\.0; install the same"):
        answer_job(DiagnosisJob(catalogue=str(tmp_path), answer=blank))


def test_a_program_that_fails_on_one_recording_goes_on(
    tmp_path: Path, measured: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    store = tmp_path / "fleet"
    shutil.rmtree(measured / "rig-b")
    whole = answering.diagnose_file

    def failing(file: Path, *rest: object, **more: object) -> object:
        if file.stem == "w1":
            raise ZeroDivisionError("float division by zero")
        return whole(file, *rest, **more)

    monkeypatch.setattr(answering, "diagnose_file", failing)
    assert fleet("add", measured, "-c", store) == 0
    assert fleet("update", "-c", store) == 2
    assert "the program failed (ZeroDivisionError: float division by zero)" in capsys.readouterr().err
    assert sorted(answers(store).verdict) == ["adequate", "failed"]
    monkeypatch.undo()
    assert fleet("update", "-c", store) == 0
    assert "failed" in list(answers(store).verdict)  # the same program would fail again
    assert fleet("update", "-c", store, "--again") == 0
    assert list(answers(store).verdict) == ["adequate", "adequate"]


def test_recordings_are_taken_as_they_come(tmp_path: Path, pool: list[Path]) -> None:
    store, folder = tmp_path / "fleet", tmp_path / "measured" / "rig-z"
    folder.mkdir(parents=True)
    with started("watch", folder.parent, "-c", store, "--every", 0.3) as running:
        assert running.stdout is not None
        assert "0 recordings" in running.stdout.readline()
        content = pool[5].read_bytes()
        with (folder / "w1.h5").open("wb") as copy:
            for k in range(4):  # a slow copy
                copy.write(content[k * len(content) // 4 : (k + 1) * len(content) // 4])
                copy.flush()
                time.sleep(0.2)
        assert running.stdout.readline() == "rig-z w1: adequate\n"
        running.send_signal(signal.SIGINT)
        assert running.wait(LIMIT) == 130
    assert list(answers(store).verdict) == ["adequate"]


def test_unusable_recordings_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, says in (
        (["update"], "is not a fleet's catalogue"),
        (["show"], "is not a fleet's catalogue"),
        (["add"], "no folder was given"),
        (["add", str(tmp_path / "nowhere")], "is not a folder"),
        (["watch", str(tmp_path), "--every", "0"], "give a positive time"),
        (["update", "--seconds", "-1"], "--seconds is -1; give a positive time"),
    ):
        assert fleet(*words, "-c", tmp_path / "fleet") == 2
        assert says in capsys.readouterr().err
    assert fleet("add", tmp_path, "-c", tmp_path / "fleet") == 0
    assert fleet("show", "-c", tmp_path / "fleet") == 2
    assert "no campaign was diagnosed with the coulomb baseline yet" in capsys.readouterr().err
    (tmp_path / "a.h5").write_bytes(b"no recording")
    with dask.config.set({"distributed.comm.timeouts.connect": "1s"}):
        assert fleet("update", "-c", tmp_path / "fleet", "--scheduler", "127.0.0.1:9") == 2
    assert "no Dask scheduler answers at 127.0.0.1:9" in capsys.readouterr().err


def test_pipes_and_devices_in_a_folder_are_reported_and_not_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "rig-a"
    folder.mkdir()
    os.mkfifo(folder / "pipe.h5")
    (folder / "endless.h5").symlink_to("/dev/zero")
    (folder / "nowhere.h5").symlink_to("/nowhere")
    (folder / "folder.h5").mkdir()
    (folder / "turns.h5").symlink_to(folder)
    place = str(tmp_path / "catalogue")
    signal.alarm(20)
    try:
        assert main(["fleet", "add", str(folder), "-c", place]) == 0
        assert main(["fleet", "update", "-c", place]) == 0
        assert main(["fleet", "watch", str(folder), "-c", place, "--every", "0.1", "--stop-after", "0.5"]) == 0
    finally:
        signal.alarm(0)
    told = capsys.readouterr().out
    for name in ("pipe", "endless"):
        assert told.count(f"{folder / name}.h5 cannot be read; make it a readable file, not a pipe or a device") == 2, told


def test_a_file_that_becomes_a_pipe_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "x.h5")
    monkeypatch.setattr(inputs, "regular", lambda path: None)
    signal.alarm(20)
    try:
        with pytest.raises(OSError, match="pipe or a device"):
            inputs.opened_regular(tmp_path / "x.h5")
    finally:
        signal.alarm(0)
