"""What kernels need of numba: its cache by a kernel's content, and calls by name of kernels that are compiled separately.

Only `jit` imports this file, with the first call of a kernel.
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from ctypes import CFUNCTYPE, addressof, c_int, c_void_p, cast
from typing import Any

import llvmlite.binding as llvm
import numba
from llvmlite import ir
from numba.core import cgutils
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.registry import cpu_target
from numba.core.sigutils import normalize_signature
from numba.core.types import BaseTuple, Function, NamedTuple, NamedUniTuple
from numba.core.typing.templates import make_concrete_template

#: Called in place of a function that is not loaded. Its result is no status of numba, which raises SystemError for it.
UNLOADED = CFUNCTYPE(c_int)(lambda: -100)


def dispatcher(function: Callable[..., Any], options: Mapping[str, Any], settings: Mapping[str, Any], digest: str) -> Any:
    """Numba's object that compiles a function, cached on disk as long as a digest of its content is the same; "" for no cache."""
    for name, value in settings.items():
        setattr(numba.config, name, value)
    found = numba.njit(**options)(function)
    if digest:
        found._cache = _Cache(function, digest)
    return found


def called_by_name(symbol: str, signature: str) -> tuple[Any, c_void_p]:
    """The type by which the compiler calls a function of this signature by a name of the linker, and the place of its address.

    A caller contains the name alone, so it needs no compiling when the function changes. It raises SystemError if it calls the
    function before the address is stored.
    """
    address = cast(UNLOADED, c_void_p)
    llvm.add_symbol(symbol, addressof(address))
    arguments, result = normalize_signature(signature)

    def call(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        conventions = context.call_conv
        kind = conventions.get_function_type(sig.return_type, sig.args).as_pointer()
        place = builder.module.globals.get(symbol) or ir.GlobalVariable(builder.module, kind, symbol)
        status, result = conventions.call_function(builder, builder.load(place), sig.return_type, sig.args, args)
        with cgutils.if_unlikely(builder, status.is_error):
            conventions.return_status_propagate(builder, status)
        return result

    cpu_target.target_context.insert_func_defn([(call, symbol, arguments)])
    return Function(make_concrete_template(symbol, symbol, [result(*arguments)])), address


def address_of(dispatcher: Any, signature: str) -> int:
    """Compile a function for one signature; return its address."""
    dispatcher.compile(signature)
    (compiled,) = dispatcher.overloads.values()
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


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
