"""The drive of a planned run at gain 1, made here and played by the instrument."""

from __future__ import annotations

from analysis.excitation import moves, multisine, random
from analysis.measured import FloatArray
from rig.acquire.plan import RunPlan
from rig.virtual import HEAD_PER_GAIN, MOVE_PER_GAIN


def drive_of(run: RunPlan, repeat: int, sample_rate: float) -> tuple[FloatArray, int | None]:
    """The head's acceleration at gain 1, m/s^2, shape (n,), and the samples of a period where it has one.

    Each repeat is another realisation.
    """
    n = run.ticks(sample_rate)
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
