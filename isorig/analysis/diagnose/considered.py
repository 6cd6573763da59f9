"""All considered causes: the share of the error they remove, their status, and which are not identifiable."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose.causes import CATALOGUE
from isorig.analysis.diagnose.causes.base import Kind, RecordedRuns
from isorig.analysis.diagnose.observe import swings
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.diagnose.step import Entry, Step
from isorig.analysis.fitting.excess import excess, ratio
from isorig.analysis.fitting.score import Score
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.rig_model import RigModel


@dataclass(frozen=True, kw_only=True)
class ConsideredCandidate:
    """A considered cause."""

    #: Names of the findings.
    cause: str
    kind: Kind
    location: str
    holdout_error: float | None  #: Held-out error with it; None if it was not fitted.
    share: float | None  #: Share of the baseline's excess error that it removes; None if it was not fitted.
    #: "established", "main contributor", "one of several", "not confirmed" (no fit confirms it, but the equations of motion point
    #: to its kind and place), "ruled out" or "not tested".
    standing: str
    why: str  #: One sentence.


def all_considered(
    searches: Sequence[tuple[Score, Sequence[Entry]]], steps: Sequence[Step], replaced: Collection[tuple[str, str]],
    exchanged: Mapping[tuple[str, str], tuple[str, str]], first: Score, floors: FloatArray, model: RigModel,
    trials: Sequence[Trial], pointed: tuple[str, str] | None,
) -> tuple[ConsideredCandidate, ...]:  # fmt: skip
    """All candidates of all searches, the largest contribution first, followed by the untested causes.

    `replaced` are the causes and places of steps that a later law at the same place replaced, `exchanged` of those
    whose place another cause took once later ones were found; `pointed` is the kind and place to which the equations of motion
    point where no simulation confirms any cause.
    """
    named = {(step.cause, step.location) for step in steps}
    sets = [{(step.cause, step.location), *step.indistinguishable} for step in steps if step.indistinguishable]
    whole = excess(first.error, floors)
    found: dict[tuple[str, str], ConsideredCandidate] = {}
    for before, entries in searches:
        best = min(entries, key=lambda entry: excess(entry.score.error, floors))
        close = {e.candidate.key for e in entries if ratio(e.score.error, best.score.error, floors) < POLICY.form_close}
        for entry in entries:
            key = entry.candidate.key
            if whole <= 0.0:
                found[key] = _needless(entry)
                continue
            # The baseline may have been fitted better since this search.
            share = (min(excess(before.error, floors), whole) - excess(entry.score.error, floors)) / whole
            if key in named:  # with the share of the step that it replaced
                gone = (found[one].share or 0.0 for one in replaced if one in found and one != key and one[1] == key[1])
                share += sum(max(part, 0.0) for part in gone)
            # A named cause that is fitted again with itself in place removes hardly anything then.
            if key not in found or (key in named and share > (found[key].share or 0.0)):
                alike = any(key in one for one in sets)
                found[key] = _considered(entry, share, best, floors, key in named, alike, len(close) > 1)
            if key in replaced and key not in named:
                why = f"It removes {_percent(share)}; a later law at the same place replaces it."
                found[key] = replace(found[key], standing="ruled out", why=why)
            if key in exchanged and key not in named:
                why = f"It removes {_percent(share)}; {' at '.join(exchanged[key])} explains more together with the later causes."
                found[key] = replace(found[key], standing="ruled out", why=why)
    lost = {
        entry.candidate.key
        for before, entries in searches
        for entry in entries
        if ratio(entry.score.error, before.error, floors) >= POLICY.form_close
    }
    for key, one in found.items():
        if key in lost and one.standing == "ruled out":
            why = "Its fit left more than the model without it, so it did not follow the motion: that does not rule it out."
            found[key] = replace(one, standing="not confirmed", why=why)
        if (one.kind, one.location) == pointed and one.standing == "ruled out":
            why = f"{one.why} The equations of motion point to its kind and place, so this does not rule it out."
            found[key] = replace(one, standing="not confirmed", why=why)
    untested = [candidate for candidate in not_tested(model, trials) if (candidate.cause, candidate.location) not in found]
    return (*sorted(found.values(), key=lambda candidate: -(candidate.share or 0.0)), *untested)


def _percent(share: float) -> str:
    return f"{100 * max(share, 0.0):.3g} % of the baseline's reproducible excess"


def _needless(entry: Entry) -> ConsideredCandidate:
    why = "The baseline, refitted from the values of this search, explains the data without it."
    return ConsideredCandidate(
        cause=entry.candidate.cause, kind=entry.kind, location=entry.candidate.location, holdout_error=entry.score.figure,
        share=0.0, standing="ruled out", why=why,
    )  # fmt: skip


def _considered(
    entry: Entry, share: float, best: Entry, floors: FloatArray, named: bool, together: bool, several: bool
) -> ConsideredCandidate:  # fmt: skip
    # `together`: it is reported as indistinguishable from another one; `several`: others come as close as the best.
    behind = ratio(entry.score.error, best.score.error, floors)
    percent = _percent(share)
    if together:
        standing, why = "one of several", f"It removes {percent}; the data cannot distinguish it from others."
    elif named:
        standing = "established" if share >= POLICY.explained else "main contributor"
        why = f"It removes {percent} on held-out data."
    elif several and share >= POLICY.main and behind < POLICY.form_close:
        standing = "one of several"
        why = f"It removes {percent}; its error is {behind:.3g} times that of the best candidate, which does not rule it out."
    elif share >= POLICY.main and entry is best:
        standing, why = "main contributor", f"It removes {percent}, not enough to be named."
    else:
        standing = "ruled out"
        rival = f"{best.candidate.cause} at {best.candidate.location}"
        why = (
            f"It removes {percent}; its error is {behind:.3g} times that of {rival}."
            if entry is not best
            else f"It removes {percent}."
        )
    return ConsideredCandidate(
        cause=entry.candidate.cause, kind=entry.kind, location=entry.candidate.location,
        holdout_error=entry.score.figure, share=share, standing=standing, why=why,
    )  # fmt: skip


def not_tested(model: RigModel, trials: Sequence[Trial]) -> list[ConsideredCandidate]:
    """Causes that are not identifiable from these runs."""
    deflection, _ = swings(model, trials)
    configurations = frozenset(trial.run.configuration for trial in trials)
    runs = RecordedRuns(
        deflection=deflection, configurations=configurations, start_times=[trial.start_time for trial in trials]
    )  # fmt: skip
    return [
        ConsideredCandidate(
            cause=cause.name, kind=cause.kind, location=place, holdout_error=None, share=None, standing="not tested", why=why
        )
        for cause in CATALOGUE
        for place, why in cause.not_identifiable(model, runs)
    ]
