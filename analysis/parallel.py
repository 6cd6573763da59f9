"""Work side by side: threads over kernels that drop the GIL, with the linear algebra library kept to one thread.

A BLAS that starts threads of its own inside ours makes two workers slower than one.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    from threadpoolctl import threadpool_limits

    threadpool_limits(limits=1, user_api="blas")
    return ThreadPoolExecutor(cores())


def side_by_side(function: Callable[[T], R], jobs: Iterable[T]) -> list[R]:
    """The function of every job, in the jobs' order, on all cores that this process may use."""
    return list(_pool().map(function, jobs))
