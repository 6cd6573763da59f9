"""Overhead of a fleet beyond its diagnoses, time to query and plot ten thousand answers, and speed-up by a second worker.

`python bench/fleet.py` prints seconds. The part with workers needs an otherwise idle computer; the load is printed next to it.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from dask.distributed import Client

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "rig" / "fleet"))

from made_up import drawn_fleet, write_catalogue
from recorded import drawn_rig, record
from table import Row, keep, options

from isorig.rig.diagnose.many import diagnose_file, shared_out
from isorig.rig.fleet.catalogue import Catalogue, query_answers
from isorig.rig.fleet.history import followed
from isorig.rig.fleet.report import fleet_page
from isorig.rig.fleet.update import update, work_of

#: Number of diagnosed recordings, of rigs and campaigns in the queried catalogue, and of jobs for the workers.
RECORDINGS, RIGS, CAMPAIGNS, JOBS = 8, 200, 50, 16
#: Steps of a job that replaces a diagnosis: about one second.
STEPS = 15_000_000


def timed(function: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> float:
    """Duration of a call, s."""
    begun = clock()
    function()
    return clock() - begun


def overhead(folder: Path) -> list[Row]:
    """Processor time of the fleet, without that of the diagnoses, and of the diagnoses."""
    measured, store = folder / "measured", Catalogue(folder / "fleet")
    draw = np.random.default_rng(1)
    for k in range(RECORDINGS):
        record(measured / "rig" / f"{k}.h5", drawn_rig(draw), k, k)
    files = sorted(measured.rglob("*.h5"))
    diagnose_file(files[0], folder / "warm", "coulomb", page=False)
    alone = timed(lambda: [diagnose_file(f, folder / "alone" / f.stem, "coulomb", page=False) for f in files], time.process_time)
    store.add_folder(measured, None)
    update(store, work_of(store, "coulomb").jobs)
    # Once more with the findings in hand and no answers: all that the fleet does, and no diagnosis.
    shutil.rmtree(store.folder / "answers")
    beside = timed(lambda: update(store, work_of(store, "coulomb").jobs), time.process_time)
    assert store.answers().content.nunique() == RECORDINGS
    done = timed(lambda: work_of(store, "coulomb"), time.process_time)
    print(f"a diagnosis (four runs of ten seconds)        {1e3 * alone / RECORDINGS:8.0f} ms of a processor")
    print(f"the fleet beside it                           {1e3 * beside / RECORDINGS:8.1f} ms, {100 * beside / alone:.1f} %")
    print(f"an update that finds {RECORDINGS} recordings done         {1e3 * done:8.0f} ms")
    return [
        Row(what="the fleet's own work for a campaign", unit="ms", ours=1e3 * beside / RECORDINGS),
        Row(what="a diagnosis of four runs of ten seconds", unit="ms", ours=1e3 * alone / RECORDINGS),
    ]


def ten_thousand(folder: Path) -> list[Row]:
    """A catalogue of ten thousand answers: read, asked, followed, drawn."""
    write_catalogue(folder / "many", drawn_fleet(2, rigs=RIGS, campaigns=CAMPAIGNS))
    store = Catalogue(folder / "many")
    whole = min(timed(store.answers) for _ in range(3))
    print(f"{RIGS * CAMPAIGNS} answers read by pandas                  {whole:8.2f} s")
    query = "select rig, parameter, avg(value), stddev(value) from answers group by rig, parameter"
    queried = min(timed(lambda: query_answers(store, query)) for _ in range(3))
    print(f"the same asked in SQL                         {queried:8.2f} s")
    call = [sys.executable, "-m", "isorig", "fleet", "report", "-c", str(store.folder), "-o", str(folder / "fleet.html")]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    took = timed(lambda: subprocess.run(call, check=True, stdout=subprocess.DEVNULL))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"rig fleet report, from call to page           {took:8.2f} s, {spent:.2f} s of a processor")
    frame = store.answers()
    fleet = followed(frame, "coulomb")
    print(f"  of that followed                            {timed(lambda: followed(frame, 'coulomb'), time.process_time):8.2f} s")
    print(f"  of that drawn                               {timed(lambda: fleet_page(fleet, {}), time.process_time):8.2f} s")
    print(f"  the page                                    {(folder / 'fleet.html').stat().st_size / 1e6:8.1f} MB")
    return [
        Row(what=f"{RIGS * CAMPAIGNS} answers read by pandas", unit="s", ours=whole),
        Row(what="`rig fleet report` of them, from call to page", unit="s", ours=took),
    ]


def spin(steps: int) -> float:
    """A fixed amount of work for one processor."""
    total = 0.0
    for k in range(steps):
        total += (k % 7) * 0.5
    return total


def diagnosed(job: tuple[str, str]) -> str:
    """A real diagnosis as a job."""
    return diagnose_file(Path(job[0]), Path(job[1]), "coulomb", page=False).verdict


@contextmanager
def workers(folder: Path, count: int) -> Iterator[str]:
    """A scheduler and workers on this machine, each worker on a processor of its own; the scheduler's address."""
    file = folder / f"scheduler-{count}.json"
    file.unlink(missing_ok=True)
    local = ["--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0", "--scheduler-file", str(file)]
    # So that workers find this file's functions.
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}

    def started(module: str, *words: str, core: int | None = None) -> subprocess.Popen[bytes]:
        pinned = [] if core is None else ["taskset", "-c", str(core)]
        call = [*pinned, sys.executable, "-m", f"distributed.cli.{module}", *local, *words]
        return subprocess.Popen(call, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    running = [started("dask_scheduler", "--port", "0")]
    try:
        while not (file.exists() and file.stat().st_size):
            time.sleep(0.1)
        cores = sorted(os.sched_getaffinity(0))[:count]
        running += [started("dask_worker", "--no-nanny", "--nthreads", "1", core=core) for core in cores]
        address = msgspec.json.decode(file.read_bytes())["address"]
        with Client(address) as client:
            client.wait_for_workers(count)
        yield address
    finally:
        # The scheduler ends its workers; one that gets a signal of its own meanwhile may hang.
        running[0].terminate()
        for process in running:
            try:
                process.wait(20.0)
            except subprocess.TimeoutExpired:
                process.kill()


def speed_up(folder: Path, real: bool) -> Row:
    """How much faster two workers are than one."""
    import fleet as module  # under the name by which the workers know it

    files = sorted((folder / "measured").rglob("*.h5"))
    took = {}
    for count in (1, 2):
        again = [(str(f), str(folder / f"real-{count}" / f"{k}-{f.stem}")) for k in range(2) for f in files]
        jobs: list[Any] = again if real else [STEPS] * JOBS
        function = module.diagnosed if real else module.spin
        with workers(folder, count) as address:
            # Each worker loads its libraries and compiled kernels first.
            list(shared_out(function, [*jobs[: 2 * count]], address))
            took[count] = timed(partial(_all, function, jobs, address))
    what = "diagnoses" if real else "jobs of fixed work"
    gain = took[1] / took[2]
    print(f"{len(jobs)} {what}: one worker {took[1]:.1f} s, two {took[2]:.1f} s, speed-up {gain:.2f} ({gain / 2:.2f} a worker)")
    return Row(what=f"{len(jobs)} {what} by two workers, and by one", unit="s", ours=took[2], peer="one worker", theirs=took[1])


def _all(function: Callable[[Any], Any], jobs: list[Any], address: str) -> None:
    for _, result in shared_out(function, jobs, address):
        if isinstance(result, Exception):
            raise result


def main() -> None:
    parser = options(__doc__)
    parser.add_argument("--only", choices=["overhead", "answers", "workers"])
    given = parser.parse_args()
    only, kept = given.only, []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if only != "answers":
            kept += overhead(folder)
        if only in (None, "answers"):
            kept += ten_thousand(folder)
        if only in (None, "workers") and (shutil.which("taskset") is None or len(os.sched_getaffinity(0)) < 2):
            print("two workers need two processors and taskset; not measured")
        elif only in (None, "workers"):
            print(f"load of the machine before it: {os.getloadavg()[0]:.1f}")
            kept += [speed_up(folder, real) for real in ((False,) if given.quick else (False, True))]
    keep(kept, given.rows)


if __name__ == "__main__":
    main()
