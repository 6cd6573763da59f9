"""Measures the runs of an investigation that are missing in the recording, each with the operator's consent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from msgspec import structs

from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.recorder import working_file
from isorig.rig.acquire.session import Decision, Operator, acquire
from isorig.rig.acquire.store import whole_runs
from isorig.rig.next.investigation import Measure, Measured


def measuring(wire: str, operator: Operator, consent: Callable[[str], Decision] | None = None, *, force: bool = False) -> Measure:
    """A function that measures a plan's runs with the instrument at a port.

    `consent` is asked before each run by its name, if given; with `force` a run starts even if the pre-run check fails.
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
            # The proposals keep to the strokes by a model fitted to the runs so far, which knows more than the description.
            chosen = structs.replace(plan, limits=structs.replace(plan.limits, stroke={}))
            acquire(chosen, wire, recording, replace(operator, decide=decide), resume=resume, force=force)
        return Measured(names=sorted(whole_runs(recording, plan)), stopped=stopped)

    return measure
