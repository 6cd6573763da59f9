"""What is held out from fits: the end of a run, its last moves if the end is at rest, or one of several decays or sweeps."""

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.spectra.windows import hanning

#: Share of every run used for fits; the rest is held out.
FIT_SHARE = 0.6
#: Blocks of a run whose motion is compared, and the share of the whole motion that the held-out end must have: half of its share
#: of the time. A run that has come to rest before has less.
BLOCKS, STILL_MOVES = 100, 0.5 * (1.0 - FIT_SHARE)
#: Share of the motion in the fit data of such a run. Chosen: at least half of two equal moves, and not the last of three.
BETWEEN = (0.4, 0.8)
#: Motion, as a share of its largest value, up to which a run is calm between two moves, and above which a decaying one lasts.
CALM, FADED = 0.01, 1e-3
#: Parts of an octave in which the drive's power at a run's end is compared with that before; share of it that a band must have
#: had before, and share of the whole in bands without it from which on the end has other frequencies. Chosen: leakage of a sweep
#: is below a hundredth next to its band, and random noise repeats to a factor of two.
PER_OCTAVE, BEFORE, OTHERWISE = 3, 0.01, 0.5
#: Fewest cycles of what is other at the end. Chosen: fewer are moves, of which none repeats another one.
CYCLES = 20


def lasting(trial: Trial) -> float:
    """Seconds for which a run moves, of a decay without its end at rest."""
    moving = np.diff(_course(trial.measured), prepend=0.0)
    return float(np.sum(moving > FADED * moving.max())) / BLOCKS * trial.samples / trial.sample_rate


def with_decays_held_out(trials: Sequence[Trial], free: Collection[str]) -> tuple[Trial, ...]:
    """The trials, of several decays the second strongest held out, and the others fitted as a whole.

    The end of a decay is its weakest part, where an effect of large motions does not show. `free` are the names of the runs that
    nothing drives, or a hammer alone.
    """
    alike = [k for k, trial in enumerate(trials) if trial.fitted > 0 and trial.run.id in free and decays(trial.measured)]
    if len(alike) < 2:
        return tuple(trials)
    _, judged, *_ = sorted(alike, key=lambda k: -float(np.mean(trials[k].measured ** 2)))
    fitted = {k: 0 if k == judged else trials[k].samples for k in alike}
    return tuple(replace(trial, fitted=fitted.get(k, trial.fitted)) for k, trial in enumerate(trials))


def with_sweeps_held_out(trials: Sequence[Trial]) -> tuple[Trial, ...]:
    """The trials, of several sweeps in a configuration the second strongest held out, and the others fitted as a whole.

    The end of a sweep has other frequencies than its beginning: fitted to the beginning, a model predicts others than it was
    fitted to. A sweep that is marked as held out takes the place of the second strongest.
    """
    sweeps: dict[str, list[int]] = defaultdict(list)
    for k, trial in enumerate(trials):
        drive = trial.excitation.recorded
        if trial.motion is None and ends_otherwise(drive[: trial.fitted or round(FIT_SHARE * len(drive))], drive):
            sweeps[trial.run.configuration].append(k)
    fitted: dict[int, int] = {}
    for alike in (each for each in sweeps.values() if len(each) > 1):
        strongest = sorted(alike, key=lambda k: -float(np.mean(trials[k].measured ** 2)))
        judged = {k for k in alike if trials[k].fitted == 0} or {strongest[1]}
        fitted |= {k: 0 if k in judged else trials[k].samples for k in alike}
    return tuple(replace(trial, fitted=fitted.get(k, trial.fitted)) for k, trial in enumerate(trials))


def ends_otherwise(beginning: FloatArray, drive: FloatArray) -> bool:
    """Whether a drive, shape (n,), has mostly other frequencies after this beginning of it, shape (fewer,)."""
    end = drive[len(beginning) :]
    if min(len(beginning), len(end)) < BLOCKS:
        return False
    cycles = [np.fft.rfftfreq(len(part))[1:] for part in (beginning, end)]
    powers = [
        np.abs(np.fft.rfft((part - part.mean()) * hanning(len(part)))[1:]) ** 2 / len(part) ** 2 for part in (beginning, end)
    ]
    # Bands that both parts resolve.
    bands = [np.floor(PER_OCTAVE * np.log2(each / cycles[1][0])).astype(np.int64) for each in cycles]
    count = int(max(each.max() for each in bands)) + 1
    before, after = (np.bincount(np.maximum(band, 0), power, count) for band, power in zip(bands, powers, strict=True))
    swept = np.arange(count) >= PER_OCTAVE * np.log2(CYCLES)
    other = after[swept & (before < BEFORE * after)].sum()
    return bool(other > OTHERWISE * after.sum())


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
