"""rig acquire: measure a campaign after a plan."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from rig.acquire.session import Live, Taken


def acquire(
    plan: Path,
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    port: str | None = None,
    resume: bool = False,
    yes: bool = False,
    json: bool = False,
) -> None:
    """Measure the runs of a plan with an instrument, and write them as a recording.

    Each run is looked at right after it was taken. Ctrl-C, an unplugged instrument or a full disk end the session with what was
    measured; rig recover and --resume go on after a kill.

    Example: rig acquire session.toml -o campaign.h5

    Parameters
    ----------
    plan
        The plan of the session, a TOML file.
    output
        The recording to write.
    port
        The instrument's port instead of the plan's: a path such as /dev/ttyACM0, or socket://127.0.0.1:4000.
    resume
        Go on with a session that was broken off: finished runs are kept.
    yes
        Ask nothing: whoever calls this sees to locking and unlocking.
    json
        Tell levels and results as one JSON object a line on standard output.
    """
    from rig.acquire.plan import read_plan
    from rig.acquire.session import Operator
    from rig.acquire.session import acquire as run_session

    planned = read_plan(plan)
    with _Screen(json=json) as screen:
        operator = Operator(lock=_silent if yes else screen.ask, watch=screen.watch, taken=screen.taken)
        path, taken = run_session(planned, port or planned.instrument.port, output, operator, resume=resume)
    if not json:
        bad = [item.id for item in taken if not item.verdict.good]
        print(f"{len(taken)} runs taken" + (f"; worth a second look: {', '.join(bad)}" if bad else ", all sound"))
        print(path)


def _silent(configuration: str) -> None:
    """Nobody is asked."""


class _Screen:
    """The live view: a line for the run that lasts, a line for each that was taken."""

    def __init__(self, *, json: bool) -> None:
        from rich.console import Console
        from rich.live import Live as Display

        self._json = json
        self._console = Console(stderr=True)
        self._display = Display(console=self._console, refresh_per_second=8, transient=True)

    def __enter__(self) -> _Screen:
        if not self._json:
            self._display.start()
        return self

    def __exit__(self, *ended: object) -> None:
        if not self._json:
            self._display.stop()

    def ask(self, configuration: str) -> None:
        self._display.stop()
        print(f"Bring the rig into the configuration {configuration!r}, then press Enter.", file=sys.stderr, flush=True)
        sys.stdin.readline()
        if not self._json:
            self._display.start()

    def watch(self, live: Live) -> None:
        if self._json:
            self._line("live", live)
            return
        levels = "  ".join(f"{name} {value:.3g}" for name, value in live.rms.items())
        faults = f"  overloads {live.overloads}" if live.overloads else ""
        lost = f"  lost {live.lost}" if live.lost else ""
        self._display.update(f"{live.run}: {live.seconds:.1f} of {live.of:g} s   rms {levels}{faults}{lost}")

    def taken(self, item: Taken) -> None:
        if self._json:
            self._line("taken", item)
            return
        coherent = "  ".join(f"{name} {value:.2f}" for name, value in item.verdict.coherence.items())
        told = f"{item.id}: {item.tally.stored} samples, {item.tally.lost} lost" + (f"; coherence {coherent}" if coherent else "")
        self._console.print(told, markup=False, highlight=False)
        for sentence in item.verdict.advice:
            self._console.print(f"  {sentence}", markup=False, highlight=False)

    @staticmethod
    def _line(kind: str, content: object) -> None:
        import msgspec

        print(msgspec.json.encode({"event": kind, **msgspec.to_builtins(content)}).decode(), flush=True)
