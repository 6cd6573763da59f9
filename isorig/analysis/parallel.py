"""Parallel work: threads for kernels that release the GIL, with the linear algebra library limited to one thread.

A BLAS with its own threads inside ours makes two workers slower than one.
"""

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")
#: Whether a thread is one of the pool.
_thread = threading.local()


def cores() -> int:
    """Number of cores available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    from threadpoolctl import threadpool_limits

    threadpool_limits(limits=1, user_api="blas")
    return ThreadPoolExecutor(cores(), initializer=lambda: setattr(_thread, "pooled", True))


def side_by_side(function: Callable[[T], R], jobs: Iterable[T]) -> list[R]:
    """The function's results for all jobs, in their order, using all cores available to this process.

    Jobs of a job are done in its thread: if all threads waited for jobs of their own, none would do them.
    """
    return list(map(function, jobs) if hasattr(_thread, "pooled") else _pool().map(function, jobs))
