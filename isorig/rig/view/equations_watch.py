"""Starts the process that computes the equations of motion of a session's runs, and ends a run that they have answered."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import msgspec

from isorig.rig.acquire.live import EquationsReport
from isorig.rig.acquire.session import Decision, Operator
from isorig.rig.process import python

#: Seconds that the process has to end.
END = 5.0


@contextmanager
def equations_watched(
    output: Path, operator: Operator, tell: Callable[[EquationsReport], None], *, until_known: bool
) -> Iterator[Operator]:
    """Compute the equations of motion of a session's runs during the block; `tell` receives each message in another thread.

    With `until_known`, a run ends as soon as its equations give a certain answer.

    Yields
    ------
    Operator
        The operator for the session.
    """
    process = subprocess.Popen(
        python("-m", "isorig.rig.view.equations_process", str(output.absolute())), stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    closes, lines = process.stdin, process.stdout
    assert closes is not None
    assert lines is not None
    current, known = "", False  # the run that is measured, and whether its equations have given a certain answer

    def listen() -> None:
        nonlocal known
        with suppress(OSError, ValueError, msgspec.DecodeError):
            for line in lines:
                message = msgspec.json.decode(line, type=EquationsReport)
                if message.run == current and not known:
                    known = message.known
                    tell(message)

    def decide(name: str) -> Decision:
        nonlocal current, known
        decision = operator.decide(name)
        if decision == "take":
            current, known = name, False
        return decision

    threading.Thread(target=listen, name="equations of motion", daemon=True).start()
    try:
        yield replace(operator, decide=decide, answered=lambda: until_known and known)
    finally:
        with suppress(OSError):
            closes.close()
        try:
            process.wait(END)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
