"""One step of a diagnosis: candidates race on short data, the best are finished, and one is chosen or none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from analysis.diagnose.evidence import Sign
from analysis.diagnose.fits import BEHIND, CLOSE, SCREENS, diverse, finished, horizon, ladder, race
from analysis.diagnose.judge import ENOUGH, Score, adequate, confidence, margin_in_errors, score
from analysis.diagnose.mechanisms import CATALOGUE, Candidate
from analysis.diagnose.mechanisms.base import Reported
from analysis.diagnose.observe import observe
from analysis.diagnose.search import Progress, Screen, glanced
from analysis.errors import FitError, ModelError
from analysis.fit import Fit, Problem, fit
from analysis.measured import Campaign, FloatArray
from analysis.model import RigModel
from analysis.trials import Trial

#: Candidates that get a full fit.
FINALISTS = 4
#: A rival that errs by this much more than what explains the data may is not like one that does.
PLAIN = 1.5


@dataclass(frozen=True, kw_only=True)
class Rival:
    """Another candidate and its held-out error."""

    cause: str
    location: str
    holdout_error: float


@dataclass(frozen=True, kw_only=True)
class Step:
    """A named cause with what speaks for it.

    Parameters
    ----------
    cause, location
        Names of the findings' catalogue.
    parameters
        (value, standard deviation, unit) by name.
    confidence
        Share of resampled held-out blocks in which it beats every rival.
    rivals
        The others that were fitted in full, best first.
    indistinguishable
        Cause and location of rivals that the data cannot tell apart from it.
    evidence
        Sentences.
    before, after
        Held-out error without and with it.
    reported
        How its parameters follow from a model.
    """

    cause: str
    location: str
    parameters: dict[str, tuple[float, float, str]]
    confidence: float
    rivals: tuple[Rival, ...]
    indistinguishable: tuple[tuple[str, str], ...]
    evidence: tuple[str, ...]
    before: float
    after: float
    reported: tuple[Reported, ...]


def next_step(
    campaign: Campaign,
    guess: RigModel,
    current: Fit,
    now: Score,
    trials: Sequence[Trial],
    fine: Sequence[Trial],
    floors: FloatArray,
    progress: Progress,
) -> tuple[Step, Fit, Score] | None:
    """The best cause for what the current model leaves, its fit and its score; None where no candidate could be fitted.

    Parameters
    ----------
    campaign, guess
        What was measured, and the rig before any fit.
    current, now
        The model that is to be extended and its score.
    trials, fine
        What fits may see, and what judges them.
    floors
        The error allowed in each run and channel that judges, shape (runs, channels).
    progress
        Called with one line per stage.
    """
    seconds = horizon(current.model, trials)
    problem = Problem(glanced(trials, seconds))
    glance = fit(current.model, current.free, problem, iterations=3, tolerance=CLOSE)
    screen = Screen(glance, problem)
    evidence = observe(campaign, current.model, trials, guess)
    looks = screen.ranked([c for mechanism in CATALOGUE for c in mechanism.candidates(glance.model, evidence)])
    if not looks:
        return None
    progress("most promising: " + ", ".join(f"{x.candidate.cause} ({x.candidate.location})" for x in looks[:3]))
    # Where a shorter stretch shows it too, fits may come near on that.
    ranked = race(diverse(looks), current, ladder(trials, 0.0 if seconds == SCREENS[0] else seconds), guess)
    finalists: list[tuple[Candidate, Fit, Score]] = []
    for candidate, rough in ranked[:FINALISTS]:
        lost = bool(finalists) and rough.cost > BEHIND * ranked[0][1].cost
        if lost and len(finalists) > 1:
            break
        # One that is far behind is no contender: its rough fit serves to say by how much.
        try:
            done = rough if lost else finished(rough, trials)
        except FitError:  # it holds out for the first seconds only
            continue
        finalists.append((candidate, done, score(done.model, fine)))
        progress(f"{candidate.cause} ({candidate.location}): held-out error {finalists[-1][2].figure:.3g}")
    if not finalists:
        return None
    finalists.sort(key=lambda item: float(np.mean(np.log(item[2].blocks))))
    return _choice(finalists, now, floors)


def _choice(finalists: Sequence[tuple[Candidate, Fit, Score]], now: Score, floors: FloatArray) -> tuple[Step, Fit, Score] | None:
    candidate, fitted, best = finalists[0]

    def alike_to(rival: Score) -> bool:
        # What shows for a moment only shows in few blocks, whose spread then hides it; not in the largest error.
        plain = adequate(best, floors) and not adequate(rival, floors, PLAIN * ENOUGH)
        return not plain and margin_in_errors(best, rival) < 2.0

    close = [item for item in finalists if item[2] is best or alike_to(item[2])]
    # Of those that the data cannot tell apart, the simplest is carried.
    candidate, fitted, carried = min(close, key=lambda item: item[0].rank)
    others = [item for item in finalists if item[2] is not carried]
    alike = {other.key for other, _, s in close if s is not carried} | ({candidate.twin} if candidate.twin else set())
    apart = [item for item in others if all(item[2] is not other[2] for other in close)]
    model = msgspec.structs.replace(fitted.model, free=tuple(free.path for free in fitted.free))
    fitted = replace(fitted, model=model)
    step = Step(
        cause=candidate.cause, location=candidate.location, parameters=_values(candidate.reported, fitted),
        confidence=confidence(carried, [item[2] for item in apart]),
        rivals=tuple(
            Rival(cause=c.cause, location=c.location, holdout_error=s.figure) for c, _, s in others
        ),
        indistinguishable=tuple(sorted(alike)),
        evidence=(
            f"With {candidate.cause} at {candidate.location} the held-out error falls from {now.figure:.3g} to "
            f"{carried.figure:.3g}.",
        ),
        before=now.figure, after=carried.figure, reported=candidate.reported,
    )  # fmt: skip
    return step, fitted, carried


def updated(step: Step, extended: Fit) -> Step:
    """The step with what later ones made of its parameters; a later step may have replaced them altogether."""
    try:
        return replace(step, parameters=_values(step.reported, extended))
    except ModelError:
        return step


def _values(reported: Sequence[Reported], fitted: Fit) -> dict[str, tuple[float, float, str]]:
    return {r.name: (r.of(fitted.model), _deviation(r, fitted), r.unit) for r in reported}


def _deviation(reported: Reported, fitted: Fit) -> float:
    # First-order propagation through whatever the reported figure is made of.
    middle = reported.of(fitted.model)
    slope = np.zeros(len(fitted.free))
    for k, free in enumerate(fitted.free):
        value = fitted.model.get(free.path)
        step = 1e-5 * abs(value) or 1e-9
        slope[k] = (reported.of(fitted.model.replace({free.path: value + step})) - middle) / step
    return float(np.sqrt(max(float(slope @ fitted.covariance @ slope), 0.0)))


def with_evidence(step: Step, said: Sequence[Sign]) -> Step:
    """The step with what the records said for it before it was fitted."""
    speaking = tuple(sign.text for sign in said if sign.supports(step.cause, step.location))
    return replace(step, evidence=(*step.evidence, *speaking))
