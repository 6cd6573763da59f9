"""A session with its screen: where the page is and what is asked stand in the terminal too, and Enter there answers."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from isorig.rig.acquire.display_thread import Aside
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.session import Operator, beside
from isorig.rig.acquire.terminal import Terminal
from isorig.rig.view.messages import Asked, Standing
from isorig.rig.view.process import SessionScreen
from isorig.rig.view.requests import Desk
from isorig.rig.view.run_list import planned_by


@contextmanager
def viewed(plan: Plan, output: Path, operator: Operator, terminal: Terminal, *, asks: bool) -> Iterator[tuple[Desk, Operator]]:
    """Show a session on a page while the block lasts.

    Parameters
    ----------
    plan, output
        The session's plan and recording.
    operator
        Told of the session beside the page; the page does not wait for him.
    terminal
        Told where the page is and what it asks.
    asks
        Whether the session waits for the operator.

    Yields
    ------
    tuple of Desk and Operator
        The desk, and who is to be the session's operator.

    Raises
    ------
    OutputError
        Where the screen does not come up.
    """
    planned = planned_by(plan)
    desk = Desk(planned, output, asks=asks)
    aside = Aside()

    def answer() -> None:
        while sys.stdin.readline():
            desk.ask(Asked(do="next", run=desk.standing.run))

    try:
        with SessionScreen(desk, planned, output) as screen:
            aside.each(lambda: terminal.shown(screen.address))
            desk.listeners.append(_Questions(terminal, aside).stands)
            if asks:
                threading.Thread(target=answer, name="standard input", daemon=True).start()
            yield desk, desk.operator(beside(operator, aside))
        aside.settle()
    finally:
        aside.end()


class _Questions:
    """Tells the terminal what a session waits for, once each time."""

    def __init__(self, terminal: Terminal, aside: Aside) -> None:
        self._terminal, self._aside = terminal, aside
        self._asked = ""

    def stands(self, standing: Standing) -> None:
        asked = standing.text if standing.phase in ("asks", "finishes") and standing.may else ""
        if asked and asked != self._asked:
            self._aside.each(lambda: self._terminal.asked(standing.run, asked))
        self._asked = asked
