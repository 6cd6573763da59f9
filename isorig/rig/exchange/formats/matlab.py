"""MATLAB files: version 5 through scipy, version 7.3 (HDF5) through h5py. Structs become dotted names; nothing is evaluated."""

import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain, islice
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from isorig.rig.exchange.formats.hdf5 import BEGINS
from isorig.rig.exchange.table import AGAIN, ForeignTable, Format, check_declared
from isorig.rig.exchange.tree import table_of
from isorig.rig.files.hdf import opened, survived

#: Header bytes of a version 5 file, and the type of a compressed variable.
HEAD, COMPRESSED = 128, 15
#: Maximum nesting of structs and cells, and maximum number of their parts.
DEEP, PARTS_MOST = 16, 20_000
OBJECT = "an object of a MATLAB class (timeseries, table, string ...) is left out; save its values as plain arrays"


def read_matlab(path: Path) -> ForeignTable:
    """All numeric variables of a .mat file; a struct array's elements are called name[0], name[1] ..."""
    with path.open("rb") as file:
        is_hdf5 = BEGINS.match(file.read(1 << 10))
    if not is_hdf5:
        return _version5(path)
    with opened(path) as hdf:
        visited = (_visited(hdf, name, hdf[name], 0) for name in hdf if not name.startswith("#"))
        items = list(islice(chain.from_iterable(visited), PARTS_MOST))
        remarks = [OBJECT for name, item in items if item is None]
        return table_of(path, [each for each in items if each[1] is not None], remarks[:1])


def _version5(path: Path) -> ForeignTable:
    from scipy.io import loadmat, whosmat

    _bounded(path)
    # scipy's reader crashes on some damaged files.
    survived(path)
    items: list[tuple[str, Any]] = []
    remarks = []
    # The simple cells have no axes of one element, also where a single channel is between its samples and its runs.
    shapes = {name: shape for name, shape, _ in whosmat(path) if len(shape) > 2}
    for name, value in loadmat(path, simplify_cells=True).items():
        if name == "None" or type(value).__name__ == "MatlabOpaque":
            remarks.append(OBJECT)
        elif not name.startswith("__"):
            numbers = isinstance(value, np.ndarray) and value.dtype.kind in "biufc" and name in shapes
            items += [(name, value.reshape(shapes[name]))] if numbers else _flattened(name, value)
    return table_of(path, items, remarks)


def _bounded(path: Path) -> None:
    # A compressed variable states its size in its first bytes (MathWorks, "MAT-File Format", level 5).
    with path.open("rb") as file:
        head = file.read(HEAD)
        order = ">" if head[-2:] == b"MI" else "<"
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack(f"{order}II", tag)
            after = file.tell() + size
            if kind == COMPRESSED:
                with suppress(zlib.error, struct.error):
                    begin = zlib.decompressobj().decompress(file.read(min(size, 1 << 10)), 8)
                    declared = struct.unpack(f"{order}II", begin)[1]
                    check_declared(path, declared, size, "save it again without compression")
            file.seek(after)


def _flattened(name: str, value: Any, depth: int = 0) -> Iterator[tuple[str, Any]]:
    if depth > DEEP:
        return
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flattened(f"{name}.{key}", inner, depth + 1)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        # The elements of a struct array or a cell array, in MATLAB's order.
        for k, inner in enumerate(np.ravel(np.asarray(value, dtype=object), order="F")[:PARTS_MOST]):
            yield from _flattened(f"{name}[{k}]", inner, depth + 1)
    elif isinstance(value, np.ndarray | int | float | complex | str | np.number):
        yield name, value


def _visited(file: h5py.File, name: str, item: Any, depth: int) -> Iterator[tuple[str, Any]]:
    # MATLAB_class is the data type of a dataset; "#refs#" contains the targets of cells and struct arrays.
    if depth > DEEP:
        return
    if isinstance(item, h5py.Group):
        if "MATLAB_sparse" not in item.attrs:
            for key in item:
                yield from _visited(file, f"{name}.{key}", item[key], depth + 1)
        return
    # MATLAB_empty marks a size instead of values.
    if not isinstance(item, h5py.Dataset) or item.attrs.get("MATLAB_empty", 0):
        return
    if "MATLAB_object_decode" in item.attrs:
        yield name, None
    elif _class_of(item) == "char" and item.dtype.kind in "ui":
        yield name, "".join(map(chr, np.asarray(item[()]).ravel(order="C").tolist()))
    elif item.dtype.kind in "biuf":
        yield name, np.asarray(item[()])
    elif item.dtype.names == ("real", "imag"):
        raw = item[()]
        yield name, np.asarray(raw["real"] + 1j * raw["imag"])
    elif h5py.check_ref_dtype(item.dtype) is h5py.Reference:
        # A cell array name{k}, or a field of a struct array: name(k).field becomes name[k].field.
        before, _, field = name.rpartition(".")
        cell = _class_of(item) == "cell" or not before
        for k, reference in enumerate(np.asarray(item[()]).ravel()[:PARTS_MOST]):
            if reference:
                yield from _visited(file, f"{name}[{k}]" if cell else f"{before}[{k}].{field}", file[reference], depth + 1)


def _class_of(item: h5py.Dataset) -> str:
    value = item.attrs.get("MATLAB_class", b"")
    return value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)


MATLAB = Format(
    extensions=(".mat",),
    name="a MATLAB file",
    read=read_matlab,
    advice=f"{AGAIN}, or save it again with save -v7",
    begins=re.compile(rb"MATLAB [57]|" + BEGINS.pattern, re.DOTALL),
)
