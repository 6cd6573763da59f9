"""A simulated instrument on a pseudo-terminal or on a TCP port of the loopback interface, served by a thread."""

import os
import select
import socket
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from isorig.drivers.errors import SettingError

#: Bytes that may wait for the connection before a peer is asked for more.
BACKLOG = 1 << 12


class Peer(Protocol):
    """A simulated instrument: receives bytes, returns bytes."""

    @property
    def unplugged(self) -> bool:
        """Whether the connection is to be cut."""

    def step(self, data: bytes) -> bytes:
        """Bytes received, bytes to send; called frequently, also without input."""


class PtyWire:
    """The instrument's end of a pseudo-terminal; `port` is a link to the other end, which pyserial opens.

    The system gives the number of a closed pseudo-terminal to the next one that is opened. The link goes first, so a driver that
    opens its port again after an unplug never reaches another program's terminal.
    """

    def __init__(self) -> None:
        if sys.platform == "win32":
            raise SettingError("Windows has no pseudo-terminals; run the simulated instrument on Linux or macOS")
        import pty
        import tty

        self._own, self._other = pty.openpty()
        tty.setraw(self._other)
        os.set_blocking(self._own, False)
        self._folder = tempfile.TemporaryDirectory(prefix="rig-pty-")
        link = Path(self._folder.name) / "port"
        link.symlink_to(os.ttyname(self._other))
        self.port = str(link)

    def read(self, timeout: float) -> bytes:
        """Bytes that arrived within `timeout` seconds, or empty."""
        try:
            return os.read(self._own, 65536) if select.select([self._own], [], [], timeout)[0] else b""
        except (OSError, ValueError):
            return b""

    def write(self, data: bytes, timeout: float) -> int:
        """Send what fits within `timeout` seconds; returns the number of bytes sent."""
        try:
            return os.write(self._own, data) if select.select([], [self._own], [], timeout)[1] else 0
        except (OSError, ValueError):
            return 0

    def close(self) -> None:
        """Disconnect."""
        self._folder.cleanup()
        for end in (self._own, self._other):
            if end >= 0:
                os.close(end)
        self._own = self._other = -1


class TcpWire:
    """The instrument's end of a TCP connection on the loopback interface, for systems without pseudo-terminals."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = f"socket://127.0.0.1:{self._listening.getsockname()[1]}"
        self._link: socket.socket | None = None

    def read(self, timeout: float) -> bytes:
        ends = [self._link or self._listening]
        if not select.select(ends, [], [], timeout)[0]:
            return b""
        if self._link is None:
            self._link = self._listening.accept()[0]
            return b""
        try:
            data = self._link.recv(65536)
        except OSError:
            data = b""
        if not data:
            self._link.close()
            self._link = None
        return data

    def write(self, data: bytes, timeout: float) -> int:
        if self._link is None or not select.select([], [self._link], [], timeout)[1]:
            return 0
        try:
            return self._link.send(data)
        except OSError:
            return 0

    def close(self) -> None:
        if self._link is not None:
            self._link.close()
        self._listening.close()


def exchange(wire: PtyWire | TcpWire, peer: Peer, over: Callable[[], bool]) -> None:
    """Transfer bytes between a connection and a peer until `over`, or until the peer is unplugged."""
    waiting, busy = b"", False
    while not over():
        if peer.unplugged:
            wire.close()
            return
        data = wire.read(0.0 if busy else 0.005)
        if data or len(waiting) < BACKLOG:
            waiting += peer.step(data)
        busy = bool(waiting)
        if busy:
            waiting = waiting[wire.write(waiting, 0.02) :]


@contextmanager
def served(peer: Peer, wire: PtyWire | TcpWire | None = None) -> Iterator[str]:
    """Serve a peer from a thread of this process; yields the port to open."""
    wire = wire or PtyWire()
    over = threading.Event()
    thread = threading.Thread(target=exchange, args=(wire, peer, over.is_set), name="simulated instrument", daemon=True)
    thread.start()
    try:
        yield wire.port
    finally:
        over.set()
        thread.join()
        wire.close()
