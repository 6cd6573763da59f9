"""The whole diagnosis of a campaign: baseline, misfit, candidates, judgement, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnose.division import Divide, Division, beginnings, ends, refined
from analysis.diagnose.doubles import Doubles, doubles
from analysis.diagnose.evidence import Sign, signs
from analysis.diagnose.fits import baseline_fit, calibrated, finished, guesses_of, widened, without
from analysis.diagnose.judge import (
    ENOUGH,
    SIMULATION_LIMIT,
    Gain,
    Score,
    adequate,
    excess,
    gain,
    noise_floor,
    score,
    worst,
)
from analysis.diagnose.misfit import Discrepancy, at_first, discrepancies
from analysis.diagnose.search import Progress
from analysis.diagnose.step import Step, next_step, updated, with_evidence
from analysis.fit import Fit
from analysis.measured import Campaign, FloatArray
from analysis.model import RigModel
from analysis.quality import faults
from analysis.trials import Trial, noise_levels, prepare

#: Steps at most.
MOST_STEPS = 3
#: Share of the excess over the floor that must go for a cause to be certain, and for the data to count as explained.
EXPLAINED = 0.8
#: Share of the figure's excess that certain causes must remove where not all is explained, and what makes them certain.
PARTLY, CERTAIN = 2.0 / 3.0, 0.95
#: Share of the excess that the first step must remove; a further one must lower the errors by it, and some error by more than
#: the simulation itself may be wrong: whatever bends a little takes a little off what a first cause has left.
WORTH = 0.15
#: Fall of the errors' mean logarithm that is worth a first step which beats all rivals, whatever is left.
ALONE = 0.4
#: Largest errors over what is allowed, as a multiple of it, up to which the baseline's own rig is asked what it would get; and
#: by how much the data must exceed that.
DOUBTFUL, BEYOND = 4.0, 1.2
#: A model fitted anew from where a step has led it is another one where its excess is lower by this much.
BETTER = 0.1


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
    signs
        What the records say beside the baseline before any cause is fitted.
    worst, enough, calibration
        The baseline's largest error over what is allowed, up to which it would be adequate, and what a rig that is the baseline
        itself would get (None where the answer was plain without).
    gain
        What the extension brought, with intervals.
    trials
        The runs it rests on.
    beside
        The same beside the baseline's.
    division
        What fits saw of them, and what judged the fits.
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
    signs: tuple[Sign, ...]
    worst: float
    enough: float
    calibration: float | None
    gain: Gain
    trials: tuple[Trial, ...]
    beside: Doubles
    division: Division


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
    progress(f"{len(trials)} runs prepared; fitting the baseline")
    guesses = guesses_of(model, trials)
    baseline = widened(baseline_fit(guesses, trials))
    search = _Search(campaign, guesses[0], trials, progress)
    found = search.causes(baseline, ends)
    if found.verdict == "adequate" and search.begins_otherwise(baseline, found.enough):
        progress("the runs' ends fit, but not their beginnings: those of some are kept from the fits")
        again = search.causes(widened(finished(baseline, beginnings(trials).fits)), beginnings)
        found = again if again.verdict != "adequate" else found
    stages, first, last = found.stages, found.stages[0], found.stages[found.kept]
    progress("gathering the evidence")
    fine = tuple(refined(trial) for trial in trials)
    beside = [doubles(stage.fit.model, fine) for stage in stages[: max(found.kept, 1)]]
    said = [signs(campaign, stage.fit.model, fine, each) for stage, each in zip(stages, beside, strict=False)]
    steps = (stage.step for stage in stages[1 : found.kept + 1])
    floor = float(np.median(found.quiet))
    shown = at_first(found.division.judged, first.score.error, found.quiet) if found.division.beginnings else ()
    return Diagnosis(
        verdict=found.verdict, baseline=first.fit, extended=last.fit,
        discrepancies=(*shown, *discrepancies(campaign, first.fit.model, fine, beside[0])), beside=beside[0],
        steps=tuple(with_evidence(updated(step, last.fit), each) for step, each in zip(steps, said, strict=False) if step),
        baseline_error=first.score.figure, extended_error=last.score.figure, floor=floor, scores=(first.score, last.score),
        signs=said[0], worst=worst(first.score, _allowed(found.quiet)), enough=found.enough,
        calibration=found.calibration, gain=gain(first.score, last.score, floor), trials=fine, division=found.division,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class _Stage:
    # A model on the way, and the step that led to it (None of the baseline).
    fit: Fit
    score: Score
    step: Step | None = None


@dataclass(frozen=True, kw_only=True)
class _Found:
    # What a search came to: how runs were divided, the models on the way and how many of them count, and their allowance.
    division: Division
    stages: Sequence[_Stage]
    verdict: str
    kept: int
    quiet: FloatArray
    enough: float
    calibration: float | None


class _Search:
    # The way from a fitted baseline to causes.

    def __init__(self, campaign: Campaign, guess: RigModel, trials: Sequence[Trial], progress: Progress) -> None:
        self._campaign, self._guess, self._trials, self._progress = campaign, guess, trials, progress
        self._drive_noise = noise_levels(campaign).get(guess.drive.channel, 0.0)

    def causes(self, baseline: Fit, divide: Divide) -> _Found:
        division = divide(self._trials)
        trials, judged, progress = division.fits, division.judged, self._progress
        stages = [_Stage(fit=baseline, score=score(baseline.model, judged))]
        quiet = noise_floor(baseline.model, judged, self._drive_noise)
        calibration = self._calibration(stages[0], divide, quiet)
        enough = max(ENOUGH, BEYOND * (calibration or 0.0))
        tries = 0
        while len(stages) <= MOST_STEPS and not adequate(stages[-1].score, _allowed(quiet), enough):
            now, floors = stages[-1], _allowed(quiet)
            told = f"held-out error {now.score.figure:.3g} against a noise floor of {np.median(quiet):.3g}"
            progress(f"{told}; looking for a cause")
            found = next_step(self._campaign, self._guess, now.fit, now.score, trials, judged, floors, progress)
            if found is None:
                break
            step, better, best = found
            # What the step is worth is measured against the model without it, from where the step has led the rest.
            bare = without(better, now.fit, trials)
            plain = score(bare.model, judged)
            moved = excess(now.score, floors) - excess(plain, floors)
            if moved > BETTER:
                progress(f"without {step.cause} the same parameters reach {plain.figure:.3g}")
                now = stages[-1] = replace(now, fit=widened(bare), score=plain)
            gained = excess(now.score, floors) - excess(best, floors)
            if moved > max(BETTER, gained) and tries < MOST_STEPS:
                # The way there did more than the cause: it is looked for again from the better fit.
                tries += 1
                continue
            if not (_worthwhile(now, step, best, floors) and _told_by_itself(now, step, best, floors, judged[0].channels)):
                break
            # A cause may make the rig sensitive: then noise on the drive alone does more.
            quiet = np.maximum(quiet, noise_floor(better.model, judged, self._drive_noise))
            stages.append(_Stage(fit=widened(better), score=best, step=replace(step, before=now.score.figure, after=best.figure)))
        verdict, kept = _verdict(stages, _allowed(quiet), float(np.median(quiet)), enough)
        return _Found(
            division=division, stages=stages, verdict=verdict, kept=kept, quiet=quiet, enough=enough, calibration=calibration
        )

    def begins_otherwise(self, fitted: Fit, enough: float) -> bool:
        judged = beginnings(self._trials).judged
        if not judged:
            return False
        floors = _allowed(noise_floor(fitted.model, judged, self._drive_noise))
        if adequate(score(fitted.model, judged), floors, enough):
            return False
        # A rig that moved before its record began says nothing by beginning otherwise.
        bad = {f.run for f in faults(self._campaign, reference=fitted.model.drive.channel) if f.kind == "not at rest"}
        return all(trial.run.id not in bad for trial in judged)

    def _calibration(self, stage: _Stage, divide: Divide, quiet: FloatArray) -> float | None:
        # Only near the noise is it worth asking; a rig judged by its drive has no motion of its own to ask.
        floors = _allowed(quiet)
        if not ENOUGH <= worst(stage.score, floors) < DOUBTFUL * ENOUGH or any(trial.motion for trial in self._trials):
            return None
        self._progress("not far above the noise; asking what the baseline's own rig would get")
        return calibrated(stage.fit, self._trials, divide, floors, self._drive_noise)


def _allowed(quiet: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(quiet, SIMULATION_LIMIT))


def _worthwhile(now: _Stage, step: Step, best: Score, floors: FloatArray) -> bool:
    gained = excess(now.score, floors) - excess(best, floors)
    if now.step is None:
        # One of two causes alone takes little off the logarithm; the verdict asks what they explain together.
        return gained >= WORTH * excess(now.score, floors) or (gained >= ALONE and step.confidence >= CERTAIN)
    return gained >= WORTH and float(np.max(now.score.error - best.error)) >= SIMULATION_LIMIT


def _told_by_itself(now: _Stage, step: Step, best: Score, floors: FloatArray, channels: Sequence[str]) -> bool:
    # A sensor's fault explains its own channel. One that only frees the rest of a fit from a spoilt channel is not the fault.
    own = [k for k, name in enumerate(channels) if all(r.path.startswith(f"sensors.{name}.chain.") for r in step.reported)]
    if not own:
        return True
    before, after = (excess(replace(x, error=x.error[:, own]), floors[:, own]) for x in (now.score, best))
    return before - after >= WORTH * before


def _verdict(stages: Sequence[_Stage], floors: FloatArray, floor: float, enough: float) -> tuple[str, int]:
    # "Explained" is asked of every run and channel alike, by the logarithm; "partly" of the figure, and of certain causes.
    first = stages[0].score
    steps = [stage.step for stage in stages if stage.step]
    if not steps:
        return ("adequate" if adequate(first, floors, enough) else "unexplained"), 0
    total = excess(first, floors)
    for kept in range(len(steps), 0, -1):
        if 1.0 - excess(stages[kept].score, floors) / max(total, 1e-12) >= EXPLAINED:
            return "explained", kept
    certain = next((k for k, step in enumerate(steps) if step.confidence < CERTAIN or step.indistinguishable), len(steps))
    removed = (first.figure - stages[certain].score.figure) / max(first.figure - floor, 1e-12)
    return ("partly explained", certain) if removed >= PARTLY else ("unexplained", 0)
