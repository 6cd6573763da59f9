"""HDF5 files of other programs: every numeric dataset by its path; rates and units from adjacent attributes."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from isorig.rig.errors import RecordingError
from isorig.rig.exchange.table import ForeignTable, Format
from isorig.rig.exchange.tree import OWN, UNIT_WORDS, table_of
from isorig.rig.files.hdf import opened
from isorig.rig.files.recording import FORMAT

#: Attributes with the factor and the offset of stored values.
SCALING = (("scale_factor", "scale"), ("add_offset", "offset"))
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
        packing = _packing(item)
        if item.dtype.names and item.dtype.names != ("r", "i"):
            raw = item[()]
            yield from ((f"{name}/{key}", np.asarray(raw[key])) for key in item.dtype.names)
        elif item.dtype.kind in "biufc":
            yield name, _scaled(np.asarray(item[()]), packing)
        elif h5py.check_string_dtype(item.dtype) is not None and item.size:
            yield name, _texts(item[()])
        own = f"{name}/" if item.dtype.names else f"{name}{OWN}/"
        for key, value in _attributes("", item):
            if key in packing:
                continue
            yield (f"{name}_unit" if key.lower() in UNIT_WORDS and isinstance(value, str) else f"{own}{key}"), value


def _packing(item: h5py.Dataset) -> dict[str, float]:
    # Attributes of packed values (CF conventions, 8.1), and of whole numbers from a converter that other programs scale.
    names = ("scale_factor", "add_offset", "_FillValue", *(("scale", "offset") if item.dtype.kind in "iu" else ()))
    given = {name: np.ravel(item.attrs[name])[:1] for name in names if np.asarray(item.attrs.get(name, "")).dtype.kind in "iuf"}
    packed = item.dtype.kind in "iuf" and given.keys() - {"_FillValue"}
    return {name: float(number[0]) for name, number in given.items() if len(number)} if packed else {}


def _scaled(values: Any, packing: Mapping[str, float]) -> Any:
    # Physical value = stored value * scale_factor + add_offset.
    if not packing:
        return values
    scale, offset = (next((packing[name] for name in names if name in packing), None) for names in SCALING)
    physical = values * (1.0 if scale is None else scale) + (offset or 0.0)
    return np.where(values == packing["_FillValue"], np.nan, physical) if "_FillValue" in packing else physical


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
