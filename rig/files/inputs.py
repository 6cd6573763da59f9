"""Files that a command is given: only real files are opened, and texts only up to a size."""

from __future__ import annotations

import errno
from pathlib import Path

#: Bytes of a result in JSON, and of a plan, a mapping or a description in TOML, whose reader takes a second for a MiB.
TEXT_MOST, TOML_MOST = 32 << 20, 2 << 20


def content_of(path: Path, most: int = TEXT_MOST) -> bytes:
    """The content of a file.

    Raises
    ------
    OSError
        Where there is none, it is a pipe or a device (which may never answer), or it is longer than `most` bytes.
    """
    regular(path)
    size = path.stat().st_size
    if size > most:
        raise OSError(errno.EFBIG, f"it has {size >> 20} MiB and at most {most >> 20} are read")
    return path.read_bytes()


def regular(path: Path) -> None:
    """Refuse what is no file.

    Raises
    ------
    OSError
        Where there is nothing, a folder, a pipe or a device.
    """
    # An absent file is told by the system in its own words.
    path.stat()
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "it is a folder")
    if not path.is_file():
        raise OSError(errno.EINVAL, "it is a pipe or a device, not a file")
