"""The whole diagnosis of a campaign: baseline, misfit, candidates, judgement, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from analysis.diagnose.judge import Score, confidence, margin_in_errors, noise_floor, score
from analysis.diagnose.mechanisms import CATALOGUE, Candidate
from analysis.diagnose.mechanisms.base import Reported
from analysis.diagnose.misfit import Discrepancy, discrepancies
from analysis.diagnose.observe import observe
from analysis.diagnose.search import Look, Progress, Screen, glanced, parameters_of
from analysis.errors import FitError
from analysis.fit import Fit, Problem, base_parameters, fit
from analysis.measured import Campaign
from analysis.model import RigModel
from analysis.start import equation_start
from analysis.trials import Trial, noise_levels, prepare

#: Fine steps per sample of the simulations that models are judged by.
JUDGED_OVERSAMPLE = 8
#: A candidate whose misfit is this many times the best's is out of the race.
BEHIND = 6.0
#: Candidates that get a full fit, and steps at most.
FINALISTS = 4
MOST_STEPS = 3
#: Below this multiple of what is allowed (the noise floor and the simulation's own limit) a model explains the data.
ENOUGH = 1.5
#: Error of the simulation itself, as a share of the signal: the sampling filter is not known to better than this.
SIMULATION_LIMIT = 0.004
#: Share of the excess over the floor that must go for a cause to be certain, and for the data to count as explained.
EXPLAINED = 0.8
#: Share of what is left of the excess that a further step must remove.
WORTH = 0.15


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
    holdout
        Held-out error of baseline and extended model, and the noise floor.
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
    fine = tuple(_refined(trial) for trial in trials)
    progress(f"{len(trials)} runs prepared; fitting the baseline")
    guess = equation_start(model, trials)
    current = baseline = _baseline(guess, trials)
    first = score(current.model, fine)
    drive_noise = noise_levels(campaign).get(model.drive.channel, 0.0)
    floors = noise_floor(current.model, fine, drive_noise)
    floor = float(np.median(floors))
    floors = np.hypot(floors, SIMULATION_LIMIT)
    now = first
    steps: list[Step] = []
    fits: list[Fit] = []
    scores: list[Score] = []
    while len(steps) < MOST_STEPS and not _adequate(now, floors):
        progress(f"held-out error {now.figure:.3g} against a noise floor of {floor:.3g}; looking for a cause")
        found = _next_step(campaign, guess, current, now, trials, fine, progress)
        if found is None:
            break
        step, better, best = found
        gained = (_excess(now, floors) - _excess(best, floors)) / max(_excess(now, floors), 1e-12)
        if gained < WORTH:
            break
        steps.append(step)
        fits.append(better)
        scores.append(best)
        current, now = better, best
    verdict, kept = _verdict(first, scores, steps, floors)
    extended = fits[kept - 1] if kept else baseline
    last = scores[kept - 1] if kept else first
    return Diagnosis(
        verdict=verdict, baseline=baseline, extended=extended,
        discrepancies=discrepancies(baseline.model, fine), steps=tuple(steps[:kept]),
        baseline_error=first.figure, extended_error=last.figure, floor=floor, scores=(first, last), trials=fine,
    )  # fmt: skip


def fit_baseline(campaign: Campaign, model: RigModel) -> tuple[Fit, tuple[Trial, ...]]:
    """The rig's free parameters fitted to all runs on the finest grid, and the runs it was fitted to."""
    trials = prepare(campaign, model)
    fine = tuple(_refined(trial) for trial in trials)
    rough = _baseline(equation_start(model, trials), trials)
    return _finished(rough, fine), fine


def _refined(trial: Trial) -> Trial:
    return replace(trial, excitation=trial.excitation.resampled(JUDGED_OVERSAMPLE))


def _baseline(guess: RigModel, trials: Sequence[Trial]) -> Fit:
    rough = _patient(guess, glanced(trials))
    return _finished(rough, trials)


def _patient(start: RigModel, trials: Sequence[Trial]) -> Fit:
    # Wide allowances first: a resonance that is off by more than its width has no slope at narrow ones.
    wide = fit(start, base_parameters(start), Problem(trials, share=0.3), iterations=6, tolerance=2e-2)
    return fit(wide.model, base_parameters(wide.model), Problem(trials), iterations=12, tolerance=5e-3)


def _finished(rough: Fit, trials: Sequence[Trial]) -> Fit:
    return fit(rough.model, rough.free, Problem(trials, share=0.004), iterations=4, tolerance=1e-3)


def _excess(score_: Score, floors: np.ndarray) -> float:
    # Mean over runs and channels of the log of the error over its floor: zero for a perfect model.
    return float(np.mean(np.log(np.maximum(score_.error / floors, 1.0))))


def _adequate(score_: Score, floors: np.ndarray) -> bool:
    return bool(np.max(score_.error / floors) < ENOUGH)


def _next_step(
    campaign: Campaign,
    guess: RigModel,
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
    evidence = observe(campaign, glance.model, trials, guess)
    looks = screen.ranked([c for mechanism in CATALOGUE for c in mechanism.candidates(glance.model, evidence)])
    if not looks:
        return None
    progress("most promising: " + ", ".join(f"{x.candidate.cause} ({x.candidate.location})" for x in looks[:3]))
    refined = _race(_diverse(looks), current, short)
    finalists: list[tuple[Candidate, Fit, Score]] = []
    for candidate, rough in refined[:FINALISTS]:
        lost = bool(finalists) and rough.cost > BEHIND * refined[0][1].cost
        if lost and len(finalists) > 1:
            break
        # One that is far behind is no contender: its rough fit serves to say by how much.
        done = rough if lost else _finished(rough, trials)
        finalists.append((candidate, done, score(done.model, fine)))
        progress(f"{candidate.cause} ({candidate.location}): held-out error {finalists[-1][2].figure:.3g}")
    if not finalists:
        return None
    finalists.sort(key=lambda item: float(np.mean(np.log(item[2].blocks))))
    return _choice(finalists, now)


def _race(looks: Sequence[Look], current: Fit, short: Sequence[Trial]) -> list[tuple[Candidate, Fit]]:
    # Fits of all on the short data, best first; after a few steps only those go on that are not far behind.
    problem, wide = Problem(short), Problem(short, share=0.3)
    running: list[tuple[Candidate, Fit]] = []
    for look in looks:
        free = parameters_of(current.model, look.candidate, current.free)
        try:
            start = look.model
            if look.candidate.family == "chain" and look.cost > 10.0:
                start = fit(start, free, wide, iterations=5, tolerance=2e-2).model
            done = fit(start, free, problem, iterations=2, tolerance=1e-2)
            if look.candidate.fresh is not None and done.cost > 10.0:
                again = fit(look.candidate.fresh, free, wide, iterations=6, tolerance=2e-2)
                again = fit(again.model, free, problem, iterations=2, tolerance=5e-3)
                done = min(done, again, key=lambda f: f.cost)
        except FitError:
            continue
        running.append((look.candidate, done))
    least = min((done.cost for _, done in running), default=0.0)
    running = [
        (candidate, fit(done.model, done.free, problem, iterations=8, tolerance=1e-2) if done.cost < BEHIND * least else done)
        for candidate, done in running
    ]
    running = [(candidate, done) for candidate, done in running if candidate.plausible(done.model)]
    return sorted(running, key=lambda pair: pair[1].cost)


def _diverse(looks: Sequence[Look]) -> list[Look]:
    # The best looks, and the best of each family that promises anything, so that no kind is lost to a rough first step.
    chosen = list(looks[:5])
    seen = {look.candidate.family for look in chosen}
    for look in looks[5:]:
        if look.candidate.family not in seen and look.cost < 1.05 * looks[-1].cost:
            chosen.append(look)
            seen.add(look.candidate.family)
    return chosen[:8]


def _choice(finalists: Sequence[tuple[Candidate, Fit, Score]], now: Score) -> tuple[Step, Fit, Score] | None:
    candidate, fitted, best = finalists[0]
    close = [item for item in finalists if item[2] is best or margin_in_errors(best, item[2]) < 2.0]
    # Of those that the data cannot tell apart, the simplest is carried.
    candidate, fitted, carried = min(close, key=lambda item: item[0].rank)
    others = [item for item in finalists if item[2] is not carried]
    alike = {other.key for other, _, s in close if s is not carried} | ({candidate.twin} if candidate.twin else set())
    apart = [item for item in others if all(item[2] is not other[2] for other in close)]
    model = msgspec.structs.replace(fitted.model, free=tuple(free.path for free in fitted.free))
    values = {r.name: (r.of(fitted.model), _deviation(r, fitted), r.unit) for r in candidate.reported}
    step = Step(
        cause=candidate.cause, location=candidate.location, parameters=values,
        confidence=confidence(carried, [item[2] for item in apart]),
        rivals=tuple(
            Rival(cause=c.cause, location=c.location, holdout_error=s.figure) for c, _, s in others
        ),
        indistinguishable=tuple(sorted(alike)),
        evidence=(
            f"With {candidate.cause} at {candidate.location} the held-out error falls from {now.figure:.3g} to "
            f"{carried.figure:.3g}.",
        ),
        before=now.figure, after=carried.figure,
    )  # fmt: skip
    return step, replace(fitted, model=model), carried


def _deviation(reported: Reported, fitted: Fit) -> float:
    # First-order propagation through whatever the reported figure is made of.
    middle = reported.of(fitted.model)
    slope = np.zeros(len(fitted.free))
    for k, free in enumerate(fitted.free):
        value = fitted.model.get(free.path)
        step = 1e-5 * abs(value) or 1e-9
        slope[k] = (reported.of(fitted.model.replace({free.path: value + step})) - middle) / step
    return float(np.sqrt(max(float(slope @ fitted.covariance @ slope), 0.0)))


def _verdict(first: Score, scores: Sequence[Score], steps: Sequence[Step], floors: np.ndarray) -> tuple[str, int]:
    if not scores:
        return ("adequate" if _adequate(first, floors) else "unexplained"), 0
    total = _excess(first, floors)
    for kept in range(len(scores), 0, -1):
        removed = 1.0 - _excess(scores[kept - 1], floors) / max(total, 1e-12)
        if removed >= EXPLAINED:
            return "explained", kept
    alone = 1.0 - _excess(scores[0], floors) / max(total, 1e-12)
    if alone >= 0.6 and steps[0].confidence >= 0.95:
        return "partly explained", 1
    return "unexplained", 0
