"""The other processes of a session: its screen, and that of the equations of motion of its runs.

The session's process never waits for them. It exchanges lines of JSON with the screen over the screen's standard input and
output: first the session sends the subject (`SessionBegin`) and the screen the address of its page; then the session sends its
state, and the screen the requests of pages.
"""

import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import msgspec

from isorig.rig.acquire.display_thread import DisplayThread
from isorig.rig.acquire.live import EquationsReport
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.rig_operator import Decision, Operator, decoupled_operator
from isorig.rig.acquire.terminal import Terminal, answer_line
from isorig.rig.errors import OutputError
from isorig.rig.process import piped
from isorig.rig.view.messages import PageRequest, SessionBegin, SessionState, planned_by
from isorig.rig.view.session_control import SessionControl

#: Seconds that the screen has to end; seconds between two messages with the session's state.
END, PACE = 5.0, 0.1


@contextmanager
def viewed(
    plan: Plan, output: Path, operator: Operator, terminal: Terminal, *, asks: bool
) -> Iterator[tuple[SessionControl, Operator]]:
    """Show a session on a page during the block; yields its control, and the operator for the session.

    The page does not wait for the operator, whose terminal has its address; `asks` is whether the session does. Raises
    OutputError if the screen does not start.
    """
    control = SessionControl(planned_by(plan), output, asks=asks)
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
            control.ask(PageRequest(do="next", run=control.standing.run))

    try:
        with session_screen(control) as address:
            display.each(lambda: terminal.shown(address))
            control.listeners.append(ask)
            if asks:
                threading.Thread(target=answer, name="standard input", daemon=True).start()
            yield control, control.operator(decoupled_operator(operator, display))
        display.settle()
    finally:
        display.end()


@contextmanager
def session_screen(control: SessionControl) -> Iterator[str]:
    """Show a running session during the block, and pass the requests of pages to its control; yields the address of the page.
    Raises OutputError if the screen does not start."""
    # A new interpreter: a forked process would share the instrument's port and the working file.
    process, to_screen, from_screen = piped("-m", "isorig.rig.view")

    def write(message: SessionBegin | SessionState) -> None:
        to_screen.write(msgspec.json.encode(message) + b"\n")
        to_screen.flush()

    def show(standing: SessionState) -> None:
        with suppress(OSError):
            write(standing)
            time.sleep(PACE)

    def receive() -> None:
        with suppress(OSError, RuntimeError, msgspec.DecodeError):
            for line in from_screen:
                asked = msgspec.json.decode(line, type=PageRequest)
                # A note waits for the disk, and no other request waits for a note.
                if asked.do == "note":
                    notes.submit(control.ask, asked)
                else:
                    control.ask(asked)

    def close() -> None:
        with suppress(OSError):
            to_screen.close()

    try:
        write(SessionBegin(output=str(control.output.absolute()), planned=tuple(control.planned.values())))
        address = msgspec.json.decode(from_screen.readline(), type=str)
    except (OSError, msgspec.DecodeError):
        process.kill()
        raise OutputError("the screen did not start; measure without --view") from None
    # The pipe may be full if the screen hangs: then only this thread waits.
    sender, notes = DisplayThread(), ThreadPoolExecutor(1, "notes")
    threading.Thread(target=receive, name="from the screen", daemon=True).start()
    control.listeners.append(lambda standing: sender.latest(lambda: show(standing)))
    sender.latest(lambda: show(control.standing))
    ending = "The session has ended."
    try:
        yield address
    except BaseException as error:
        ending = _ending(error)
        raise
    finally:
        notes.shutdown()
        control.over(ending)
        sender.each(close)
        sender.settle(END)
        sender.end()
        ended(process)


@contextmanager
def equations_watched(
    output: Path, operator: Operator, tell: Callable[[EquationsReport], None], *, until_known: bool
) -> Iterator[Operator]:
    """Compute the equations of motion of a session's runs during the block; yields the operator for the session.

    `tell` receives each message in another thread. With `until_known`, a run ends as soon as its equations give a certain answer.
    """
    process, closes, lines = piped("-m", "isorig.rig.view.equations_process", str(output.absolute()))
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
        ended(process)


def ended(process: subprocess.Popen[bytes]) -> None:
    """Wait until a process whose standard input is closed ends; kill it after `END`."""
    try:
        process.wait(END)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _ending(error: BaseException) -> str:
    if isinstance(error, SystemExit):
        return "The session was ended by the system or by closing its terminal."
    if isinstance(error, KeyboardInterrupt):
        return "The session was stopped by the operator."
    return f"The session has ended: {error}"
