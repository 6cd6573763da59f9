"""Measures the runs of a plan with an instrument."""

from __future__ import annotations

import sys
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from isorig.rig.options import Output

if TYPE_CHECKING:
    from isorig.rig.acquire.live import EquationsReport
    from isorig.rig.acquire.terminal import Terminal
    from isorig.rig.view.session_control import SessionControl


def acquire(
    plan: Path,
    *,
    output: Output,
    port: str | None = None,
    resume: bool = False,
    again: tuple[str, ...] = (),
    force: bool = False,
    yes: bool = False,
    view: bool = False,
    until_known: bool = False,
    json: bool = False,
    sync: float = 1.0,
) -> None:
    """Measure the runs of a plan with an instrument, and write them as a recording.

    A post-run check rates each run. A connection that returns within 15 s is continued. Ctrl-C, TERM, a closed terminal, an
    unplugged instrument or a full disk end the session; the measured data are kept and the drive is switched off. After a kill,
    use rig recover or --resume.

    Example: rig acquire session.toml -o campaign.h5

    Parameters
    ----------
    plan
        The plan of the session, a TOML file.
    output
        The recording to write.
    port
        The instrument's port instead of the plan's: a path like /dev/ttyACM0, or socket://127.0.0.1:4000.
    resume
        Continue an interrupted session: finished runs are kept.
    again
        With --resume: repeat a finished run; the new run replaces the first. May be given several times.
    force
        Start even if the pre-run check fails.
    yes
        Do not prompt; the caller locks and unlocks the rig.
    view
        Show the session on a page in the browser of this computer, at the printed address. The page has buttons to stop a run, to
        repeat it, to write a note, and to start the next run when the session waits for the operator: before the first run, when
        the rig must be locked or unlocked, and after a run with a fault. With --yes it never waits. Bars
        show during each run how well each equation of motion of the records holds, and the cause that explains the best what
        breaks one.
    until_known
        End each run as soon as its equations of motion identify a cause, or have held for some time. The run counts as
        complete; --resume measures it again.
    json
        Print levels and results as one JSON object per line on standard output: event is "live" during a run, "taken" after it,
        "ask" when the rig must be locked or unlocked and a line on standard input is expected, "view" with the address of the
        page, and "equations" for what the equations of motion show with --until-known or --view.
    sync
        Seconds between two syncs of the data to disk: the maximum loss in a power failure. A kill loses at most a quarter of a
        second in any case. With 0 every block is synced.
    """
    from isorig.drivers.errors import DriverError
    from isorig.rig.acquire.notes import reopen_notes, settle_notes
    from isorig.rig.acquire.plan import as_virtual
    from isorig.rig.acquire.plan_check import read_plan
    from isorig.rig.acquire.rig_operator import Operator
    from isorig.rig.acquire.session import acquire as run_session
    from isorig.rig.acquire.terminal import Terminal
    from isorig.rig.errors import OutputError, PlanError
    from isorig.rig.process.interrupts import ended_by_signals
    from isorig.rig.process.terminal import discard_output
    from isorig.rig.view.process import equations_watched, viewed

    planned = read_plan(plan) if port != "virtual" else as_virtual(read_plan(plan))
    if not 0.0 <= sync < float("inf"):
        raise PlanError(f"--sync is {sync:g} s; give 0 or more, 1 is usual")
    if again and not resume:
        raise PlanError("--again repeats runs of an earlier session; give it together with --resume")
    if until_known and planned.instrument.analyzer:
        raise PlanError("--until-known needs an instrument that streams samples, and an analyzer returns finished records")
    if output.exists() and not resume:
        raise OutputError(f"{output} already exists; continue it with --resume, or give another -o")
    reopen_notes(output)
    wire = port or planned.instrument.port
    with ended_by_signals(), Terminal(json=json) as terminal:
        own = Operator(lock=(lambda configuration: None) if yes else terminal.ask, watch=terminal.watch, taken=terminal.taken)
        equations = (view or until_known) and not planned.instrument.analyzer
        shown = viewed(planned, output, own, terminal, asks=not yes) if view else nullcontext((None, own))
        try:
            with (
                shown as (control, by_page),
                nullcontext(by_page)
                if not equations
                else equations_watched(output, by_page, partial(_show, terminal, control), until_known=until_known) as operator,
            ):
                taken = run_session(planned, wire, output, operator, resume=resume, again=set(again), force=force, sync=sync)
                while control is not None and (name := control.again()):
                    more = run_session(planned, wire, output, operator, resume=True, again={name}, force=force, sync=sync)
                    taken = [item for item in taken if item.id != name] + more
        except (KeyboardInterrupt, SystemExit, DriverError):
            settle_notes(output)
            if output.exists():
                # A closed terminal may be the reason for the end.
                with suppress(OSError):
                    print(f"the measured data are in {output}; rig acquire --resume continues the plan", file=sys.stderr)
            raise
    settle_notes(output)
    if json:
        return
    bad = [item.id for item in taken if not item.verdict.good]
    words = [f"{len(taken)} {'run' if len(taken) == 1 else 'runs'} measured" + ("" if bad else ", no faults")]
    if bad:
        words.append(f"repeat while the rig is set up: --resume {' '.join(f'--again {name}' for name in bad)}")
    try:
        print(*words, output, sep="\n", flush=True)
    except BrokenPipeError:
        # The reader of the output has ended, and the session is complete all the same.
        discard_output()


def _show(terminal: Terminal, control: SessionControl | None, report: EquationsReport) -> None:
    """Show what the equations of motion tell, on the page and in the terminal."""
    if control is not None:
        control.equations(report)
    terminal.equations(report)
