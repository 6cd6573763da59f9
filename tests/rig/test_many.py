"""Many campaigns at once: what the pool does beside its work."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil

from isorig.analysis.parallel import cores
from isorig.rig.cli import main
from isorig.rig.diagnose.many import diagnose_files, shared_out
from isorig.rig.files.recording import write
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign


def test_work_on_this_computer_opens_no_port(tmp_path: Path) -> None:
    torn = tmp_path / "torn.h5"
    torn.write_bytes(b"no recording")
    outcomes = diagnose_files([(torn, tmp_path / "out")], "coulomb")
    first = next(outcomes)  # the work is under way as long as the answers are not all taken
    assert not [c for c in psutil.Process().net_connections() if c.status == psutil.CONN_LISTEN]
    assert first.verdict == "refused"
    assert list(outcomes) == []
    assert not (tmp_path / "out").exists()


def test_few_jobs_wait_and_the_rest_is_not_begun_when_nobody_takes_the_results() -> None:
    consumed: list[int] = []

    def jobs() -> Iterator[int]:
        for k in range(100):
            consumed.append(k)
            yield k

    results = shared_out(lambda job: 1 // (job - 2), jobs())
    taken = [next(results) for _ in range(4)]
    results.close()
    assert len(consumed) <= 3 + cores()
    assert {job: type(result) for job, result in taken if job == 2} in ({}, {2: ZeroDivisionError})
    assert all(result == 1 // (job - 2) for job, result in taken if job != 2)


def test_every_result_arrives_with_its_job() -> None:
    found = dict(shared_out(lambda job: job**2, range(50)))
    assert found == {k: k**2 for k in range(50)}
    assert list(shared_out(lambda job: job, [])) == []


#: Eight threads of a fresh process read their first model at the same moment.
AT_ONCE = """
import sys, threading
from isorig.analysis.model.rig_model import from_tree, to_tree
from isorig.rig.wire_bonder.description import wire_bonder
sys.setswitchinterval(1e-6)
tree, gate = to_tree(wire_bonder()), threading.Barrier(8)
threads = [threading.Thread(target=lambda: (gate.wait(), from_tree(tree))) for _ in range(8)]
for thread in threads: thread.start()
for thread in threads: thread.join()
"""


def test_threads_may_read_their_first_model_at_once() -> None:
    for _ in range(3):
        subprocess.run([sys.executable, "-c", AT_ONCE], check=True, cwd=Path(__file__).parents[2])


def test_names_must_differ(tmp_path: Path, capsys) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.h5").write_bytes(b"")
    files = [str(tmp_path / folder / "same.h5") for folder in ("a", "b")]
    assert main(["diagnose", *files, "-o", str(tmp_path / "out")]) == 2
    assert "two recordings are named 'same'" in capsys.readouterr().err


def test_empty_folder(tmp_path: Path, capsys) -> None:
    assert main(["diagnose", str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    assert "no recording was given" in capsys.readouterr().err


def test_a_computer_that_sleeps_ends_nothing(tmp_path: Path) -> None:
    """A process that stood still for longer than a worker may be silent goes on."""
    take = VirtualRun(id="u70", configuration="unlocked", gain=70.0, seconds=20.0, start=0.0)
    recordings, out = tmp_path / "recordings", tmp_path / "out"
    recordings.mkdir()
    for k in range(2):
        write(recordings / f"{k}.h5", virtual_campaign(wire_bonder({**THESIS, "friction_force": 10.0}), [take], seed=k))
    command = [sys.executable, "-m", "isorig", "diagnose", str(recordings), "-o", str(out)]
    with subprocess.Popen(command) as running:
        process = psutil.Process(running.pid)
        time.sleep(3.0)
        process.suspend()
        time.sleep(7.0)
        process.resume()
        assert running.wait(timeout=120.0) == 0
    assert all((out / str(k) / "findings.json").exists() for k in range(2))


LATE = """
import logging
from dask.distributed import LocalCluster
from isorig.rig.diagnose.many import shared_out

def late(job):
    # As Dask does for a heartbeat that is late on a busy host.
    try:
        raise TimeoutError
    except TimeoutError:
        logging.getLogger("distributed.worker").exception("Failed to communicate with scheduler during heartbeat.")
    return job

quiet = {"dashboard_address": "127.0.0.1:0", "worker_dashboard_address": "127.0.0.1:0"}
with LocalCluster(processes=False, n_workers=1, threads_per_worker=1, **quiet) as cluster:
    print(sorted(shared_out(late, [1, 2], cluster.scheduler_address)))
"""


def test_what_dask_logs_of_a_late_worker_is_no_traceback() -> None:
    done = subprocess.run([sys.executable, "-c", LATE], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout == "[(1, 1), (2, 2)]\n"
    assert "Traceback" not in done.stderr
