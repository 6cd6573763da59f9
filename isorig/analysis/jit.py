"""The only place that uses the compiler: kernels are compiled on first use, cached on disk, and run without the GIL.

A kernel contains the code of all kernels that it calls, also of those in other files. The cache is therefore valid only as long
as no kernel's source has changed: every file of this package that imports this one. Constants used by kernels are in such files.
The compiler itself is imported with the first call of a kernel, because commands that simulate nothing need none.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property, partial
from hashlib import sha256
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

P = ParamSpec("P")
R = TypeVar("R")


def sources() -> tuple[Path, ...]:
    """The files of this package that contain kernels."""
    files = sorted(Path(__file__).parent.rglob("*.py"))
    return tuple(file for file in files if b"isorig.analysis.jit import" in file.read_bytes())


@cache
def fingerprint() -> str:
    """Digest of all kernels' sources."""
    digest = sha256()
    for file in sources():
        digest.update(file.read_bytes())
    return digest.hexdigest()


#: Without Python objects and the GIL, with fused multiply-add.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
#: Without reference counting of arrays: counting for every row view would cost more than the arithmetic.
UNCOUNTED: dict[str, Any] = {"_nrt": False, **OPTIONS}


class Kernel:
    """A function that becomes machine code when it, or a kernel that calls it, is first called."""

    def __init__(self, function: Callable[..., Any], **options: Any) -> None:
        self._function, self._options = function, options

    @cached_property
    def compiled(self) -> Any:
        """Numba's dispatcher."""
        dispatcher = _numba().njit(**self._options)(self._function)
        if self._options.get("cache"):
            # Numba considers a cache valid as long as the function's own file is unchanged; here all kernel files count.
            file = dispatcher._cache._cache_file
            file._source_stamp = (file._source_stamp, fingerprint())
        return dispatcher

    def __call__(self, *args: Any) -> Any:
        """Call the compiled function."""
        return self.compiled(*args)

    def __getattr__(self, name: str) -> Any:
        # Numba asks a kernel that another calls for its options and its source.
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.compiled, name)


@cache
def _numba() -> Any:
    import numba
    from numba.extending import typeof_impl

    # Vectorize straight-line arithmetic too, which numba does not by default: it halves the kernels' time.
    numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]
    typeof_impl.register(Kernel)(lambda value, context: typeof_impl(value.compiled, context))
    return numba


def _decorator(**options: Any) -> Callable[[Callable[P, R]], Callable[P, R]]:
    return cast("Callable[[Callable[P, R]], Callable[P, R]]", partial(Kernel, **options))


#: Compiles a numeric function to machine code, cached on disk. It uses its caller's arrays and cannot allocate any.
kernel = _decorator(cache=True, **UNCOUNTED)
#: The same for one that allocates arrays.
allocating_kernel = _decorator(cache=True, **OPTIONS)
#: The same inlined into each calling kernel: passing many arrays takes longer than a short body.
inlined = _decorator(inline="always", **UNCOUNTED)
#: As `kernel`, with reassociation of sums so that they are vectorized.
fast_kernel = _decorator(cache=True, nogil=True, fastmath=True, error_model="numpy")
