"""Content of a file of another program, for all formats: columns by name."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import IntArray, Spectrum
from isorig.rig.errors import RecordingError
from isorig.rig.files.hdf_walk import EXPANSION, SPARE

#: What to do with a file that cannot be read.
AGAIN = "copy it again from its source"
#: Maximum number of columns from one multidimensional array.
COLUMNS_MOST = 256

#: LabVIEW's name of a channel or a group that was given none.
UNTITLED = re.compile(r"Untitled( \d+)?")
#: Name of the columns of a format without names.
UNNAMED = "channel"
#: Name of the streamed gain in files whose `gain` is a single number for the run.
STREAMED = "gain_streamed"


@dataclass(frozen=True, kw_only=True)
class Column:
    """A record of a file.

    Parameters
    ----------
    values
        As stored, shape (n,).
    sample_rate
        Hz, if given by the file.
    unit
        Unit of the physical value, if given by the file.
    sensitivity
        Conversion to that unit: physical value = values / sensitivity.
    lost
        Indices of samples without a value in the file.
    label
        The channel's name according to the file, where the column's key does not contain it.
    """

    values: NDArray[Any]
    sample_rate: float | None = None
    unit: str = ""
    sensitivity: float = 1.0
    lost: IntArray | None = None
    label: str = ""

    @property
    def whole(self) -> bool:
        """Whether all values are whole numbers, as those of a counter."""
        values = np.asarray(self.values, dtype=np.float64)
        return bool(np.array_equal(values, np.round(values)))


@dataclass(frozen=True, kw_only=True)
class ForeignTable:
    """The columns of a file, the single numbers next to them, its spectra, and remarks on its content."""

    path: Path
    columns: Mapping[str, Column]
    numbers: Mapping[str, float] = field(default_factory=dict)
    spectra: tuple[Spectrum, ...] = ()
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of other programs.

    Parameters
    ----------
    extensions
        Of its files, in lower case, with the dot.
    name
        In a sentence: "cannot be read as ...".
    read
        Reads a file. It may raise any error for damaged content: the message then has its first line, and the advice.
    advice
        What to do with a file that cannot be read.
    begins
        First bytes of its files; None for text.
    """

    extensions: tuple[str, ...]
    name: str
    read: Callable[[Path], ForeignTable]
    advice: str = AGAIN
    begins: re.Pattern[bytes] | None = None


def check_declared(path: Path, declared: int, stored: int, advice: str) -> None:
    """Raises RecordingError with the advice if a file declares many more bytes than it stores: a few kilobytes must not become
    gigabytes."""
    if declared > EXPANSION * stored + SPARE:
        raise RecordingError(
            f"{path} declares {declared >> 20} MiB in {stored} bytes; at most {EXPANSION} times the stored size is read, so "
            f"{advice}"
        )


def vectors_of(name: str, values: NDArray[Any], samples: int | None) -> dict[str, NDArray[Any]]:
    """A vector by its name; a multidimensional array as vectors along its axis `samples`, by default its longest one, named
    name[0], name[1] ... or name[0,2] ...

    Axes of one element do not count. Empty if the array would become more than `COLUMNS_MOST` vectors.
    """
    values = np.squeeze(np.asarray(values))
    if values.ndim == 1:
        return {name: values}
    if values.ndim == 0 or values.size == 0:
        return {}
    along = np.moveaxis(values, int(np.argmax(values.shape)) if samples is None else samples, 0)
    if values.size // along.shape[0] > COLUMNS_MOST:
        return {}
    flat = along.reshape(along.shape[0], -1)
    places = product(*(range(n) for n in along.shape[1:]))
    return {f"{name}[{','.join(map(str, place))}]": flat[:, k] for k, place in enumerate(places)}
