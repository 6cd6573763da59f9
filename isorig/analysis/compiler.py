"""What kernels need of numba: its cache by a kernel's content, and calls by name of kernels that are compiled separately.

Only `jit` imports this file, with the first call of a kernel.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import llvmlite.binding as llvm
import numba
from numba.core import cgutils
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.registry import cpu_target
from numba.core.types import BaseTuple, Function, NamedTuple, NamedUniTuple
from numba.core.typing.templates import make_concrete_template


def dispatcher(function: Callable[..., Any], options: Mapping[str, Any], settings: Mapping[str, Any], digest: str) -> Any:
    """Numba's object that compiles a function, cached on disk as long as a digest of its content is the same; "" for no cache."""
    for name, value in settings.items():
        setattr(numba.config, name, value)
    found = numba.njit(**options)(function)
    if digest:
        found._cache = _Cache(function, digest)
    return found


def called_by_name(symbol: str, dispatcher: Any, signature: str) -> Any:
    """Compile a function for one signature; return the type by which the compiler calls it by a name of the linker.

    A caller contains the name alone. It needs no compiling when the function changes, but cannot be loaded before this call.
    """
    dispatcher.compile(signature)
    (compiled,) = dispatcher.overloads.values()
    llvm.add_symbol(symbol, compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))

    def call(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        conventions = context.call_conv
        declared = cgutils.get_or_insert_function(
            builder.module, conventions.get_function_type(sig.return_type, sig.args), symbol
        )
        status, result = conventions.call_function(builder, declared, sig.return_type, sig.args, args)
        with cgutils.if_unlikely(builder, status.is_error):
            conventions.return_status_propagate(builder, status)
        return result

    cpu_target.target_context.insert_func_defn([(call, symbol, compiled.signature.args)])
    return Function(make_concrete_template(symbol, symbol, [compiled.signature]))


class _WithoutLine(CompileResultCacheImpl):
    # Numba's file names contain the function's line number: a line more above it would be a new function.
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return f"{fullname}.py{sys.version_info[0]}{sys.version_info[1]}{abiflags}"


class _Cache(FunctionCache):
    # Numba's cache is valid as long as the date of the function's own file is the same; this one, as long as the digest is.
    _impl_class = _WithoutLine

    def __init__(self, function: Callable[..., Any], digest: str) -> None:
        super().__init__(function)
        self._cache_file = IndexDataCacheFile(self._cache_path, self._impl.filename_base, digest)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        # Numba takes named tuples with the same types for the same, also if their fields differ.
        return sig, tuple(_fields(sig)), codegen.magic_tuple()


def _fields(types: Any) -> Iterator[tuple[str, ...]]:
    for each in types:
        if isinstance(each, NamedTuple | NamedUniTuple):
            yield each.fields
        if isinstance(each, BaseTuple):
            yield from _fields(each)
