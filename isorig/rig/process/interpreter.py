"""Other processes of this program: a module in the working folder is never imported by them."""

from __future__ import annotations

import sys


def python(*arguments: str) -> list[str]:
    """The command line of another interpreter.

    `-P` keeps the working folder, which may contain anybody's files, out of its import path.
    """
    return [sys.executable, "-P", *arguments]
