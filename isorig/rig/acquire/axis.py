"""Reliability of a run's time axis, from the timing of its blocks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isorig.drivers.arrivals import BIN, JUMP, SCATTER
from isorig.drivers.block import Status

#: Attributes of a recording: who counted the samples, the longest undetectable loss in seconds, and the number of blocks before
#: which counter and clock disagreed, bytes were lost, or only the host's clock indicated a loss.
AXIS = ("time_axis", "time_axis_unseen", "time_axis_doubts")
DOUBTS = Status.DISAGREES | Status.CLOCKED | Status.RESYNCED


def axis_of(timing: NDArray[Any], rate: float) -> dict[str, str | float | int]:
    """The attributes of a time axis.

    Parameters
    ----------
    timing
        A row for each block, shape (blocks,): its first tick, its arrival time by the host's clock and the instrument's time, s,
        and its status.
    rate
        Sample rate, Hz.
    """
    # A clock of the instrument shows every loss, as the numbers of the samples do.
    numbered = bool(len(timing)) and bool((timing["status"] & int(Status.NUMBERED)).all())
    counted = numbered or bool(np.isfinite(timing["device_time"]).any())
    doubts = int((timing["status"] & int(DOUBTS)).astype(bool).sum())
    unseen = 0.0 if counted else max(JUMP, SCATTER * _scatter(timing, rate))
    return dict(zip(AXIS, ("instrument" if counted else "host", unseen, doubts), strict=True))


def _scatter(timing: NDArray[Any], rate: float) -> float:
    # The smallest delay of each bin relative to a fitted line, as in `isorig.drivers.arrivals`.
    if len(timing) < 3 or rate <= 0.0:
        return 0.0
    host = timing["host_time"] - timing["host_time"][0]
    late = host - (timing["tick"] - timing["tick"][0]) / rate
    _, bins = np.unique((host / BIN).astype(np.int64), return_inverse=True)
    least = np.full(int(bins.max()) + 1, np.inf)
    np.minimum.at(least, bins, late)
    if len(least) < 3:
        return 0.0
    at = np.arange(len(least))
    least -= np.polyval(np.polyfit(at, least, 1), at)
    return float(np.median(least) - least.min())
