"""Detects exchanged channels from the shape of their ratio: for every pair, from a single run.

The ratio of two channels over frequency has a shape that the given rig predicts for the recorded drive. If the recorded ratio has
the inverse shape, the channels are exchanged. Levels do not matter, so a wrong unit is no exchange; channels with the same motion
over the drive's band cannot be distinguished. Bands in which a record does not exceed its noise do not count.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import FloatArray, broad
from isorig.analysis.errors import AnalysisError
from isorig.analysis.fitting.trials import Trial, simulated, true_motion
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.spectra.noise import noise_level

#: Bands in an octave, the fewest that make a shape, and the lowest frequency of the first if the drive has no band, Hz.
PER_OCTAVE, FEWEST, LOWEST = 3, 6, 1.0
#: rms of a predicted ratio's logarithm about its mean above which it has a shape.
SHAPED = 0.35
#: Regression of the recorded on the predicted shape: ideally +1, and -1 for exchanged channels. Of 1 610 pairs of records without
#: faults on eleven rigs none was below 0.08, with starting values wrong by up to a factor of 1.6; an exchange changes the sign.
TURNED = -0.1
#: An exchange with the drive must reduce the distance of all channels' shapes by this (mean |log|): a wrong drive predicts
#: another motion, so the regression is less informative. For records without faults there was no reduction at all.
NEARER = 0.3
#: Power of a record relative to its noise from which a band counts. Chosen: half of it is then motion.
ABOVE_NOISE = 2.0


def swapped_channels(given: RigModel, trials: Sequence[Trial]) -> dict[tuple[str, str], list[str]]:
    """Pairs of channels that seem exchanged, and the runs concerned.

    Parameters
    ----------
    given
        The rig with known values and starting values.
    trials
        The runs; those without a broad-band drive are skipped.
    """
    found: dict[tuple[str, str], list[str]] = {}
    for trial in trials:
        if trial.motion is None and broad([trial.run]):
            with suppress(AnalysisError):
                pair = _pair(given, trial)
                if pair is not None:
                    found.setdefault(pair, []).append(trial.run.id)
    return found


def _pair(given: RigModel, trial: Trial) -> tuple[str, str] | None:
    names = (given.drive.channel, *trial.channels)
    heard = _heard(trial, given.drive.channel)
    recorded, predicted = _shapes(given, trial, heard)
    if recorded.shape[1] < FEWEST:
        return None
    as_is, best = _distance(recorded, predicted), None
    for gain, a, b in _nearer(given, trial, recorded, predicted, as_is, heard):
        if best is None or gain > best[0]:
            best = (gain, (names[a], names[b]))
    return None if best is None else best[1]


def _nearer(
    given: RigModel, trial: Trial, recorded: FloatArray, predicted: FloatArray, as_is: float, heard: NDArray[np.bool_]
) -> Iterator[tuple[float, int, int]]:
    # Exchanges indicated by the records, and the reduction of the distance by each.
    for a, b in combinations(range(len(recorded)), 2):
        turned = _turned(recorded[a] - recorded[b], predicted[a] - predicted[b])
        if a == 0:
            gain = as_is - _distance(*_shapes(given, _exchanged(trial, b - 1), heard))
            if gain > (0.0 if turned else NEARER):
                yield gain, a, b
        elif turned:
            order = list(range(len(recorded)))
            order[a], order[b] = b, a
            gain = as_is - _distance(recorded[order], predicted)
            if gain > 0.0:
                yield gain, a, b


def _shapes(given: RigModel, trial: Trial, heard: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    # Logarithms of the amplitudes of drive and responses in the bands that count, as recorded and as predicted by the given rig.
    edges, kept = _edges(trial), heard.copy()
    drive = trial.excitation.recorded[None, : trial.samples]
    shown = simulated(given, trial, true_motion(given, trial))
    rows = [_amplitudes(each, trial.sample_rate, edges) for each in (drive, trial.measured, shown)]
    for each in rows:
        kept &= np.isfinite(each).all(axis=0)
    d, m, e = (each[:, kept] for each in rows)
    return np.vstack([d, m]), np.vstack([d, e])


def _heard(trial: Trial, drive: str) -> NDArray[np.bool_]:
    # The bands in which every response exceeds its noise.
    noise = np.array([noise_level(trial.run, name, (drive,)) or 0.0 for name in trial.channels])
    return exceeds_noise(trial.measured, noise, trial.sample_rate, _edges(trial))


def exceeds_noise(records: FloatArray, noise: FloatArray, rate: float, edges: FloatArray) -> NDArray[np.bool_]:
    """Whether the power of all records in each band is at least `ABOVE_NOISE` times that of white noise.

    Parameters
    ----------
    records
        Shape (channels, n).
    noise
        Its standard deviation in each record, shape (channels,).
    rate
        Sample rate, Hz.
    edges
        Edges of the bands in Hz, shape (bands + 1,).
    """
    window = float(np.sum(np.hanning(records.shape[1]) ** 2))
    with np.errstate(divide="ignore"):
        least = np.log(noise * np.sqrt(ABOVE_NOISE * window))
    return np.asarray(~(_amplitudes(records, rate, edges) < least[:, None]).any(axis=0))


def _edges(trial: Trial) -> FloatArray:
    low, high = trial.run.band or (LOWEST, trial.sample_rate / 4.0)
    low, high = max(low, LOWEST), min(high, trial.sample_rate / 2.0)
    count = max(int(np.ceil(PER_OCTAVE * np.log2(high / low))), 1) if high > low else 1
    return np.asarray(np.geomspace(low, max(high, low * 1.001), count + 1))


def _amplitudes(rows: FloatArray, rate: float, edges: FloatArray) -> FloatArray:
    # Log of the rms amplitude in each band, -inf or NaN if there is none.
    n = rows.shape[1]
    power = np.abs(np.fft.rfft((rows - rows.mean(axis=1, keepdims=True)) * np.hanning(n), axis=1)) ** 2
    place = np.searchsorted(edges, np.fft.rfftfreq(n, 1.0 / rate), side="right") - 1
    means = np.full((len(rows), len(edges) - 1), np.nan)
    for band in range(len(edges) - 1):
        if (place == band).any():
            means[:, band] = power[:, place == band].mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(0.5 * np.log(means))


def _turned(recorded: FloatArray, predicted: FloatArray) -> bool:
    recorded, predicted = recorded - recorded.mean(), predicted - predicted.mean()
    size = float(predicted @ predicted)
    return bool(np.sqrt(size / len(predicted)) > SHAPED and float(recorded @ predicted) < TURNED * size)


def _distance(recorded: FloatArray, predicted: FloatArray) -> float:
    # Mean distance of the responses' shapes relative to the drive; infinite if friction holds everything.
    if not recorded.shape[1]:
        return np.inf
    apart = (recorded[1:] - recorded[0]) - (predicted[1:] - predicted[0])
    return float(np.mean(np.abs(apart - apart.mean(axis=1, keepdims=True))))


def _exchanged(trial: Trial, row: int) -> Trial:
    # The trial with its drive and one response exchanged.
    drive, measured = trial.excitation.recorded, trial.measured.copy()
    excitation = trial.excitation.with_drive(measured[row])
    measured[row] = drive[: trial.samples]
    return replace(trial, excitation=excitation, measured=measured)
