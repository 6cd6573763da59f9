"""The one place that names the compiler: kernels are compiled on first use, cached on disk, and free of the GIL."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

# Straight lines of arithmetic into vector lanes too, which numba leaves out by default: the kernels take half the time.
numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]

P = ParamSpec("P")
R = TypeVar("R")


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a numeric function to machine code (nopython, cached, without the GIL, multiplications and additions fused)."""
    return cast("Callable[P, R]", numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})(function))


def fast_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as `kernel`, letting sums be reordered so that they run in vector lanes."""
    return cast("Callable[P, R]", numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")(function))
