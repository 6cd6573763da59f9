"""The judgement on data that took no part in any fit: errors, their noise floor, and paired comparison by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.errors import SimulationError
from analysis.inverse import required_drive
from analysis.measured import FloatArray
from analysis.model import RigModel
from analysis.parallel import side_by_side
from analysis.simulate import Excitation, simulate
from analysis.trials import Trial, expected

BLOCKS = 8
#: Draws of the drive's noise, and the ratio of two draws' powers from which more than two are needed.
DRAWS, SENSITIVE = 8, 1.3
#: Below this multiple of what is allowed (the noise floor and the simulation's own limit) a model explains the data.
ENOUGH = 1.5
#: Error of the simulation itself, as a share of the signal: the sampling filter is not known to better than this.
SIMULATION_LIMIT = 0.004


@dataclass(frozen=True, kw_only=True)
class Score:
    """How a model does on held-out data.

    Parameters
    ----------
    error
        rms(predicted - measured) / rms(measured) of each run and channel, shape (runs, channels).
    blocks
        Mean square error of each block of held-out data over the noise's, shape (runs, channels, blocks).
    """

    error: FloatArray
    blocks: FloatArray

    @property
    def figure(self) -> float:
        """The campaign's figure: the median over runs and channels."""
        return float(np.median(self.error))


def held_out(trial: Trial) -> slice:
    """The samples of a trial that no fit has seen, without the edge of the record."""
    return slice(trial.fitted, trial.samples)


def score(model: RigModel, trials: Sequence[Trial]) -> Score:
    """Simulate every run freely from its first sample, and compare where nothing was fitted."""

    def one(trial: Trial) -> tuple[FloatArray, FloatArray]:
        part = held_out(trial)
        try:
            predicted = expected(model, trial)[:, part]
        except SimulationError:
            predicted = np.full((len(trial.channels), trial.samples - trial.fitted), 1e6)
        measured = trial.measured[:, part]
        error = predicted - measured
        size = np.sqrt(np.mean(measured**2, axis=1))
        relative = np.sqrt(np.mean(error**2, axis=1)) / np.maximum(size, 1e-30)
        floor = trial.noise**2 + (0.003 * size) ** 2
        blocks = np.stack([np.mean(b**2, axis=1) for b in np.array_split(error, BLOCKS, axis=1)], axis=1)
        return relative, blocks / np.maximum(floor, 1e-30)[:, None]

    results = side_by_side(one, trials)
    return Score(error=np.stack([r[0] for r in results]), blocks=np.stack([r[1] for r in results]))


def noise_floor(model: RigModel, trials: Sequence[Trial], drive_noise: float) -> FloatArray:
    """The error that a perfect model would show in each run and channel, shape (runs, channels).

    The responses' own noise, and the drive channel's through the model: the difference that noise of its size, added to the
    recorded drive, makes in the simulation. Where two draws of it do not agree the motion is sensitive, and the largest of more
    is allowed.
    """
    generator = np.random.default_rng(7)

    def through(trial: Trial, noises: Sequence[FloatArray]) -> FloatArray:
        part = held_out(trial)
        if trial.motion is not None and trial.shaken is not None:
            off = required_drive(model, trial.motion) - required_drive(model, trial.shaken)
            return np.asarray(np.mean(off[part] ** 2)).reshape(1, 1)
        excitation = trial.excitation
        shaken = (
            Excitation.prepare(excitation.recorded + noise, excitation.sample_rate, oversample=excitation.oversample)
            for noise in noises
        )
        clean, *others = (
            simulate(model, e, configuration=trial.run.configuration, start_time=trial.start_time).channels
            for e in (excitation, *shaken)
        )
        return np.array([[np.mean((clean[n] - other[n])[part] ** 2) for n in trial.channels] for other in others])

    def one(job: tuple[Trial, FloatArray]) -> FloatArray:
        trial, noises = job
        power = through(trial, list(noises[:2]))
        if np.any(power.max(axis=0) > SENSITIVE * power.min(axis=0)):
            power = np.concatenate([power, through(trial, list(noises[2:]))])
        measured = trial.measured[:, held_out(trial)]
        return np.asarray(np.sqrt((trial.noise**2 + power.max(axis=0)) / np.maximum(np.mean(measured**2, axis=1), 1e-30)))

    noises = [generator.normal(0.0, drive_noise, (DRAWS, len(trial.excitation.recorded))) for trial in trials]
    return np.stack(side_by_side(one, list(zip(trials, noises, strict=True))))


def confidence(best: Score, rivals: Sequence[Score], *, draws: int = 400) -> float:
    """Share of resampled held-out blocks in which the best beats every rival (mean log error over blocks)."""
    if not rivals:
        return 1.0
    generator = np.random.default_rng(11)
    own = np.log(best.blocks).reshape(-1, BLOCKS).mean(axis=0)
    others = np.stack([np.log(r.blocks).reshape(-1, BLOCKS).mean(axis=0) for r in rivals])
    margin = others - own
    picks = generator.integers(0, BLOCKS, (draws, BLOCKS))
    return float(np.mean(margin[:, picks].mean(axis=2).min(axis=0) > 0.0))


def margin_in_errors(best: Score, rival: Score) -> float:
    """How many standard errors of the paired blocks the rival lies behind the best."""
    difference = (np.log(rival.blocks) - np.log(best.blocks)).reshape(-1, BLOCKS).mean(axis=0)
    spread = float(difference.std(ddof=1) / np.sqrt(BLOCKS))
    return float(difference.mean() / max(spread, 1e-12))


def excess(score_: Score, floors: FloatArray) -> float:
    """Mean over runs and channels of the log of the error over its floor: zero for a perfect model."""
    return float(np.mean(np.log(np.maximum(score_.error / floors, 1.0))))


def worst(score_: Score, floors: FloatArray) -> float:
    """The largest error of any run and channel over what is allowed."""
    return float(np.max(score_.error / floors))


def adequate(score_: Score, floors: FloatArray, enough: float = ENOUGH) -> bool:
    """Whether every run and channel is explained to what is allowed."""
    return worst(score_, floors) < enough


@dataclass(frozen=True, kw_only=True)
class Gain:
    """What an extension brought on held-out data, each with the 95 % interval of resampled blocks.

    Parameters
    ----------
    before, after
        The campaign's figure without and with it: (low, high).
    removed, removed_interval
        Share of the error's excess over the floor that it removed.
    """

    before: tuple[float, float]
    after: tuple[float, float]
    removed: float
    removed_interval: tuple[float, float]


def gain(before: Score, after: Score, floor: float, *, draws: int = 400) -> Gain:
    """The gain with its interval: blocks of held-out time are drawn anew, the same for both models (bootstrap, Efron 1979)."""
    generator = np.random.default_rng(13)
    picks = generator.integers(0, BLOCKS, (draws, BLOCKS))

    def figures(score_: Score) -> FloatArray:
        share = score_.blocks[:, :, picks].mean(axis=3) / np.maximum(score_.blocks.mean(axis=2), 1e-300)[:, :, None]
        return np.asarray(np.median(score_.error[:, :, None] * np.sqrt(share), axis=(0, 1)))

    def interval(values: FloatArray) -> tuple[float, float]:
        low, high = np.quantile(values, (0.025, 0.975))
        return float(low), float(high)

    one, other = figures(before), figures(after)
    removed = (one - other) / np.maximum(one - floor, 1e-12)
    return Gain(
        before=interval(one), after=interval(other), removed_interval=interval(removed),
        removed=(before.figure - after.figure) / max(before.figure - floor, 1e-12),
    )  # fmt: skip
