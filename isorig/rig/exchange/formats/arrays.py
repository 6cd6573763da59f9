"""Arrays of other programs: JSON, and numpy's .npy and .npz; nothing is unpickled."""

import codecs
import re
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from isorig.rig.exchange.clock import completed
from isorig.rig.exchange.table import AGAIN, ForeignTable, Format, check_declared
from isorig.rig.exchange.tree import NAMES, table_of
from isorig.rig.files.inputs import content_of

#: Maximum bytes of a JSON file: in memory it takes about ten times as many.
JSON_MOST = 256 << 20
#: Maximum nesting of lists and objects.
DEEP = 16


def read_json(path: Path) -> ForeignTable:
    """Arrays of a JSON file: of an object by its keys, of a list of objects, or of an object in each line, by their keys or
    names; null is a lost sample."""
    content = content_of(path, JSON_MOST).removeprefix(codecs.BOM_UTF8)
    # An object in each line is a list of them.
    several = re.match(rb"\s*\{[^\n]*\}\s*\n\s*\{", content)
    value = msgspec.json.Decoder().decode_lines(content) if several else msgspec.json.decode(content)
    found = table_of(path, _flattened("", value, 0))
    columns, remarks = completed(found.columns)
    return replace(found, columns=columns, remarks=(*found.remarks, *remarks))


def read_npy(path: Path) -> ForeignTable:
    """The array of a .npy file; the fields of a structured array by their names."""
    with path.open("rb") as file:
        values = np.lib.format.read_array(file, allow_pickle=False)
    return table_of(path, _fields("data", values))


def read_npz(path: Path) -> ForeignTable:
    """The arrays of a .npz file by their names."""
    with zipfile.ZipFile(path) as archive:
        declared = sum(item.file_size for item in archive.infolist())
    check_declared(path, declared, path.stat().st_size, "save it without compression")
    with np.load(path, allow_pickle=False) as archived:
        stored = {name: archived[name] for name in archived.files}
    # A member that is no array is returned as its bytes.
    remarks = [f"{name!r} is not an array and is left out" for name, values in stored.items() if isinstance(values, bytes)]
    arrays = {name: values for name, values in stored.items() if not isinstance(values, bytes)}
    return table_of(path, [item for name, values in arrays.items() for item in _fields(name, values)], remarks)


def _fields(name: str, values: Any) -> Iterator[tuple[str, Any]]:
    if values.dtype.names:
        for key in values.dtype.names:
            yield from _fields(f"{name}.{key}" if name != "data" else key, values[key])
    elif values.dtype.kind in "US" and values.size == 1:
        yield name, str(values.ravel()[0])
    else:
        yield name, values


def _flattened(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    if depth > DEEP or isinstance(value, bool) or value is None:
        return
    if isinstance(value, dict) and len(value) > 1 and all(key == str(k) for k, key in enumerate(value)):
        # A column of pandas: its values by their rows.
        yield from _flattened(name, list(value.values()), depth + 1)
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _flattened(f"{name}.{key}" if name else str(key), inner, depth + 1)
    elif isinstance(value, list):
        yield from _listed(name, value, depth)
    elif isinstance(value, int | float | str):
        yield name, value


def _listed(name: str, value: list[Any], depth: int) -> Iterator[tuple[str, Any]]:
    numbers = _numbers(value)
    if numbers is not None:
        yield name or "data", numbers
    elif value and all(isinstance(item, str) for item in value):
        yield name, np.array(value)
    elif value and all(isinstance(item, dict) for item in value):
        items = [_unnested(item) for item in value]
        plain = set.intersection(*(set(item) for item in items))
        rows = {key: _numbers_or_words([item[key] for item in items]) for key in items[0] if key in plain}
        longer = any(values is not None and values.ndim > 1 and values.shape[1] > len(value) for values in rows.values())
        if len(value) > 1 and not longer and any(values is not None and values.ndim == 1 for values in rows.values()):
            # Rows of a table: {"t": 0.0, "x": 1.0}, {"t": 0.1, ...}
            yield from ((f"{name}.{key}" if name else key, values) for key, values in rows.items() if values is not None)
            return
        for k, item in enumerate(value):
            label = next((str(item[key]) for key in NAMES if isinstance(item.get(key), str | int)), str(k))
            yield from _flattened(f"{name}.{label}" if name else label, item, depth + 1)
    else:
        for k, item in enumerate(value):
            if isinstance(item, dict | list):
                yield from _flattened(f"{name}[{k}]" if name else f"data[{k}]", item, depth + 1)


def _unnested(item: dict[str, Any], depth: int = 0) -> dict[str, Any]:
    # An object with those in it in one: {"x": {"y": 1.0}} becomes {"x.y": 1.0}.
    found: dict[str, Any] = {}
    for key, inner in item.items():
        nested = isinstance(inner, dict) and depth < DEEP
        found |= {f"{key}.{own}": each for own, each in _unnested(inner, depth + 1).items()} if nested else {key: inner}
    return found


def _numbers(value: list[Any]) -> Any:
    # The list as an array of numbers, null as NaN; None if it is not one.
    try:
        values = np.array(value, dtype=np.float64)
    except (ValueError, TypeError):
        return None
    whole = values.ndim >= 1 and values.size > 0 and not _has_words(value)
    return values if whole else None


def _numbers_or_words(value: list[Any]) -> Any:
    return np.array(value) if all(isinstance(item, str) for item in value) else _numbers(value)


def _has_words(value: Any) -> bool:
    # numpy would accept "1.5" and true as numbers.
    return any(_has_words(item) if isinstance(item, list) else isinstance(item, str | bool) for item in value)


JSON = Format(
    extensions=(".json", ".jsonl", ".ndjson"), name="JSON", read=read_json, advice=f"{AGAIN}, or write it as arrays by name"
)
NPY = Format(
    extensions=(".npy",),
    name="a .npy file",
    read=read_npy,
    advice="save plain numbers with numpy.save",
    begins=re.compile(rb"\x93NUMPY"),
)
NPZ = Format(
    extensions=(".npz",),
    name="a .npz file",
    read=read_npz,
    advice="save plain arrays of numbers with numpy.savez",
    begins=re.compile(rb"PK\x03\x04.{26}[^\0]{1,500}\.npy", re.DOTALL),
)
