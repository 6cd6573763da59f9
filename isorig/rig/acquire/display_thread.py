"""Displays run in a separate thread, so that the acquisition never waits for a display."""

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

#: Seconds to wait for a display at the end of a session, and before a question.
PATIENCE = 2.0


class DisplayThread:
    """Executes calls in sequence in another thread; of calls that may be skipped, only the latest."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[bool, Callable[[], Any]]] = deque()
        self._changed = threading.Condition()
        self._busy = self._ended = False
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="display", daemon=True)
        self._thread.start()

    def latest(self, call: Callable[[], Any]) -> None:
        """Execute this call, or a later one that replaces it. Raises the error of an earlier call."""
        self._put(True, call)

    def each(self, call: Callable[[], Any]) -> None:
        """Execute this call in its turn. Raises the error of an earlier call."""
        self._put(False, call)

    def settle(self, patience: float = PATIENCE) -> None:
        """Wait until all calls are done, or for the given seconds."""
        with self._changed:
            self._changed.wait_for(lambda: not self._waiting and not self._busy, patience)
        self._raise()

    def end(self) -> None:
        """Execute no further calls."""
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
