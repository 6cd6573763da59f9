"""A simulated instrument at the end of a pseudo-terminal or of a TCP port of this machine, served from a thread."""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from isorig.drivers.simulated.wire import PtyWire, Wire


class Peer(Protocol):
    """The far end: takes what came, gives what goes back."""

    @property
    def unplugged(self) -> bool:
        """Whether the wire is to be cut."""
        ...

    def step(self, data: bytes) -> bytes:
        """Bytes in, bytes out; called often also where nothing came."""
        ...


class TcpWire:
    """The instrument's end of a TCP connection on the loopback, for machines without pseudo-terminals."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = f"socket://127.0.0.1:{self._listening.getsockname()[1]}"
        self._link: socket.socket | None = None

    def read(self, timeout: float) -> bytes:
        """What arrived within `timeout` seconds, empty where nothing did."""
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
        """Send what fits within `timeout` seconds; the number of bytes taken."""
        if self._link is None or not select.select([], [self._link], [], timeout)[1]:
            return 0
        try:
            return self._link.send(data)
        except OSError:
            return 0

    def close(self) -> None:
        """Unplug."""
        if self._link is not None:
            self._link.close()
        self._listening.close()


def exchange(wire: Wire, peer: Peer, over: Callable[[], bool]) -> None:
    """Carry bytes between a wire and a peer until it is over, or the peer is unplugged."""
    waiting = b""
    while not over():
        if peer.unplugged:
            wire.close()
            return
        waiting += peer.step(wire.read(0.0 if waiting else 0.005))
        if waiting:
            waiting = waiting[wire.write(waiting, 0.02) :]


@contextmanager
def served(peer: Peer, wire: PtyWire | TcpWire | None = None) -> Iterator[str]:
    """Serve a peer from a thread of this process; the port to open."""
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
