"""What a rig's sensors can tell of its parameters, from runs as its description says that it is usually driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.fitting.apart import Apart, told_apart
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.files.rigfile import GivenRig
from isorig.rig.prediction import predicted
from isorig.rig.virtual.simulated_recording import made_up, usual_run

#: A run for this needs no more seconds.
LONGEST = 8.0


def from_usual_runs(model: RigModel, paths: Sequence[str]) -> Apart:
    """What one run in each configuration tells of parameters; no longer than `LONGEST`.

    Raises
    ------
    AnalysisError, PlanError
        Where the rig cannot be simulated or judged so.
    """
    runs = []
    for k, name in enumerate(model.configurations):
        plan = usual_run(model, name)
        plan = replace(plan, seconds=min(plan.seconds, LONGEST), seed=k + 1)
        whole = predicted(model, made_up(GivenRig(model=model), plan))
        runs += [replace(run, id=name, started=None) for run in whole.runs]
    return told_apart(model, Campaign(runs=tuple(runs), source="a usual run"), paths)


def sentences(found: Apart, free: bool) -> list[str]:
    """What is to be said of it."""
    said = []
    for group in found.alike:
        if len(group) > 1:
            said.append(
                f"The sensors cannot tell apart: {', '.join(group)}. Some change of all of them together leaves no trace: "
                + ("take at least one of them from free and give its value, or add a sensor or a configuration." if free else
                   "know at least one of them beforehand.")
            )  # fmt: skip
    if found.silent:
        said.append(
            f"No sensor notices: {', '.join(found.silent)}. "
            + (
                "Take them from free, or state in usual a drive that makes them act."
                if free
                else "A usual run does not use them."
            )
        )
    if found.blurred:
        said.append(f"Hardly told from the rest: {', '.join(found.blurred)}. A longer run, another band or a sensor more helps.")
    if not said:
        said.append("The sensors tell all of them apart.")
    return said


def rows(model: RigModel, found: Apart) -> dict[str, str]:
    """The relative deviation by path, as it is shown."""
    shown = {}
    for path, std in zip(found.paths, found.std, strict=True):
        shown[path] = "cannot be told" if not np.isfinite(std) else f"{100.0 * std:.2g} %"
    return shown
