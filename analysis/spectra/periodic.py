"""Periodic drives, period by period: the transfer function with noise and distortion told apart.

What differs from period to period is noise; what differs beyond that from one realization of the drive (other phases) to the
next is distortion by a nonlinearity (the robust method: Pintelon and Schoukens, System Identification, 2012, 4.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import ComplexArray, FloatArray, IntArray, Run
from isorig.analysis.errors import DataError
from isorig.analysis.spectra.welch import stretches

#: Lines with less than this share of the strongest line's amplitude count as not driven.
DRIVEN = 0.01
#: First periods that are left out, for the motion to settle, and periods needed beyond them.
SETTLING, NEEDED = 1, 2


@dataclass(frozen=True, kw_only=True)
class PeriodicFrf:
    """A transfer function at the driven lines.

    Parameters
    ----------
    response, reference
        Channel names.
    frequency
        Of the driven lines, Hz, shape (lines,).
    value
        Complex, the mean over periods and realizations, shape (lines,).
    magnitude_std, phase_std
        Standard deviation of the magnitude and of the phase (rad): noise and distortion together, shape (lines,).
    noise, distortion
        Standard deviation of the complex value of one realization by noise (averaged over its periods), and by distortion,
        shape (lines,). Distortion is NaN with one realization, which cannot tell it.
    periods, realizations
        Averaged periods of each run (the fewest), and runs.
    """

    response: str
    reference: str
    frequency: FloatArray
    value: ComplexArray
    magnitude_std: FloatArray
    phase_std: FloatArray
    noise: FloatArray
    distortion: FloatArray
    periods: int
    realizations: int


def periodic(runs: Sequence[Run], *, response: str, reference: str) -> PeriodicFrf:
    """Average runs under a periodic drive; each run is one realization.

    Parameters
    ----------
    runs
        Of one rate and one period. What follows a gap is not used.
    response, reference
        Channels.

    Raises
    ------
    DataError
        Where a run has no period or too few of them, or runs do not go together.
    """
    if not runs:
        raise DataError("no run was given; name at least one")
    first = runs[0]
    spectra = [settled_periods(run, (reference, response)) for run in runs]
    for run in runs:
        if (run.period, run.sample_rate) != (first.period, first.sample_rate):
            raise DataError(
                f"run {run.id!r} has periods of {run.period} samples at {run.sample_rate:g} Hz and run {first.id!r} "
                f"{first.period} at {first.sample_rate:g} Hz; average runs of one period only"
            )
    driven = driven_lines([x.mean(axis=0) for x, _ in spectra], first.id)
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
    """Spectra of channels in each period of a run after those in which the motion settles, each shape (periods, lines).

    Raises
    ------
    DataError
        Where the run has no period or too few of them.
    """
    if run.period is None:
        raise DataError(f"run {run.id!r} has no period; give a run under a periodic drive that says how long it is")
    start, stop = next(stretches(run))
    count = (stop - start) // run.period - SETTLING
    if count < NEEDED:
        raise DataError(
            f"run {run.id!r} holds {(stop - start) / run.period:.1f} periods, but needs at least {SETTLING + NEEDED} whole "
            "periods, the first of which settles; measure longer"
        )
    begin = start + SETTLING * run.period
    rows = (run.channel(name).read(begin, begin + count * run.period).reshape(count, -1) for name in names)
    return tuple(np.asarray(np.fft.rfft(row, axis=1)) for row in rows)


def driven_lines(drives: Sequence[ComplexArray], where: str) -> IntArray:
    """The lines that every one of the mean drives has power at.

    Raises
    ------
    DataError
        Where there is none.
    """
    size = np.min([np.abs(drive) for drive in drives], axis=0)
    size[0] = 0.0
    kept: NDArray[np.bool_] = size > DRIVEN * size.max()
    if not kept.any():
        raise DataError(f"run {where!r} has a drive without content; check its channel")
    return np.flatnonzero(kept)
