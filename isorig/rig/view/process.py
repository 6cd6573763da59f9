"""The screen of a session, in a separate process: the session's process never waits for a page.

The two exchange lines of JSON over the screen's standard input and output. First the session sends the subject (`SessionBegin`)
and the screen sends the address of its page; then the session sends its state, and the screen sends the requests of pages.
"""

from __future__ import annotations

import subprocess
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from types import TracebackType

import msgspec

from isorig.rig.errors import OutputError
from isorig.rig.process import python
from isorig.rig.view.messages import PageRequest, SessionBegin, SessionState
from isorig.rig.view.requests import Desk

#: Seconds that the screen has to end; seconds between two messages with the session's state.
END, PACE = 5.0, 0.1


class SessionScreen:
    """Shows a running session, and passes the requests of pages to the desk.

    Attributes
    ----------
    address
        Address of the page.
    """

    address = ""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._newest: SessionState | None = desk.standing
        self._changed = threading.Condition()
        self._ended = False
        self._notes = ThreadPoolExecutor(1, "notes")

    def __enter__(self) -> SessionScreen:
        # A new interpreter: a forked process would share the instrument's port and the working file.
        self._process = subprocess.Popen(python("-m", "isorig.rig.view"), stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._input, self._output = self._process.stdin, self._process.stdout
        try:
            self._write(SessionBegin(output=str(self._desk.output.absolute()), planned=tuple(self._desk.planned.values())))
            self.address = msgspec.json.decode(self._output.readline(), type=str)
        except (OSError, msgspec.DecodeError):
            self._process.kill()
            raise OutputError("the screen did not start; measure without --view") from None
        self._sender = threading.Thread(target=self._send, name="to the screen", daemon=True)
        self._sender.start()
        threading.Thread(target=self._receive, name="from the screen", daemon=True).start()
        self._desk.listeners.append(self._tell)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._notes.shutdown()
        self._desk.over(_ending(error))
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        self._sender.join(END)
        with suppress(OSError):
            if not self._sender.is_alive():
                self._input.close()
        try:
            self._process.wait(END)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _tell(self, standing: SessionState) -> None:
        with self._changed:
            self._newest = standing
            self._changed.notify_all()

    def _send(self) -> None:
        # The pipe may be full if the screen hangs: then only this thread waits.
        with suppress(OSError):
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: self._newest is not None or self._ended)
                    newest, self._newest = self._newest, None
                if newest is None:
                    return
                self._write(newest)
                time.sleep(PACE)

    def _receive(self) -> None:
        with suppress(OSError, RuntimeError, msgspec.DecodeError):
            for line in self._output:
                asked = msgspec.json.decode(line, type=PageRequest)
                # A note waits for the disk, and no other request waits for a note.
                if asked.do == "note":
                    self._notes.submit(self._desk.ask, asked)
                else:
                    self._desk.ask(asked)

    def _write(self, message: msgspec.Struct) -> None:
        self._input.write(msgspec.json.encode(message) + b"\n")
        self._input.flush()


def _ending(error: BaseException | None) -> str:
    if error is None:
        return "The session has ended."
    if isinstance(error, SystemExit):
        return "The session was ended by the system or by closing its terminal."
    if isinstance(error, KeyboardInterrupt):
        return "The session was stopped by the operator."
    return f"The session has ended: {error}"
