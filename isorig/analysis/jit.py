"""The only place that uses the compiler: kernels are compiled on first use, cached on disk, and run without the GIL.

A kernel contains the code of all kernels that it calls, also of those in other files. What is cached is therefore valid only as
long as the kernel's code, that of all kernels that it calls, and the constants that they use are unchanged. Docstrings, comments
and the place in the file do not count: they do not change the code. Of a separate kernel, callers contain only the name: so the
engine stays valid when a law is added or changed. The compiler itself is imported with the first call of a kernel, because
commands that simulate nothing need none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dis import EXTENDED_ARG, hasconst
from functools import cache, cached_property, partial
from threading import RLock
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

#: Without Python objects and the GIL, with fused multiply-add.
OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}}
#: Without reference counting of arrays: counting for every row view would cost more than the arithmetic.
UNCOUNTED: dict[str, Any] = {"_nrt": False, **OPTIONS}
#: Of the compiler. Vectorize straight-line arithmetic too, which numba does not by default: it halves the kernels' time.
SETTINGS = {"SLP_VECTORIZE": 1}
PACKAGE = __name__.partition(".")[0]
LINKING = RLock()


class Kernel:
    """A function that becomes machine code when it, or a kernel that calls it, is first called."""

    def __init__(self, function: Callable[..., Any], *, cached: bool, **options: Any) -> None:
        self._function, self._cached, self._options = function, cached, options
        self.symbol = f"{function.__module__}.{function.__qualname__}"

    @cached_property
    def compiled(self) -> Any:
        """Numba's dispatcher."""
        for each in self.calls_by_name:
            # Otherwise the linker does not find it when it loads this kernel.
            each.type  # noqa: B018
        return _compiler().dispatcher(self._function, self._options, SETTINGS, self.digest if self._cached else "")

    @cached_property
    def type(self) -> Any:
        """Numba's type of it, for the kernels that call it."""
        from numba.extending import typeof_impl

        return typeof_impl(self.compiled, None)

    @cached_property
    def calls_by_name(self) -> frozenset[SeparateKernel]:
        """The separate kernels that it, or a kernel contained in it, calls."""
        called = [value for value in _outside(self._function) if isinstance(value, Kernel)]
        inside = (each.calls_by_name for each in called if not isinstance(each, SeparateKernel))
        return frozenset(each for each in called if isinstance(each, SeparateKernel)).union(*inside)

    @cached_property
    def digest(self) -> str:
        """Digest of what the machine code depends on: this code, that of all kernels contained in it, constants, and options.
        Raises TypeError if the kernel uses an object whose content is unknown."""
        from hashlib import sha256

        codes = (
            (code.co_names, code.co_varnames, code.co_exceptiontable, *_instructions(code))
            for code in _codes(self._function.__code__)
        )
        content = (sorted(SETTINGS.items()), sorted(self._options.items()), *codes, *map(_content, _outside(self._function)))
        return sha256(repr(content).encode()).hexdigest()

    @property
    def contained(self) -> str:
        """What a kernel depends on that calls this one."""
        return self.digest

    def __call__(self, *args: Any) -> Any:
        """Call the compiled function."""
        return self.compiled(*args)

    def __getattr__(self, name: str) -> Any:
        # Numba asks a kernel that another calls for its options and its source.
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.compiled, name)


class SeparateKernel(Kernel):
    """A kernel of one signature that its callers call by its name: they do not contain its code.

    It is compiled when `load` needs it, not with its callers: a rig without curved forces needs no law that has them.
    """

    def __init__(self, function: Callable[..., Any], *, signature: str, **options: Any) -> None:
        super().__init__(function, **options)
        self._signature, self._loaded = signature, False
        self._place: Any = None

    @property
    def type(self) -> Any:
        """Numba's type of it, for the kernels that call it; afterwards these can be loaded."""
        return self._called_by_name[0]

    @property
    def _called_by_name(self) -> Any:
        # The linker knows one place of its address, whichever thread asks first.
        with LINKING:
            if self._place is None:
                self._place = _compiler().called_by_name(self.symbol, self._signature)
            return self._place

    def load(self) -> None:
        """Compile it and those that it calls, or load them from the cache, before a kernel is called that may call it."""
        if not self._loaded:
            for each in self.calls_by_name:
                each.load()
            self._called_by_name[1].value = _compiler().address_of(self.compiled, self._signature)
            self._loaded = True

    @property
    def contained(self) -> str:
        """What a kernel depends on that calls this one."""
        return f"address of {self.symbol}: {self._signature}"


def _outside(function: Any) -> Iterator[Any]:
    # The values that a function uses from outside it. A name may be an attribute's as well: then there is one too many.
    yield function.__defaults__
    for cell in function.__closure__ or ():
        yield cell.cell_contents
    for code in _codes(function.__code__):
        for name in code.co_names:
            if name in function.__globals__:
                yield function.__globals__[name]


def _codes(code: CodeType) -> Iterator[CodeType]:
    # With the code of functions and comprehensions inside it.
    yield code
    for const in code.co_consts:
        if isinstance(const, CodeType):
            yield from _codes(const)


def _instructions(code: CodeType) -> Iterator[Any]:
    # Constants by their value: a docstring is a constant that no instruction uses, and shifts the numbers of the others.
    high = 0
    for operation, low in zip(code.co_code[::2], code.co_code[1::2], strict=True):
        number = high | low
        high = number << 8 if operation == EXTENDED_ARG else 0
        if operation not in hasconst:
            yield operation, number
        elif not isinstance(code.co_consts[number], CodeType):
            yield operation, code.co_consts[number]


def _content(value: Any) -> Any:
    """What a kernel that uses a value depends on, as an object whose `repr` differs where that differs."""
    match value:
        case Kernel():
            return value.contained
        case np.ndarray() | np.generic():
            return value.dtype.str, value.shape, value.tobytes()
        case None | bool() | int() | float() | complex() | str():
            return value
        case tuple():
            return type(value).__qualname__, *map(_content, value)
        case type() | FunctionType() | BuiltinFunctionType() | np.ufunc():
            # Of other packages, or named tuples: the compiler refuses other classes and functions of this project.
            return getattr(value, "__module__", ""), value.__name__, getattr(value, "_fields", ())
        case ModuleType() if value.__name__.partition(".")[0] != PACKAGE:
            return value.__name__
    raise TypeError(
        f"a kernel uses {value!r}, whose content is unknown; import kernels, numbers, arrays and tuples by their names"
    )


@cache
def _compiler() -> ModuleType:
    from numba.extending import typeof_impl

    from isorig.analysis import compiler

    typeof_impl.register(Kernel)(lambda value, context: value.type)
    return compiler


def _decorator(**options: Any) -> Callable[[Callable[P, R]], Callable[P, R]]:
    return cast("Callable[[Callable[P, R]], Callable[P, R]]", partial(Kernel, **options))


#: Compiles a numeric function to machine code, cached on disk. It uses its caller's arrays and cannot allocate any.
kernel = _decorator(cached=True, **UNCOUNTED)
#: The same for one that allocates arrays.
allocating_kernel = _decorator(cached=True, **OPTIONS)
#: The same inlined into each calling kernel: passing many arrays takes longer than a short body. LLVM inlines it: numba's own
#: inlining (`inline="always"`) infers the types of the whole caller again for each call, which takes longer than all else.
inlined = _decorator(cached=False, forceinline=True, **UNCOUNTED)
#: The same by numba, for a short function in the innermost loop: a rig with curved forces takes an eighth less time.
inlined_by_numba = _decorator(cached=False, inline="always", **UNCOUNTED)
#: As `kernel`, but compiled with each kernel that calls it: for closures, which have one name.
uncached = _decorator(cached=False, **UNCOUNTED)
#: As `kernel`, with reassociation of sums so that they are vectorized.
fast_kernel = _decorator(cached=True, nogil=True, fastmath=True, error_model="numpy")


def separate_kernel(signature: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """As `kernel`, for one signature in numba's words; what calls it stays valid when it changes, and needs `load` first."""
    return cast(
        "Callable[[Callable[P, R]], Callable[P, R]]", partial(SeparateKernel, signature=signature, cached=True, **UNCOUNTED)
    )


def load(*kernels: Callable[..., Any]) -> None:
    """Compile separate kernels, or load them from the cache, before a kernel is called that may call them."""
    for each in kernels:
        cast("SeparateKernel", each).load()
