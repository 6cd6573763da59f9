"""The part of a run that is held out from fits: the last of its time, or, if its end is at rest, the last of its moves."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.analysis.fitting.trials import Trial

#: Share of every run used for fits; the rest is held out.
FIT_SHARE = 0.6
#: Blocks of a run whose motion is compared, and the share of the whole motion that the held-out end must have: half of its share
#: of the time. A run that has come to rest before has less.
BLOCKS, STILL_MOVES = 100, 0.5 * (1.0 - FIT_SHARE)
#: Share of the motion in the fit data of such a run. Chosen: at least half of two equal moves, and not the last of three.
BETWEEN = (0.4, 0.8)
#: Motion, as a share of its largest value, up to which a run is calm between two moves, and above which a decaying one lasts.
CALM, FADED = 0.01, 1e-3


def lasting(trial: Trial) -> float:
    """Seconds for which a run moves, of a decay without its end at rest."""
    moving = np.diff(_course(trial.measured), prepend=0.0)
    return float(np.sum(moving > FADED * moving.max())) / BLOCKS * trial.samples / trial.sample_rate


def with_decays_held_out(trials: Sequence[Trial], free: Collection[str]) -> tuple[Trial, ...]:
    """The trials, of several decays the second strongest held out, and the others fitted as a whole.

    The end of a decay is its weakest part, where an effect of large motions does not show. `free` are the names of the runs that
    nothing drives.
    """
    alike = [k for k, trial in enumerate(trials) if trial.fitted > 0 and trial.run.id in free and decays(trial.measured)]
    if len(alike) < 2:
        return tuple(trials)
    _, judged, *_ = sorted(alike, key=lambda k: -float(np.mean(trials[k].measured ** 2)))
    fitted = {k: 0 if k == judged else trials[k].samples for k in alike}
    return tuple(replace(trial, fitted=fitted.get(k, trial.fitted)) for k, trial in enumerate(trials))


def decays(measured: FloatArray) -> bool:
    """Whether records, shape (channels, n), have a single move that decays, so that their end is at rest."""
    course = _course(measured)
    return _comes_to_rest(course) and not len(_between_moves(course))


def fit_samples(measured: FloatArray) -> int:
    """Number of leading samples of a run for fits: `FIT_SHARE` of it, or, if its end is at rest, some of its moves.

    The fit data of a run that comes to rest end at the calmest moment, so that whole moves are held out; those of a single move
    that decays end after `FIT_SHARE` of its time.

    Parameters
    ----------
    measured
        The responses, shape (channels, n).
    """
    samples = int(measured.shape[1])
    if samples < BLOCKS or not _comes_to_rest(course := _course(measured)):
        return round(FIT_SHARE * samples)
    moving, between = np.diff(course, prepend=0.0), _between_moves(course)
    if len(between):
        last = between[moving[between] <= moving[between].min()][-1]
    else:
        lasting = np.flatnonzero(moving > FADED * moving.max())
        last = lasting[round(FIT_SHARE * len(lasting)) - 1]
    return int(sum(part.shape[1] for part in np.array_split(measured, BLOCKS, axis=1)[: last + 1]))


def _course(measured: FloatArray) -> FloatArray:
    # Share of the motion until the end of each block of the run.
    power = np.stack([part.var(axis=1) for part in np.array_split(measured, BLOCKS, axis=1)])
    return np.asarray(np.cumsum(np.mean(power / np.maximum(power.sum(axis=0), 1e-300), axis=1)))


def _comes_to_rest(course: FloatArray) -> bool:
    return bool(course[-1] > 0.0 and course[-1] - course[round(FIT_SHARE * BLOCKS) - 1] < STILL_MOVES)


def _between_moves(course: FloatArray) -> IntArray:
    # Calm blocks, with enough of the motion before and after them.
    moving = np.diff(course, prepend=0.0)
    return np.flatnonzero((course >= BETWEEN[0]) & (course <= BETWEEN[1]) & (moving <= CALM * moving.max()))
