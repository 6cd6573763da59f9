"""The sample rate of an instrument by the host's clock, the only one that the instrument cannot set.

Samples arrive late, never early: the earliest arrivals give the difference between the number of samples and the elapsed time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray

#: Relative deviation of the sample rate that is reported, and that ends a run: crystals are within 1e-4, and a host's clock that
#: is being set within 5e-4 (NTP, `man adjtimex`). At the second, a natural frequency would be wrong by 2 %.
REPORTED, REFUSED = 0.002, 0.02
#: Number of arrivals kept, the earliest of neighbours.
ARRIVALS = 4096
#: Number of equal parts of the time, each with its earliest arrival; minimum number of parts with arrivals; minimum time, s.
PARTS, LEAST, SHORTEST = 16, 8, 0.5
#: Uncertainty of an earliest arrival that is always assumed, s: the steps in which hosts schedule.
GRAIN = 1e-3
#: Factor from a standard uncertainty to certainty.
SURE = 3.0


@dataclass(frozen=True, kw_only=True)
class Drift:
    """Relative deviation of the instrument's sample rate by the host's clock, and its standard uncertainty, parts per million."""

    ppm: float
    std: float

    @property
    def sure(self) -> bool:
        """Whether it exceeds the scatter of the arrival times."""
        return self.beyond(0.0)

    @property
    def percent(self) -> str:
        """The deviation as text."""
        return f"{self.ppm / 1e4:+.2g} %"

    def beyond(self, share: float) -> bool:
        """Whether the rate certainly deviates by more than a share."""
        return abs(self.ppm) - SURE * self.std > 1e6 * share


class Pace:
    """The arrivals of a run.

    Parameters
    ----------
    rate
        Stated sample rate, Hz.
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._arrivals = np.zeros((0, 2))

    def add(self, end_ticks: FloatArray, host_times: FloatArray) -> None:
        """Add blocks: the ticks after their last samples, and their arrival times in s, each of shape (n,)."""
        self._arrivals = np.concatenate([self._arrivals, np.column_stack([end_ticks, host_times])])
        while len(self._arrivals) > ARRIVALS:
            # The earlier of two neighbours.
            pairs = self._arrivals[: len(self._arrivals) // 2 * 2].reshape(-1, 2, 2)
            late = pairs[:, :, 1] - pairs[:, :, 0] / self._rate
            self._arrivals = np.take_along_axis(pairs, np.argmin(late, axis=1)[:, None, None], axis=1)[:, 0]

    def drift(self) -> Drift | None:
        """The deviation of the rate; None if too little has arrived."""
        if len(self._arrivals) < LEAST:
            return None
        tick, host = self._arrivals.T - self._arrivals[0][:, None]
        span = float(host[-1])
        if not SHORTEST <= span < np.inf:
            return None
        # Lost ticks are counted, so that losses do not appear as drift. After a silence, the last of what was held arrives in
        # time, so the parts are parts of the time.
        late = host - tick / self._rate
        part = np.clip((host / span * PARTS).astype(np.int64), 0, PARTS - 1)
        order = np.lexsort((late, part))
        first = order[np.unique(part[order], return_index=True)[1]]
        if len(first) < LEAST:
            return None
        (slope, _), covariance = np.polyfit(host[first], late[first], 1, cov=True)
        # In the time t the instrument has taken rate * t * (1 - slope) samples.
        return Drift(ppm=-1e6 * float(slope), std=1e6 * max(float(np.sqrt(covariance[0, 0])), GRAIN / span))
