"""The only place that uses the compiler: kernels are compiled on first use, cached on disk, and run without the GIL.

A kernel contains the code of all kernels that it calls, also of those in other files. The cache is therefore valid only as long
as no kernel's source has changed: every file of this package that imports this one. Constants used by kernels are in such files.
"""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

# Vectorize straight-line arithmetic too, which numba does not by default: it halves the kernels' time.
numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]

P = ParamSpec("P")
R = TypeVar("R")


def sources() -> tuple[Path, ...]:
    """The files of this package that contain kernels."""
    files = sorted(Path(__file__).parent.rglob("*.py"))
    return tuple(file for file in files if b"isorig.analysis.jit import" in file.read_bytes())


def _fingerprint() -> str:
    digest = sha256()
    for file in sources():
        digest.update(file.read_bytes())
    return digest.hexdigest()


FINGERPRINT = _fingerprint()


#: Without Python objects and the GIL, with fused multiply-add.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
#: Without reference counting of arrays: counting for every row view would cost more than the arithmetic.
UNCOUNTED: dict[str, Any] = {"_nrt": False, **OPTIONS}


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a numeric function to machine code, cached on disk. It uses its caller's arrays and cannot allocate any."""
    return cast("Callable[P, R]", _cached(numba.njit(cache=True, **UNCOUNTED)(function)))


def allocating_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a numeric function that allocates arrays, cached on disk."""
    return cast("Callable[P, R]", _cached(numba.njit(cache=True, **OPTIONS)(function)))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as `kernel`, inlined into each calling kernel: passing many arrays takes longer than a short body."""
    return cast("Callable[P, R]", numba.njit(inline="always", **UNCOUNTED)(function))


def fast_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as `kernel`, with reassociation of sums so that they are vectorized."""
    return cast("Callable[P, R]", _cached(numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")(function)))


def _cached(compiled: Any) -> Any:
    # Numba considers a cache valid as long as the function's own file is unchanged; here all kernel files count.
    file = compiled._cache._cache_file
    file._source_stamp = (file._source_stamp, FINGERPRINT)
    return compiled
