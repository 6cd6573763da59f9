"""Results on disk: written whole under a temporary name, then put in place."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from rig.errors import OutputError

if TYPE_CHECKING:
    from analysis.measured import FloatArray


@contextmanager
def replaced(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its place when the block ends well, and is removed when it does not."""
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
        temporary.chmod(0o644)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> Path:
    """Write text whole or not at all."""
    with replaced(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


def write_json(path: str | Path, content: Any) -> Path:
    """Write JSON, indented, numbers as numbers."""
    return write_text(path, msgspec.json.format(msgspec.json.encode(content), indent=2).decode() + "\n")


def write_csv(path: str | Path, columns: Mapping[str, FloatArray]) -> Path:
    """Write columns of equal length, nine digits each."""
    rows = zip(*columns.values(), strict=True)
    return write_text(path, "\n".join([",".join(columns), *(",".join(f"{value:.9g}" for value in row) for row in rows)]) + "\n")
