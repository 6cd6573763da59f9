"""Proposes the next run, to distinguish the remaining causes."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from isorig.rig.options import Output


def next_(
    *diagnoses: Path,
    output: Output,
    limits: Path | None = None,
    plan: Path | None = None,
    seconds: float = 60.0,
    for_: Annotated[str | None, Parameter(name="--for")] = None,
) -> None:
    """Propose runs that distinguish the causes which a diagnosis leaves open, as a plan for rig acquire.

    Candidate runs are simulated with every remaining cause; the rivals of each are refitted before their distance counts. A run
    that exceeds a limit with any of them is never proposed. If no allowed run distinguishes two causes, the answer says so.

    Example: rig next diagnosis -o next.toml

    Parameters
    ----------
    diagnoses
        Output folders of rig diagnose, for one rig; the last one counts, the others contribute the ruled-out causes.
    output
        The plan to write, a TOML file; a page with the same name and the extension .html shows the predictions.
    limits
        A TOML file of limits: stroke, drive, force, channels, gains, band, seconds, lock_price. They apply in addition to those
        of the rig's description and of the plan.
    plan
        The plan of the session: its instrument, channels and limits. Without it the proposed plan is for the virtual rig.
    seconds
        Maximum seconds of measuring for the proposed runs together.
    for_
        A parameter and its required relative uncertainty, e.g. links.spring.damping=2%: propose the run that reaches it.
    """
    from rich.console import Console

    from isorig.rig.acquire.plan_check import read_plan
    from isorig.rig.errors import PlanError, RigError
    from isorig.rig.files.output import write_text
    from isorig.rig.files.rivals import read_rivals
    from isorig.rig.next.page import proposal_page
    from isorig.rig.next.plan_file import limits_of, run_names, virtual_instrument_of, with_runs, write_plan
    from isorig.rig.next.proposal import propose, situation
    from isorig.rig.next.runs import planned
    from isorig.rig.next.sentences import reasons, summary

    if not diagnoses:
        raise RigError("no diagnosis was given; give a folder that rig diagnose -o wrote")
    if not 0.0 < seconds < float("inf"):
        raise RigError(f"--seconds is {seconds:g}; give the maximum seconds of measuring, e.g. 60")
    if output.suffix != ".toml":
        raise RigError(f"-o is {output}, but it names the plan; give it a name that ends in .toml, e.g. next.toml")
    found = [read_rivals(folder) for folder in diagnoses]
    own = None if plan is None else read_plan(plan, runs=False)
    if own is not None and own.instrument.analyzer:
        raise PlanError(f"{plan} is for an analyzer, which cannot play a plan's drive; choose its next run by hand")
    earlier = {} if own is None else {name: run for run in own.runs if run.repeats == 1 for name in run.ids()}
    now = situation(found, limits_of(found[-1].explains.model, own, limits), earlier)
    with Console(stderr=True).status("comparing candidate runs") as status:
        if for_ is not None:
            from isorig.rig.next.proposal import propose_for, required_uncertainty

            proposal = propose_for(now, *required_uncertainty(for_), budget=seconds, tell=status.update)
        else:
            proposal = propose(now, budget=seconds, tell=status.update)
    head = summary(proposal, now.rivals)
    print(*head, sep="\n")
    if not proposal.runs:
        return
    names = run_names(len(proposal.runs), [run.id for run in now.rivals.runs])
    base = own or virtual_instrument_of(found[-1])
    runs = [planned(item.run, name) for name, item in zip(names, proposal.runs, strict=True)]
    why = {name: reasons(item, proposal, now) for name, item in zip(names, proposal.runs, strict=True)}
    if own is None:
        head.append("No plan was given with --plan: instrument and sensitivities are those of the virtual rig.")
    write_plan(output, with_runs(base, runs), why, head)
    page = write_text(output.with_suffix(".html"), proposal_page(proposal, now, names))
    for name, item in zip(names, proposal.runs, strict=True):
        print(f"{name}: {now.run_words(item.run)}", *why[name], sep="\n  ")
    print(output, page, sep="\n")
