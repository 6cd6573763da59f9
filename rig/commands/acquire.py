"""rig acquire: measure a campaign after a plan."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from rich.table import Table

    from rig.acquire.session import Taken
    from rig.acquire.take import Live


def acquire(
    plan: Path,
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    port: str | None = None,
    resume: bool = False,
    again: tuple[str, ...] = (),
    force: bool = False,
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
    again
        With --resume: take a finished run once more; it replaces the first. May be given several times.
    force
        Begin runs that the look before them speaks against.
    yes
        Ask nothing: whoever calls this sees to locking and unlocking.
    json
        Tell levels and results as one JSON object a line on standard output: event is "live" while a run lasts, "taken"
        behind it, and "ask" where the rig is to be locked or unlocked and a line on standard input is waited for.
    """
    from drivers.errors import DriverError
    from rig.acquire.session import Operator
    from rig.acquire.session import acquire as run_session
    from rig.acquire.sound import read_plan
    from rig.errors import OutputError, PlanError

    planned = read_plan(plan)
    if again and not resume:
        raise PlanError("--again takes runs of an earlier session once more; give it together with --resume")
    if output.exists() and not resume:
        raise OutputError(f"{output} exists already; go on with it by --resume, or give another -o")
    with _Screen(json=json) as screen:
        operator = Operator(lock=_silent if yes else screen.ask, watch=screen.watch, taken=screen.taken)
        try:
            path, taken = run_session(
                planned, port or planned.instrument.port, output, operator, resume=resume, again=set(again), force=force
            )
        except (KeyboardInterrupt, DriverError):
            if output.exists():
                print(f"what was measured is in {output}; rig acquire --resume goes on with the plan", file=sys.stderr)
            raise
    if not json:
        bad = [item.id for item in taken if not item.verdict.good]
        print(f"{len(taken)} runs taken" + ("" if bad else ", all sound"))
        if bad:
            print(f"worth taking again while the rig stands: --resume {' '.join(f'--again {name}' for name in bad)}")
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
        from rig.errors import PlanError

        if self._json:
            self._line("ask", {"configuration": configuration})
        self._display.stop()
        print(f"Bring the rig into the configuration {configuration!r}, then press Enter.", file=sys.stderr, flush=True)
        if not sys.stdin.readline():
            raise PlanError("nobody answers on standard input; --yes asks nothing where whoever calls sees to locking")
        if not self._json:
            self._display.start()

    def watch(self, live: Live) -> None:
        if self._json:
            self._line("live", live)
            return
        self._display.update(_levels(live))

    def taken(self, item: Taken) -> None:
        if self._json:
            self._line("taken", item)
            return
        coherent = "  ".join(f"{name} {value:.2f}" for name, value in item.verdict.coherence.items())
        told = f"{item.id}: {item.tally.stored} samples, {item.tally.lost} lost" + (f"; coherence {coherent}" if coherent else "")
        if item.verdict.detections:
            told += f"; {item.verdict.detections[0].periods} periods after the first, distortion " + "  ".join(
                f"{d.response} {100 * max(d.odd, d.even):.1f} % (noise {100 * d.noise:.1f} %)" for d in item.verdict.detections
            )
        if item.drift is not None and item.drift.sure:
            told += f"; its clock runs {item.drift.ppm:+.0f} ± {item.drift.std:.0f} ppm against this machine's"
        self._console.print(told, markup=False, highlight=False)
        for sentence in item.verdict.advice:
            self._console.print(f"  {sentence}", markup=False, highlight=False)

    @staticmethod
    def _line(kind: str, content: object) -> None:
        import msgspec

        print(msgspec.json.encode({"event": kind, **msgspec.to_builtins(content)}).decode(), flush=True)


def _levels(live: Live) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, title=f"{live.run}: {max(live.of - live.seconds, 0.0):.0f} s left", title_justify="left")
    for head in ("channel", "rms", "peak", "of range", "coherence so far"):
        table.add_column(head, justify="left" if head == "channel" else "right")
    for name, rms in live.rms.items():
        share = live.peak[name] / live.full_scale[name] if name in live.full_scale else None
        shown = "" if share is None else f"{'█' * min(int(10 * share), 10)} {100 * share:.0f} %"
        coherence = f"{live.coherence[name]:.2f}" if name in live.coherence else ""
        table.add_row(name, f"{rms:.3g}", f"{live.peak[name]:.3g}", shown, coherence)
    table.caption = f"lost {live.lost}, overloads {live.overloads}, damaged on the way {live.damaged}"
    return table
