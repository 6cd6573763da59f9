"""One session at a time on a port and on an output: locks of the operating system, released when their process ends."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from isorig.rig.errors import OutputError, PlanError

if sys.platform == "win32":
    import msvcrt

    def _lock(handle: int) -> None:
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _lock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def output_locked(output: Path) -> Iterator[None]:
    """Lock the output file for this session.

    Raises
    ------
    OutputError
        Another session has locked it, or it cannot be written.
    """
    lock = output.with_name(f".{output.name}.lock")
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        handle, holder = _taken(lock)
    except OSError as error:
        raise OutputError(f"{output} cannot be written ({error.strerror}); choose another place with -o") from None
    if handle is None:
        raise OutputError(f"{output} is being measured by another session{holder}; wait for its end, or give another -o")
    with _held(lock, handle):
        yield


@contextmanager
def port_locked(port: str) -> Iterator[None]:
    """Lock a port for this session; different names of one device are the same port.

    Raises
    ------
    PlanError
        Another session has locked it.
    """
    name = port.lower().replace("localhost", "127.0.0.1") if "://" in port else _device(port)
    lock = Path(tempfile.gettempdir()) / f"rig-port-{hashlib.sha256(name.encode()).hexdigest()[:20]}.lock"
    try:
        handle, holder = _taken(lock)
    except OSError as error:
        raise PlanError(
            f"the port {port} cannot be locked in {lock.parent} ({error.strerror}); make that folder writable"
        ) from None
    if handle is None:
        raise PlanError(f"the port {port} is in use by another session{holder}; wait for its end, or end it")
    with _held(lock, handle):
        yield


def _device(port: str) -> str:
    # The number of a pseudo-terminal that was closed is given to the next one: the time it was made parts the two.
    path = os.path.realpath(port)
    if path.startswith("/dev/pts/"):
        with suppress(OSError):
            return f"{path} {Path(path).stat().st_ctime_ns}"
    return path


def _taken(lock: Path) -> tuple[int | None, str]:
    # The handle of the lock, None if another process holds it; and which process.
    while True:
        try:
            handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        except PermissionError:
            # The file of another user: it can be locked, but not written.
            handle = os.open(lock, os.O_RDONLY)
        try:
            _lock(handle)
        except OSError:
            with suppress(OSError):
                holder = os.pread(handle, 20, 0).decode("ascii", "replace").strip() if hasattr(os, "pread") else ""
            os.close(handle)
            return None, f" (process {holder})" if holder.isdigit() else ""
        with suppress(OSError):
            if os.path.samestat(os.fstat(handle), lock.stat()):
                break
        # It was released and removed between the two steps.
        os.close(handle)
    with suppress(OSError):
        os.ftruncate(handle, 0)
        os.write(handle, str(os.getpid()).encode())
    return handle, ""


@contextmanager
def _held(lock: Path, handle: int) -> Iterator[None]:
    try:
        yield
    finally:
        with suppress(OSError):
            lock.unlink(missing_ok=True)
        os.close(handle)
