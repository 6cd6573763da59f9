"""Which reader reads which file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

from rig.errors import RecordingError
from rig.exchange.table import ForeignTable

#: Reader by the ending of the name, as module:function; loaded when it is needed.
READERS: Mapping[str, str] = {
    ".mat": "matlab:read_matlab", ".csv": "text:read_text", ".txt": "text:read_text", ".tsv": "text:read_text",
    ".dat": "text:read_text", ".uff": "uff:read_uff", ".unv": "uff:read_uff", ".tdms": "more:read_tdms", ".wav": "more:read_wav",
}  # fmt: skip


def read_foreign(path: Path) -> ForeignTable:
    """The columns of a file in another program's format.

    Raises
    ------
    RecordingError
        In one sentence: what is wrong with the file and what to do.
    """
    place = READERS.get(path.suffix.lower())
    if place is None:
        raise RecordingError(f"{path} ends in {path.suffix or 'nothing'}; files that can be imported end in {', '.join(READERS)}")
    try:
        if path.stat().st_size == 0:
            raise RecordingError(f"{path} is empty; export or copy it again")
        module, function = place.split(":")
        reader: Callable[[Path], ForeignTable] = getattr(import_module(f"rig.exchange.{module}"), function)
        table = reader(path)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read ({error.strerror or error}); give the path of a file") from None
    if not table.columns and not table.spectra:
        raise RecordingError(f"{path} holds no records of numbers; export the time records too")
    return table
