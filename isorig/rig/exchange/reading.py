"""The reader for each file format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from isorig.analysis.errors import AnalysisError
from isorig.rig.errors import RecordingError, RigError
from isorig.rig.exchange.table import ForeignTable
from isorig.rig.files.inputs import regular
from isorig.rig.files.output import reason
from isorig.rig.files.recording import VALUE_MOST

AGAIN = "copy it again from its source"
#: By file name extension: the reader as module:function, loaded when needed; the format in words; and what to do if it fails.
READERS: Mapping[str, tuple[str, str, str]] = {
    ".mat": ("matlab:read_matlab", "a MATLAB file", f"{AGAIN}, or save it again with save -v7"),
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat", ".asc", ".prn"), ("text:read_text", "text", AGAIN)),
    ".lvm": ("lvm:read_lvm", "LVM", "save it again from LabVIEW, or as CSV"),
    **dict.fromkeys((".uff", ".unv"), ("uff:read_uff", "a universal file", "export it again as dataset 58")),
    ".tdms": ("other_formats:read_tdms", "TDMS", AGAIN),
    ".wav": ("other_formats:read_wav", "WAV", AGAIN),
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), ("hdf5:read_hdf5", "HDF5", AGAIN)),
    ".json": ("arrays:read_json", "JSON", f"{AGAIN}, or write it as arrays by name"),
    ".npy": ("arrays:read_npy", "a .npy file", "save plain numbers with numpy.save"),
    ".npz": ("arrays:read_npz", "a .npz file", "save plain arrays of numbers with numpy.savez"),
}


def read_foreign(path: Path) -> ForeignTable:
    """The columns of a file in another program's format.

    Raises
    ------
    RecordingError
        In one sentence: the fault of the file and what to do.
    """
    if path.suffix.lower() not in READERS:
        raise RecordingError(f"{path} ends in {path.suffix or 'nothing'}; files that can be imported end in {', '.join(READERS)}")
    place, kind, advice = READERS[path.suffix.lower()]
    try:
        regular(path)
        if path.stat().st_size == 0:
            raise RecordingError(f"{path} is empty; export or copy it again")
        module, function = place.split(":")
        reader: Callable[[Path], ForeignTable] = getattr(import_module(f"isorig.rig.exchange.{module}"), function)
        table = reader(path)
    except (RigError, AnalysisError):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.strerror:
            raise RecordingError(f"{path} cannot be read ({error.strerror}); give the path of a file") from None
        # Parsers raise many kinds of errors on damaged bytes: of zlib, struct and tokenize, and bare exceptions.
        raise RecordingError(f"{path} cannot be read as {kind} ({reason(error)}); {advice}") from None
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
