"""Channels of two instruments whose clocks differ: the delay between them grows with time."""

import numpy as np

from isorig.analysis.campaign import BROAD, Campaign, ComplexArray, Run, once
from isorig.analysis.spectra.windows import hanning, segment_spectra

#: Number of segments of a run, the least and the largest length of one in samples.
SEGMENTS, SHORTEST, LONGEST = 16, 128, 8192
#: Coherence of the change from each segment to the next above which a frequency bin counts, and the number of such bins needed.
#: Chosen: the change is the same throughout a run, and noise shows none.
COHERENT, BINS = 0.3, 8
#: Smallest power of the drive in a bin that counts, as a share of its largest. Derived: the window's leakage of a line is below
#: it from the third bin on, and with that alone a harmonic of the response turns as if its clock differed.
DRIVEN = 1e-4
#: Multiple of its standard error and share that a difference of clocks must exceed: quartz clocks differ by less. Share of the
#: phases' power that it must explain: a drift of the rig changes them near its resonances only.
SURE, QUARTZ, STRAIGHT = 6.0, 1e-4, 0.7


@once
def clock_errors(campaign: Campaign, drive: str) -> dict[str, float]:
    """By which share the samples of a channel are further apart than those of the drive, by channel; 0 of none is stated.

    The phase of the cross-spectrum with the drive changes from each segment of a run to the next by 2 pi f T e, where T is the
    time between them and e that share. All runs that tell must show the same.
    """
    found: dict[str, list[tuple[float, float, float]]] = {}
    # All runs must agree, so one whose interval is within what quartz clocks have excludes a difference in its channel, and the
    # others are not read. Runs of low gain come first: friction holds the bodies there, so their phases are the most accurate.
    excluded = {drive}
    for run in sorted(campaign.runs, key=lambda run: abs(run.gain)):
        if run.excitation not in BROAD or run.excitation == "sweep":  # each segment of a sweep has other frequencies
            continue
        length = min(1 << int(np.log2(max(len(run) // SEGMENTS, 1))), LONGEST)
        names = [name for name in run.sensors if name not in excluded]
        if length < SHORTEST or not names:
            continue
        of_drive = _spectra(run, drive, length).conj()
        for name in names:
            if (change := _change(run, name, of_drive, length)) is not None:
                found.setdefault(name, []).append(change)
                value, std, _ = change
                if abs(value) + SURE * std <= QUARTZ:
                    excluded.add(name)
    errors = {}
    for name, changes in found.items():
        if name in excluded:
            continue
        values, stds, straight = np.array(changes).T
        weight = 1.0 / stds**2
        mean, std = float(np.sum(weight * values) / np.sum(weight)), float(np.sum(weight) ** -0.5)
        agree = straight.mean() >= STRAIGHT and np.all(np.abs(values - mean) <= SURE * stds)
        if agree and abs(mean) > max(SURE * std, QUARTZ):
            errors[name] = mean
    return errors


def _spectra(run: Run, name: str, length: int) -> ComplexArray:
    # Of the segments of a channel, shape (segments, bins).
    values = run.read(name)
    return segment_spectra(values - values.mean(), hanning(length), length)


def _change(run: Run, name: str, of_drive: ComplexArray, length: int) -> tuple[float, float, float] | None:
    # The share in a run, its standard error, and the share of the phases' power that it explains; None if too few bins tell.
    cross = _spectra(run, name, length) * of_drive
    steps = cross[1:] * cross[:-1].conj()
    total = steps.sum(axis=0)
    coherence = np.abs(total) ** 2 / np.maximum(len(steps) * np.sum(np.abs(steps) ** 2, axis=0), 1e-300)
    frequency = np.fft.rfftfreq(length, 1.0 / run.sample_rate)
    power = np.mean(np.abs(of_drive) ** 2, axis=0)
    driven = power >= DRIVEN * power.max()
    kept = driven & (coherence > COHERENT) & (frequency > 0.0) & (frequency <= run.usable)
    if np.count_nonzero(kept) < BINS:
        return None
    weight, phase = coherence[kept] / (1.0 - np.minimum(coherence[kept], 0.999)), np.angle(total[kept])
    omega = 2.0 * np.pi * frequency[kept] * length / run.sample_rate
    size = float(np.sum(weight * omega**2))
    slope = float(np.sum(weight * omega * phase)) / size
    left = float(np.sum(weight * (phase - slope * omega) ** 2))
    straight = 1.0 - left / max(float(np.sum(weight * phase**2)), 1e-300)
    return slope, float(np.sqrt(left / (np.count_nonzero(kept) - 1) / size)), straight
