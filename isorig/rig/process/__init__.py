"""The process of a command: its terminal, its signals, its interpreter."""

from __future__ import annotations

import sys


def python(*arguments: str) -> list[str]:
    """The command line of another interpreter.

    `-P` keeps the working folder, which may contain anybody's files, out of its import path: a module there is never imported.
    """
    return [sys.executable, "-P", *arguments]
