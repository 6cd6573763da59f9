"""What stands in for a browser: a socket that answers each frame, or does not, and a screen that is served in a thread."""

from __future__ import annotations

import http.client
import json
import socket
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

from isorig.rig.view.messages import PageRequest, SessionState
from isorig.rig.view.server import ScreenServer, read_frame
from isorig.rig.view.sources import Reading
from isorig.rig.view.state import Subject


def request(address: str, path: str = "", **headers: str) -> tuple[int, str, dict[str, str]]:
    """Status, text and headers of a request for a file of the page; a header that is None is left out."""
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(str(parts.hostname), parts.port or 0, timeout=10.0)
    connection.putrequest("GET", parts.path + path if not path.startswith("/") else path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    told = answer.status, answer.read().decode(), dict(answer.getheaders())
    connection.close()
    return told


class Socket:
    """A page's socket, byte by byte, so that a test decides what is read and answered.

    Parameters
    ----------
    address
        The screen's.
    host, origin, path
        What the request tells instead of what a browser would; no origin where empty.
    """

    def __init__(self, address: str, *, host: str = "", origin: str | None = None, path: str = "") -> None:
        parts = urlsplit(address)
        self._wire = socket.create_connection((parts.hostname, parts.port), timeout=20.0)
        origin = f"http://{parts.netloc}" if origin is None else origin
        lines = [
            f"GET {path or parts.path + 'live'} HTTP/1.1", f"Host: {host or parts.netloc}", "Upgrade: websocket",
            "Connection: Upgrade", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version: 13",
            *([f"Origin: {origin}"] if origin else []),
        ]  # fmt: skip
        self._wire.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        answer = b""
        while b"\r\n\r\n" not in answer and (byte := self._wire.recv(1)):
            answer += byte
        self.status = int(answer.split()[1])

    def frame(self, *, answer: bool = True) -> tuple[dict[str, Any], dict[str, Any]]:
        """The next frame's head and plots; it is said to be drawn unless it is not to be answered."""
        kind, message = self.read()
        assert kind == 2, (kind, message)
        head, plots = read_frame(message)
        if answer:
            self.say({"say": "drawn", "frame": head["frame"], "values": int(sum(rows.size for rows in plots.values()))})
        return head, plots

    def read(self) -> tuple[int, bytes]:
        """Kind and content of the next message: 2 a frame, 8 the end, with its number."""
        while True:
            kind, length = self._exactly(2)
            length &= 127
            if length > 125:
                length = int.from_bytes(self._exactly(2 if length == 126 else 8), "big")
            content = self._exactly(length)
            if kind & 15 != 9:  # a ping
                return kind & 15, content

    def say(self, what: Any) -> None:
        """Send JSON."""
        self.send(json.dumps(what).encode())

    def send(self, content: bytes, kind: int = 1) -> None:
        """Send a message as a browser would, masked."""
        size = len(content)
        length = bytes([0x80 | size]) if size < 126 else bytes([0x80 | 126]) + size.to_bytes(2, "big")
        self._wire.sendall(bytes([0x80 | kind]) + length + b"\0\0\0\0" + content)

    def ended(self) -> int:
        """Read on to the end that the screen makes; its number."""
        while (message := self.read())[0] != 8:
            pass
        return int.from_bytes(message[1][:2], "big")

    def silent(self, seconds: float) -> bool:
        """Whether nothing comes for so long."""
        self._wire.settimeout(seconds)
        try:
            return not self._wire.recv(1, socket.MSG_PEEK)
        except TimeoutError:
            return True
        finally:
            self._wire.settimeout(20.0)

    def close(self) -> None:
        """Hang up."""
        self._wire.close()

    def _exactly(self, count: int) -> bytes:
        content = b""
        while len(content) < count:
            more = self._wire.recv(count - len(content))
            if not more:
                raise EOFError
            content += more
        return content


class Served:
    """A screen in a thread, what pages asked of it, and its address."""

    def __init__(self, readings: Iterator[Reading], subject: Subject) -> None:
        self.asked: list[PageRequest] = []
        self.screen = ScreenServer(subject, readings, self.asked.append)
        self.over, self._listening = threading.Event(), threading.Event()
        self.address = ""
        self._thread = threading.Thread(target=lambda: self.screen.run(self.over.is_set, self._up), daemon=True)

    def _up(self, address: str) -> None:
        self.address = address
        self._listening.set()

    def begin(self) -> Served:
        """Serve it."""
        self._thread.start()
        assert self._listening.wait(20.0)
        return self

    def end(self) -> None:
        """Let it go."""
        self.over.set()
        self._thread.join(20.0)
        assert not self._thread.is_alive()


@contextmanager
def served(
    readings: Iterable[Reading] = (), subject: Subject | None = None, standing: SessionState | None = None
) -> Iterator[Served]:
    """A screen that is served while the block lasts."""
    screen = Served(iter(readings), subject or Subject(title="lab.h5", mode="session")).begin()
    if standing is not None:
        screen.screen.stand(standing)
    try:
        yield screen
    finally:
        screen.end()


def until(true: Any, seconds: float = 20.0) -> None:
    """Wait until something is so."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.01)
