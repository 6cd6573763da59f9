"""A session on the terminal, or as JSON lines for a program; output without a reader is dropped, and the session continues."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from datetime import datetime, timedelta
from typing import TYPE_CHECKING

import msgspec

from isorig.rig.acquire.live import EquationsReport, advice, shares
from isorig.rig.errors import PlanError
from isorig.rig.process.terminal import NonBlockingTerminal, never_wait_for_terminal

if TYPE_CHECKING:
    from rich.console import Console, Group

    from isorig.rig.acquire.live import LiveState
    from isorig.rig.acquire.rig_operator import Decision, MeasuredRun

#: Refusal where a question cannot be asked.
NO_ANSWER = (
    "standard input is closed, so questions cannot be answered; with --yes the program does not ask and the caller locks the rig"
)
#: Characters of a level bar.
BAR = 10


class Terminal:
    """The live view: a table for the current run, a line for each measured run; or JSON lines for a program."""

    def __init__(self, *, json: bool) -> None:
        from rich.console import Console
        from rich.live import Live as Display

        self._json = json
        self._gone = False
        self._console = Console(stderr=True)
        self._display = Display(console=self._console, refresh_per_second=8, transient=True)

    def __enter__(self) -> Terminal:
        never_wait_for_terminal()
        if not self._json:
            self._quietly(self._display.start)
        return self

    def __exit__(self, *ended: object) -> None:
        if not self._json:
            self._quietly(self._display.stop)

    def ask(self, configuration: str) -> None:
        """Ask the operator to bring the rig into a configuration, and wait for Enter."""
        if self._json:
            self._line("ask", {"configuration": configuration})
        self._answer(f"Bring the rig into the configuration {configuration!r}, then press Enter.")

    def shown(self, address: str) -> None:
        """Print the address of the session's page."""
        self._say("view", {"address": address}, f"the session is shown at {address}")

    def say(self, text: str) -> None:
        """Print lines of text above the table of the current run."""
        self._say("text", {"text": text}, text)

    def consent(self, run: str) -> Decision:
        """Ask the operator whether to measure a run, and wait for the answer."""
        answer = self._answer(f"Measure {run}? Enter starts it, n skips it, q stops here.")
        decisions: dict[str, Decision] = {"n": "skip", "q": "end"}
        return decisions.get(answer, "take")

    def asked(self, run: str, question: str) -> None:
        """Print the page's question; Enter answers it here, too."""
        self._say("ask", {"run": run, "text": question}, f"{question} Press Enter here, or the button on the page.")

    def watch(self, live: LiveState) -> None:
        """Show the levels."""
        self._tell("live", live, lambda: self._display.update(levels(live)))

    def taken(self, item: MeasuredRun) -> None:
        """Print a measured run."""
        self._tell("taken", item, lambda: _print(self._console, item))

    def equations(self, report: EquationsReport) -> None:
        """Print what the equations of motion tell of a run once that is certain; as JSON all of it."""
        if self._json or report.known:
            self._say("equations", report, f"equations of motion of {report.sentence}")

    def _answer(self, question: str) -> str:
        self._quietly(self._display.stop)
        self._quietly(lambda: print(question, file=sys.stderr, flush=True))
        answer = answer_line()
        if not answer:
            raise PlanError(NO_ANSWER)
        if not self._json:
            self._quietly(self._display.start)
        return answer.strip().lower()

    def _say(self, kind: str, content: object, words: str) -> None:
        self._tell(kind, content, lambda: self._console.print(words, markup=False, highlight=False, soft_wrap=True))

    def _tell(self, kind: str, content: object, show: Callable[[], object]) -> None:
        if self._json:
            self._line(kind, content)
        else:
            self._quietly(show)

    def _line(self, kind: str, content: object) -> None:
        data = msgspec.json.encode({"event": kind, **msgspec.to_builtins(content)}) + b"\n"

        def write() -> None:
            if isinstance(sys.stdout, NonBlockingTerminal):
                sys.stdout.write(data.decode())
                return
            # Bypasses the buffer of standard output: a thread waiting in it would delay the end of the program.
            left = memoryview(data)
            while left:
                left = left[os.write(sys.stdout.fileno(), left) :]

        self._quietly(write)

    def _quietly(self, show: Callable[[], object]) -> None:
        # The reader of a pipe has ended or a terminal was closed: the measurement is more important than its display.
        if self._gone:
            return
        try:
            show()
        except OSError:
            self._gone = True


def answer_line() -> str:
    """The next line of standard input; empty if it has ended, or if its terminal was closed."""
    try:
        return sys.stdin.readline()
    except OSError:
        return ""


def levels(live: LiveState) -> Group:
    """The state of a run in at most 80 columns, if the channel names are short: progress, a table, advice."""
    from rich import box
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for head in ("channel", "rms", "peak", "of range", "coherence so far"):
        table.add_column(head, justify="left" if head in ("channel", "of range") else "right", no_wrap=True)
    share = shares(live.highest, live.full_scale)
    for name, rms in live.rms.items():
        shown = f"{'█' * min(round(BAR * share[name]), BAR):<{BAR}} {100 * share[name]:3.0f} %" if name in share else ""
        coherence = f"{live.coherence[name]:.2f}" if name in live.coherence else ""
        table.add_row(name, f"{rms:.3g}", f"{live.peak[name]:.3g}", shown, coherence)
    sentences = [f"lost {live.lost}, overloads {live.overloads}, damaged in transmission {live.damaged}"]
    return Group(Text(_progress(live)), table, *map(Text, sentences + advice(live.highest, live.full_scale)))


def _progress(live: LiveState) -> str:
    end = datetime.now().astimezone() + timedelta(seconds=live.left)
    done = f"{live.run} (run {live.number} of {live.runs}): {_duration(live.of - live.seconds)} left"
    return done if live.runs == 1 else f"{done}; all runs {_duration(live.left)}, to about {end:%H:%M}"


def _duration(seconds: float) -> str:
    whole = max(round(seconds), 0)
    return f"{whole} s" if whole < 100 else f"{whole // 60} min" if whole < 7200 else f"{whole // 3600} h {whole // 60 % 60} min"


def _print(console: Console, item: MeasuredRun) -> None:
    coherent = "  ".join(f"{name} {value:.2f}" for name, value in item.verdict.coherence.items())
    text = f"{item.id}: {item.tally.stored} samples, {item.tally.lost} lost" + (f"; coherence {coherent}" if coherent else "")
    if item.verdict.detections:
        text += f"; {item.verdict.detections[0].periods} periods after the first, distortion " + "  ".join(
            f"{d.response} {100 * max(d.odd, d.even):.1f} % (noise {100 * d.noise:.1f} %)" for d in item.verdict.detections
        )
    if item.drift is not None and item.drift.sure:
        text += f"; its clock runs {item.drift.ppm:+.0f} ± {item.drift.std:.0f} ppm relative to the host's"
    console.print(text, markup=False, highlight=False)
    for sentence in item.verdict.advice:
        console.print(f"  {sentence}", markup=False, highlight=False)
