"""Reads a file of another program by the format that its extension names."""

import re
import zipfile
from dataclasses import replace
from pathlib import Path

from isorig.analysis.errors import AnalysisError
from isorig.analysis.wording import did_you_mean
from isorig.rig.errors import RecordingError, RigError
from isorig.rig.exchange.formats import FORMATS
from isorig.rig.exchange.table import ForeignTable, Format
from isorig.rig.files.inputs import opened_regular
from isorig.rig.files.output import reason
from isorig.rig.files.recording import VALUE_MOST

#: Bytes at the start of a file by which its format is recognized.
HEAD = 1024
ARCHIVE = b"PK\x03\x04"
CAN_LOG = "a log of CAN messages; decode it with its database (DBC), and save the signals as CSV or MATLAB"
#: Files that cannot be imported, by their first bytes, and what to do with them.
OTHERS = (
    (b"\xd0\xcf\x11\xe0", "an Excel workbook or another document; save its numbers as CSV"),
    (b"FEA1", "a Feather file of version 1; save it as Parquet or CSV"),
    (b"MDF     ", "an MDF file; export it as CSV, MATLAB or HDF5"),
    (b"CDF", "a netCDF 3 file; convert it to netCDF 4, or export it as CSV"),
    (b"\x1f\x8b", "compressed; unpack it"),
    (b"LOGG", CAN_LOG),
    (b";$FILEVERSION", CAN_LOG),
    (b"%PDF", "a PDF document; export its numbers as CSV"),
)


def read_foreign(path: Path) -> ForeignTable:
    """The columns of a file in another program's format. Raises RecordingError with the fault of the file and what to do."""
    found = FORMATS.get(path.suffix.lower())
    unknown = (
        f"{path} ends in {path.suffix or 'nothing'}; files that can be imported end in {', '.join(FORMATS)}, so export it as one "
        "of these, or rename it to .csv if it is text"
    )
    try:
        _blame_content(path, found)
        if found is None:
            raise RecordingError(unknown)
        if path.stat().st_size == 0:
            raise RecordingError(f"{path} is empty; export or copy it again")
        table = found.read(path)
    except (RigError, AnalysisError):
        raise
    except FileNotFoundError:
        there = sorted(each.name for each in path.parent.glob(f"*{path.suffix}")) if path.parent.is_dir() else []
        raise RecordingError(f"{path} does not exist{did_you_mean(path.name, there)}; give the path of a file") from None
    except Exception as error:
        if isinstance(error, OSError) and error.strerror:
            raise RecordingError(f"{path} cannot be read ({error.strerror}); give the path of a file") from None
        # Parsers raise many kinds of errors on damaged bytes: of zlib, struct and tokenize, and bare exceptions.
        said = unknown if found is None else f"{path} cannot be read as {found.name} ({reason(error)}); {found.advice}"
        raise RecordingError(said) from None
    if not table.columns and not table.spectra:
        remarks = "; ".join(table.remarks)
        raise RecordingError(
            f"{path} contains no numeric records{f' ({remarks})' if remarks else ''}; export the time records too"
        )
    return _with_sound_rates(table)


def _blame_content(path: Path, named: Format | None) -> None:
    # Whether the content is that of another format than the name says.
    with opened_regular(path) as file:
        head = file.read(HEAD)
    if other := next((what for begin, what in OTHERS if head.startswith(begin)), None) or _document_in(path, head):
        raise RecordingError(f"{path} is {other}")
    formats = [each for each in dict.fromkeys(FORMATS.values()) if each.begins is not None and each.begins.match(head)]
    if formats and named not in formats:
        raise RecordingError(
            f"{path} contains {formats[0].name}{f', not {named.name}' if named else ''}; rename it to "
            f"{path.with_suffix(formats[0].extensions[0]).name}"
        )


def _document_in(path: Path, head: bytes) -> str | None:
    # Spreadsheets are archives, like .npz files. Vector's text log of a CAN begins with its date, and the base of its numbers.
    if re.match(rb"date .*\r?\nbase (?:hex|dec)", head):
        return CAN_LOG
    if not head.startswith(ARCHIVE):
        return None
    if not zipfile.is_zipfile(path):
        return None if path.suffix == ".npz" else "a damaged archive; save or copy it again"
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    if "mimetype" in names and "content.xml" in names:
        return "an OpenDocument file; save it as CSV"
    known = any(name.endswith(".npy") or name.startswith("xl/") for name in names)
    return None if known else "an archive; unpack it"


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
