"""The fits of a diagnosis: the baseline, many candidates in a race, and the winner to the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnose.division import Divide, refined
from analysis.diagnose.judge import score, worst
from analysis.diagnose.mechanisms import Candidate
from analysis.diagnose.search import Look, glanced, parameters_of
from analysis.errors import FitError
from analysis.fit import Fit, Free, Problem, base_parameters, disagreement, fit
from analysis.measured import Campaign, FloatArray
from analysis.model import RigModel
from analysis.simulate import Excitation
from analysis.start import equation_start
from analysis.trials import Trial, expected, prepare

#: A fit sees the first seconds of each run, then more; steps that it may take at each, and the gain that ends them early.
HORIZONS = (0.25, 0.5, 1.0, 2.0, 4.0, 10.0)
STEPS = (8, 5, 5, 5, 5, 8)
CLOSE = 1e-2
#: What a short stretch does not show stays where it was.
TETHER = 1.0
#: Seconds of each run that a look at all candidates takes in, and the share of a model's misfit that must show in them.
SCREENS = (4.0, 10.0)
SHOWN = 0.3
#: How many times a fit's misfit another's must be to be far worse.
FAR_WORSE = 2.0
#: Candidates that race, beside the best of each family.
RACING = 6
#: A candidate whose misfit is this many times the best's is out of the race.
BEHIND = 6.0
#: A fit whose misfit over a run's first moments is more than this times its allowance has been bent by what it lacks.
BENT = 10.0
#: Share of a channel's rms that counts as noise where a fit ends.
NARROW = 0.004

Running = list[tuple[Candidate, Fit]]


def fit_baseline(campaign: Campaign, model: RigModel) -> tuple[Fit, tuple[Trial, ...]]:
    """The rig's free parameters fitted to all runs on the finest grid, and the runs it was fitted to."""
    trials = prepare(campaign, model)
    fine = tuple(refined(trial) for trial in trials)
    rough = baseline_fit(guesses_of(model, trials), trials)
    return finished(rough, fine), fine


def guesses_of(model: RigModel, trials: Sequence[Trial]) -> tuple[RigModel, ...]:
    """Where fits may start: the equations of motion, the same with the first guess of friction, and the first guesses."""
    solved = equation_start(model, trials)
    dry = [path for path in model.free if path.endswith("friction_force")]
    between = (solved.replace({path: model.get(path) for path in dry}),) if dry else ()
    return (solved, *between, model)


def baseline_fit(starts: Sequence[RigModel], trials: Sequence[Trial]) -> Fit:
    """The rig's own free parameters fitted to all runs, from the best of several starts, the most trusted first."""
    rungs = ladder(trials)
    free = base_parameters(starts[0])
    begun = [done for start in starts if (done := tried(start, free, rungs[0]))]
    if not begun:
        raise FitError(f"the model {starts[0].name!r} cannot be simulated at its starting values; correct its parameters")
    # Of starts that lead equally far the first is the most trusted: a rig that is not so may be bent to anything.
    least = min(done.cost for done in begun)
    done = next(done for done in begun if done.cost <= FAR_WORSE * least)
    for rung in rungs[1:]:
        done = fit(done.model, free, rung.problem, iterations=rung.steps, tolerance=CLOSE, tether=TETHER)
    return finished(done, trials)


@dataclass(frozen=True, kw_only=True)
class Rung:
    """What a fit sees on its way, and how many steps it may take there."""

    problem: Problem
    steps: int


def ladder(trials: Sequence[Trial], shows: float = 0.0) -> tuple[Rung, ...]:
    """Problems from a run's first moments to its first ten seconds, without those that see less than `shows` seconds.

    Waveforms are a rough ground to descend on: once two motions have drifted apart by half a period, no slope leads back. From a
    known rest they cannot have at first, so a fit that sees more only once it agrees with less finds its way from far.
    """
    if any(trial.motion for trial in trials):  # judged by the drive, moment by moment: nothing drifts
        shows = max(shows, HORIZONS[-1])
    rungs = [rung for rung in zip(HORIZONS, STEPS, strict=True) if rung[0] >= shows] or [(shows, STEPS[-1])]
    return tuple(Rung(problem=Problem(glanced(trials, seconds)), steps=steps) for seconds, steps in rungs)


def horizon(model: RigModel, trials: Sequence[Trial]) -> float:
    """Seconds of each run, from the first on, after which a model's misfit shows as it does in the whole."""
    *short, whole = (*SCREENS, np.inf)
    size = _largest(model, Problem(glanced(trials, whole)))
    return next((s for s in short if _largest(model, Problem(glanced(trials, s))) > SHOWN * size), whole)


def _largest(model: RigModel, problem: Problem) -> float:
    # Mean square weighted residual of the trial that is worst.
    parts = np.split(problem.residuals([model])[0], np.cumsum(problem.sizes)[:-1])
    return max(float(np.mean(part**2)) for part in parts)


def finished(rough: Fit, trials: Sequence[Trial]) -> Fit:
    """A fit brought to its end on all that fits may see."""
    return fit(rough.model, rough.free, Problem(trials, share=NARROW), iterations=4, tolerance=1e-3)


def tried(start: RigModel, free: Sequence[Free], rung: Rung) -> Fit | None:
    """A fit on a rung, or None from a start whose motion grows without bound."""
    try:
        return fit(start, free, rung.problem, iterations=rung.steps, tolerance=CLOSE, tether=TETHER)
    except FitError:
        return None


def widened(done: Fit) -> Fit:
    """A fit whose deviations include how far the runs disagree."""
    return replace(done, covariance=done.covariance + disagreement(done))


def without(step: Fit, current: Fit, trials: Sequence[Trial]) -> Fit:
    """The model as it was before a step, fitted from where the step has led its parameters."""
    values = {free.path: step.model.get(free.path) for free in current.free if free.path in step.values}
    try:
        return finished(replace(current, model=current.model.replace(values)), trials)
    except FitError:
        return current


def calibrated(done: Fit, trials: Sequence[Trial], divide: Divide, floors: FloatArray, drive_noise: float) -> float:
    """What a rig that is the model itself would get for its largest error over what is allowed.

    The fitted model is simulated with the data's own noise on responses and drive, fitted anew, and judged as data are.
    """
    generator = np.random.default_rng(17)

    def twin(trial: Trial) -> Trial:
        fine = refined(trial)
        clean = expected(done.model, fine)
        noise = generator.normal(0.0, 1.0, clean.shape) * trial.noise[:, None]
        drive = trial.excitation.recorded + generator.normal(0.0, drive_noise, trial.samples)
        excitation = Excitation.prepare(drive, trial.sample_rate, oversample=trial.excitation.oversample)
        return replace(trial, measured=clean + noise, excitation=excitation)

    twins = divide([twin(trial) for trial in trials])
    again = fit(done.model, done.free, Problem(twins.fits, share=NARROW), iterations=3, tolerance=1e-3)
    return worst(score(again.model, twins.judged), floors)


def diverse(looks: Sequence[Look]) -> list[Look]:
    """The best looks, and the best of each family, so that no kind is lost to a rough first step."""
    chosen = list(looks[:RACING])
    for look in looks[RACING:]:
        if all(look.candidate.family != other.candidate.family for other in chosen):
            chosen.append(look)
    return chosen


def _entered(looks: Sequence[Look]) -> list[tuple[Candidate, RigModel]]:
    return [(look.candidate, model) for look in looks for model in look.models]


def race(looks: Sequence[Look], current: Fit, rungs: Sequence[Rung], guess: RigModel) -> Running:
    """Fits of candidates up the ladder, best first; those that fall far behind on a rung are left there.

    They start from the current fit; the most promising also from the rig's first guess, where the current fit is so far off that
    what is missing has bent all its parameters.
    """
    starts = [(c, parameters_of(current.model, c, current.free), model) for c, model in _entered(looks)]
    if float(np.mean(rungs[0].problem.residuals([current.model])[0] ** 2)) > BENT:
        for c, model in _entered(looks[:RACING]):
            free = parameters_of(current.model, c, current.free)
            unbent = {f.path: guess.get(f.path) for f in free if f not in c.free and f.path in guess.free}
            starts.append((c, free, model.replace(unbent)))
    running: Running = []
    for rung in rungs:
        climbed = [(c, done) for c, free, start in starts if (done := tried(start, free, rung)) and c.plausible(done.model)]
        climbed.sort(key=lambda pair: pair[1].cost)
        # From several starts the best goes on.
        first = [p for k, p in enumerate(climbed) if all(p[0] is not other for other, _ in climbed[:k])]
        running = [pair for place, pair in enumerate(first) if place < 2 or pair[1].cost < BEHIND * first[0][1].cost]
        starts = [(candidate, done.free, done.model) for candidate, done in running]
    return [p for k, p in enumerate(running) if all(p[0].key != other.key for other, _ in running[:k])]
