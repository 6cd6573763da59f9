"""The drive of a planned run at gain 1, made here and played by the instrument."""

from __future__ import annotations

import numpy as np

from analysis.excitation import moves, multisine, random
from analysis.measured import FloatArray
from drivers.errors import SettingError
from drivers.instrument import Exciter, Stream
from rig.acquire.plan import RunPlan
from rig.virtual import HEAD_PER_GAIN, MOVE_PER_GAIN


def drive_of(run: RunPlan, repeat: int, sample_rate: float) -> tuple[FloatArray, int | None]:
    """The head's acceleration at gain 1, m/s^2, shape (n,), and the samples of a period where it has one.

    Each repeat is another realisation. Runs that are driven by other means have a drive of zeros, so that nothing is played.
    """
    n = run.ticks(sample_rate)
    if not run.played:
        return np.zeros(n), None
    if run.excitation == "moves":
        return moves(samples=n, sample_rate=sample_rate, peak=MOVE_PER_GAIN), None
    assert run.band is not None  # the plan was checked
    if run.excitation == "random":
        return random(samples=n, sample_rate=sample_rate, rms=HEAD_PER_GAIN, band=run.band, seed=run.seed + repeat), None
    period = round(run.period * sample_rate)
    values, _ = multisine(
        period=period, periods=n // period, sample_rate=sample_rate, rms=HEAD_PER_GAIN, band=run.band,
        seed=run.seed + repeat,
    )  # fmt: skip
    return values, period


def load(instrument: Stream, run: RunPlan, drive: FloatArray) -> None:
    """Hand a run's drive and gain to an instrument that plays them.

    Raises
    ------
    SettingError
        Where the run needs a drive and the instrument plays none.
    """
    if isinstance(instrument, Exciter):
        instrument.set_gain(run.gain)
        if instrument.load_drive(drive):
            return
    if run.played:
        raise SettingError(
            f"run {run.id!r} needs a drive and {instrument.identity} plays none; drive the rig by other means and call the "
            'excitation "other"'
        )
