"""The one place that names the compiler: kernels are compiled on first use, cached on disk, and free of the GIL.

A kernel holds the code of all kernels that it calls, also of those in other files. So what is cached counts as long as no
kernel's source has changed: every file of this package that imports this one. Numbers that kernels use stand in such files.
"""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba

# Straight lines of arithmetic into vector lanes too, which numba leaves out by default: the kernels take half the time.
numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]

P = ParamSpec("P")
R = TypeVar("R")


def sources() -> tuple[Path, ...]:
    """The files of this package that hold kernels."""
    files = sorted(Path(__file__).parent.rglob("*.py"))
    return tuple(file for file in files if b"isorig.analysis.jit import" in file.read_bytes())


def _fingerprint() -> str:
    digest = sha256()
    for file in sources():
        digest.update(file.read_bytes())
    return digest.hexdigest()


FINGERPRINT = _fingerprint()


#: Without Python objects and the GIL, multiplications and additions fused.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
#: Without counting who uses an array: counting at every row taken from one would cost more than the arithmetic.
UNCOUNTED: dict[str, Any] = {"_nrt": False, **OPTIONS}


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a numeric function to machine code, cached on disk. It works on its caller's arrays and can make none."""
    return cast("Callable[P, R]", _cached(numba.njit(cache=True, **UNCOUNTED)(function)))


def allocating_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a numeric function that makes arrays, cached on disk."""
    return cast("Callable[P, R]", _cached(numba.njit(cache=True, **OPTIONS)(function)))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as `kernel`, into the code of each kernel that calls it: passing many arrays takes longer than a short body."""
    return cast("Callable[P, R]", numba.njit(inline="always", **UNCOUNTED)(function))


def fast_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as `kernel`, letting sums be reordered so that they run in vector lanes."""
    return cast("Callable[P, R]", _cached(numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")(function)))


def _cached(compiled: Any) -> Any:
    # Numba takes what is cached for right as long as the function's own file is unchanged; here all kernels' files count.
    file = compiled._cache._cache_file
    file._source_stamp = (file._source_stamp, FINGERPRINT)
    return compiled
