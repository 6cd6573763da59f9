"""A copy of this process that answers questions: it needs no second start of an interpreter and no second import."""

import os
import signal
import sys
from collections.abc import Callable
from typing import NoReturn


def has_one_thread() -> bool:
    """Whether this process may be copied: other threads, whose locks a copy would keep forever, would not be. False where the
    system does not list them."""
    try:
        return len(os.listdir("/proc/self/task")) == 1  # noqa: PTH208
    except OSError:
        return False


class ForkedProcess:
    """A copy of this process that runs a function instead, with the streams of a `subprocess.Popen` in text.

    Call it only if `has_one_thread`. The copy has no other open file of this process; what it writes to standard error is
    discarded.
    """

    def __init__(self, function: Callable[[], object]) -> None:
        asked, ask = os.pipe()
        answers, answer = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            _run(function, asked, answer)
        os.close(asked)
        os.close(answer)
        self.stdin, self.stdout = os.fdopen(ask, "w", encoding="utf-8"), os.fdopen(answers, encoding="utf-8")

    def kill(self) -> None:
        """End it."""
        os.kill(self._pid, signal.SIGKILL)

    def wait(self) -> None:
        """Wait for its end."""
        os.waitpid(self._pid, 0)


def _run(function: Callable[[], object], asked: int, answer: int) -> NoReturn:
    try:
        # The handlers of a command are for its own work.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        os.dup2(asked, 0)
        os.dup2(answer, 1)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        # It ends with the process that asks, so it must not hold the other end of its own pipe.
        os.closerange(3, os.sysconf("SC_OPEN_MAX"))
        sys.stdin, sys.stdout = os.fdopen(0, encoding="utf-8"), os.fdopen(1, "w", encoding="utf-8")
        function()
    finally:
        os._exit(0)
