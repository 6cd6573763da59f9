"""The runs of an investigation taken with an instrument: those that the recording lacks, each with the operator's consent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.recorder import working_file
from isorig.rig.acquire.session import Decision, Operator, acquire
from isorig.rig.acquire.store import whole_runs
from isorig.rig.next.course import Measure, Measured


def measuring(wire: str, operator: Operator, consent: Callable[[str], Decision] | None = None, *, force: bool = False) -> Measure:
    """What takes a plan's runs from the instrument at a port.

    Parameters
    ----------
    wire
        The port.
    operator
        Who locks, and who is told.
    consent
        Asked before each run by its name; nobody is asked where None.
    force
        Begin runs that the look before them speaks against.
    """

    def measure(plan: Plan, recording: Path) -> Measured:
        stopped = False

        def decide(name: str) -> Decision:
            nonlocal stopped
            decision = "take" if consent is None else consent(name)
            stopped = stopped or decision == "end"
            return decision

        left = {name for run in plan.runs for name in run.ids()} - whole_runs(recording, plan)
        broken_off = working_file(recording).exists()
        if left or broken_off:
            resume = broken_off or recording.exists()
            acquire(plan, wire, recording, replace(operator, decide=decide), resume=resume, force=force)
        return Measured(names=sorted(whole_runs(recording, plan)), stopped=stopped)

    return measure
