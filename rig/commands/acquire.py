"""rig acquire: measure a campaign after a plan."""

from __future__ import annotations

import os
import sys
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter


def acquire(
    plan: Path,
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    port: str | None = None,
    resume: bool = False,
    again: tuple[str, ...] = (),
    force: bool = False,
    yes: bool = False,
    view: bool = False,
    json: bool = False,
    sync: float = 1.0,
) -> None:
    """Measure the runs of a plan with an instrument, and write them as a recording.

    Each run is looked at right after it was taken. A cable that comes back within 15 s is taken up again. Ctrl-C, TERM, a closed
    terminal, an unplugged instrument or a full disk end the session with what was measured and the drive off; rig recover and
    --resume go on after a kill.

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
    view
        Show the session on a page in the browser of this machine, at the address that is printed. The page has buttons to stop a
        run, to take it again, to note something, and to start the next run where the session waits for the operator: before the
        first run, where the rig is to be locked or unlocked, and after a run that is not sound. With --yes it never waits.
    json
        Tell levels and results as one JSON object a line on standard output: event is "live" while a run lasts, "taken"
        behind it, "ask" where the rig is to be locked or unlocked and a line on standard input is waited for, and "view" with
        the address of the page.
    sync
        Seconds between two times that what was measured is handed to the disk itself: a power loss takes no more than these;
        a kill takes a quarter of a second in any case. 0 waits for the disk after every block.
    """
    from isorig.drivers.errors import DriverError
    from isorig.rig.acquire.notes import reopen_notes, settle_notes
    from isorig.rig.acquire.plan import as_virtual
    from isorig.rig.acquire.plan_check import read_plan
    from isorig.rig.acquire.session import Operator
    from isorig.rig.acquire.session import acquire as run_session
    from isorig.rig.acquire.shutdown import ended_by_signals
    from isorig.rig.acquire.terminal import Terminal
    from isorig.rig.errors import OutputError, PlanError
    from isorig.rig.view.with_screen import viewed

    planned = read_plan(plan) if port != "virtual" else as_virtual(read_plan(plan))
    if not 0.0 <= sync < float("inf"):
        raise PlanError(f"--sync is {sync:g} s; give 0 or more, 1 is usual")
    if again and not resume:
        raise PlanError("--again takes runs of an earlier session once more; give it together with --resume")
    if output.exists() and not resume:
        raise OutputError(f"{output} exists already; go on with it by --resume, or give another -o")
    reopen_notes(output)
    wire = port or planned.instrument.port
    with ended_by_signals(), Terminal(json=json) as terminal:
        told = Operator(lock=_silent if yes else terminal.ask, watch=terminal.watch, taken=terminal.taken)
        shown = viewed(planned, output, told, terminal, asks=not yes) if view else nullcontext((None, told))
        try:
            with shown as (desk, operator):
                path, taken = run_session(
                    planned, wire, output, operator, resume=resume, again=set(again), force=force, sync=sync
                )
                while desk is not None and (name := desk.again()):
                    _, more = run_session(planned, wire, output, operator, resume=True, again={name}, force=force, sync=sync)
                    taken = [item for item in taken if item.id != name] + more
        except (KeyboardInterrupt, SystemExit, DriverError):
            settle_notes(output)
            if output.exists():
                # The terminal may be what ended it.
                with suppress(OSError):
                    print(f"what was measured is in {output}; rig acquire --resume goes on with the plan", file=sys.stderr)
            raise
    settle_notes(output)
    if json:
        return
    bad = [item.id for item in taken if not item.verdict.good]
    words = [f"{len(taken)} runs taken" + ("" if bad else ", all sound")]
    if bad:
        words.append(f"worth taking again while the rig stands: --resume {' '.join(f'--again {name}' for name in bad)}")
    try:
        print(*words, path, sep="\n", flush=True)
    except BrokenPipeError:
        # Whoever read has ended; nothing is left to be written at the end of the program.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _silent(configuration: str) -> None:
    """Nobody is asked."""
