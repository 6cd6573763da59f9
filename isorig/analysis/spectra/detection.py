"""Noise and distortion from one run with a multisine: from differences between periods, and from frequencies not excited.

The frequencies that the drive omits show distortion, which is periodic like the drive: even multiples show even distortion, odd
ones odd distortion (fast method: Pintelon and Schoukens, System Identification, 2012, 4.3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray, Run
from isorig.analysis.errors import DataError
from isorig.analysis.spectra.periodic import driven_lines, settled_periods


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
    driven = np.isin(line, driven_lines([drive.mean(axis=0)], run.id))
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
