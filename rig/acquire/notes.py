"""What the operator notes: beside the recording while a session lasts, in the recording behind it."""

from __future__ import annotations

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

#: Characters of a note, and notes of a session.
LONGEST, MOST = 500, 500
#: Bytes of a note's text: a character has four at most.
WIDEST = 4 * LONGEST
#: Where a recording keeps them: a dataset of text for each field of a note.
GROUP = "notes"
#: Bytes of a recording that describe them.
ROOM = 1 << 16
#: Held while the file beside the recording changes: a note may come while the recording is being finished.
_LOCK = threading.Lock()


class Note(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A note: when it was written (ISO 8601), in which run (empty where in none), and its text."""

    time: str
    run: str
    text: str


FIELDS = Note.__struct_fields__


def add_note(output: Path, run: str, text: str) -> Note:
    """Keep a note beside the working file of a recording, safe on disk when this returns.

    Raises
    ------
    OutputError
        Where it cannot be written.
    """
    printable = "".join(letter if letter.isprintable() else " " for letter in text)
    note = Note(time=datetime.now(UTC).isoformat(timespec="seconds"), run=run, text=printable.strip()[:LONGEST])
    with _LOCK:
        _append(output, [note])
    return note


def notes_beside(output: Path) -> list[Note]:
    """The notes that are not in the recording yet; a last one that was not written whole is left out."""
    try:
        lines = _beside(output).read_bytes().splitlines()
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
    """The notes that a recording keeps."""
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
    # Text as it is written here: of a fixed length, which the walk through the file has read.
    found = file.get(path)
    if not isinstance(found, h5py.Dataset) or found.ndim != 1:
        return False
    text = h5py.check_string_dtype(found.dtype)
    return text is not None and text.length is not None and text.length <= WIDEST


def reopen_notes(output: Path) -> None:
    """Put the notes of a recording beside it, where a session goes on that will write it anew."""
    with _LOCK:
        beside = notes_beside(output)
        _append(output, [note for note in notes_in(output) if note not in beside])


def settle_notes(output: Path, session: Path | None = None) -> None:
    """Put the notes that are beside a finished recording into it; they stay beside it while there is a working file.

    Parameters
    ----------
    output
        The recording.
    session
        The recording of the session that the notes are beside, where it is another one; its notes stay.

    Raises
    ------
    OutputError
        Where the disk has no room; the notes stay beside the recording.
    """
    if session is None and working_file(output).exists():
        return
    with _LOCK:
        beside, inside = notes_beside(session or output), notes_in(output)
        if not beside or not output.exists():
            return
        if set(beside) - set(inside):
            _write(output, list(dict.fromkeys([*inside, *beside])))
        if session is None:
            _beside(output).unlink(missing_ok=True)


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
            kept = f"they stay in {_beside(output)}"
            raise OutputError(f"the notes cannot be put into {output} ({reason(error)}); {kept}") from None


def _fixed(texts: Sequence[str]) -> NDArray[np.bytes_]:
    # Of a fixed length: HDF5 keeps text of variable length where no checksum covers it.
    encoded = [text.encode() for text in texts]
    return np.array(encoded, h5py.string_dtype("utf-8", max(1, *map(len, encoded))))


def _append(output: Path, notes: Sequence[Note]) -> None:
    if not notes:
        return
    try:
        with _beside(output).open("ab+") as file:
            if file.tell() and (file.seek(-1, os.SEEK_END), file.read(1))[1] != b"\n":
                file.write(b"\n")  # the last one was not written whole
            file.writelines(msgspec.json.encode(note) + b"\n" for note in notes)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise OutputError(f"notes cannot be kept beside {output} ({error.strerror}); make room and write them again") from None


def _beside(output: Path) -> Path:
    return output.with_name(output.name + ".notes")
