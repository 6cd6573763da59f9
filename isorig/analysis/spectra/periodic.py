"""Periodic drives, period by period: the transfer function, with separate noise and distortion.

Differences between periods are noise. Distortion shows in two ways (Pintelon and Schoukens, System Identification, 2012, 4.3): in
several runs by additional differences between realizations of the drive, which have other phases (robust method); in one run with
a multisine in the frequencies that it omits, because distortion is periodic like the drive (fast method): even multiples show
even distortion, odd ones odd distortion.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import ComplexArray, FloatArray, IntArray, Run
from isorig.analysis.errors import DataError
from isorig.analysis.spectra.welch import DRIVEN, stretches

#: Number of initial periods discarded because of transients, and minimum number of further periods.
SETTLING, NEEDED = 1, 2


@dataclass(frozen=True, kw_only=True)
class PeriodicFrf:
    """A transfer function at the excited frequencies."""

    #: Channel names.
    response: str
    reference: str
    frequency: FloatArray  #: Of the excited frequencies, Hz, shape (bins,).
    value: ComplexArray  #: Complex, the mean over periods and realizations, shape (bins,).
    #: Standard deviation of the magnitude and of the phase (rad): noise and distortion together, shape (bins,).
    magnitude_std: FloatArray
    phase_std: FloatArray
    #: Standard deviation of the complex value of one realization due to noise (averaged over its periods), and due to distortion,
    #: shape (bins,). Distortion is NaN with one realization.
    noise: FloatArray
    distortion: FloatArray
    #: Averaged periods of each run (the smallest number), and number of runs.
    periods: int
    realizations: int


def periodic(runs: Sequence[Run], *, response: str, reference: str) -> PeriodicFrf:
    """Average runs with a periodic drive of one rate and one period; each run is one realization.

    Data after a gap are not used. Raises DataError if a run has no period or too few of them, or the runs are incompatible.
    """
    if not runs:
        raise DataError("no run was given; give at least one")
    first = runs[0]
    spectra = [settled_periods(run, (reference, response)) for run in runs]
    for run in runs:
        if (run.period, run.sample_rate) != (first.period, first.sample_rate):
            raise DataError(
                f"run {run.id!r} has periods of {run.period} samples at {run.sample_rate:g} Hz but run {first.id!r} has "
                f"{first.period} at {first.sample_rate:g} Hz; average runs of one period only"
            )
    driven = driven_bins([x.mean(axis=0) for x, _ in spectra], first.id)
    values, noises = [], []
    for drive, answer in spectra:
        x, y = drive[:, driven], answer[:, driven]
        mean = x.mean(axis=0)
        value = y.mean(axis=0) / mean
        left = y - value * x
        count = len(x)
        noises.append((np.abs(left - left.mean(axis=0)) ** 2).sum(axis=0) / (count * (count - 1)) / np.abs(mean) ** 2)
        values.append(value)
    many = len(runs)
    value, noise = np.mean(values, axis=0), np.mean(noises, axis=0)
    if many > 1:
        spread = (np.abs(np.array(values) - value) ** 2).sum(axis=0) / (many - 1)
        distortion, whole = np.sqrt(np.maximum(spread - noise, 0.0)), spread / many
    else:
        distortion, whole = np.full(len(driven), np.nan), noise
    std = np.sqrt(whole / 2.0)
    return PeriodicFrf(
        response=response, reference=reference,
        frequency=np.asarray(driven * first.sample_rate / float(first.period or 1), dtype=np.float64), value=value,
        magnitude_std=std, phase_std=np.minimum(std / np.maximum(np.abs(value), np.finfo(float).tiny), np.pi),
        noise=np.sqrt(noise), distortion=distortion, periods=min(len(x) for x, _ in spectra), realizations=many,
    )  # fmt: skip


def settled_periods(run: Run, names: Sequence[str]) -> tuple[ComplexArray, ...]:
    """Spectra of channels in each period of a run after the transient, each shape (periods, bins). Raises DataError if the run
    has no period or too few of them."""
    if run.period is None:
        raise DataError(f"run {run.id!r} has no period; give a run with a periodic drive that states its period")
    start, stop = next(stretches(run))
    count = (stop - start) // run.period - SETTLING
    if count < NEEDED:
        raise DataError(
            f"run {run.id!r} contains {(stop - start) / run.period:.1f} periods, but needs at least {SETTLING + NEEDED} whole "
            "periods, the first of which is discarded; measure longer"
        )
    begin = start + SETTLING * run.period
    rows = (run.channel(name).read(begin, begin + count * run.period).reshape(count, -1) for name in names)
    return tuple(np.asarray(np.fft.rfft(row, axis=1)) for row in rows)


def driven_bins(drives: Sequence[ComplexArray], where: str) -> IntArray:
    """The frequency bins in which every one of the mean drives has power. Raises DataError if there is none."""
    power = np.min([np.abs(drive) ** 2 for drive in drives], axis=0)
    power[0] = 0.0
    kept: NDArray[np.bool_] = power > DRIVEN * power.max()
    if not kept.any():
        raise DataError(f"run {where!r} has a drive without content; check its channel")
    return np.flatnonzero(kept)


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Composition of a response within the band of the drive, relative to the rms at the excited frequencies.

    Noise is the rms in a frequency bin of one period; odd and even distortion are the rms in a bin that is not excited, corrected
    for noise. There were so many whole periods after the first.
    """

    response: str
    periods: int
    noise: float
    odd: float
    even: float


def detect(run: Run, *, response: str, reference: str) -> Detection:
    """Separate noise and distortion in a run with a periodic drive. Raises DataError if the run has no period, too few of them,
    no drive, or one that excites every frequency."""
    drive, answer = settled_periods(run, (reference, response))
    count = len(answer)
    line = np.arange(drive.shape[1])
    driven = np.isin(line, driven_bins([drive.mean(axis=0)], run.id))
    inside = (line >= line[driven][0]) & (line <= line[driven][-1])
    free = inside & ~driven
    if not free.any():
        raise DataError(f"run {run.id!r} excites every frequency of its band; measure it with a multisine that omits some")
    mean = answer.mean(axis=0)
    variance = np.var(answer, axis=0, ddof=1)
    level = float(np.sqrt(np.mean(np.abs(mean[driven]) ** 2))) or 1.0
    beyond = np.abs(mean) ** 2 - variance / count
    return Detection(
        response=response, periods=count, noise=_rms(variance[inside]) / level, odd=_rms(beyond[free & (line % 2 == 1)]) / level,
        even=_rms(beyond[free & (line % 2 == 0)]) / level,
    )  # fmt: skip


def _rms(power: FloatArray) -> float:
    return float(np.sqrt(max(float(power.mean()), 0.0))) if len(power) else 0.0
