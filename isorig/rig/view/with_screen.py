"""A session with its screen: the terminal also prints the page's address and questions, and Enter there answers."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from isorig.rig.acquire.display_thread import DisplayThread
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.session import Operator, decoupled_operator
from isorig.rig.acquire.terminal import Terminal, answer_line
from isorig.rig.view.messages import PageRequest, SessionState
from isorig.rig.view.process import SessionScreen
from isorig.rig.view.requests import Desk
from isorig.rig.view.run_list import planned_by


@contextmanager
def viewed(plan: Plan, output: Path, operator: Operator, terminal: Terminal, *, asks: bool) -> Iterator[tuple[Desk, Operator]]:
    """Show a session on a page during the block; the page does not wait for the operator, whose terminal has its address.

    `asks` is whether the session waits for the operator.

    Yields
    ------
    tuple of Desk and Operator
        The desk, and the operator for the session.

    Raises
    ------
    OutputError
        The screen does not start.
    """
    desk = Desk(planned_by(plan), output, asks=asks)
    display = DisplayThread()
    question = ""

    def ask(standing: SessionState) -> None:
        # What the session waits for, once for each change.
        nonlocal question
        asked = standing.text if standing.phase in ("asks", "finishes") and standing.may else ""
        if asked and asked != question:
            display.each(lambda: terminal.asked(standing.run, asked))
        question = asked

    def answer() -> None:
        while answer_line():
            desk.ask(PageRequest(do="next", run=desk.standing.run))

    try:
        with SessionScreen(desk) as screen:
            display.each(lambda: terminal.shown(screen.address))
            desk.listeners.append(ask)
            if asks:
                threading.Thread(target=answer, name="standard input", daemon=True).start()
            yield desk, desk.operator(decoupled_operator(operator, display))
        display.settle()
    finally:
        display.end()
