"""Disturbance: the difference between runs with the same drive, measured and not assumed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.fitting.coherent_power import coherent_density, coherent_power, segments
from isorig.analysis.fitting.score import signal_powers
from isorig.analysis.fitting.trials import SIGNAL_SHARE, Disturbance, Trial, expected
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.spectra.hum import hum, mains_in

#: Two drives are the same if they differ by less than this share of their rms.
SAME_DRIVE = 0.03
#: Frequency bands of a disturbance's spectrum, equal on a logarithmic scale. Chosen: about three to the octave.
BANDS = 30
#: Frequencies at which a stated disturbance is averaged. Chosen: some hundred for the lowest of its bands that has any power.
FREQUENCIES = 4097


def repeated(trials: Sequence[Trial]) -> list[tuple[int, int]]:
    """Pairs of trials with the same drive: according to the recording, or equal to `SAME_DRIVE`."""
    index = {trial.run.id: k for k, trial in enumerate(trials)}
    pairs = []
    for k, trial in enumerate(trials):
        if trial.run.repeat_of in index:
            pairs.append((index[str(trial.run.repeat_of)], k))
            continue
        for j in range(k):
            if _alike(trials[j], trial):
                pairs.append((j, k))
                break
    return pairs


def _alike(one: Trial, other: Trial) -> bool:
    if one.run.configuration != other.run.configuration or one.sample_rate != other.sample_rate:
        return False
    a, b = one.excitation.recorded, other.excitation.recorded
    return abs(len(a) - len(b)) <= 0.02 * min(len(a), len(b)) and same_drive(a, b)


def same_drive(one: FloatArray, other: FloatArray) -> bool:
    """Whether two records of a drive are equal to `SAME_DRIVE`, in the part that both have."""
    n = min(len(one), len(other))
    size = float(np.mean(one[:n] ** 2))
    return size > 0.0 and float(np.mean((one[:n] - other[:n]) ** 2)) < SAME_DRIVE**2 * size


def disturbance(model: RigModel, trials: Sequence[Trial]) -> FloatArray:
    """Error of every run and channel that repeated runs do not share, beyond the sensors' noise, (runs, channels).

    Half the power of the difference of two residuals with one drive, minus the noise. Without such a pair among the trials, that
    which the trials state (`with_disturbance`), zero if none does. What shakes the rig from outside has the same power in the
    other runs; what follows the motion has the same share of their signal. Where the power would be more than that share, as in a
    run of a lower level, only as much of it counts as the run has in what no transfer function from the drive explains: an
    allowance must not hide deficiencies of the model.
    """
    pairs = repeated(trials)
    power = _power(trials, pairs, _left(model, trials)) if pairs else np.stack([_stated(trial) for trial in trials])
    return np.asarray(np.sqrt(power / signal_powers(trials)))


def _stated(trial: Trial) -> FloatArray:
    # The power of a trial's disturbance, shape (channels,); noise of an imposed motion is no disturbance.
    if trial.disturbance is None or trial.motion is not None:
        return np.zeros(len(trial.measured))
    frequency = np.linspace(0.0, trial.sample_rate / 2.0, FREQUENCIES)
    return np.asarray(np.mean(trial.disturbance.at(frequency) ** 2, axis=1))


def _left(model: RigModel, trials: Sequence[Trial]) -> list[FloatArray]:
    # The residuals of each run without hum, shape (channels, samples): its phase differs between runs, but it is a cause.
    return [
        np.stack([_without_hum(row, trial.sample_rate) for row in trial.measured - expected(model, trial)]) for trial in trials
    ]


def _without_hum(residual: FloatArray, rate: float) -> FloatArray:
    mains = mains_in(residual, rate)
    return residual if mains is None else residual - hum(residual, rate, mains)


def _power(trials: Sequence[Trial], pairs: Sequence[tuple[int, int]], left: Sequence[FloatArray]) -> FloatArray:
    # The power that `disturbance` compares with the signal's, shape (runs, channels).
    signal = signal_powers(trials)
    power = np.full(signal.shape, np.nan)
    share = []
    for one, other in pairs:
        a, b = trials[one], trials[other]
        part = slice(max(a.held_out.start, b.held_out.start), min(a.samples, b.samples))
        if part.stop - part.start < 16:
            continue
        noise = 0.5 * (a.usable_noise**2 + b.usable_noise**2)
        apart = np.maximum(0.5 * np.mean((left[one][:, part] - left[other][:, part]) ** 2, axis=1) - noise, 0.0)
        share.append(apart / (0.5 * (signal[one] + signal[other])))
        for k in (one, other):
            power[k] = apart if np.isnan(power[k]).any() else np.maximum(power[k], apart)
    if not share:
        return np.zeros(signal.shape)
    known = ~np.isnan(power).any(axis=1)
    usual, typical = np.mean(share, axis=0), np.mean(power[known], axis=0)
    unrelated = _unrelated(trials, left)
    for k in np.flatnonzero(~known).tolist():
        power[k] = np.minimum(typical, np.maximum(usual * signal[k], unrelated[k]))
    return power


def with_disturbance(model: RigModel, trials: Sequence[Trial]) -> tuple[Trial, ...]:
    """The trials with the disturbance that repeated runs show, as they are if it is smaller than the accuracy of fits.

    Its spectrum is half that of the difference between the residuals of repeated runs, beyond the noise and without what is
    related to the drive: a rig that drifts. Its power in each run is that of `disturbance`.
    """
    pairs = repeated(trials)
    if not pairs:
        return tuple(trials)
    left = _left(model, trials)
    power = _power(trials, pairs, left)
    if np.all(power <= SIGNAL_SHARE**2 * signal_powers(trials)):
        return tuple(trials)
    apart = (_spectrum(trials[one], trials[other], left[one], left[other]) for one, other in pairs)
    found = [spectrum for spectrum in apart if spectrum is not None]
    if not found:
        return tuple(trials)
    frequency, density = found[0][0], np.mean([density for _, density in found], axis=0)
    usual = np.mean(power[sorted({k for pair in pairs for k in pair})], axis=0)
    scale = np.sqrt(power / np.where(usual > 0.0, usual, 1.0))
    return tuple(
        replace(trial, disturbance=Disturbance(frequency=frequency, level=scale[k][:, None] * np.sqrt(density)))
        for k, trial in enumerate(trials)
    )


def _spectrum(one: Trial, other: Trial, left: FloatArray, right: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    # Centres of frequency bands (Hz), and the density there of what the residuals of two runs of one drive do not share, shape
    # (channels, bands); None if they are too short.
    n = min(one.samples, other.samples)
    drive = segments(one, one.excitation.recorded[:n])
    averages = len(drive) / 2.0
    if averages <= 1.0:
        return None
    frequency = np.linspace(0.0, one.sample_rate / 2.0, drive.shape[1])
    edges = np.geomspace(frequency[1], frequency[-1], BANDS + 1)
    band = np.clip(np.digitize(frequency, edges) - 1, 0, BANDS - 1)
    counts = np.bincount(band, minlength=BANDS)
    kept = counts > 0
    density = []
    for row, values in enumerate((left[:, :n] - right[:, :n]) / np.sqrt(2.0)):
        spectra = segments(one, values)
        whole = np.mean(np.abs(spectra) ** 2, axis=0)
        # By chance one part in the number of averages looks related.
        related = np.maximum(coherent_density(drive, spectra) - whole / averages, 0.0) / (1.0 - 1.0 / averages)
        noise = 0.5 * (one.noise[row] ** 2 + other.noise[row] ** 2)
        beyond = np.bincount(band, whole - related, minlength=BANDS)[kept] / counts[kept] - noise
        density.append(np.maximum(beyond, 0.0))
    centres = np.sqrt(edges[:-1] * edges[1:])[kept]
    return centres, np.stack(density)


def _unrelated(trials: Sequence[Trial], left: Sequence[FloatArray]) -> FloatArray:
    # Power of the held-out residuals, beyond the noise, that no transfer function from the drive explains, (runs, channels).
    later = [values[:, trial.held_out] for trial, values in zip(trials, left, strict=True)]
    whole = np.stack([np.mean(values**2, axis=1) for values in later])
    noise = np.stack([trial.usable_noise**2 for trial in trials])
    return np.asarray(np.maximum(whole - noise - coherent_power(trials, later)[1], 0.0))
