"""A required uncertainty of a parameter, and the runs that reach it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import isfinite

from isorig.analysis.deadline import Deadline
from isorig.analysis.errors import AnalysisError
from isorig.analysis.proposals.policy import POLICY as PROPOSALS
from isorig.analysis.proposals.precision import KnownPrecision, parameter_by_name, runs_for_uncertainty
from isorig.analysis.proposals.prediction import evaluated, models_within_limits
from isorig.rig.errors import PlanError
from isorig.rig.next.policy import POLICY
from isorig.rig.next.proposal import Proposal, Proposed, Situation

EXAMPLE = "give a parameter and a relative uncertainty, e.g. links.spring.damping=2%"


def required_uncertainty(text: str) -> tuple[str, float]:
    """Parameter and required relative uncertainty from the command line, e.g. links.spring.damping=2%. Raises PlanError if the
    text is not valid."""
    name, _, size = text.partition("=")
    try:
        percent = float(size.strip().removesuffix("%"))
    except ValueError:
        percent = -1.0
    if not name.strip() or not size.strip().endswith("%") or not (isfinite(percent) and percent > 0.0):
        raise PlanError(f"--for is {text!r}; {EXAMPLE}")
    return name.strip(), percent / 100.0


def propose_for(now: Situation, name: str, wanted: float, *, budget: float, tell: Callable[[str], None]) -> Proposal:
    """The runs after which a parameter has the wanted relative uncertainty. Raises PlanError if the rig has no such parameter, or
    it does not depend on fitted values."""
    variant = now.explains
    try:
        known = KnownPrecision(variant, parameter_by_name(variant.model, name), now.rivals.noise, now.taken)
    except AnalysisError as error:
        raise PlanError(f"--for {name}: {error}") from None
    runs = [
        replace(run, seconds=min(PROPOSALS.longer * run.seconds, now.limits.seconds or run.seconds)) for run in now.candidates()
    ]
    prospects = [now.prospect(run) for run in runs if run.repeat_of is None]
    with Deadline(POLICY.comparison_seconds):
        candidates = evaluated(prospects, known.information, tell)
    models = models_within_limits(variant)
    found = runs_for_uncertainty(
        known, candidates, now.limits, lambda one: one.peaks(models, whole=True), wish=wanted,
        configuration=now.configuration, budget=budget,
    )  # fmt: skip
    how = "the error bars of the transfer functions" if known.linear else "the waveforms"
    std = known.std(known.now)
    sentences = [
        f"{name} is {known.value:.5g} now, with a standard uncertainty of {_percent(std)}; {_percent(wanted)} "
        f"is required. {len(candidates)} candidate runs were compared by {how} that they would give."
    ]
    last = found[-1].std if found else std
    if std <= wanted:
        sentences.append("The required uncertainty is reached already.")
    elif last > wanted:
        sentences.append(f"No allowed runs of {budget:g} s together reach it; these reach {_percent(last)}.")
    return Proposal(
        kind="parameter", asked=" ".join(sentences), unreached=len(prospects) - len(candidates),
        runs=tuple(
            Proposed(
                run=item.prospect.run, peaks=item.peaks,
                remarks=(f"It reduces the standard uncertainty of {name} to {_percent(item.std)}.",),
            )
            for item in found
        ),
    )  # fmt: skip


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"
