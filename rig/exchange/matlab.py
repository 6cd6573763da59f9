"""MATLAB files: version 5 through scipy, version 7.3 (HDF5) through h5py. Structs become dotted names; nothing is evaluated."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import RecordingError
from rig.exchange.table import Column, ForeignTable, columns_of


def read_matlab(path: Path) -> ForeignTable:
    """All numeric variables of a .mat file."""
    items = _version73(path) if h5py.is_hdf5(path) else _version5(path)
    columns: dict[str, Column] = {}
    numbers: dict[str, float] = {}
    for name, values in items:
        if values.dtype.kind not in "biuf" or values.size == 0:
            continue
        if values.size == 1:
            numbers[name] = float(values.ravel()[0])
        else:
            columns |= columns_of(name, values)
    return ForeignTable(path=path, columns=columns, numbers=numbers)


def _version5(path: Path) -> Iterator[tuple[str, NDArray[Any]]]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = loadmat(path, simplify_cells=True)
    except (MatReadError, ValueError, TypeError, NotImplementedError, IndexError, EOFError, OSError, MemoryError) as error:
        raise RecordingError(f"{path} cannot be read as a MATLAB file ({_first(error)}); save it again with save -v7") from None
    except Exception as error:
        # scipy's parser and zlib raise whatever a damaged byte leads them to.
        raise RecordingError(f"{path} is a damaged MATLAB file ({_first(error)}); copy it again from its source") from None
    for name, value in content.items():
        if not name.startswith("__"):
            yield from _flattened(name, value)


def _flattened(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flattened(f"{name}.{key}", inner)
    elif isinstance(value, np.ndarray | int | float | np.number):
        yield name, np.asarray(value)


def _version73(path: Path) -> Iterator[tuple[str, NDArray[Any]]]:
    found: list[tuple[str, NDArray[Any]]] = []

    def visit(name: str, item: object) -> None:
        # "#refs#" holds what cells point to; MATLAB_empty marks a size in place of values.
        if isinstance(item, h5py.Dataset) and not name.startswith("#") and not item.attrs.get("MATLAB_empty", 0):
            found.append((name.replace("/", "."), np.asarray(item[()])))

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except (OSError, RuntimeError, MemoryError) as error:
        raise RecordingError(f"{path} is damaged ({_first(error)}); copy it again from its source") from None
    yield from found


def _first(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
