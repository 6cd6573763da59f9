"""Analysis of one series: alarms, and the changes that caused them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.trends.change import DatedChange, bent, dated, described, drifting, stepped
from isorig.analysis.trends.cusum import alarms
from isorig.analysis.trends.policy import POLICY
from isorig.analysis.trends.series import Series


@dataclass(frozen=True, kw_only=True)
class Followed:
    """Result for one parameter.

    Parameters
    ----------
    changes
        In order of time.
    level, std
        The present level and its standard deviation.
    alone
        Indices of outlying campaigns between regular neighbours.
    """

    changes: tuple[DatedChange, ...]
    level: float
    std: float
    alone: tuple[int, ...]


def follow(series: Series, between: float, limits: Sequence[float]) -> Followed:
    """Search for changes in a series.

    Parameters
    ----------
    series
        At least one campaign.
    between
        Campaign-to-campaign variance.
    limits
        The thresholds of the charts (`isorig.analysis.trends.cusum.thresholds`).
    """
    variance = series.variance(between)
    raised = alarms(series.value, variance, limits)
    changes = _changes(series, variance, raised.at, raised.rising)
    begun = changes[-1].first if changes else 0
    level, std = float(np.average(series.value[begun:], weights=1.0 / variance[begun:])), variance[begun:]
    if changes and changes[-1].kind == "drift":
        level = changes[-1].after
    far = set(np.flatnonzero(np.abs(raised.z) > POLICY.outlying_campaign).tolist())
    touched = {k for change in changes for k in range(change.earliest, change.alarm + 1)}
    return Followed(
        changes=changes, level=level, std=float(1.0 / np.sqrt((1.0 / std).sum())),
        alone=tuple(k for k in sorted(far - touched) if not {k - 1, k + 1} & far),
    )  # fmt: skip


def _changes(series: Series, variance: FloatArray, at: Sequence[int], rising: Sequence[bool]) -> tuple[DatedChange, ...]:
    if not at:
        return ()
    # First the dates from the data up to each alarm; then each change from all data between its neighbours.
    firsts, begin = [], 0
    for alarm in at:
        firsts.append(begin + dated(series.value[begin : alarm + 1], variance[begin : alarm + 1])[0])
        begin = firsts[-1]
    groups: list[list[int]] = []
    for k in range(len(at)):
        if groups and rising[groups[-1][-1]] == rising[k]:
            groups[-1].append(k)
        else:
            groups.append([k])
    found: list[DatedChange] = []
    for group, following in pairwise([*groups, []]):
        begin = found[-1].first if found else 0
        end = firsts[following[0]] if following else len(series)
        found += _one_drift(series, variance, begin, end, [firsts[k] for k in group], at[group[0]])
        if found and found[-1].kind == "drift" and found[-1].alarm == at[group[0]]:
            continue
        for place, k in enumerate(group):
            begin = found[-1].first if found else 0
            stop = firsts[group[place + 1]] if place + 1 < len(group) else end
            found.append(_shifted(series, variance, begin, stop, at[k]))
    return tuple(found)


def _one_drift(
    series: Series, variance: FloatArray, begin: int, end: int, firsts: Sequence[int], alarm: int
) -> tuple[DatedChange, ...]:
    # Several steps in the same direction may be one drift: the model with fewer parameters per likelihood (Schwarz 1978) is kept.
    # A step has a date and a level, a drift a date and a slope.
    if len(firsts) < 2:
        return ()
    part = slice(begin, end)
    time, value, weight = series.time[part], series.value[part], 1.0 / variance[part]
    knee = bent(time, value, weight)
    steps = stepped(value, weight, [first - begin for first in firsts])
    if knee.likelihood + (len(firsts) - 1) * np.log(end - begin) < steps:
        return ()
    return (_moved(drifting(time, knee, alarm - begin), begin),)


def _shifted(series: Series, variance: FloatArray, begin: int, end: int, alarm: int) -> DatedChange:
    part = slice(begin, end)
    return _moved(described(series.time[part], series.value[part], variance[part], alarm=alarm - begin), begin)


def _moved(change: DatedChange, by: int) -> DatedChange:
    return replace(
        change, first=change.first + by, earliest=change.earliest + by, latest=change.latest + by, alarm=change.alarm + by
    )
