"""Measures and diagnoses until one cause is identified."""

from pathlib import Path

from isorig.rig.choices import TIME_LIMIT, Baseline
from isorig.rig.options import OutputFolder


def investigate(
    plan: Path,
    *,
    output: OutputFolder,
    port: str | None = None,
    limits: Path | None = None,
    baseline: Baseline = "coulomb",
    tolerance: float = 0.0,
    runs: int = 12,
    seconds: float = 300.0,
    yes: bool = False,
    force: bool = False,
) -> None:
    """Measure, diagnose, propose the run that distinguishes the remaining causes, and repeat until one cause is identified.

    The plan's runs come first; a plan without runs starts with the most informative ones. The operator confirms each run. The
    investigation ends when one cause is identified, when no allowed run is likely to show more, or when the limit of runs or
    seconds is reached. Repeating the command continues an interrupted investigation.

    Example: rig investigate session.toml -o investigation

    Parameters
    ----------
    plan
        The plan: instrument, channels, known values of the rig, limits, and the first runs if any.
    output
        The folder for recording.h5, session.toml (all runs), diagnosis-1 and so on, and report.html about the whole
        investigation.
    port
        The instrument's port instead of the plan's.
    limits
        A TOML file of limits, in addition to those of the plan and of the rig's description.
    baseline
        The wire bonder with Coulomb friction, or without any.
    tolerance
        Error, as a share of the signal, that counts as adequate.
    runs
        Maximum number of runs in total.
    seconds
        Maximum seconds of measuring in total.
    yes
        Do not prompt: for a rig that locks itself, or a virtual one.
    force
        Start even if the pre-run check fails.
    """
    from isorig.rig.acquire.plan import as_virtual
    from isorig.rig.acquire.plan_check import read_plan
    from isorig.rig.acquire.rig_operator import Operator
    from isorig.rig.acquire.terminal import Terminal
    from isorig.rig.diagnose.many import tolerated
    from isorig.rig.errors import PlanError, RigError
    from isorig.rig.next.investigation import PAGE, Terms, described_rig, measure_with, read_investigation
    from isorig.rig.next.investigation import investigate as go_on
    from isorig.rig.next.plan_file import limits_of
    from isorig.rig.next.policy import POLICY
    from isorig.rig.next.stages import Investigation

    tolerance = tolerated(tolerance)
    if runs < 1 or not 0.0 < seconds < float("inf"):
        raise RigError(f"--runs is {runs} and --seconds is {seconds:g}; give at least one run and a positive time")
    own = read_plan(plan, runs=False)
    if own.instrument.analyzer:
        raise PlanError(
            f"{plan} is for an analyzer, which cannot play a plan's drive; an investigation needs an instrument that can"
        )
    if any(run.repeats > 1 for run in own.runs):
        raise PlanError(f"{plan} has runs with repeats; give each run of an investigation its own id")
    wire = port or own.instrument.port
    own = as_virtual(own) if wire == "virtual" else own
    begun = read_investigation(output) or Investigation(plan=plan.name, baseline=baseline, tolerance=tolerance)
    if (begun.plan, begun.baseline, begun.tolerance) != (plan.name, baseline, tolerance):
        raise RigError(
            f"{output} has an investigation of {begun.plan} with baseline {begun.baseline} and tolerance {begun.tolerance:g}; "
            "continue with these, or give another folder"
        )
    output.mkdir(parents=True, exist_ok=True)
    with Terminal(json=False) as terminal:
        operator = Operator(
            lock=(lambda configuration: None) if yes else terminal.ask, watch=terminal.watch, taken=terminal.taken
        )
        measure = measure_with(wire, operator, None if yes else terminal.consent, force=force)
        terms = Terms(
            most_runs=runs, seconds=seconds, limits=limits_of(described_rig(own, baseline), own, limits),
            work=POLICY.comparison_seconds, measure=measure, limit=TIME_LIMIT, tell=terminal.say,
        )  # fmt: skip
        investigation = go_on(own, output, begun, terms)
    print(investigation.ended or "Stopped by the operator; the same command continues the investigation.")
    print(f"{investigation.seconds:g} s measured in {len(investigation.runs)} runs", output / PAGE, sep="\n")
