"""rig investigate: measure, diagnose and measure again until one cause stands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter


def investigate(
    plan: Path,
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    port: str | None = None,
    limits: Path | None = None,
    baseline: Literal["coulomb", "linear"] = "coulomb",
    tolerance: float = 0.0,
    runs: int = 12,
    seconds: float = 300.0,
    yes: bool = False,
    force: bool = False,
) -> None:
    """Measure, diagnose, propose the run that parts what is open, and measure again, until one cause stands.

    The plan's runs come first; a plan without runs begins with those that tell most. Before each run the operator is asked. It
    ends when one cause stands, when no allowed run would be likely to show more, or when its runs or seconds are spent. Broken
    off at any moment, the same call goes on where it was.

    Example: rig investigate session.toml -o investigation

    Parameters
    ----------
    plan
        The plan: instrument, channels, what is known of the rig, limits, and the first runs if there are any.
    output
        The folder for recording.h5, session.toml (all runs), diagnosis-1 and so on, and report.html, the whole course.
    port
        The instrument's port instead of the plan's.
    limits
        A TOML file of limits, which hold together with those of the plan and of the rig's description.
    baseline
        The wire bonder with Coulomb friction, or without any.
    tolerance
        Error, as a share of the signal, that is not worth a cause.
    runs, seconds
        Runs, and seconds of measuring, that it may take in all.
    yes
        Ask nothing: for a rig that locks itself, or a virtual one.
    force
        Begin runs that the look before them speaks against.
    """
    from isorig.rig.acquire.plan import as_virtual
    from isorig.rig.acquire.plan_check import read_plan
    from isorig.rig.acquire.session import Operator
    from isorig.rig.acquire.terminal import Terminal
    from isorig.rig.commands.diagnose import LIMIT
    from isorig.rig.errors import PlanError, RigError
    from isorig.rig.next.course import PAGE, Course, Terms, described_rig, read_course
    from isorig.rig.next.course import investigate as go_on
    from isorig.rig.next.limits_file import limits_of
    from isorig.rig.next.measuring import measuring
    from isorig.rig.next.proposal import WORK

    if not 0.0 <= tolerance < float("inf"):
        raise RigError(f"--tolerance is {tolerance:g}; give a share of the signal that is not negative, such as 0.05 for 5 %")
    if runs < 1 or not 0.0 < seconds < float("inf"):
        raise RigError(f"--runs is {runs} and --seconds is {seconds:g}; give at least one run and a positive time")
    own = read_plan(plan, runs=False)
    if own.instrument.analyzer:
        raise PlanError(
            f"{plan} is for an analyzer, which plays no drive of a plan; an investigation needs an instrument that does"
        )
    if any(run.repeats > 1 for run in own.runs):
        raise PlanError(f"{plan} has runs with repeats; give each run of an investigation its own id")
    wire = port or own.instrument.port
    own = as_virtual(own) if wire == "virtual" else own
    begun = read_course(output) or Course(plan=plan.name, baseline=baseline, tolerance=tolerance)
    if (begun.plan, begun.baseline, begun.tolerance) != (plan.name, baseline, tolerance):
        raise RigError(
            f"{output} holds an investigation of {begun.plan} with baseline {begun.baseline} and tolerance {begun.tolerance:g}; "
            "go on with these, or give another folder"
        )
    output.mkdir(parents=True, exist_ok=True)
    with Terminal(json=False) as terminal:
        operator = Operator(lock=_silent if yes else terminal.ask, watch=terminal.watch, taken=terminal.taken)
        measure = measuring(wire, operator, None if yes else terminal.consent, force=force)
        terms = Terms(
            most_runs=runs, seconds=seconds, limits=limits_of(described_rig(own, baseline), own, limits), work=WORK,
            measure=measure, limit=LIMIT, tell=terminal.say,
        )  # fmt: skip
        course = go_on(own, output, begun, terms)
    print(course.ended or "Stopped by the operator; the same call goes on where it was.")
    print(f"{course.seconds:g} s measured in {len(course.runs)} runs", output / PAGE, sep="\n")


def _silent(configuration: str) -> None:
    """Nobody is asked."""
