"""HDF5 files from other programs: another process checks them before they are opened here.

The library behind h5py crashes on some damaged files and hangs on others, and a small file may declare more data than fits into
memory. `isorig.rig.files.hdf_walk` detects this in a separate process, and rejects files with external links.
"""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import IO, TYPE_CHECKING, Literal

from isorig.rig.errors import RecordingError
from isorig.rig.files.forked import ForkedProcess, has_one_thread
from isorig.rig.files.inputs import import_first
from isorig.rig.files.output import reason

if TYPE_CHECKING:
    import h5py

#: Seconds of a processor within which the other process has to show progress; seconds of the clock within which it has to start,
#: and after which it is taken for one that waits forever: on a busy host it may have no processor for long.
STILL, START, WAITS = 6.0, 60.0, 60.0
#: Minimum reading speed for a MATLAB file, bytes per second.
SPEED = 10 << 20
#: Number of files whose check is remembered, so that a command that opens a file twice checks it once.
REMEMBERED = 64
#: Bytes of chunks cached for each dataset while it is read: runs are read from start to end.
CHUNK_CACHE = 1 << 20
SIGNATURE = b"\x89HDF\r\n\x1a\n"


FileKind = Literal["hdf5", "matlab"]


class _Walker:
    """The other process, a fork of this one if that is safe, and the thread that reads its answers."""

    def __init__(self) -> None:
        self._process = _forked() if has_one_thread() else _started()
        self._lines: queue.Queue[str] = queue.Queue()
        assert self._process.stdout is not None
        self._listener = threading.Thread(target=self._listen, args=(self._process.stdout,), daemon=True)
        self._listener.start()
        self._started = False

    def ask(self, kind: FileKind, path: Path, patience: float) -> dict[str, str] | None:
        """The answer for a file; None if the process crashed or hung on it. Raises RecordingError if the process does not
        start."""
        if not self._started and self._answer(START) is None:
            raise RecordingError(f"{sys.executable} could not be started to check a file; check the installation")
        self._started = True
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps([kind, os.fsdecode(path), patience]) + "\n")
            self._process.stdin.flush()
        except OSError:
            return None
        return self._answer(max(patience, WAITS))

    def end(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        # Afterwards this process has one thread less: the next one may be forked, too.
        self._listener.join()

    def _answer(self, patience: float) -> dict[str, str] | None:
        with suppress(queue.Empty):
            while line := self._lines.get(timeout=patience):
                if line != ".\n":
                    answer: dict[str, str] = json.loads(line)
                    return answer
        return None

    def _listen(self, lines: IO[str]) -> None:
        for line in lines:
            self._lines.put(line)
        self._lines.put("")


def _forked() -> ForkedProcess:
    # This process imports the libraries for a recording anyway; another interpreter would import them once more.
    from isorig.rig.files import hdf_walk

    return ForkedProcess(hdf_walk.main)


def _started() -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-I", str(Path(__file__).with_name("hdf_walk.py"))],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, encoding="utf-8",
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip


_lock = threading.Lock()


def start_checks() -> None:
    """Start the other process before this one has threads, or, where it cannot be forked, so that it starts while this one
    imports; files are checked later."""
    with _lock:
        _walker(os.getpid())


def survived(path: Path) -> None:
    """Reject, with a RecordingError, a file of MATLAB's version 5 whose reading crashes or hangs a process."""
    with _lock:
        _asked("matlab", path, STILL + path.stat().st_size / SPEED)


@lru_cache(maxsize=1)
def _walker(pid: int) -> _Walker:
    # A forked process, which has another `pid`, shares its parent's pipes, so it needs another checking process.
    return _Walker()


def _asked(kind: FileKind, path: Path, patience: float) -> dict[str, str]:
    walker = _walker(os.getpid())
    try:
        answer = walker.ask(kind, path.absolute(), patience)
        if answer is None:
            raise RecordingError(f"{path} is damaged so that reading it never ends; copy it again from its source")
    except RecordingError:
        walker.end()
        _walker.cache_clear()
        raise
    if "refused" in answer:
        raise RecordingError(f"{path}: {answer['refused']}")
    return answer


@lru_cache(maxsize=REMEMBERED)
def _walk(path: Path, begin: bytes, identity: tuple[int, ...]) -> None:
    # A file with another `identity` is another one, although it has the same path.
    answer = _asked("hdf5", path, STILL)
    if "damaged" in answer:
        raise RecordingError(f"{path} is damaged ({answer['damaged']}); copy it again from its source")
    if "closed" in answer:
        raise RecordingError(_unreadable(path, begin, answer["closed"]))


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """An HDF5 file open for reading, after the check. Raises RecordingError with what is wrong with the file, and what to do."""
    import h5py

    begin, identity = _begin(path)
    with _lock:
        _walk(path, begin, identity)
    try:
        file = h5py.File(path, "r", rdcc_nbytes=CHUNK_CACHE)
    except OSError as error:
        raise RecordingError(_unreadable(path, begin, reason(error))) from None
    with file:
        yield file


def _begin(path: Path) -> tuple[bytes, tuple[int, ...]]:
    try:
        about = path.stat()
        if path.is_dir():
            raise RecordingError(f"{path} is a folder, not a recording; give the path of a file")
        if not path.is_file():
            # A pipe would block forever.
            raise RecordingError(f"{path} is not a file; give the path of a recording")
        with path.open("rb") as stream:
            begin = stream.read(len(SIGNATURE))
    except FileNotFoundError:
        raise RecordingError(f"{path} does not exist; give the path of a recording") from None
    except OSError as error:
        raise RecordingError(f"{path} cannot be read ({error.strerror}); change its permissions or copy it") from None
    return begin, (about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns)


def _unreadable(path: Path, begin: bytes, message: str) -> str:
    if not begin:
        return f"{path} is empty; record or copy it again"
    if begin != SIGNATURE:
        if path.suffix.lower() in (".h5", ".hdf5"):
            return f"{path} is not an HDF5 file, although its name ends like one; give a recording"
        return f"{path} is not a recording; {import_first(path)}"
    if "truncated" in message:
        return f"{path} is truncated ({path.stat().st_size} bytes); copy it again from its source"
    return f"{path} is damaged or was never closed ({message}); copy it again, or recover it if its recorder was killed"
