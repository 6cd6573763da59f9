"""The process that checks HDF5 files, as a fork: without its start of Python, for tests of many commands."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, NoReturn

from isorig.rig.files import hdf, hdf_walk


class ForkedWalker:
    """Takes the place of the checking process that `hdf` starts: a fork that runs the same loop, ready to read."""

    def __init__(self, call: Sequence[str], **how: Any) -> None:
        assert call[-1].endswith("hdf_walk.py")
        asked, ask = os.pipe()
        answers, answer = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            self._serve(asked, answer)
        os.close(asked)
        os.close(answer)
        self.stdin, self.stdout = os.fdopen(ask, "w", encoding="utf-8"), os.fdopen(answers, encoding="utf-8")

    @staticmethod
    def _serve(asked: int, answer: int) -> NoReturn:
        try:
            os.dup2(asked, 0)
            os.dup2(answer, 1)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            # It ends with the process that asks, so it must not hold the other end of its own pipe.
            os.closerange(3, 1024)
            sys.stdin, sys.stdout = os.fdopen(0, encoding="utf-8"), os.fdopen(1, "w", encoding="utf-8")
            hdf_walk.main()
        finally:
            os._exit(0)

    def kill(self) -> None:
        """End it."""
        os.kill(self._pid, signal.SIGKILL)

    def wait(self) -> None:
        """Wait for its end."""
        os.waitpid(self._pid, 0)


def fork_walkers() -> None:
    """Let this process fork each checking process that it would start."""
    hdf.subprocess = SimpleNamespace(Popen=ForkedWalker, PIPE=subprocess.PIPE, DEVNULL=subprocess.DEVNULL)  # type: ignore[attr-defined,assignment]
