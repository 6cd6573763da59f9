"""Results on disk: written under a temporary name, then renamed."""

from __future__ import annotations

import csv
import io
import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from isorig.rig.errors import OutputError

if TYPE_CHECKING:
    from isorig.analysis.campaign import FloatArray


@contextmanager
def replaced(path: str | Path) -> Iterator[Path]:
    """A temporary path next to `path` that replaces it if the block succeeds, and is removed otherwise."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        os.close(handle)
    except OSError as error:
        raise OutputError(f"{path} cannot be written ({error.strerror}); choose another place with -o") from None
    temporary = Path(name)
    try:
        yield temporary
        try:
            temporary.chmod(0o644)
            _sync(temporary)
            temporary.replace(path)
            _sync(path.parent)
        except OSError as error:
            raise OutputError(f"{path} cannot be written ({reason(error)}); choose another place with -o") from None
    finally:
        temporary.unlink(missing_ok=True)


def remove_leftovers(path: Path) -> None:
    """Remove leftovers of `replaced` from killed programs; only for the single writer of this file."""
    left = re.compile(re.escape(f".{path.name}.") + "[a-z0-9_]{8}")
    with suppress(OSError):
        for other in path.parent.iterdir():
            if left.fullmatch(other.name) and other.is_file() and not other.is_symlink():
                other.unlink(missing_ok=True)


#: Maximum number of characters quoted from another program's error: it may quote a file at length.
REASON = 200


def reason(error: BaseException) -> str:
    """The text of an error, in one displayable line."""
    text = displayable(getattr(error, "strerror", None) or (str(error).splitlines() or [""])[0] or type(error).__name__)
    return text if len(text) <= REASON else text[:REASON] + " ..."


def displayable(text: str) -> str:
    """The text in one line, without characters that a terminal would obey (names and texts come from files of others)."""
    return text if text.isprintable() else "".join(letter if letter.isprintable() else "?" for letter in text)


#: First characters of a text that a spreadsheet takes for a formula (OWASP, "CSV injection").
FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")


def cell(value: Any) -> Any:
    """A value for a table in text form: text that a spreadsheet would evaluate is preceded by an apostrophe."""
    if not isinstance(value, str) or not value.startswith(FORMULA):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def reserve(path: Path, size: int) -> None:
    """Reserve disk space for a file, if the system supports it: HDF5 does not survive a full disk. Raises OSError if there is not
    enough space."""
    if hasattr(os, "posix_fallocate") and size > 0:
        with path.open("r+b") as file:
            os.posix_fallocate(file.fileno(), 0, size)


def _sync(path: Path) -> None:
    # To the disk, so that a power loss cannot destroy both the old and the new content.
    if path.is_dir() and os.name == "nt":
        return
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_text(path: str | Path, text: str) -> Path:
    """Write text atomically."""
    with replaced(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


def write_json(path: str | Path, content: Any) -> Path:
    """Write JSON, indented, numbers as numbers; one that is not finite is null."""
    return write_text(path, msgspec.json.format(msgspec.json.encode(content), indent=2).decode() + "\n")


def csv_text(names: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """A table as CSV; None is an empty cell."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(map(cell, row) for row in (names, *rows))
    return text.getvalue()


def write_csv(path: str | Path, columns: Mapping[str, FloatArray]) -> Path:
    """Write columns of equal length, nine digits each."""
    row = ",".join(["%.9g"] * len(columns)) + "\n"
    values = zip(*(column.tolist() for column in columns.values()), strict=True)
    return write_text(path, ",".join(map(cell, columns)) + "\n" + "".join([row % each for each in values]))
