"""Reads a file of another program by the format that its extension names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from isorig.analysis.errors import AnalysisError
from isorig.analysis.wording import did_you_mean
from isorig.rig.errors import RecordingError, RigError
from isorig.rig.exchange.formats import FORMATS
from isorig.rig.exchange.table import ForeignTable
from isorig.rig.files.inputs import regular
from isorig.rig.files.output import reason
from isorig.rig.files.recording import VALUE_MOST


def read_foreign(path: Path) -> ForeignTable:
    """The columns of a file in another program's format.

    Raises
    ------
    RecordingError
        In one sentence: the fault of the file and what to do.
    """
    if path.suffix.lower() not in FORMATS:
        raise RecordingError(f"{path} ends in {path.suffix or 'nothing'}; files that can be imported end in {', '.join(FORMATS)}")
    found = FORMATS[path.suffix.lower()]
    try:
        regular(path)
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
        raise RecordingError(f"{path} cannot be read as {found.name} ({reason(error)}); {found.advice}") from None
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
