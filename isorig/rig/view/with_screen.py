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
    """Show a session on a page during the block.

    Parameters
    ----------
    plan, output
        The session's plan and recording.
    operator
        Receives the same calls; the page does not wait for it.
    terminal
        Prints the page's address and questions.
    asks
        Whether the session waits for the operator.

    Yields
    ------
    tuple of Desk and Operator
        The desk, and the operator for the session.

    Raises
    ------
    OutputError
        The screen does not start.
    """
    planned = planned_by(plan)
    desk = Desk(planned, output, asks=asks)
    display = DisplayThread()

    def answer() -> None:
        while answer_line():
            desk.ask(PageRequest(do="next", run=desk.standing.run))

    try:
        with SessionScreen(desk, planned, output) as screen:
            display.each(lambda: terminal.shown(screen.address))
            desk.listeners.append(_Questions(terminal, display).stands)
            if asks:
                threading.Thread(target=answer, name="standard input", daemon=True).start()
            yield desk, desk.operator(decoupled_operator(operator, display))
        display.settle()
    finally:
        display.end()


class _Questions:
    """Prints what a session waits for in the terminal, once for each change."""

    def __init__(self, terminal: Terminal, display: DisplayThread) -> None:
        self._terminal, self._display = terminal, display
        self._asked = ""

    def stands(self, standing: SessionState) -> None:
        asked = standing.text if standing.phase in ("asks", "finishes") and standing.may else ""
        if asked and asked != self._asked:
            self._display.each(lambda: self._terminal.asked(standing.run, asked))
        self._asked = asked
