"""The power of residuals that is related to the drive by transfer functions."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.spectra.windows import hanning, segment_spectra

#: Longest segment in s, minimum number of segments of a record, and minimum samples of a segment.
SEGMENT, SEGMENTS, FEWEST = 4.0, 7, 64


def _segment(trial: Trial, length: int) -> int:
    # Samples of a segment of a record of that length.
    return min(round(SEGMENT * trial.sample_rate), 2 * length // (SEGMENTS + 1))


def segments(trial: Trial, values: FloatArray) -> ComplexArray:
    """Spectra of a record's Hann-windowed segments with 50 % overlap, shape (segments, frequency bins); none if it is short.

    White noise has its own variance as their mean square magnitude.
    """
    n = _segment(trial, len(values))
    if n < FEWEST:
        return np.zeros((0, 1), dtype=np.complex128)
    window = hanning(n)
    return segment_spectra(values, window / np.sqrt(np.sum(window**2)), n // 2)


def coherent_density(drive: ComplexArray, spectra: ComplexArray) -> FloatArray:
    """Density of a record, shape (bins,), that its transfer function from the drive explains; some of it by chance.

    Both are given by their `segments`, shape (segments, bins).
    """
    return np.asarray(np.abs(np.mean(drive.conj() * spectra, axis=0)) ** 2 / (np.mean(np.abs(drive) ** 2, axis=0) + 1e-300))


def coherent_power(trials: Sequence[Trial], left: Sequence[FloatArray]) -> FloatArray:
    """Power that a transfer function from the drive takes away: one for all gains of a configuration, and each run's own.

    What chance alone takes away, one part in the number of averages, is left out. The residuals are those of each run in its
    held-out samples, shape (channels, samples); the powers have the shape (2, runs, channels).
    """
    powers = np.zeros((2, len(trials), len(left[0])))
    groups: dict[tuple[str, int], list[int]] = defaultdict(list)  # segments of one length have the same lines
    for k, trial in enumerate(trials):
        groups[trial.run.configuration, _segment(trial, trial.held_out.stop - trial.held_out.start)].append(k)
    for group in groups.values():
        driven = {k: segments(trials[k], trials[k].excitation.recorded[trials[k].held_out]) for k in group}
        drives = {k: spectra for k, spectra in driven.items() if len(spectra)}
        members = list(drives)
        for channel in range(len(left[0])):
            errors = {k: segments(trials[k], left[k][channel]) for k in members}
            cross = {k: np.mean(drives[k].conj() * errors[k], axis=0) for k in members}
            auto = {k: np.mean(np.abs(drives[k]) ** 2, axis=0) + 1e-300 for k in members}
            size = {k: float(np.sum(np.mean(np.abs(errors[k]) ** 2, axis=0))) + 1e-300 for k in members}
            weight = {k: 1.0 / float(auto[k].sum()) for k in members}
            if not members:
                continue
            total = np.sum([weight[k] * auto[k] for k in members], axis=0)
            common = np.sum([weight[k] * cross[k] for k in members], axis=0) / total
            averages = {k: 0.5 * len(drives[k]) for k in members}
            for k in members:
                own = float(np.sum(np.abs(cross[k]) ** 2 / auto[k])) / size[k]
                shared = float(np.sum(2.0 * np.real(common.conj() * cross[k]) - np.abs(common) ** 2 * auto[k])) / size[k]
                chance = 1.0 / averages[k], 1.0 / sum(averages.values())
                power = float(np.mean(left[k][channel] ** 2))
                for row, (value, luck) in enumerate(((shared, chance[1]), (own, chance[0]))):
                    powers[row, k, channel] = power * min(max((value - luck) / (1.0 - luck), 0.0), 1.0)
    return powers
