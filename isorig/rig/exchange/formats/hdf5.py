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
            yield name, _scaled(np.asarray(item[()]), item.attrs)
        elif h5py.check_string_dtype(item.dtype) is not None and item.size:
            yield name, _texts(item[()])
        own = f"{name}/" if item.dtype.names else f"{name}{OWN}/"
        for key, value in _attributes("", item):
            yield (f"{name}_unit" if key.lower() in UNIT_WORDS and isinstance(value, str) else f"{own}{key}"), value


def _scaled(values: Any, attributes: Any) -> Any:
    # Packed values of netCDF (CF conventions, 8.1): physical value = stored value * scale_factor + add_offset.
    names = ("scale_factor", "add_offset", "_FillValue")
    packed = {
        key: float(np.ravel(attributes[key])[0]) for key in names if np.asarray(attributes.get(key, "")).dtype.kind in "iuf"
    }
    if values.dtype.kind not in "iuf" or not {"scale_factor", "add_offset"} & set(packed):
        return values
    physical = values * packed.get("scale_factor", 1.0) + packed.get("add_offset", 0.0)
    return np.where(values == packed["_FillValue"], np.nan, physical) if "_FillValue" in packed else physical


def _attributes(before: str, item: Any) -> Iterator[tuple[str, Any]]:
    for key, value in item.attrs.items():
        kind = np.asarray(value).dtype.kind
        if kind in "USO" and not isinstance(value, h5py.Empty | h5py.Reference):
            yield f"{before}{key}", _texts(value)
        elif kind in "iuf" and np.size(value) == 1:
            yield f"{before}{key}", float(np.ravel(value)[0])


def _texts(value: Any) -> Any:
    # A text, or an array of several.
    found = [each.decode("utf-8", "replace") if isinstance(each, bytes) else str(each) for each in np.ravel(value)]
    return found[0] if len(found) == 1 else np.array(found)


HDF5 = Format(extensions=(".h5", ".hdf5", ".hdf", ".nc"), name="HDF5", read=read_hdf5, begins=BEGINS)
