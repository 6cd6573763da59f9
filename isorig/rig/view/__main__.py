"""The process of a session's screen; the session starts it (`isorig.rig.view.process`) and exchanges lines of JSON with it."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec

from isorig.rig.errors import REFUSALS
from isorig.rig.view.messages import PageRequest, SessionBegin, SessionState
from isorig.rig.view.server import ScreenServer
from isorig.rig.view.sources import watched
from isorig.rig.view.state import Subject

#: The session has priority over the screen when both need the processor.
NICE = 5
#: Message on the page if the session's process was killed.
GONE = (
    "The session's process has ended. Its data are in the working file: continue with rig acquire --resume, or save them with "
    "rig recover."
)


def main() -> None:
    """Serve the page until the session is over, or its process has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the session handles Ctrl-C
    with suppress(AttributeError, OSError):
        os.nice(NICE)
    heard = _lines()
    begin = msgspec.json.decode(next(heard), type=SessionBegin)
    output, over = Path(begin.output), threading.Event()
    subject = Subject(title=output.name, mode="session", planned=begin.planned)
    screen = ScreenServer(subject, watched(output, over.is_set), _say)

    def listen() -> None:
        standing = SessionState()
        for line in heard:
            standing = msgspec.json.decode(line, type=SessionState)
            screen.stand(standing)
        if standing.phase != "over":
            screen.stand(msgspec.structs.replace(standing, phase="over", may=(), text=GONE))
        over.set()

    def listening(address: str) -> None:
        _say(address)
        threading.Thread(target=listen, name="from the session", daemon=True).start()

    try:
        screen.run(over.is_set, listening)
    except REFUSALS as refusal:
        print(f"rig: the screen has ended, the session continues: {refusal}", file=sys.stderr)


def _lines() -> Iterator[bytes]:
    # Read without Python's buffer: a thread waiting in it would delay the end of the process.
    rest = b""
    while chunk := os.read(sys.stdin.fileno(), 1 << 16):
        *lines, rest = (rest + chunk).split(b"\n")
        yield from lines


def _say(message: str | PageRequest) -> None:
    with suppress(OSError):
        sys.stdout.buffer.write(msgspec.json.encode(message) + b"\n")
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
