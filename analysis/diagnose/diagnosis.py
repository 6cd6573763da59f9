"""The whole diagnosis of a campaign: baseline, misfit, candidates, judgement, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from analysis.diagnose.fits import (
    BEHIND,
    MISFIT,
    afresh,
    baseline_fit,
    diverse,
    finished,
    first_start,
    guesses_of,
    race,
    refined,
    settled,
    without,
)
from analysis.diagnose.judge import (
    SIMULATION_LIMIT,
    Score,
    adequate,
    confidence,
    excess,
    margin_in_errors,
    noise_floor,
    score,
)
from analysis.diagnose.mechanisms import CATALOGUE, Candidate
from analysis.diagnose.mechanisms.base import Reported
from analysis.diagnose.misfit import Discrepancy, discrepancies
from analysis.diagnose.observe import observe
from analysis.diagnose.search import Progress, Screen, glanced
from analysis.errors import ModelError
from analysis.fit import Fit, Problem, fit
from analysis.measured import Campaign, FloatArray
from analysis.model import RigModel
from analysis.trials import Trial, noise_levels, prepare

#: Candidates that get a full fit, and steps at most.
FINALISTS = 4
MOST_STEPS = 3
#: Share of the excess over the floor that must go for a cause to be certain, and for the data to count as explained.
EXPLAINED = 0.8
#: Share of the figure's excess that certain causes must remove where not all is explained, and what makes them certain.
PARTLY, CERTAIN = 2.0 / 3.0, 0.95
#: Share of the excess that the first step must remove; a further one must lower the errors by it, and some error by more than
#: the simulation itself may be wrong: whatever bends a little takes a little off what a first cause has left.
WORTH = 0.15
#: A model fitted anew from where a step has led it is another one where its excess is lower by this much.
BETTER = 0.1


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


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What was found.

    Parameters
    ----------
    verdict
        "adequate", "explained", "partly explained" or "unexplained".
    baseline, extended
        The fitted models before and after.
    discrepancies
        What the baseline gets wrong.
    steps
        The named causes, largest first.
    baseline_error, extended_error, floor
        Held-out error of baseline and extended model, and the noise floor.
    scores
        The held-out errors of both behind these, run by run and channel by channel.
    trials
        The runs it rests on.
    """

    verdict: str
    baseline: Fit
    extended: Fit
    discrepancies: tuple[Discrepancy, ...]
    steps: tuple[Step, ...]
    baseline_error: float
    extended_error: float
    floor: float
    scores: tuple[Score, Score]
    trials: tuple[Trial, ...]


def diagnose(campaign: Campaign, model: RigModel, *, progress: Progress = lambda text: None) -> Diagnosis:
    """Fit the baseline, show its misfit, and name what explains it.

    Parameters
    ----------
    campaign
        What was measured.
    model
        The baseline with first guesses; its `free` parameters are fitted.
    progress
        Called with one line per stage.
    """
    trials = prepare(campaign, model)
    fine = tuple(refined(trial) for trial in trials)
    progress(f"{len(trials)} runs prepared; fitting the baseline")
    guesses = guesses_of(model, trials)
    guesses = (first_start(guesses, trials), *guesses)
    current = baseline = baseline_fit(guesses[0], trials)
    first = score(current.model, fine)
    floors = noise_floor(current.model, fine, noise_levels(campaign).get(model.drive.channel, 0.0))
    floor = float(np.median(floors))
    floors = np.hypot(floors, SIMULATION_LIMIT)
    now = first
    steps: list[Step] = []
    fits: list[Fit] = []
    scores: list[Score] = []
    tries = 0
    while len(steps) < MOST_STEPS and not adequate(now, floors):
        progress(f"held-out error {now.figure:.3g} against a noise floor of {floor:.3g}; looking for a cause")
        found = _next_step(campaign, guesses, current, now, trials, fine, progress)
        if found is None:
            break
        step, better, best = found
        if not adequate(best, floors):
            longer = settled(better, trials)
            if longer is not better:
                better, best = longer, score(longer.model, fine)
        # What the step is worth is measured against the model without it, from where the step has led the rest.
        bare = without(better, current, trials)
        plain = score(bare.model, fine)
        moved = excess(plain, floors) < excess(now, floors) - BETTER
        if moved:
            progress(f"without {step.cause} the same parameters reach {plain.figure:.3g}")
            current, now = bare, plain
            if not steps:
                baseline, first = bare, plain
            else:
                fits[-1], scores[-1] = bare, plain
        gained = excess(now, floors) - excess(best, floors)
        if gained < WORTH * (1.0 if steps else excess(now, floors)) or (steps and _drop(now, best) < SIMULATION_LIMIT):
            if moved and not adequate(now, floors) and tries < MOST_STEPS:
                tries += 1
                continue
            break
        steps.append(replace(step, before=now.figure, after=best.figure))
        fits.append(better)
        scores.append(best)
        current, now = better, best
    verdict, kept = _verdict(first, scores, steps, floors, floor)
    extended = fits[kept - 1] if kept else baseline
    last = scores[kept - 1] if kept else first
    return Diagnosis(
        verdict=verdict, baseline=baseline, extended=extended,
        discrepancies=discrepancies(baseline.model, fine),
        steps=tuple(_updated(step, extended) for step in steps[:kept]),
        baseline_error=first.figure, extended_error=last.figure, floor=floor, scores=(first, last), trials=fine,
    )  # fmt: skip


def _drop(before: Score, after: Score) -> float:
    # The largest fall of the error of a run and channel.
    return float(np.max(before.error - after.error))


def _next_step(
    campaign: Campaign,
    guesses: tuple[RigModel, ...],
    current: Fit,
    now: Score,
    trials: Sequence[Trial],
    fine: Sequence[Trial],
    progress: Progress,
) -> tuple[Step, Fit, Score] | None:
    short = glanced(trials)
    problem = Problem(short)
    glance = fit(current.model, current.free, problem, iterations=1)
    screen = Screen(glance, problem)
    evidence = observe(campaign, glance.model, trials, guesses)
    looks = screen.ranked([c for mechanism in CATALOGUE for c in mechanism.candidates(glance.model, evidence)])
    if not looks:
        return None
    progress("most promising: " + ", ".join(f"{x.candidate.cause} ({x.candidate.location})" for x in looks[:3]))
    ranked = race(diverse(looks), current, short)
    if not ranked or ranked[0][1].cost > MISFIT:
        progress("nothing explains it yet; starting again away from the baseline")
        ranked = afresh([look.candidate for look in looks], ranked, current, short)
    finalists: list[tuple[Candidate, Fit, Score]] = []
    for candidate, rough in ranked[:FINALISTS]:
        lost = bool(finalists) and rough.cost > BEHIND * ranked[0][1].cost
        if lost and len(finalists) > 1:
            break
        # One that is far behind is no contender: its rough fit serves to say by how much.
        done = rough if lost else finished(rough, trials)
        finalists.append((candidate, done, score(done.model, fine)))
        progress(f"{candidate.cause} ({candidate.location}): held-out error {finalists[-1][2].figure:.3g}")
    if not finalists:
        return None
    finalists.sort(key=lambda item: float(np.mean(np.log(item[2].blocks))))
    return _choice(finalists, now)


def _choice(finalists: Sequence[tuple[Candidate, Fit, Score]], now: Score) -> tuple[Step, Fit, Score] | None:
    candidate, fitted, best = finalists[0]
    close = [item for item in finalists if item[2] is best or margin_in_errors(best, item[2]) < 2.0]
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


def _updated(step: Step, extended: Fit) -> Step:
    # With what later steps made of its parameters; a later step may have replaced them altogether.
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


def _verdict(first: Score, scores: Sequence[Score], steps: Sequence[Step], floors: FloatArray, floor: float) -> tuple[str, int]:
    # "Explained" is asked of every run and channel alike, by the logarithm; "partly" of the figure, and of certain causes.
    if not scores:
        return ("adequate" if adequate(first, floors) else "unexplained"), 0
    total = excess(first, floors)
    for kept in range(len(scores), 0, -1):
        if 1.0 - excess(scores[kept - 1], floors) / max(total, 1e-12) >= EXPLAINED:
            return "explained", kept
    certain = next((k for k, step in enumerate(steps) if step.confidence < CERTAIN or step.indistinguishable), len(steps))
    removed = (first.figure - scores[certain - 1].figure) / max(first.figure - floor, 1e-12) if certain else 0.0
    return ("partly explained", certain) if removed >= PARTLY else ("unexplained", 0)
