"""The page about a session on the loopback interface: what it shows is read in a thread; who may see it, and what it may ask.

A page is sent a frame after it has drawn the previous one, so a slow page misses frames and delays nothing.
"""

import asyncio
import hmac
import logging
import secrets
import struct
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from isorig.rig.errors import RigError
from isorig.rig.view.messages import FrameDrawn, PageRequest, SessionState
from isorig.rig.view.snapshot import Plot, Snapshot, SnapshotBuilder
from isorig.rig.view.sources import Reading
from isorig.rig.view.state import Subject, state_of

#: Seconds between two frames, and for sending the last frame to the pages.
FRAME, LAST = 0.2, 1.5
#: Consecutive failed readings before the screen gives up.
PATIENCE = 10
#: Maximum size of a message from a page, bytes.
MESSAGE = 4096
HERE = Path(__file__).parent
FILES = {
    "": ("page.html", "text/html; charset=utf-8"), "page.css": ("page.css", "text/css; charset=utf-8"),
    "page.js": ("page.js", "text/javascript; charset=utf-8"), "uplot.css": ("vendor/uPlot.min.css", "text/css; charset=utf-8"),
    "uplot.js": ("vendor/uPlot.iife.min.js", "text/javascript; charset=utf-8"),
}  # fmt: skip
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin", "Cross-Origin-Opener-Policy": "same-origin",
}  # fmt: skip


@dataclass
class PageTally:
    """What pages have drawn, and how many were disconnected because they did not respond."""

    frames: int = 0
    values: int = 0
    dropped: int = 0


class ScreenServer:
    """One page about one session or recording, in at most `most_pages` browsers; one that has not drawn its last frame for
    `stalled` seconds is disconnected.

    Its readings of the measured data are taken in a separate thread; `ask` is called with the requests of a page.
    """

    def __init__(
        self, subject: Subject, readings: Iterator[Reading], ask: Callable[[PageRequest], None] = lambda asked: None
    ) -> None:
        self._subject, self._readings, self.ask = subject, readings, ask
        self._builder = SnapshotBuilder(subject.planned, judge=subject.mode != "session")
        self._picture = Snapshot()
        self._standing: SessionState | None = SessionState() if subject.mode == "session" else None
        self._failed: Exception | None = None
        self.token, self.port = secrets.token_urlsafe(24), 0
        self.pages: set[_Socket] = set()
        self.tally, self.stalled, self.most_pages = PageTally(), 30.0, 8

    def stand(self, standing: SessionState) -> None:
        """Update the session's state."""
        self._standing = standing

    def run(self, over: Callable[[], bool], listening: Callable[[str], None]) -> PageTally:
        """Serve the page until `over` returns True; `listening` is called with its address. Returns what pages have drawn. Raises
        RigError or AnalysisError if the data to be shown cannot be read."""
        return asyncio.run(self._run(over, listening))

    def allows(self, host: str, origin: str | None, token: str, *, socket: bool) -> bool:
        """Whether a request comes from this screen's own page: checks its host, its origin and the token of its address."""
        hosts = (f"127.0.0.1:{self.port}", f"localhost:{self.port}")
        own = host in hosts and hmac.compare_digest(token.encode(), self.token.encode())
        # A browser always sends the origin of a socket; if there is one, it must be this host.
        return own and (origin == f"http://{host}" if socket or origin is not None else True)

    async def _run(self, over: Callable[[], bool], listening: Callable[[str], None]) -> PageTally:
        # Refused requests are not logged in the terminal, where the session prints.
        logging.getLogger("tornado").setLevel(logging.ERROR)
        given = {"server": self}
        application = Application(
            [(r"/([\w-]{1,99})/live", _Socket, given), (r"/([\w-]{1,99})/([\w.]{0,20})", _File, given)],
            default_handler_class=_Guarded, default_handler_args=given, websocket_max_message_size=MESSAGE,
            websocket_ping_interval=20.0, log_function=lambda handler: None,
        )  # fmt: skip
        sockets = bind_sockets(0, "127.0.0.1")
        self.port = sockets[0].getsockname()[1]
        http = HTTPServer(application, max_header_size=1 << 14, max_body_size=MESSAGE, idle_connection_timeout=60.0)
        http.add_sockets(sockets)
        threading.Thread(target=self._read, name="screen's readings", daemon=True).start()
        listening(f"http://127.0.0.1:{self.port}/{self.token}/")
        while not over() and self._failed is None:
            self._show()
            await asyncio.sleep(FRAME)
        for _ in range(round(LAST / FRAME) if self.pages else 0):
            self._show()
            await asyncio.sleep(FRAME)
        http.stop()
        for page in list(self.pages):
            page.close(1001, "the screen has ended")
        await asyncio.sleep(0.05)
        await http.close_all_connections()
        if self._failed is not None:
            raise self._failed
        return self.tally

    def _show(self) -> None:
        # The newest frame, to every page that has drawn its last one.
        ready = [page for page in list(self.pages) if page.ready()]
        if ready:
            picture = self._picture
            state = state_of(self._subject, picture, self._standing)
            for page in ready:
                page.send(state, picture.plots)

    def _read(self) -> None:
        unread = 0
        try:
            for reading in self._readings:
                try:
                    self._builder.see(reading, self._publish)
                    unread = 0
                except (RigError, OSError, RuntimeError):
                    # It was read between two writes; the next reading is complete.
                    unread += 1
                    if unread >= PATIENCE:
                        raise
        except Exception as error:
            # Raised in the loop of the page, which would otherwise freeze without a message.
            self._failed = error

    def _publish(self, picture: Snapshot) -> None:
        self._picture = picture


class _Guarded(RequestHandler):
    def initialize(self, server: ScreenServer) -> None:
        self.server = server

    def set_default_headers(self) -> None:
        for name, value in HEADERS.items():
            self.set_header(name, value)
        self.clear_header("Server")

    def prepare(self) -> None:
        socket = isinstance(self, WebSocketHandler)
        token = self.path_args[0] if self.path_args else ""
        if not self.server.allows(self.request.host, self.request.headers.get("Origin"), token, socket=socket):
            raise HTTPError(403)

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish("This is not the address of the screen; open the one that the session printed.\n")


class _File(_Guarded):
    def get(self, token: str, name: str) -> None:
        if name not in FILES:
            raise HTTPError(404)
        path, kind = FILES[name]
        self.set_header("Content-Type", kind)
        self.finish((HERE / path).read_bytes())


class _Socket(_Guarded, WebSocketHandler):
    """The connection of a page."""

    def initialize(self, server: ScreenServer) -> None:
        super().initialize(server)
        self._sent: dict[str, Plot] = {}
        self._frame = self._drawn = 0
        self._since = time.monotonic()

    def check_origin(self, origin: str) -> bool:
        """Checked before, together with host and token."""
        return self.server.allows(self.request.host, origin, self.path_args[0], socket=True)

    def open(self, *args: str) -> None:
        """A page has connected."""
        if len(self.server.pages) >= self.server.most_pages:
            self.close(1013, "too many pages are open; close one")
            return
        self.set_nodelay(True)
        self.server.pages.add(self)

    def on_close(self) -> None:
        """A page has disconnected."""
        self.server.pages.discard(self)

    def ready(self) -> bool:
        """Whether it has drawn its last frame; a page that has not for long is disconnected."""
        if self._drawn == self._frame:
            return True
        if time.monotonic() - self._since > self.server.stalled:
            self.server.pages.discard(self)
            self.server.tally.dropped += 1
            self.close(1013, "the page did not respond")
        return False

    def send(self, state: dict[str, Any], plots: Mapping[str, Plot]) -> None:
        """Send the state, and the plots that are new to it."""
        new = {name: plot for name, plot in plots.items() if self._sent.get(name) is not plot}
        self._frame += 1
        self._since = time.monotonic()
        try:
            self.write_message(frame(self._frame, state, new), binary=True)
        except WebSocketClosedError:
            self.server.pages.discard(self)
            return
        self._sent |= new

    def on_message(self, message: str | bytes) -> None:
        """The page has drawn a frame, or sends a request; any other message ends the connection."""
        try:
            said = msgspec.json.decode(message, type=PageRequest | FrameDrawn)
        except (msgspec.DecodeError, UnicodeDecodeError):
            self.close(1008, "not understood")
            return
        if isinstance(said, PageRequest):
            self.server.ask(said)
        elif said.frame == self._frame != self._drawn and 0 <= said.values < 1 << 32:
            self._drawn = said.frame
            self.server.tally.frames += 1
            self.server.tally.values += said.values


def frame(number: int, state: Mapping[str, Any], plots: Mapping[str, Plot]) -> bytes:
    """A frame as bytes: a header in JSON, and the numbers of the plots that have changed, as float32.

    ::

        uint32 little-endian   length of the header in bytes, a multiple of 4
        header                 JSON, padded with spaces: {"frame": 7, "state": {...}, "plots": {"frf": {"names": [...],
                               "rows": 16, "points": 600, "at": 0}}}
        float32 little-endian  the plots' rows in sequence; "at" is the index of the first number of a plot
    """
    at, heads, numbers = 0, {}, []
    for name, plot in plots.items():
        rows, points = plot.rows.shape
        heads[name] = {"names": plot.names, "rows": rows, "points": points, "at": at}
        numbers.append(plot.rows.astype("<f4").tobytes())
        at += plot.rows.size
    head = msgspec.json.encode({"frame": number, "state": state, "plots": heads})
    head += b" " * (-len(head) % 4)
    return b"".join([struct.pack("<I", len(head)), head, *numbers])


def read_frame(message: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and plots of a message, for programs other than browsers."""
    (length,) = struct.unpack_from("<I", message)
    head = msgspec.json.decode(message[4 : 4 + length])
    numbers = np.frombuffer(message, "<f4", offset=4 + length)
    plots = {
        name: numbers[about["at"] : about["at"] + about["rows"] * about["points"]].reshape(about["rows"], about["points"])
        for name, about in head["plots"].items()
    }
    return head, plots
