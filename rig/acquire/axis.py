"""How sure a run's time axis is, from what came with its blocks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isorig.drivers.arrivals import BIN, JUMP, SCATTER
from isorig.drivers.block import Status

#: What a recording says of it: who counted the samples, the seconds of a loss that nothing would have shown, and the number of
#: blocks before which counter and clock disagreed, bytes were lost, or this machine's clock alone told of a loss.
AXIS = ("time_axis", "time_axis_unseen", "time_axis_doubts")
DOUBTS = Status.DISAGREES | Status.CLOCKED | Status.RESYNCED


def axis_of(timing: NDArray[Any], rate: float) -> dict[str, str | float | int]:
    """What is known of a time axis.

    Parameters
    ----------
    timing
        A row for each block: its first tick, when it arrived by this machine's clock and the instrument's, s, and its status.
    rate
        Samples a second, Hz.
    """
    counted = bool(np.isfinite(timing["device_time"]).any())
    doubts = int((timing["status"] & int(DOUBTS)).astype(bool).sum())
    unseen = 0.0 if counted else max(JUMP, SCATTER * _scatter(timing, rate))
    return dict(zip(AXIS, ("instrument" if counted else "host", unseen, doubts), strict=True))


def _scatter(timing: NDArray[Any], rate: float) -> float:
    # The least delay of each bin over a line through them, as `isorig.drivers.arrivals` looks at them.
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
