"""One session at a time on a port and on an output: locks of the operating system, released when their process ends.

A port is locked by what the system sees: a device by its number, an address by the peers that it resolves to. Its spelling, and
the environment of the session (the folder for temporary files), make no difference.
"""

import hashlib
import ipaddress
import os
import socket
import stat
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from urllib.parse import urlsplit

from filelock import FileLock, Timeout

from isorig.rig.errors import OutputError, PlanError
from isorig.rig.files.output import reason

#: Folder of the locks of ports, the same for all users and in every environment.
PORTS = Path("C:/ProgramData" if sys.platform == "win32" else "/tmp")


class HeldError(Exception):
    """Another process holds the lock; the text names it if it is known."""


@contextmanager
def output_locked(output: Path) -> Iterator[None]:
    """Lock the output file for this session. Raises OutputError if another session has locked it, or it cannot be written."""
    with ExitStack() as stack:
        try:
            output.parent.mkdir(parents=True, exist_ok=True)
            stack.enter_context(locked(output.with_name(f".{output.name}.lock")))
        except OSError as error:
            raise OutputError(f"{output} cannot be written ({reason(error)}); choose another place with -o") from None
        except HeldError as holder:
            raise OutputError(
                f"{output} is being measured by another session{holder}; wait for its end, or give another -o"
            ) from None
        yield


@contextmanager
def port_locked(port: str) -> Iterator[None]:
    """Lock a port for this session; different names of one device, and of one address, are the same port.

    The port "virtual" is never in use: every session has its own simulated instrument. Raises PlanError if another session has
    locked it.
    """
    with ExitStack() as stack:
        try:
            for name in sorted(identities(port)) if port != "virtual" else ():
                stack.enter_context(locked(PORTS / f"rig-port-{hashlib.sha256(name.encode()).hexdigest()[:20]}.lock"))
        except OSError as error:
            raise PlanError(f"the port {port} cannot be locked in {PORTS} ({reason(error)}); make that folder writable") from None
        except HeldError as holder:
            raise PlanError(f"the port {port} is in use by another session{holder}; wait for its end, or end it") from None
        yield


def identities(port: str) -> frozenset[str]:
    """What the system sees behind the name of a port: the number of a device, or the peers of an address.

    Of a GPIB address at an adapter (GPIB::11@/dev/ttyUSB0) the adapter counts.
    """
    port = port.rpartition("@")[2] if "::" in port.partition("@")[0] else port
    if "::" in port and "://" not in port:
        return frozenset((port.lower(),))
    if "://" in port:
        with suppress(ValueError, OSError):
            parts = urlsplit(port)
            return frozenset(_peers(parts.hostname or "", parts.port or 0)) or frozenset((port,))
        return frozenset((port,))
    path = os.path.realpath(port)
    try:
        about = Path(path).stat()
    except OSError:
        # The name of a device in its maker's library is the same in every folder.
        return frozenset((port if Path(port).name == port else path,))
    if not stat.S_ISCHR(about.st_mode):
        return frozenset((path,))
    # The number of a pseudo-terminal that was closed is given to the next one: the time it was made parts the two.
    made = f" {about.st_ctime_ns}" if path.startswith("/dev/pts/") else ""
    return frozenset((f"device {about.st_rdev}{made}",))


def _peers(host: str, port: int) -> Iterator[str]:
    for *_, place in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM):
        address = ipaddress.ip_address(str(place[0]).partition("%")[0])
        if isinstance(address, ipaddress.IPv6Address):
            address = address.ipv4_mapped or address
        # A server that listens on all addresses of this computer is reached at each of them.
        yield f"{'this computer' if _is_own(address) else address} {port}"


def _is_own(address: ipaddress.IPv4Address | ipaddress.IPv6Address) -> bool:
    family = socket.AF_INET if address.version == 4 else socket.AF_INET6
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((str(address), 0))
    except OSError:
        return address.is_loopback
    return True


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock a file, which is created and removed again; `HeldError` if another process or thread has locked it."""
    # Open to other users, whose sessions lock the same file.
    lock = FileLock(path, timeout=0, mode=0o666, is_singleton=False)
    try:
        lock.acquire()
    except Timeout:
        holder = ""
        with suppress(OSError):
            holder = path.read_bytes()[:20].decode("ascii", "replace").strip()
        raise HeldError(f" (process {holder})" if holder.isdigit() else "") from None
    try:
        with suppress(OSError):
            path.write_text(str(os.getpid()))
        yield
    finally:
        # Removed while it is still held: who opened it meanwhile finds that it has no name any more, and tries again.
        with suppress(OSError):
            path.unlink(missing_ok=True)
        lock.release()
