"""HDF5 files of other programs: every numeric dataset by its path; rates and units from adjacent attributes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from isorig.rig.errors import RecordingError
from isorig.rig.exchange.table import ForeignTable, Format
from isorig.rig.exchange.tree import OWN, UNIT_WORDS, table_of
from isorig.rig.files.hdf import opened
from isorig.rig.files.recording import FORMAT

#: Its signature, also after the block that MATLAB writes before it.
BEGINS = re.compile(rb"(.{512})?\x89HDF", re.DOTALL)


def read_hdf5(path: Path) -> ForeignTable:
    """The datasets of an HDF5 file as columns group/dataset, or group/dataset/field of a table. Raises RecordingError if it is a
    recording already, or damaged."""
    items: list[tuple[str, Any]] = []
    with opened(path) as file:
        if file.attrs.get("format") in (FORMAT, FORMAT.encode()):
            raise RecordingError(f"{path} is a recording already; use it directly, or list it with rig check")
        items += _attributes("", file)
        file.visititems(lambda name, item: items.extend(_items(name, item)))
    return table_of(path, items, dot="/")


def _items(name: str, item: object) -> Iterator[tuple[str, Any]]:
    if isinstance(item, h5py.Group):
        yield from _attributes(f"{name}/", item)
    elif isinstance(item, h5py.Dataset):
        if item.dtype.names and item.dtype.names != ("r", "i"):
            raw = item[()]
            yield from ((f"{name}/{key}", np.asarray(raw[key])) for key in item.dtype.names)
        elif item.dtype.kind in "biufc":
            yield name, np.asarray(item[()])
        elif h5py.check_string_dtype(item.dtype) is not None and item.shape == ():
            yield name, _text(item[()])
        own = f"{name}/" if item.dtype.names else f"{name}{OWN}/"
        for key, value in _attributes("", item):
            yield (f"{name}_unit" if key.lower() in UNIT_WORDS else f"{own}{key}"), value


def _attributes(before: str, item: Any) -> Iterator[tuple[str, Any]]:
    for key, value in item.attrs.items():
        if isinstance(value, str | bytes):
            yield f"{before}{key}", _text(value)
        elif isinstance(value, int | float | np.number):
            yield f"{before}{key}", float(value)


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


HDF5 = Format(extensions=(".h5", ".hdf5", ".hdf"), name="HDF5", read=read_hdf5, begins=BEGINS)
