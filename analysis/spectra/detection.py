"""Noise and distortion from one run under a multisine: what changes from period to period, and what lies where nothing drives.

The lines that the drive leaves out show distortion, which repeats with the period as the drive does: the even ones even
distortion, the odd ones odd (the fast method: Pintelon and Schoukens, System Identification, 2012, 4.3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray, Run
from isorig.analysis.errors import DataError
from isorig.analysis.spectra.periodic import driven_lines, settled_periods


@dataclass(frozen=True, kw_only=True)
class Detection:
    """What a response is made of inside the drive's band, as shares of the rms at the driven lines.

    Parameters
    ----------
    response
        Channel name.
    periods
        Whole periods after the first.
    noise
        rms by noise at a line of one period.
    odd, even
        rms of distortion at a line that is not driven, what noise explains taken off.
    """

    response: str
    periods: int
    noise: float
    odd: float
    even: float


def detect(run: Run, *, response: str, reference: str) -> Detection:
    """Tell noise from distortion in a run whose drive repeats.

    Raises
    ------
    DataError
        Where the run has no period, too few of them, no drive, or one at every line.
    """
    drive, answer = settled_periods(run, (reference, response))
    count = len(answer)
    line = np.arange(drive.shape[1])
    driven = np.isin(line, driven_lines([drive.mean(axis=0)], run.id))
    inside = (line >= line[driven][0]) & (line <= line[driven][-1])
    free = inside & ~driven
    if not free.any():
        raise DataError(f"run {run.id!r} drives every line of its band; take it under a multisine that leaves lines out")
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
