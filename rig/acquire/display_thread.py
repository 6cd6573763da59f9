"""What is shown is shown from a thread of its own, so that the wire never waits for a display."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

#: Seconds that are waited for a display at the end of a session, and before a question.
PATIENCE = 2.0


class Aside:
    """Calls one after the other, in another thread; of those that may be left out the latest only."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[bool, Callable[[], Any]]] = deque()
        self._changed = threading.Condition()
        self._busy = self._ended = False
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="display", daemon=True)
        self._thread.start()

    def latest(self, call: Callable[[], Any]) -> None:
        """Call this, or a later one in its place. What an earlier call raised is raised here."""
        self._put(True, call)

    def each(self, call: Callable[[], Any]) -> None:
        """Call this in its turn. What an earlier call raised is raised here."""
        self._put(False, call)

    def settle(self, patience: float = PATIENCE) -> None:
        """Wait until all was called, or so many seconds."""
        with self._changed:
            self._changed.wait_for(lambda: not self._waiting and not self._busy, patience)
        self._raise()

    def end(self) -> None:
        """Call nothing any more."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _put(self, replaceable: bool, call: Callable[[], Any]) -> None:
        self._raise()
        with self._changed:
            if self._waiting and self._waiting[-1][0] and replaceable:
                self._waiting.pop()
            self._waiting.append((replaceable, call))
            self._changed.notify_all()

    def _raise(self) -> None:
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _work(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting or self._ended)
                if self._ended:
                    return
                _, call = self._waiting.popleft()
                self._busy = True
            try:
                call()
            except BaseException as error:
                self._failure = error
