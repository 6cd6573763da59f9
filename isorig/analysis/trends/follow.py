"""Analysis of one series: alarms, and the changes that caused them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.trends.change import DatedChange, change_in, date_of_step, drift_of, fitted_knee, likelihood_of_steps
from isorig.analysis.trends.cusum import alarms
from isorig.analysis.trends.policy import POLICY
from isorig.analysis.trends.series import Series


@dataclass(frozen=True, kw_only=True)
class Followed:
    """Result for one parameter: its changes in order of time, its present level, and outlying campaigns between regular
    neighbours."""

    changes: tuple[DatedChange, ...]
    level: float
    std: float
    outlying: tuple[int, ...]


def follow(series: Series, between: float, limits: Sequence[float]) -> Followed:
    """Search for changes in a series of one campaign or more, with a campaign-to-campaign variance.

    The limits are the thresholds of the charts (`isorig.analysis.trends.cusum.thresholds`).
    """
    variance = series.variance(between)
    raised = alarms(series.value, variance, limits)
    changes = _changes(series, variance, raised.at, raised.rising)
    begun = changes[-1].first if changes else 0
    weight = 1.0 / variance[begun:]
    drifts = bool(changes) and changes[-1].kind == "drift"
    level = changes[-1].after if drifts else float(np.average(series.value[begun:], weights=weight))
    far = set(np.flatnonzero(np.abs(raised.z) > POLICY.outlying_campaign).tolist())
    touched = {k for change in changes for k in range(change.earliest, change.alarm + 1)}
    return Followed(
        changes=changes, level=level, std=float(1.0 / np.sqrt(weight.sum())),
        outlying=tuple(k for k in sorted(far - touched) if not {k - 1, k + 1} & far),
    )  # fmt: skip


def _changes(series: Series, variance: FloatArray, at: Sequence[int], rising: Sequence[bool]) -> tuple[DatedChange, ...]:
    # First the dates from the data up to each alarm; then each change from all data between its neighbours.
    firsts, begin = [], 0
    for alarm in at:
        firsts.append(begin + date_of_step(series.value[begin : alarm + 1], variance[begin : alarm + 1])[0])
        begin = firsts[-1]
    ends = [*firsts[1:], len(series)]
    found: list[DatedChange] = []
    for _, group in groupby(range(len(at)), key=rising.__getitem__):
        same = list(group)
        begin = found[-1].first if found else 0
        part = slice(begin, ends[same[-1]])
        drift = _one_drift(series, variance, part, [firsts[k] for k in same], at[same[0]])
        if drift is not None:
            found.append(drift)
            continue
        for k in same:
            begin = found[-1].first if found else 0
            part = slice(begin, ends[k])
            found.append(change_in(series.time[part], series.value[part], variance[part], alarm=at[k], begin=begin))
    return tuple(found)


def _one_drift(series: Series, variance: FloatArray, part: slice, firsts: Sequence[int], alarm: int) -> DatedChange | None:
    # Several steps in the same direction may be one drift: the model with fewer parameters per likelihood (Schwarz 1978) is kept.
    # A step has a date and a level, a drift a date and a slope.
    if len(firsts) < 2:
        return None
    time, value, weight = series.time[part], series.value[part], 1.0 / variance[part]
    knee = fitted_knee(time, value, weight)
    steps = likelihood_of_steps(value, weight, [first - part.start for first in firsts])
    drifts = knee.likelihood + (len(firsts) - 1) * np.log(len(time)) >= steps
    return drift_of(time, knee, alarm, part.start) if drifts else None
