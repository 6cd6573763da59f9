"""The running screen: a thread that reads the measured data, and a loop that serves the page."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable, Iterator
from typing import Any

from isorig.rig.errors import RigError
from isorig.rig.view.messages import PageRequest, SessionState
from isorig.rig.view.server import FRAME, PageTally, Server
from isorig.rig.view.snapshot import Board, Plot, Snapshot
from isorig.rig.view.sources import Reading
from isorig.rig.view.state import Subject, state_of

#: Seconds for sending the last frame to the pages.
LAST = 1.5
#: Consecutive failed readings before the screen gives up.
PATIENCE = 10


class ScreenServer:
    """One page about one session or recording.

    Its readings of the measured data are taken in a separate thread; `ask` is called with the requests of a page.
    """

    def __init__(
        self, subject: Subject, readings: Iterator[Reading], ask: Callable[[PageRequest], None] = lambda asked: None
    ) -> None:
        self._subject, self._readings = subject, readings
        self._board = Board(subject.planned, judge=subject.mode != "session")
        self._picture = Snapshot()
        self._standing: SessionState | None = SessionState() if subject.mode == "session" else None
        self._failed: Exception | None = None
        self._server = Server(content=self._content, ask=ask)

    def stand(self, standing: SessionState) -> None:
        """Update the session's state."""
        self._standing = standing

    def run(self, over: Callable[[], bool], listening: Callable[[str], None]) -> PageTally:
        """Serve the page until `over` returns True; `listening` is called with its address. Returns what pages have drawn. Raises
        RigError or AnalysisError if the data to be shown cannot be read."""
        return asyncio.run(self._run(over, listening))

    async def _run(self, over: Callable[[], bool], listening: Callable[[str], None]) -> PageTally:
        # Refused requests are not logged in the terminal, where the session prints.
        logging.getLogger("tornado").setLevel(logging.ERROR)
        address = self._server.listen()
        threading.Thread(target=self._read, name="screen's readings", daemon=True).start()
        listening(address)
        while not over() and self._failed is None:
            self._server.show()
            await asyncio.sleep(FRAME)
        for _ in range(round(LAST / FRAME) if self._server.pages else 0):
            self._server.show()
            await asyncio.sleep(FRAME)
        await self._server.close()
        if self._failed is not None:
            raise self._failed
        return self._server.tally

    def _content(self) -> tuple[dict[str, Any], dict[str, Plot]]:
        picture = self._picture
        return state_of(self._subject, picture, self._standing), dict(picture.plots)

    def _read(self) -> None:
        unread = 0
        try:
            for reading in self._readings:
                try:
                    self._board.see(reading, self._publish)
                    unread = 0
                except (RigError, OSError, RuntimeError):
                    # It was read between two writes; the next reading is complete.
                    unread += 1
                    if unread >= PATIENCE:
                        raise
        except Exception as error:
            # Raised in the screen's loop, otherwise the page would freeze without a message.
            self._failed = error

    def _publish(self, picture: Snapshot) -> None:
        self._picture = picture
