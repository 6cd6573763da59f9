"""Input files of a command: only regular files are opened, and text files only up to a size."""

import errno
import os
import stat
from io import BufferedReader
from pathlib import Path

#: Maximum bytes of a result in JSON, and of a plan, mapping or description in TOML, whose reader takes a second per MiB.
TEXT_MOST, TOML_MOST = 32 << 20, 2 << 20


def import_first(path: Path) -> str:
    """What to do with a file that is not a recording: the commands that import it, if its format can be imported."""
    from isorig.rig.exchange.formats import FORMATS

    made = f"{path.stem}.h5" if path.suffix.lower() != ".h5" else f"{path.stem}-imported.h5"
    if path.suffix.lower() == ".toml":
        return f"if it is a mapping, import it first: rig import {path} -o {made}"
    if path.suffix.lower() not in FORMATS:
        return f"give a recording, or import a file that ends in {', '.join(FORMATS)}"
    return f"import it first: rig import --draft {path} -o mapping.toml, correct what has a ?, rig import mapping.toml -o {made}"


def content_of(path: Path, most: int = TEXT_MOST) -> bytes:
    """The content of a file. Raises OSError if it does not exist, is a pipe or a device (which may block forever), or is longer
    than `most` bytes."""
    regular(path)
    size = path.stat().st_size
    if size > most:
        raise OSError(errno.EFBIG, f"it has {size >> 20} MiB but at most {most >> 20} are read")
    return path.read_bytes()


def opened_regular(path: Path) -> BufferedReader:
    """A regular file open for reading, even if its path becomes that of a pipe in the meantime. Raises OSError if there is
    nothing, or a folder, a pipe or a device."""
    regular(path)
    # Without O_NONBLOCK, opening a pipe waits for its writer.
    file = os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)), "rb")
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "it is a pipe or a device, not a file")
    return file


def regular(path: Path) -> None:
    """Raise OSError for anything that is not a regular file: nothing, a folder, a pipe or a device."""
    # For an absent file the system raises its own error.
    path.stat()
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "it is a folder")
    if not path.is_file():
        raise OSError(errno.EINVAL, "it is a pipe or a device, not a file")
