"""Jobs on the workers of a Dask cluster, of one or many machines: the package's extra `cluster`."""

import logging
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

import msgspec

from isorig.rig.errors import RigError

#: Seconds to wait for a scheduler's file to appear: its processes start concurrently.
FILE_PATIENCE = 30.0
#: Seconds that jobs wait at a scheduler without workers: enough for a worker to restart.
WORKER_PATIENCE = 300.0
#: Seconds between checks of the workers while no result arrives.
LOOK = 1.0
#: Waiting jobs per running job: enough to keep workers busy, few enough to be cancelled quickly.
WAITING = 3

J = TypeVar("J")
R = TypeVar("R")


def on_cluster(function: Callable[[J], R], jobs: Iterable[J], scheduler: str) -> Iterator[tuple[J, R | Exception]]:
    """As `isorig.rig.diagnose.many.shared_out`, by the workers of a cluster.

    If a worker dies, another one does its job; a job that ends several workers results in an exception. The scheduler of Dask is
    given by its address, or by the file that it writes (`--scheduler-file`, ending in .json). Raises RigError if Dask is not
    installed, no scheduler answers at the address, or it has had no worker for `WORKER_PATIENCE`.
    """
    waiting = iter(jobs)
    first = list(islice(waiting, 1))
    if not first:
        return
    try:
        from dask.distributed import Client, Future
    except ImportError:
        raise RigError("--scheduler needs Dask, which is not installed; run pip install 'isorig[cluster]'") from None

    # What it logs when work is cancelled, or when its worker is late on a busy host, comes with a traceback; a job that fails has
    # its exception as its result.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = Client(_address(scheduler))
    except (OSError, ValueError) as error:
        raise RigError(f"no Dask scheduler answers at {scheduler} ({error}); start one, or leave out --scheduler") from None
    with client:
        done: SimpleQueue[Future[Any]] = SimpleQueue()
        of: dict[Future[Any], J] = {}

        def submit(job: J) -> None:
            future = client.submit(function, job, pure=False)
            of[future] = job
            future.add_done_callback(done.put)

        for job in first:
            submit(job)
        room = max(sum(client.nthreads().values()), 1) * (1 + WAITING)
        for job in islice(waiting, room):
            submit(job)
        worked = time.monotonic()
        while of:
            try:
                future = done.get(timeout=LOOK)
            except Empty:
                with suppress(OSError):  # a lost scheduler cancels the futures
                    worked = time.monotonic() if client.nthreads() else worked
                if time.monotonic() > worked + WORKER_PATIENCE:
                    raise RigError(
                        f"the Dask scheduler at {scheduler} has had no worker for {WORKER_PATIENCE:.0f} s; start workers "
                        "and repeat the command, which keeps finished answers"
                    ) from None
                continue
            if future.status == "cancelled":
                raise RigError(f"the Dask scheduler at {scheduler} was lost; finished answers are kept, so start again")
            failure = future.exception()
            yield of.pop(future), future.result() if failure is None else failure
            worked = time.monotonic()
            for job in islice(waiting, 1):
                submit(job)


def _address(scheduler: str) -> str:
    # Address of a scheduler given by address or by file.
    if not scheduler.endswith(".json"):
        return scheduler
    end = time.monotonic() + FILE_PATIENCE
    while True:
        try:
            return str(msgspec.json.decode(Path(scheduler).read_bytes())["address"])
        except (OSError, msgspec.DecodeError, KeyError, TypeError) as error:
            if time.monotonic() > end:
                why = error.strerror if isinstance(error, OSError) else "it contains no address"
                raise RigError(
                    f"{scheduler} cannot be read as the file of a Dask scheduler ({why}); start one with --scheduler-file "
                    f"{scheduler}, or give its address"
                ) from None
        time.sleep(0.1)
