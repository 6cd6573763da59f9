"""Which parameters a rig's sensors determine, from runs with the usual drive of its description."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.fitting.identifiability import Identifiability, identifiability
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.model.prediction import predicted
from isorig.rig.virtual.simulated_recording import synthetic_drive, usual_run

#: Maximum length of a simulated run, s.
LONGEST = 8.0


def from_usual_runs(model: RigModel, paths: Sequence[str]) -> Identifiability:
    """Identifiability from one run in each configuration, each at most `LONGEST` seconds.

    Raises
    ------
    AnalysisError, PlanError
        If the rig cannot be simulated or fitted.
    """
    runs = []
    for k, name in enumerate(model.configurations):
        plan = usual_run(model, name)
        plan = replace(plan, seconds=min(plan.seconds, LONGEST), seed=k + 1)
        whole = predicted(model, synthetic_drive(model, plan))
        runs += [replace(run, id=name, started=None) for run in whole.runs]
    return identifiability(model, Campaign(runs=tuple(runs), source="a usual run"), paths)


def sentences(found: Identifiability, free: bool) -> list[str]:
    """The result as sentences; `free` states whether the parameters are those marked as free."""
    said = []
    remedy = "Remove at least one of them from free and give its value, or add a sensor or a configuration." if free else ""
    for group in found.indistinguishable:
        said.append(
            f"The sensors cannot distinguish {', '.join(group)}: a joint change has no effect on any sensor. {remedy}".strip()
        )
    if found.without_effect:
        remedy = "Remove them from free, or give in usual a drive that excites them." if free else ""
        said.append(f"No effect on any sensor in a usual run: {', '.join(found.without_effect)}. {remedy}".strip())
    if found.correlated:
        said.append(f"Poorly determined, strongly correlated: {', '.join(found.correlated)}. Use longer runs or more sensors.")
    return said or ["The sensors determine all of them."]


def uncertainties(found: Identifiability) -> dict[str, str]:
    """The relative standard uncertainty by path, as text."""
    return {
        path: "not identifiable" if not np.isfinite(std) else f"{100.0 * std:.2g} %"
        for path, std in zip(found.paths, found.std, strict=True)
    }
