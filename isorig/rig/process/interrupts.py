"""Signals that end a command: never while a module is imported, and in a session once, so that the measured data are kept.

A module whose import was interrupted is incomplete, and packages report that as all kinds of errors, or not at all.
"""

import signal
import sys
import threading
from _thread import interrupt_main
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

#: Seconds after which a signal that came during an import is delivered again.
AGAIN = 0.02
#: Signals that end a session: Ctrl-C, termination by the system, a closed terminal.
SIGNALS = (signal.SIGINT, signal.SIGTERM) if sys.platform == "win32" else (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def _deferred(number: int, frame: FrameType | None) -> bool:
    """Whether a signal came during an import or the end of a weak reference; it is then delivered again later.

    An exception in the callback of a weak reference goes no further: Python prints it.
    """
    while frame is not None and not (
        frame.f_code.co_filename.startswith("<frozen importlib") or frame.f_globals.get("__name__") == "weakref"
    ):
        frame = frame.f_back
    if frame is None:
        return False
    later = threading.Timer(AGAIN, interrupt_main, [number])
    later.daemon = True
    later.start()
    return True


@contextmanager
def interrupted_between_imports() -> Iterator[None]:
    """Ctrl-C raises KeyboardInterrupt as usual, but not while a module is imported."""
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    ):
        yield
        return
    waits = False

    def interrupted(number: int, frame: FrameType | None) -> None:
        nonlocal waits
        waits = _deferred(number, frame)
        if not waits:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupted)
    try:
        yield
    finally:
        # A signal that waits would be delivered while the program ends.
        signal.signal(signal.SIGINT, signal.SIG_IGN if waits else signal.default_int_handler)
        if waits:  # a short command does hardly more than import
            raise KeyboardInterrupt


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """The first signal raises KeyboardInterrupt, or SystemExit with 128 plus its number; later ones are ignored.

    Nested calls have no effect.
    """
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) is _end:
        yield
        return
    before = {one: signal.signal(one, _end) for one in SIGNALS if signal.getsignal(one) != signal.SIG_IGN}
    try:
        yield
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)


def _end(number: int, frame: FrameType | None) -> None:
    if _deferred(number, frame):
        return
    for one in SIGNALS:
        signal.signal(one, signal.SIG_IGN)
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(128 + number)
