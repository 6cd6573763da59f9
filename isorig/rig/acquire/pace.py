"""The sample rate of an instrument by the host's clock, the only one that the instrument cannot set.

Samples arrive late, never early, and on a busy host much too late. The deviation is therefore the slope of the lower convex hull
of lateness over time, at its edge above the middle of the time (Moon, Skelly and Towsley, Estimation and removal of clock skew
from network delay measurements, INFOCOM 1999). A wrong clock has the same slope in every part of the time, a host that becomes
slower has not: the differences between parts are the uncertainty.
"""

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import FloatArray

#: Number of arrivals kept, the earliest of neighbours.
ARRIVALS = 4096
#: Number of equal parts of the time whose slopes are compared, minimum number of arrivals, and minimum time, s.
PARTS, LEAST, SHORTEST = 4, 8, 0.5
#: Uncertainty of an earliest arrival that is always assumed, s: the steps in which hosts schedule.
GRAIN = 1e-3
#: Factor from a standard uncertainty to certainty.
SURE = 3.0


@dataclass(frozen=True, kw_only=True)
class ClockDrift:
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
    """The arrivals of a run whose stated sample rate is `rate`, Hz."""

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

    @property
    def began(self) -> float | None:
        """Arrival of tick 0 by the earliest of all arrivals, s; None if nothing has arrived."""
        return float((self._arrivals[:, 1] - self._arrivals[:, 0] / self._rate).min()) if len(self._arrivals) else None

    def drift(self) -> ClockDrift | None:
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
        slopes = [_slope(host[part == k], late[part == k]) for k in range(PARTS)]
        known = [slope for slope in slopes if slope is not None]
        slope = _slope(host, late)
        if slope is None or len(known) < PARTS - 1:
            return None
        scatter = float(np.sqrt(np.mean((np.array(known) - slope) ** 2)))
        # In the time t the instrument has taken rate * t * (1 - slope) samples.
        return ClockDrift(ppm=-1e6 * slope, std=1e6 * max(scatter, GRAIN / span))


def _slope(times: FloatArray, late: FloatArray) -> float | None:
    # Slope of the edge of the lower convex hull above the middle of the time; None for less than two times.
    if len(times) < 2 or times[-1] <= times[0]:
        return None
    order = np.lexsort((late, times))
    hull: list[tuple[float, float]] = []
    for x, y in zip(times[order].tolist(), late[order].tolist(), strict=True):
        if hull and x == hull[-1][0]:
            continue
        while len(hull) > 1 and _turns_down(hull[-2], hull[-1], (x, y)):
            hull.pop()
        hull.append((x, y))
    middle = 0.5 * (hull[0][0] + hull[-1][0])
    right = next(k for k, (x, _) in enumerate(hull) if x >= middle)
    (x0, y0), (x1, y1) = hull[right - 1], hull[right]
    return (y1 - y0) / (x1 - x0)


def _turns_down(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    # Whether b lies on or above the line from a to c.
    return (b[0] - a[0]) * (c[1] - a[1]) <= (b[1] - a[1]) * (c[0] - a[0])
