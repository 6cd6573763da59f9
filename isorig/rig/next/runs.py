"""Candidate runs as entries of a plan, with the drive that the instrument would play."""

from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

from isorig.analysis.excitations import PLAYED_BROAD, PlannedExcitation
from isorig.analysis.proposals.menu import CandidateRun
from isorig.analysis.proposals.prediction import Prospect
from isorig.rig.acquire.drive import drive_of
from isorig.rig.acquire.plan import RunPlan
from isorig.rig.files.rivals import ExistingRun
from isorig.rig.virtual.levels import HEAD_PER_GAIN, MOVE_PER_GAIN

#: Excitations with different realizations.
WITH_REALIZATIONS = (*PLAYED_BROAD, "moves")
EXCITATION_WORDS = {
    "random": "random drive", "multisine": "odd multisine with omitted lines", "sine": "sine", "sweep": "sweep",
    "moves": "moves", "steps": "steps to and fro", "free": "rest", "other": "driven by other means",
}  # fmt: skip


def planned(run: CandidateRun, name: str) -> RunPlan:
    """The run as an entry of a plan."""
    return RunPlan(id=name, **{**vars(run), "period": min(run.period, run.seconds)})


def candidate(run: RunPlan) -> CandidateRun:
    """A planned run as a candidate for proposals."""
    return CandidateRun(**{name: getattr(run, name) for name in CandidateRun.__dataclass_fields__})


def prospect(run: CandidateRun, sample_rate: float, start_time: float, scale: float = 1.0) -> Prospect:
    """A run with its drive as recorded by the drive channel; `scale` is the rig's drive divided by the planned one."""
    plan = planned(run, "candidate")
    drive = drive_of(plan, 0, sample_rate)
    values = drive[0 : plan.ticks(sample_rate)] if plan.played else np.zeros(plan.ticks(sample_rate))
    return Prospect(run=run, drive=scale * run.gain * values, sample_rate=sample_rate, start_time=start_time)


def drive_scale(taken: Sequence[ExistingRun]) -> float:
    """The recorded drive of the runs so far divided by the planned one: the median over runs with a known drive."""
    ratios = [run.drive_rms / (run.gain * HEAD_PER_GAIN) for run in taken if run.excitation in PLAYED_BROAD]
    ratios += [run.drive_peak / (run.gain * MOVE_PER_GAIN) for run in taken if run.excitation == "moves"]
    return float(np.median(ratios)) if ratios else 1.0


def existing_runs(taken: Sequence[ExistingRun], plans: Mapping[str, RunPlan], sample_rate: float, scale: float) -> list[Prospect]:
    """The runs so far with their drives: exact if their plan is known, otherwise another realization of the same kind.

    A run at rest contains no information about the rig, and an unknown drive cannot be generated again: both are left out.
    """
    found = []
    for run in taken:
        plan = plans.get(run.id)
        known = run.excitation in WITH_REALIZATIONS
        if plan is not None and plan.played:
            one = candidate(plan)
        elif plan is None and known and (run.band is not None or run.excitation == "moves"):
            one = CandidateRun(
                configuration=run.configuration, excitation=cast("PlannedExcitation", run.excitation), gain=run.gain,
                seconds=run.seconds, band=run.band, period=run.period or CandidateRun.period,
            )  # fmt: skip
        else:
            continue
        found.append(prospect(one, sample_rate, run.start_time, scale))
    return found


def run_words(run: CandidateRun | RunPlan, alone: bool = False) -> str:
    """A run in one line; `alone` states that the rig has one configuration, which needs no name."""
    text = EXCITATION_WORDS[run.excitation]
    if run.excitation not in ("free", "other"):
        text += "" if run.band is None else f" from {run.band[0]:g} to {run.band[1]:g} Hz"
        text += "" if run.frequency is None else f" of {run.frequency:g} Hz"
        text += f" at gain {run.gain:g}"
    again = f", repeating the drive of {run.repeat_of}" if run.repeat_of else ""
    return f"{text}, {'' if alone else f'{run.configuration}, '}{run.seconds:g} s{again}"
