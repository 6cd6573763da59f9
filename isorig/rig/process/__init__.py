"""The process of a command: its terminal, its signals, its interpreter."""

import subprocess
import sys
from typing import IO


def python(*arguments: str) -> list[str]:
    """The command line of another interpreter.

    `-P` keeps the working folder, which may contain anybody's files, out of its import path: a module there is never imported.
    """
    return [sys.executable, "-P", *arguments]


def piped(*arguments: str, apart: bool = False) -> tuple[subprocess.Popen[bytes], IO[bytes], IO[bytes]]:
    """Another interpreter, with its standard input and output; one that is `apart` is not interrupted by Ctrl-C."""
    process = subprocess.Popen(python(*arguments), stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=apart)
    assert process.stdin is not None
    assert process.stdout is not None
    return process, process.stdin, process.stdout
