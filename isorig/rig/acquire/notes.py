"""The operator's notes: in a separate file during a session, in the recording afterwards."""

import os
import shutil
import threading
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import h5py
import msgspec
import numpy as np
from numpy.typing import NDArray

from isorig.rig.acquire.recorder import working_file
from isorig.rig.errors import OutputError, RecordingError
from isorig.rig.files.hdf import opened
from isorig.rig.files.output import reason, replaced, reserve
from isorig.rig.files.recording import LIBVER, store

#: Maximum number of characters in a note, and of notes in a session.
LONGEST, MOST = 500, 500
#: Maximum size of a note's text in bytes: a character has up to four.
WIDEST = 4 * LONGEST
#: Location in a recording: a text dataset for each field of a note.
GROUP = "notes"
#: Bytes of metadata for them in a recording.
ROOM = 1 << 16
#: Held while the file of notes changes: a note may arrive while the recording is being finished.
_LOCK = threading.Lock()


class Note(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A note: time of writing (ISO 8601), run (empty if none), and text."""

    time: str
    run: str
    text: str


FIELDS = Note.__struct_fields__


def add_note(output: Path, run: str, text: str) -> Note:
    """Add a note to the file next to the working file of a recording; it is synced to disk on return. Raises OutputError if it
    cannot be written."""
    printable = "".join(letter if letter.isprintable() else " " for letter in text)
    note = Note(time=datetime.now(UTC).isoformat(timespec="seconds"), run=run, text=printable.strip()[:LONGEST])
    with _LOCK:
        _append(output, [note])
    return note


def separate_notes(output: Path) -> list[Note]:
    """The notes that are not in the recording yet, without an incomplete last one."""
    try:
        lines = _separate_file(output).read_bytes().splitlines()
    except OSError:
        return []
    found = []
    for line in lines[:MOST]:
        try:
            found.append(msgspec.json.decode(line, type=Note))
        except msgspec.DecodeError:
            continue
    return found


def notes_in(recording: Path) -> list[Note]:
    """The notes stored in a recording."""
    if not recording.exists():
        return []
    try:
        with opened(recording) as file:
            if not all(_is_text(file, f"{GROUP}/{key}") for key in FIELDS):
                return []
            columns = [file[f"{GROUP}/{key}"].asstr()[:MOST] for key in FIELDS]
    except (RecordingError, OSError, RuntimeError, TypeError, ValueError, KeyError):
        return []
    return [Note(**{key: text[:LONGEST] for key, text in zip(FIELDS, row, strict=True)}) for row in zip(*columns, strict=False)]


def _is_text(file: h5py.File, path: str) -> bool:
    # Text as written here: of fixed length, which the check of the file has read.
    found = file.get(path)
    if not isinstance(found, h5py.Dataset) or found.ndim != 1:
        return False
    text = h5py.check_string_dtype(found.dtype)
    return text is not None and text.length is not None and text.length <= WIDEST


def reopen_notes(output: Path) -> None:
    """Move the notes of a recording to the separate file, for a session that continues and writes the recording again."""
    with _LOCK:
        separate = separate_notes(output)
        _append(output, [note for note in notes_in(output) if note not in separate])


def settle_notes(output: Path, session: Path | None = None) -> None:
    """Move the notes into a finished recording; they also stay in the separate file while there is a working file.

    The notes may be those of the session of another recording, where they stay. Raises OutputError if the disk is full; the notes
    then stay in the separate file.
    """
    if session is None and working_file(output).exists():
        return
    with _LOCK:
        separate, inside = separate_notes(session or output), notes_in(output)
        if not separate or not output.exists():
            return
        if set(separate) - set(inside):
            _write(output, list(dict.fromkeys([*inside, *separate])))
        if session is None:
            _separate_file(output).unlink(missing_ok=True)


def _write(output: Path, notes: Sequence[Note]) -> None:
    with replaced(output) as temporary:
        try:
            columns = {key: _fixed([getattr(note, key) for note in notes]) for key in FIELDS}
            shutil.copyfile(output, temporary)
            reserve(temporary, output.stat().st_size + sum(column.nbytes for column in columns.values()) + ROOM)
            with h5py.File(temporary, "r+", libver=LIBVER) as file:
                if GROUP in file:
                    del file[GROUP]
                group = file.create_group(GROUP)
                for key, column in columns.items():
                    store(group, key, column)
        except (OSError, RuntimeError) as error:
            kept = f"they stay in {_separate_file(output)}"
            raise OutputError(f"the notes cannot be put into {output} ({reason(error)}); {kept}") from None


def _fixed(texts: Sequence[str]) -> NDArray[np.bytes_]:
    # Of fixed length: HDF5 stores text of variable length outside of the checksums.
    encoded = [text.encode() for text in texts]
    return np.array(encoded, h5py.string_dtype("utf-8", max(1, *map(len, encoded))))


def _append(output: Path, notes: Sequence[Note]) -> None:
    if not notes:
        return
    try:
        with _separate_file(output).open("ab+") as file:
            if file.tell() and (file.seek(-1, os.SEEK_END), file.read(1))[1] != b"\n":
                file.write(b"\n")  # the last one is incomplete
            file.writelines(msgspec.json.encode(note) + b"\n" for note in notes)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise OutputError(f"notes cannot be saved next to {output} ({error.strerror}); make room and write them again") from None


def _separate_file(output: Path) -> Path:
    return output.with_name(output.name + ".notes")
