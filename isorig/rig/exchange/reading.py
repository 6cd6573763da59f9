"""The reader for each file format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from isorig.rig.errors import RecordingError
from isorig.rig.exchange.table import ForeignTable
from isorig.rig.files.inputs import regular
from isorig.rig.files.recording import VALUE_MOST

#: Reader by file name extension, as module:function; loaded when needed.
READERS: Mapping[str, str] = {
    ".mat": "matlab:read_matlab",
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".asc", ".prn"), "text:read_text"),
    ".lvm": "lvm:read_lvm",
    **dict.fromkeys((".uff", ".unv"), "uff:read_uff"),
    ".tdms": "other_formats:read_tdms", ".wav": "other_formats:read_wav",
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), "hdf5:read_hdf5"),
    ".json": "arrays:read_json", ".npy": "arrays:read_npy", ".npz": "arrays:read_npz",
}  # fmt: skip


def read_foreign(path: Path) -> ForeignTable:
    """The columns of a file in another program's format.

    Raises
    ------
    RecordingError
        In one sentence: the fault of the file and what to do.
    """
    place = READERS.get(path.suffix.lower())
    if place is None:
        raise RecordingError(f"{path} ends in {path.suffix or 'nothing'}; files that can be imported end in {', '.join(READERS)}")
    try:
        regular(path)
        if path.stat().st_size == 0:
            raise RecordingError(f"{path} is empty; export or copy it again")
        module, function = place.split(":")
        reader: Callable[[Path], ForeignTable] = getattr(import_module(f"isorig.rig.exchange.{module}"), function)
        table = reader(path)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read ({error.strerror or error}); give the path of a file") from None
    if not table.columns and not table.spectra:
        raise RecordingError(f"{path} contains no numeric records; export the time records too")
    return _with_sound_rates(table)


def _with_sound_rates(table: ForeignTable) -> ForeignTable:
    # A file may state a rate of zero, or an interval that is infinite or no number.
    bad = {
        name: column for name, column in table.columns.items()
        if column.sample_rate is not None and not 1.0 / VALUE_MOST < column.sample_rate < VALUE_MOST
    }  # fmt: skip
    said = [
        f"column {name!r} states {column.sample_rate:g} Hz, which is no sample rate, so it is not used"
        for name, column in bad.items()
    ]
    columns = {**table.columns, **{name: replace(column, sample_rate=None) for name, column in bad.items()}}
    return replace(table, columns=columns, remarks=(*table.remarks, *said))
