"""The fits of a diagnosis: the baseline, many candidates in a race, and the winner to the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnose.judge import score, worst
from analysis.diagnose.mechanisms import Candidate
from analysis.diagnose.search import Look, glanced, parameters_of
from analysis.errors import FitError, ModelError
from analysis.fit import Correlated, Fit, Free, Problem, base_parameters, disagreement, fit
from analysis.measured import Campaign, FloatArray
from analysis.model import RigModel
from analysis.simulate import Excitation
from analysis.start import equation_start
from analysis.trials import Trial, expected, prepare

#: Fine steps per sample of the simulations that models are judged by.
JUDGED_OVERSAMPLE = 8
#: Mean square of the weighted residuals from which a fit does not explain the data.
MISFIT = 10.0
#: A candidate whose misfit is this many times the best's is out of the race.
BEHIND = 6.0
#: Where one explains all, others whose look was this many times worse need not run.
HOPELESS = 30.0
#: Fresh starts that are fitted, the best of each candidate, and those that are followed further.
FRESH, FOLLOWED = 12, 4
#: Share of a channel's rms that counts as noise: to come near from far, and to finish.
COARSE, NARROW = 0.02, 0.004

Running = list[tuple[Candidate, Fit]]


def fit_baseline(campaign: Campaign, model: RigModel) -> tuple[Fit, tuple[Trial, ...]]:
    """The rig's free parameters fitted to all runs on the finest grid, and the runs it was fitted to."""
    trials = prepare(campaign, model)
    fine = tuple(refined(trial) for trial in trials)
    rough = baseline_fit(first_start(guesses_of(model, trials), trials), trials)
    return finished(rough, fine), fine


def refined(trial: Trial) -> Trial:
    """The trial on the grid that models are judged on."""
    return replace(trial, excitation=trial.excitation.resampled(JUDGED_OVERSAMPLE))


def guesses_of(model: RigModel, trials: Sequence[Trial]) -> tuple[RigModel, ...]:
    """Where fits may start: the equations of motion, the same with the first guess of friction, and the first guesses."""
    solved = equation_start(model, trials)
    dry = [path for path in model.free if path.endswith("friction_force")]
    between = (solved.replace({path: model.get(path) for path in dry}),) if dry else ()
    return (solved, *between, model)


def first_start(guesses: Sequence[RigModel], trials: Sequence[Trial]) -> RigModel:
    """The best of several starts after a short look."""
    problem = Problem(glanced(trials), gauge=Correlated, share=COARSE)
    looks = [fit(start, base_parameters(start), problem, iterations=3, tolerance=5e-2) for start in guesses]
    return min(looks, key=lambda look: look.cost).model


def baseline_fit(start: RigModel, trials: Sequence[Trial]) -> Fit:
    """The rig's own free parameters fitted to all runs."""
    return finished(_near(start, base_parameters(start), trials), trials)


def _near(start: RigModel, free: Sequence[Free], trials: Sequence[Trial]) -> Fit:
    # From far on what goes along with the drive, then on the waveforms; a run's first seconds show the way.
    short = glanced(trials)
    coarse = fit(start, free, Problem(short, gauge=Correlated, share=COARSE), iterations=12, tolerance=1e-2)
    return fit(coarse.model, free, Problem(short), iterations=12, tolerance=5e-3)


def finished(rough: Fit, trials: Sequence[Trial]) -> Fit:
    """A fit brought to its end on all that fits may see."""
    return fit(rough.model, rough.free, Problem(trials, share=NARROW), iterations=4, tolerance=1e-3)


def tried(start: RigModel, free: Sequence[Free], problem: Problem, *, iterations: int, tolerance: float) -> Fit | None:
    """A fit, or None from a start whose motion grows without bound."""
    try:
        return fit(start, free, problem, iterations=iterations, tolerance=tolerance)
    except FitError:
        return None


def widened(done: Fit) -> Fit:
    """A fit whose deviations include how far the runs disagree."""
    return replace(done, covariance=done.covariance + disagreement(done))


def settled(done: Fit, guesses: Sequence[RigModel], trials: Sequence[Trial]) -> Fit:
    """A fit that ended far from the data may have stopped on the way: it comes near again, from where it is or from a guess.

    A rig that was fitted without a cause is bent to it; with the cause in place the first guesses of its own parameters may lie
    nearer.
    """
    problem = Problem(glanced(trials), gauge=Correlated, share=COARSE)
    starts = [done.model, *(done.model.replace(_shared(guess, done)) for guess in guesses)]
    looks = [tried(start, done.free, problem, iterations=4, tolerance=2e-2) for start in starts]
    best = min((look for look in looks if look), key=lambda look: look.cost, default=done)
    try:
        return min(done, finished(_near(best.model, done.free, trials), trials), key=lambda f: f.cost)
    except FitError:
        return done


def _shared(guess: RigModel, done: Fit) -> dict[str, float]:
    # The guess's values of those parameters that the fit has too.
    paths = {free.path for free in done.free}
    return {path: guess.get(path) for path in guess.free if path in paths}


def without(step: Fit, current: Fit, trials: Sequence[Trial]) -> Fit:
    """The model as it was before a step, fitted from where the step has led its parameters."""
    values = {free.path: step.model.get(free.path) for free in current.free if free.path in step.values}
    try:
        return finished(replace(current, model=current.model.replace(values)), trials)
    except FitError:
        return current


def calibrated(done: Fit, trials: Sequence[Trial], floors: FloatArray, drive_noise: float) -> float:
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

    twins = [twin(trial) for trial in trials]
    again = fit(done.model, done.free, Problem(twins, share=NARROW), iterations=3, tolerance=1e-3)
    return worst(score(again.model, [refined(trial) for trial in twins]), floors)


def diverse(looks: Sequence[Look]) -> list[Look]:
    """The best looks, and the best of each family that promises anything, so that no kind is lost to a rough first step."""
    chosen = list(looks[:6])
    seen = {look.candidate.family for look in chosen}
    for look in looks[6:]:
        if look.candidate.family not in seen and look.cost < 1.05 * looks[-1].cost:
            chosen.append(look)
            seen.add(look.candidate.family)
    return chosen[:10]


def race(looks: Sequence[Look], current: Fit, short: Sequence[Trial]) -> Running:
    """Fits of candidates on the short data, best first; those that are not far behind go on to their end.

    Once one explains the data, those whose look was hopeless need not start.
    """
    problem, coarse = Problem(short), Problem(short, gauge=Correlated, share=COARSE)
    running: Running = []
    for look in looks:
        least = min((done.cost for _, done in running), default=np.inf)
        if least < 1.0 and len(running) > 1 and look.cost > HOPELESS * least:
            continue
        free = parameters_of(current.model, look.candidate, current.free)
        done = tried(look.model, free, problem, iterations=2, tolerance=1e-2)
        if done is None:
            continue
        if done.cost > MISFIT:
            near = tried(look.model, free, coarse, iterations=5, tolerance=2e-2)
            again = tried(near.model, free, problem, iterations=2, tolerance=1e-2) if near else None
            done = again if again and again.cost < done.cost else done
        elif done.cost < least:
            done = _ended(done, problem)
        running.append((look.candidate, done))
    return _to_the_end(running, problem)


def afresh(candidates: Sequence[Candidate], refined: Running, current: Fit, short: Sequence[Trial]) -> Running:
    """The race run again from each candidate's own starts: a baseline bent far out of shape is no place to start from."""
    problem, coarse = Problem(short), Problem(short, gauge=Correlated, share=COARSE)
    starts = [(candidate, start) for candidate in candidates for start in candidate.fresh if _holds(start, current, candidate)]
    if not starts:
        return refined
    started = []
    for candidate, start in _promising(starts, current, coarse):
        free = parameters_of(current.model, candidate, current.free)
        near = tried(start, free, coarse, iterations=6, tolerance=2e-2)
        if near is not None:
            started.append((candidate, near))
    started.sort(key=lambda pair: pair[1].cost)
    followed = []
    for candidate, near in started[:FOLLOWED]:
        done = tried(near.model, near.free, problem, iterations=3, tolerance=5e-3)
        if done is not None:
            followed.append((candidate, done))
    best: dict[tuple[str, str], tuple[Candidate, Fit]] = {}
    for candidate, done in sorted([*refined, *_to_the_end(followed, problem)], key=lambda pair: pair[1].cost):
        best.setdefault(candidate.key, (candidate, done))
    return list(best.values())


def _promising(starts: Sequence[tuple[Candidate, RigModel]], current: Fit, problem: Problem) -> list[tuple[Candidate, RigModel]]:
    # The best start of each candidate after a linear step of the model's own parameters.
    here = fit(current.model, current.free, problem, iterations=1)
    costs = here.reachable(problem.residuals([start for _, start in starts]))
    chosen: list[tuple[Candidate, RigModel]] = []
    for k in np.argsort(costs):
        if all(candidate.key != starts[k][0].key for candidate, _ in chosen):
            chosen.append(starts[k])
    return chosen[:FRESH]


def _holds(start: RigModel, current: Fit, candidate: Candidate) -> bool:
    # Fresh starts are without an earlier step's parts: then they are no start for what comes after it.
    try:
        return all(np.isfinite(start.get(free.path)) for free in parameters_of(current.model, candidate, current.free))
    except ModelError:
        return False


def _ended(done: Fit, problem: Problem) -> Fit:
    return fit(done.model, done.free, problem, iterations=8, tolerance=1e-2)


def _to_the_end(running: Running, problem: Problem) -> Running:
    least = min((done.cost for _, done in running), default=0.0)
    running = [(candidate, _ended(done, problem) if done.cost < BEHIND * least else done) for candidate, done in running]
    running = [(candidate, done) for candidate, done in running if candidate.plausible(done.model)]
    return sorted(running, key=lambda pair: pair[1].cost)
