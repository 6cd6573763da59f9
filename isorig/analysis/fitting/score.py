"""Scores on held-out data: errors, their noise floor, and paired comparison by block."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.fitting.excess import ADEQUATE, MOST_ERROR, excess, is_adequate
from isorig.analysis.fitting.residuals import QUIET
from isorig.analysis.fitting.trials import Trial, expected, true_motion
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.parallel import side_by_side
from isorig.analysis.simulate.inverse import required_drive

#: Number of time blocks of each held-out record.
BLOCKS = 8
#: Share of the campaign's excess error that a draw of blocks must show to count for the share removed. Chosen: without it that
#: share is a ratio of two roundings.
SHOWS = 0.05
#: Number of runs above which whole runs are resampled: blocks of one run are not independent.
RUNS = 5
#: Draws of held-out blocks (bootstrap). Chosen: each end of a 95 % interval then scatters by 3 % of the interval.
RESAMPLED = 400
#: Draws of the drive's noise, and the ratio of two draws' powers above which more than two are needed.
DRAWS, SENSITIVE = 8, 1.3
#: A jump of a recorded drive, as a share of its range, the largest difference of neighbouring samples next to it, as a share of
#: the jump, and the number of these differences on either side. Chosen: a step through a converter's filter rings by 9 %.
JUMP, FLAT, AROUND = 0.2, 0.03, 3
#: A block's error is at least this share of the allowed error: below it two models do not differ.
LEAST_BLOCK = 1e-4
#: Share of a record's rms that counts as noise in comparisons block by block. Chosen: just below `SIMULATION_LIMIT`, so that
#: blocks with only the simulation's own error do not decide.
BLOCK_NOISE = 0.003


@dataclass(frozen=True)
class Score:
    """Errors of a model on held-out data."""

    #: rms(predicted - measured) / rms(measured) of each run and channel, shape (runs, channels); the measured motion relative to
    #: an imposed one, where that is less.
    error: FloatArray
    #: Mean square error of each block of held-out data divided by the noise's, shape (runs, channels, blocks).
    blocks: FloatArray
    power: FloatArray  #: The same divided by the mean square of the whole record there, shape (runs, channels, blocks).

    @property
    def figure(self) -> float:
        """The campaign's error: the median over runs and channels."""
        return float(np.median(self.error))


def signal_powers(trials: Sequence[Trial]) -> FloatArray:
    """Mean square of the held-out record of each run and channel, at least that of `QUIET` of the channel's largest run.

    A body that friction holds for a whole run has no signal to compare an error with. A drive that judges a run may rest while
    the bodies coast, so it counts as a whole. Shape (runs, channels).
    """
    powers = np.stack(
        [np.mean((t.signal if t.motion is not None else t.signal[:, t.held_out]) ** 2, axis=1) for t in trials]
    )  # fmt: skip
    return np.asarray(np.maximum(powers, np.maximum(QUIET**2 * powers.max(axis=0), 1e-60)))


def score(model: RigModel, trials: Sequence[Trial]) -> Score:
    """Free-run simulation of every run from its first sample, compared on held-out data."""

    def one(job: tuple[Trial, FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
        trial, signal = job
        part = trial.held_out
        try:
            predicted = expected(model, trial)[:, part]
        except (SimulationError, ModelError):
            predicted = np.full((len(trial.channels), part.stop - part.start), 1e6)
        measured = trial.measured[:, part]
        error = predicted - measured
        relative = np.sqrt(np.mean(error**2, axis=1) / signal)
        floor = trial.usable_noise**2 + BLOCK_NOISE**2 * signal
        blocks = np.stack([np.mean(b**2, axis=1) for b in np.array_split(error, BLOCKS, axis=1)], axis=1)
        power = blocks / signal[:, None]
        # Without motion, e.g. an encoder at rest, a block without error does not distinguish two models.
        return relative, np.maximum(blocks / np.maximum(floor, 1e-30)[:, None], LEAST_BLOCK), power

    results = side_by_side(one, list(zip(trials, signal_powers(trials), strict=True)))
    return Score(*(np.stack([r[k] for r in results]) for k in range(3)))


def noise_floors(model: RigModel, trials: Sequence[Trial]) -> FloatArray:
    """The error of a perfect model in each run and channel, which it hardly exceeds, and its typical one.

    Their shape is (2, runs, channels). The responses' own noise, and the drive channel's propagated through the model: the change
    of the simulation due to noise of its size, added to the recorded drive. If two draws of it disagree, the motion is sensitive
    and more draws are used: the largest of them, and their median for the typical error. A recorded drive that jumps between two
    samples, e.g. at a release, acts at an unknown moment between them.
    """
    generator = np.random.default_rng(7)

    def through(trial: Trial, noises: Sequence[FloatArray]) -> FloatArray:
        part = trial.held_out
        if trial.motion is not None and trial.noisy is not None:
            off = required_drive(model, trial.motion) - required_drive(model, trial.noisy)
            return np.asarray(np.mean(off[:, part] ** 2, axis=1))[None]
        clean = true_motion(model, trial)
        drive = trial.excitation.recorded
        with_noise = (replace(trial, excitation=trial.excitation.with_drive(drive + noise)) for noise in noises)
        others = [true_motion(model, other) for other in with_noise]
        return np.array([[np.mean((clean[n] - other[n])[part] ** 2) for n in trial.channels] for other in others])

    def between_samples(trial: Trial) -> FloatArray | float:
        changes = moved_jumps(trial.excitation.recorded)
        if trial.motion is not None or trial.excitation.held or not changes[0].any():
            return 0.0
        return np.asarray(through(trial, changes).max(axis=0))

    def one(job: tuple[Trial, FloatArray, FloatArray]) -> FloatArray:
        trial, noises, signal = job
        power = through(trial, list(noises[:2]))
        drawn = np.stack([power.max(axis=0)] * 2)
        if np.any(drawn[0] > SENSITIVE * power.min(axis=0)):
            power = np.concatenate([power, through(trial, list(noises[2:]))])
            drawn = np.stack([power.max(axis=0), np.median(power, axis=0)])
        return np.asarray(np.sqrt((trial.usable_noise**2 + drawn + between_samples(trial)) / signal))

    noises = [generator.normal(0.0, trial.drive_noise, (DRAWS, len(trial.excitation.recorded))) for trial in trials]
    return np.stack(side_by_side(one, list(zip(trials, noises, signal_powers(trials), strict=True))), axis=1)


def moved_jumps(drive: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The changes of a recorded drive, each shape (n,), if its jumps between two samples act half a sample later, and earlier.

    A jump is a difference of neighbouring samples of at least `JUMP` of the drive's range, between samples that differ
    by less than `FLAT` of it.
    """
    steps = np.diff(drive)
    size = np.abs(steps)
    # The largest difference of the `AROUND` pairs of samples on either side.
    padded = np.pad(size, AROUND, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1)
    around = np.delete(windows, AROUND, axis=1).max(axis=1)
    jumps = np.flatnonzero((size > 0.0) & (size >= JUMP * float(np.ptp(drive))) & (around < FLAT * size))
    later, earlier = np.zeros(len(drive)), np.zeros(len(drive))
    later[jumps + 1] = -0.5 * steps[jumps]
    earlier[jumps] = 0.5 * steps[jumps]
    return later, earlier


def confidence(best: Score, rivals: Sequence[Score], *, draws: int = RESAMPLED) -> float:
    """Share of resampled held-out blocks in which the best beats every rival (mean log error over blocks)."""
    if not rivals:
        return 1.0
    generator = np.random.default_rng(11)
    own = np.log(best.blocks).reshape(-1, BLOCKS).mean(axis=0)
    others = np.stack([np.log(r.blocks).reshape(-1, BLOCKS).mean(axis=0) for r in rivals])
    margin = others - own
    picks = generator.integers(0, BLOCKS, (draws, BLOCKS))
    return float(np.mean(margin[:, picks].mean(axis=2).min(axis=0) > 0.0))


def units(score_: Score) -> FloatArray:
    """Square errors by independent unit: runs if there are enough of them, otherwise blocks of time, shape (units,)."""
    power = np.minimum(score_.power, MOST_ERROR**2)
    return np.asarray(power.mean(axis=(1, 2)) if len(power) >= RUNS else power.mean(axis=(0, 1)))


def margin_in_errors(best: Score, rival: Score) -> float:
    """Difference between rival and best in standard errors of the paired blocks."""
    difference = (np.log(rival.blocks) - np.log(best.blocks)).reshape(-1, BLOCKS).mean(axis=0)
    spread = float(difference.std(ddof=1) / np.sqrt(BLOCKS))
    return float(difference.mean() / max(spread, 1e-12))


def worst(score_: Score, floors: FloatArray) -> float:
    """The largest ratio of error to allowed error, over runs and channels."""
    return float(np.max(score_.error / floors))


def adequate(score_: Score, floors: FloatArray) -> bool:
    """Whether every run and channel is explained to the allowed error."""
    return is_adequate(score_.error, floors, ADEQUATE)


def share_interval(
    first: Score, before: Score, after: Score, floors: FloatArray, *, draws: int = RESAMPLED
) -> tuple[float, float, float]:
    """Share of the first model's excess removed from one model to another: (value, low, high).

    The 95 % interval is from resampled units, see `units`. Blocks of time in which the models' square errors differ by less
    than is allowed, because the rig rests, are not drawn.
    """
    generator = np.random.default_rng(19)
    by_run = len(before.error) >= RUNS

    def drawn(score_: Score, picks: IntArray) -> FloatArray:
        if by_run:
            return score_.error[picks]
        return np.asarray(np.sqrt(score_.power[:, :, picks].mean(axis=2)))

    count = len(before.error) if by_run else BLOCKS
    telling = np.arange(count)
    if not by_run:
        differences = np.ptp([model.power for model in (first, before, after)], axis=0)
        differ = np.any(differences > floors[:, :, None] ** 2, axis=(0, 1))
        telling = np.flatnonzero(differ) if np.any(differ) else telling

    def share(picks: IntArray) -> float:
        allowed = floors[picks] if by_run else floors
        whole, one, other = (excess(drawn(model, picks), allowed) for model in (first, before, after))
        return (one - other) / whole if whole > 0.0 else 0.0

    values = [share(telling[generator.integers(0, len(telling), len(telling))]) for _ in range(draws)]
    low, high = np.quantile(values, (0.025, 0.975))
    return share(np.arange(count)), float(low), float(high)


def surely_removes(before: Score, after: Score, floors: FloatArray) -> bool:
    """Whether a model leaves less excess than the one before it in 97.5 % of the draws of `share_interval`.

    One channel of one run may decide whether a model is adequate, while the errors of all do not fall.
    """
    return share_interval(before, before, after, floors)[1] > 0.0


@dataclass(frozen=True, kw_only=True)
class Improvement:
    """Improvement by an extension on held-out data, each with the 95 % interval of resampled blocks."""

    #: The campaign's error without and with it: (low, high).
    before: tuple[float, float]
    after: tuple[float, float]
    #: Share of the error's excess above the floor that it removed.
    removed: float
    removed_interval: tuple[float, float]


def improvement(before: Score, after: Score, floor: float, *, draws: int = RESAMPLED) -> Improvement:
    """The improvement with its interval: held-out blocks are resampled, the same for both models (bootstrap, Efron 1979)."""
    generator = np.random.default_rng(13)
    picks = generator.integers(0, BLOCKS, (draws, BLOCKS))

    def figures(score_: Score) -> FloatArray:
        share = score_.blocks[:, :, picks].mean(axis=3) / np.maximum(score_.blocks.mean(axis=2), 1e-300)[:, :, None]
        return np.asarray(np.median(score_.error[:, :, None] * np.sqrt(share), axis=(0, 1)))

    def interval(values: FloatArray) -> tuple[float, float]:
        low, high = np.quantile(values, (0.025, 0.975))
        return float(low), float(high)

    one, other = figures(before), figures(after)
    # A draw without the misfit, if only a short part of the data shows it, says nothing about its removal.
    shows = one - floor > SHOWS * (before.figure - floor)
    removed = ((one - other) / np.maximum(one - floor, 1e-12))[shows if shows.any() else slice(None)]
    return Improvement(
        before=interval(one), after=interval(other), removed_interval=interval(removed),
        removed=(before.figure - after.figure) / (before.figure - floor) if before.figure > floor else 0.0,
    )  # fmt: skip
