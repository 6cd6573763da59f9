"""The fits of a diagnosis: the baseline, successive elimination of candidates, and the final fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray
from isorig.analysis.errors import FitError, ModelError, OutOfTimeError
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.division import Divide, refined
from isorig.analysis.fitting.excess import SIMULATION_LIMIT
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.score import score, worst
from isorig.analysis.fitting.screen import Progress, shortened
from isorig.analysis.fitting.solve import Fit, Free, base_parameters, disagreement, fit
from isorig.analysis.fitting.trials import SIGNAL_SHARE, Trial, expected
from isorig.analysis.model.rig_model import RigModel

#: A fit sees the first seconds of each run, then more; steps that it may take at each, and the relative fall of the cost
#: below which they end early.
HORIZONS = (0.25, 0.5, 1.0, 2.0, 4.0, 10.0)
STEPS = (8, 5, 5, 5, 5, 8)
CLOSE = 1e-2
#: Seconds of each run up to which the baseline is fitted from all starting points: the first moments may prefer a wrong one.
UNDECIDED = 1.0
#: Distance of a fitted parameter from its given value, in e-folds, beyond which the fit is repeated from the given value. Chosen:
#: masses and stiffnesses of a description are rarely wrong by a factor of four.
FAR = 1.5
#: Tether for parameters that a short part of the runs does not determine.
TETHER = 1.0
#: Seconds of each run that a free shape's fit sees on its way to the whole, and its tether then.
UNROLLED, HOLDS = (16.0, 30.0), 3.0
#: A longer stretch on which the model's misfit is below this multiple of that on the shorter one is left out: nothing has drifted
#: apart there. Chosen: drift of a waveform multiplies the misfit by ten and more.
UNCHANGED = 2.0
#: Steps of a fit on all that fits may see.
LAST_STEPS = 4
#: Maximum number of further steps of a baseline that has not converged yet, and the relative fall of the cost that ends them.
#: Chosen: a single pull of a cart with stick and slip took fifty.
VALLEY_STEPS, VALLEY_FALL = 80, 5e-3
#: Maximum number of steps with which a candidate's fit is continued. Chosen: hidden modes took 15 to 25.
FURTHER_STEPS = 24
#: Seconds of each run for the first short fits, and the share of a model's misfit that must appear in them.
SCREENS = (4.0, 10.0)
SHOWN = 0.3
#: Ratio of misfits above which a fit is far worse.
FAR_WORSE = 2.0
#: A candidate whose misfit exceeds the best's by this factor is eliminated.
BEHIND = 6.0
#: The largest number of candidates that is followed to a longer part of the runs.
CROWD = 8
#: Number of a candidate's starting points, those closest to the data, that are fitted. Chosen: where a missing effect had biased
#: all parameters, one of the closest four led to the right fit.
EACH = 4
#: Misfit of a refitted model, in allowed errors, above which the data distinguish candidates; and the share by which one must
#: reduce it.
TELLING, PROMISING = 2.0, 0.1
#: Share of the refitted model's misfit that the best candidate must remove before others are eliminated.
#: Chosen: on a short stretch, a cause may imitate the small imperfections of a rig whose main effect does not show yet.
DECISIVE = 0.5
#: A fit whose misfit over a run's first moments exceeds this multiple of its allowance is biased by a missing effect.
BENT = 10.0

#: Misfit, in allowed errors, up to which a fit agrees with the data.
AGREES = 1.0
#: rms error, as a share of the signal, below which a simulation has not lost the motion: waveforms half a period apart have twice
#: the signal's.
STAYS = 0.5
#: Ratio of misfits at the starting points above which one is far from the data, and the maximum number of those that are fitted.
LEAVES, TRIED = 100.0, 12

Running = list[tuple[Candidate, Fit]]


def fit_again(campaign: Campaign, model: RigModel, free: Sequence[Free], later: float = 0.0) -> tuple[Fit, tuple[Trial, ...]]:
    """A fitted model's parameters `free` fitted again to all runs from their values, and these runs on the finest grid.

    `later` is the time in seconds from the model's zero to the campaign's first sample.
    """
    fine = tuple(replace(refined(trial), start_time=trial.start_time + later) for trial in prepare(campaign, model))
    return fit(model, free, Problem(fine, share=SIMULATION_LIMIT), iterations=LAST_STEPS, tolerance=1e-3), fine


def baseline_fit(starts: Sequence[RigModel], trials: Sequence[Trial], *, misfits: bool = False) -> Fit:
    """The rig's own free parameters fitted to all runs, from the best of several starting points, the most trusted first.

    The last starting point has the rig's given values. Where the rig `misfits` for certain, no other starting point makes it
    adequate, and the first one suffices if its motion stays with the data.
    """
    first, *longer = ladder(trials)
    free = base_parameters(starts[0])
    last = (first, *longer)[-1]
    closest = min(starts, key=lambda start: np.nan_to_num(misfit(start, last.problem), nan=np.inf))
    if closest is not starts[0]:  # the given values may explain the data
        given = tried(closest, free, last)
        if given is not None and given.cost < TELLING:
            return _converged(given, trials)
    # Values from the equations of motion are usually close: then nothing diverges.
    quick = tried(starts[0], free, last)
    if quick is not None and quick.cost < ((STAYS / SIGNAL_SHARE) ** 2 if misfits else TELLING):
        return _converged(quick, trials)
    fits = [done for start in starts if (done := tried(start, free, first))]
    for shorter, rung in pairwise((first, *longer)):
        kept = fits if shorter.seconds < UNDECIDED else [_trusted(fits, starts[0].name)]
        fits = [done for each in kept if (done := tried(each.model, free, rung))]
    direct = [quick] if quick is not None else []
    best = min([_trusted([*fits, *direct], starts[0].name), *direct], key=lambda fit: fit.cost)
    return _converged(_returned(best, starts[-1], last), trials)


def not_fitted(model: RigModel) -> Fit:
    """A model with its values as they are, whose uncertainties are unknown."""
    free = base_parameters(model)
    return Fit(model=model, free=free, covariance=np.full((len(free),) * 2, np.nan), cost=np.nan, evaluations=0)


def _trusted(fits: Sequence[Fit], name: str) -> Fit:
    # Of equally good fits the first has the most trusted starting point: a wrong model can be fitted with arbitrary values.
    if not fits:
        raise FitError(f"the model {name!r} cannot be simulated at its starting values; correct its parameters")
    least = min(done.cost for done in fits)
    return next(done for done in fits if done.cost <= FAR_WORSE * least)


def _returned(done: Fit, given: RigModel, rung: Rung) -> Fit:
    # A parameter that went far from its given value, to where the data hardly depend on it, cannot return: a large stiffness is
    # rigid with any value. It starts again from the given value, and stays if that fits better.
    for free in done.free:
        far = free.log and abs(free.encode(done.model.get(free.path)) - free.encode(given.get(free.path))) > FAR
        if far and (again := tried(done.model.replace({free.path: given.get(free.path)}), done.free, rung)):
            done = min(done, again, key=lambda fit: fit.cost)
    return done


@dataclass(frozen=True, kw_only=True)
class Rung:
    """Data of a stage of a fit, its maximum number of steps, and its seconds of each run."""

    problem: Problem
    steps: int
    seconds: float


def ladder(trials: Sequence[Trial], shows: float = 0.0) -> tuple[Rung, ...]:
    """Problems from a run's first moments to its first ten seconds, without those that use less than `shows` seconds.

    The error of waveforms has many local minima: once two motions have diverged by half a period, no gradient leads back.
    Starting from a known rest, they have not diverged yet, so a fit that uses more data only after it agrees with less converges
    from distant starting values.
    """
    if any(trial.motion for trial in trials):  # judged by the drive at each moment: nothing diverges
        shows = max(shows, HORIZONS[-1])
    rungs = [rung for rung in zip(HORIZONS, STEPS, strict=True) if rung[0] >= shows] or [(shows, STEPS[-1])]
    return tuple(Rung(problem=Problem(shortened(trials, seconds)), steps=steps, seconds=seconds) for seconds, steps in rungs)


def horizon(model: RigModel, trials: Sequence[Trial]) -> float:
    """Seconds of each run, from the start, after which a model's misfit is as visible as in the whole."""
    *short, whole = (*SCREENS, np.inf)
    size = _largest(model, Problem(shortened(trials, whole)))
    return next((s for s in short if _largest(model, Problem(shortened(trials, s))) > SHOWN * size), whole)


def _largest(model: RigModel, problem: Problem) -> float:
    # Mean square weighted residual of the worst trial.
    parts = np.split(problem.residuals([model])[0], np.cumsum(problem.sizes)[:-1])
    return max(float(np.mean(part**2)) for part in parts)


def finished(rough: Fit, trials: Sequence[Trial], steps: int = LAST_STEPS, tolerance: float = 1e-3) -> Fit:
    """A fit completed on all fit data, at all frequencies.

    A drive limited to a low band may excite a resonance above it nonetheless, where friction changes at once.
    """
    whole = [replace(trial, ceiling=trial.sample_rate / 2.0) for trial in trials]
    return fit(rough.model, rough.free, Problem(whole, share=SIMULATION_LIMIT), iterations=steps, tolerance=tolerance)


def _converged(rough: Fit, trials: Sequence[Trial]) -> Fit:
    # Dry friction leaves narrow valleys, in which steps are short: the fit goes on as long as they reduce its misfit.
    done = finished(rough, trials)
    return done if done.converged else finished(done, trials, VALLEY_STEPS, VALLEY_FALL)


def unrolled(rough: Fit, trials: Sequence[Trial]) -> Fit:
    """A free shape's fit continued to the whole runs, over increasing lengths if the motion diverges on them.

    Each length may reach points of the curve that no shorter one did, and from a distant solution no gradient leads back. Where
    nothing diverges, one step on the whole is enough.
    """
    done, steps = rough, LAST_STEPS
    longest = max((trial.fitted - trial.onset) / trial.sample_rate for trial in trials)
    runs = Problem(trials)
    for seconds in (s for s in UNROLLED if s < longest):
        if misfit(done.model, runs) < UNCHANGED * done.cost:
            steps = 1
            break
        problem = Problem(shortened(trials, seconds))
        if misfit(done.model, problem) >= UNCHANGED * done.cost:
            done = fit(done.model, done.free, problem, iterations=STEPS[-1], tolerance=1e-3, tether=HOLDS)
    problem = Problem(trials, share=SIMULATION_LIMIT)
    return fit(done.model, done.free, problem, iterations=steps, tolerance=1e-3, tether=HOLDS)


def misfit(model: RigModel, problem: Problem) -> float:
    """Mean square weighted residual; NaN, which compares false, if the model cannot be simulated."""
    return float(np.mean(problem.residuals([model])[0] ** 2))


def tried(start: RigModel, free: Sequence[Free], rung: Rung) -> Fit | None:
    """A fit on a rung, or None from a starting point whose motion grows without bound."""
    try:
        return fit(start, free, rung.problem, iterations=rung.steps, tolerance=CLOSE, tether=TETHER)
    except FitError:
        return None


def widened(done: Fit) -> Fit:
    """A fit whose uncertainties include the differences between runs."""
    return replace(done, covariance=done.covariance + disagreement(done))


def without_step(step: Fit, current: Fit) -> RigModel:
    """The model as it was before a step, with the parameters after the step; those before it where a law excludes these.

    The curve that replaces a law may lead its level to zero.
    """
    after = {free.path: step.model.get(free.path) for free in current.free if free.path in step.values}
    try:
        return current.model.replace(after)
    except ModelError:
        return current.model


def without(step: Fit, current: Fit, trials: Sequence[Trial]) -> Fit:
    """The model as it was before a step, refitted from the parameters after the step."""
    try:
        return finished(replace(current, model=without_step(step, current)), trials)
    except FitError:
        return current


def calibrated(done: Fit, trials: Sequence[Trial], divide: Divide, floors: FloatArray, draw: int) -> float:
    """Largest ratio of error to allowed error for simulated data of the model itself.

    The fitted model is simulated with the data's noise on responses and drive, refitted, and judged like data. Each `draw` has
    other noise.
    """
    generator = np.random.default_rng([17, draw])

    def twin(trial: Trial) -> Trial:
        fine = refined(trial)
        clean = expected(done.model, fine)
        noise = generator.normal(0.0, 1.0, clean.shape) * trial.noise[:, None]
        drive = trial.excitation.recorded + generator.normal(0.0, trial.drive_noise, trial.samples)
        excitation = trial.excitation.with_drive(drive)
        return replace(trial, measured=clean + noise, excitation=excitation)

    twins = divide([twin(trial) for trial in trials])
    again = finished(done, twins.fits)
    return worst(score(again.model, twins.judged), floors)


Start = tuple[Candidate, tuple[Free, ...], RigModel]
Starts = list[Start]


def followed(
    starts: Starts, rungs: Sequence[Rung], current: Fit, progress: Progress, promising: float = PROMISING
) -> Running:  # fmt: skip
    """Fits of candidates on growing lengths of the runs, best first, from starting points that may be far from the data.

    Once the best one removes much of the current model's misfit, those far behind it are eliminated; at the end those that remove
    less than the share `promising`.
    """
    run: Running = []
    for rung in rungs:
        try:
            bare = bare_cost(current, rung)
            run = verified(starts, rung, progress, most=len(starts))
        except OutOfTimeError:
            break
        # Data with which the current model agrees do not distinguish candidates.
        if run and (rung is rungs[-1] or (bare >= TELLING and run[0][1].cost < (1.0 - DECISIVE) * bare)):
            near = [pair for k, pair in enumerate(run) if k < 2 or pair[1].cost < BEHIND * run[0][1].cost]
            run = [pair for pair in near if pair[1].cost < (1.0 - promising) * bare or bare < TELLING][:CROWD]
        if bare < TELLING:  # a fit further from the data than the current model, which it contains, is lost
            run = [pair for pair in run if pair[1].cost < LEAVES * TELLING]
        starts = [(candidate, done.free, done.model) for candidate, done in run]
    return run


def verified(
    starts: Starts, rung: Rung, progress: Progress, most: int = TRIED, *, sure: bool = False, limit: float = np.inf,
    whole: Problem | None = None,
) -> Running:  # fmt: skip
    """Fits of candidates on one rung, best first, from the `most` starting points whose simulation is closest to the data.

    Of one candidate the `EACH` closest are tried. Those whose simulation leaves the data from the start are only tried if no
    other stays with them, but if the first candidate is `sure` to be in the rig, always its closest. None with a misfit above the
    limit is tried; with a limit, none far from the data once another one agrees with them. A fit that leaves more of the `whole`
    runs than its starting point is repeated on these: where a resonance jumps, the first seconds do not tell when.
    """
    costs = [misfit(model, rung.problem) for _, _, model in starts]
    begun = sorted(((cost, k) for k, cost in enumerate(costs) if np.isfinite(cost) and cost <= limit), key=lambda item: item[0])
    first = next((k for _, k in begun if sure and starts[k][0] is starts[0][0]), None)
    near: list[tuple[float, Candidate, tuple[Free, ...], RigModel]] = []
    for cost, k in begun:
        few = sum(other[1] is starts[k][0] for other in near) < EACH
        if few and (cost <= LEAVES * begun[0][0] or k == first):
            near.append((cost, *starts[k]))
    last = next((item for item in near[most:] if first is not None and item[3] is starts[first][2]), None)
    near = near[:most] if last is None else [*near[: most - 1], last]
    climbed: Running = []
    for place, (cost, candidate, free, model) in enumerate(near):
        if any(other[1] is candidate and cost <= (1.0 + CLOSE) * other[0] for other in near[:place]):
            continue  # the same starting point
        if any(one is candidate and done.cost <= AGREES for one, done in climbed):
            continue  # another starting point of it cannot fit better than the data allow
        if np.isfinite(limit) and any(done.cost <= min(AGREES, cost / LEAVES) for _, done in climbed):
            continue  # it begins far from data with which another candidate agrees
        progress(f"fitting {candidate.cause} ({candidate.location})")
        try:
            done = tried(model, free, rung)
            if done is not None and whole is not None and misfit(model, whole) < misfit(done.model, whole):
                done = tried(model, free, replace(rung, problem=whole))
        except OutOfTimeError:
            if climbed:  # what was fitted until then is the answer
                break
            raise
        if done is not None and candidate.plausible(done.model):
            climbed.append((candidate, done))
    climbed.sort(key=lambda pair: pair[1].cost)
    return [pair for k, pair in enumerate(climbed) if not any(_alike(pair[0], other) for other, _ in climbed[:k])]


def continued(run: Running, rung: Rung) -> Running:
    """The same fits, best first, with those that ended by their number of steps continued on this rung.

    A resonance that a description lacks lies in a long valley: much mass far away moves the rig as less of it close by.
    """

    def further(candidate: Candidate, done: Fit) -> Fit:
        if done.converged or done.cost <= AGREES:
            return done
        more = tried(done.model, done.free, replace(rung, steps=FURTHER_STEPS))
        return more if more is not None and more.cost < done.cost and candidate.plausible(more.model) else done

    return sorted(((candidate, further(candidate, done)) for candidate, done in run), key=lambda pair: pair[1].cost)


def _alike(one: Candidate, other: Candidate) -> bool:
    # Two laws of one cause differ only where their effects show; two of the same free shape are one.
    return one is other or (one.shape is not None and (one.key, one.shape) == (other.key, other.shape))


def bare_cost(current: Fit, rung: Rung) -> float:
    """Misfit of a model refitted on a rung."""
    done = tried(current.model, current.free, rung)
    return done.cost if done else np.inf
