"""History of a fleet: each rig's parameters over time, its changes, and outlying rigs, computed from the catalogue."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import FloatArray
from isorig.analysis.trends import policy as trends
from isorig.analysis.trends.change import DatedChange, Followed, follow
from isorig.analysis.trends.cusum import thresholds
from isorig.analysis.trends.series import Scatter, Series, Siblings, scatter_of, siblings
from isorig.analysis.wording import with_std
from isorig.rig.errors import RigError
from isorig.rig.fleet.catalogue import SUPERSEDED, WITHOUT
from isorig.rig.fleet.policy import POLICY

if TYPE_CHECKING:
    import pandas as pd

#: Days of a month.
MONTH = 365.25 / 12.0
#: Verdict of a diagnosis that names no cause although the model misfits.
UNEXPLAINED = "unexplained"
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
#: Columns of the catalogue; `started` in days since the epoch.
Rows: TypeAlias = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, kw_only=True)
class DiagnosedCampaign:
    """A campaign of a rig from its answer: date, named causes, and recording."""

    name: str
    started: float
    verdict: str
    causes: frozenset[str]
    alike: frozenset[str]
    content: str
    path: str

    @property
    def day(self) -> str:
        """The date of its start."""
        return (EPOCH + timedelta(days=self.started)).strftime("%Y-%m-%d")


@dataclass(frozen=True, kw_only=True)
class Track:
    """One parameter of one rig."""

    #: The parameter's path, or cause, place and name.
    name: str
    unit: str
    #: Whether the logarithm is tracked (if the parameter is positive throughout the fleet), so that differences are relative.
    log: bool
    campaigns: tuple[int, ...]  #: Index of each value's campaign in the rig's list.
    series: Series  #: The tracked values.
    followed: Followed  #: The result of tracking.

    def plain(self, value: float) -> float:
        """A level as the parameter's value."""
        return math.exp(value) if self.log else value

    @property
    def level(self) -> float:
        """The parameter's present value."""
        return self.plain(self.followed.level)

    @property
    def values(self) -> FloatArray:
        """The parameter's value in each campaign, shape (n,)."""
        return np.exp(self.series.value) if self.log else self.series.value

    @property
    def stds(self) -> FloatArray:
        """Standard uncertainties of the values, shape (n,)."""
        return self.values * self.series.std if self.log else self.series.std

    def moved(self, change: DatedChange) -> str:
        """A change in words: its size, with the standard uncertainty."""
        if self.log:
            share, std = math.expm1(change.after - change.before), math.exp(change.after - change.before) * change.std
            return f"{with_std(100.0 * share, 100.0 * std, sign=True)} %"
        return f"{with_std(change.after - change.before, change.std, sign=True)} {self.unit}"


@dataclass(frozen=True, kw_only=True)
class NewCause:
    """A cause that the diagnoses of a rig name from some campaign on, and did not name before.

    Indices of the rig's campaigns: it may have changed from `begun` on, as no model explains that one; the `first` names it; one
    raised the alarm.
    """

    cause: str
    begun: int
    first: int
    alarm: int


@dataclass(frozen=True, kw_only=True)
class Incident:
    """A date on which a rig changed: all changes of that date."""

    rig: str
    changes: tuple[tuple[Track, DatedChange], ...]  #: The parameters that changed, the most significant first.
    named: tuple[NewCause, ...]  #: Causes named from then on.
    #: Indices of the rig's campaigns between which it happened, with 95 % certainty.
    last_before: int
    first_after: int
    first: int  #: Index of the most likely first campaign after it.
    alarm: int  #: Index of the campaign that raised the first alarm.

    @property
    def confirmed(self) -> bool:
        """Whether all campaigns since confirm the change."""
        return bool(self.named) or any(abs(change.size) >= POLICY.confirmed_change for _, change in self.changes)


@dataclass(frozen=True, kw_only=True)
class TrackedRig:
    """One rig."""

    name: str  #: The folder of its recordings.
    campaigns: tuple[DiagnosedCampaign, ...]  #: The tracked campaigns, in order of time.
    version: str  #: The version of the program of all their diagnoses.
    waiting: int  #: Number of campaigns not diagnosed by this version yet, or only by a newer one: they are not tracked.
    tracks: Mapping[str, Track]  #: Parameters by name.
    incidents: tuple[Incident, ...]  #: The latest last.

    @property
    def last_change(self) -> Incident | None:
        """The latest one that later campaigns confirm."""
        return next((incident for incident in reversed(self.incidents) if incident.confirmed), None)


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """All rigs by name, and what their tracking used: by parameter the campaign-to-campaign variance, the thresholds of the CUSUM
    charts and the comparison with the other rigs.

    `false_per_month` is the allowed number of false alarms in the whole fleet; `notes` are about recordings that could not be
    tracked.
    """

    baseline: str
    rigs: Mapping[str, TrackedRig]
    scatter: Mapping[str, Scatter]
    limits: Mapping[str, tuple[float, ...]]
    false_per_month: float
    siblings: Mapping[str, Siblings]
    notes: tuple[str, ...]

    @property
    def incidents(self) -> list[Incident]:
        """Those of all rigs, the latest first."""
        found = [incident for rig in self.rigs.values() for incident in rig.incidents]
        return sorted(found, key=lambda i: self.rigs[i.rig].campaigns[i.alarm].started, reverse=True)

    @property
    def in_order(self) -> list[TrackedRig]:
        """The rigs in display order: the latest change first, then outliers, then the rest by name."""

        def place(rig: TrackedRig) -> tuple[float, bool, str]:
            last = rig.last_change
            alarm = -math.inf if last is None else rig.campaigns[last.alarm].started
            return -alarm, not self.outlying_in(rig.name), rig.name

        return sorted(self.rigs.values(), key=place)

    def outlying_in(self, rig: str) -> list[str]:
        """Parameters in which a rig differs from the others by more than their spread."""
        return [name for name, found in self.siblings.items() if rig in found.outliers]


def followed(answers: pd.DataFrame, baseline: str, *, false_per_month: float | None = None) -> Fleet:
    """Track every parameter of every rig by the diagnoses with a baseline.

    The whole fleet may raise `false_per_month` false alarms per month, by default those of `POLICY`. Raises RigError if no
    campaign can be tracked, or the rate is not positive.
    """
    if false_per_month is not None and not false_per_month > 0.0:
        raise RigError(f"the rate of false alarms is {false_per_month:g} a month; give a positive one")
    mine = answers[(answers.baseline == baseline) & (answers.verdict != SUPERSEDED)]
    usable = mine[~mine.verdict.isin(WITHOUT)]
    dated = usable[usable.started.notna()].sort_values(["rig", "started", "content"], kind="stable")
    notes = [
        f"{row.rig} {row.campaign}: {row.verdict}; {row.reason}"
        for row in mine[mine.verdict.isin(WITHOUT)].drop_duplicates(["content"], keep="last").itertuples()
        if not (usable.content == row.content).any()
    ]
    notes += [
        f"{row.rig} {row.campaign} is not tracked: the recording does not give its start time"
        for row in usable[usable.started.isna()].drop_duplicates("content").itertuples()
    ]
    if not len(dated):
        why = f"; {notes[0]}" if notes else ""
        raise RigError(f"no campaign was diagnosed with the {baseline} baseline yet{why}; run rig fleet update first")
    chosen = {rows["rig"][0]: _one_version(rows) for rows in _by_rig(dated)}
    positive = dated.groupby("parameter").value.min() > 0.0
    campaigns = {name: _campaigns(rows) for name, (rows, _, _) in chosen.items()}
    causes = {name: _named(own) for name, own in campaigns.items()}
    raw = {name: _raw_tracks(rows, positive, _without(causes[name], campaigns[name])) for name, (rows, _, _) in chosen.items()}
    by_name: dict[str, list[Series]] = {}
    for tracks in raw.values():
        for name, (_, _, series) in tracks.items():
            by_name.setdefault(name, []).append(series)
    scatter = {name: scatter_of(series) for name, series in by_name.items()}
    allowed = min(POLICY.false_alarms, POLICY.false_alarms_of_rig * len(raw)) if false_per_month is None else false_per_month
    rate = allowed / max(_tests_per_month(chain(*by_name.values())), 2.0 * allowed)
    # Thresholds are computed once for each step of a tenth.
    freedom = {name: float(1.1 ** np.floor(np.log(max(s.freedom, 1.0)) / np.log(1.1))) for name, s in scatter.items()}
    limits = {name: thresholds(rate, each) for name, each in freedom.items() if each >= trends.POLICY.fewest_freedom}
    rigs = {}
    for name, (_, version, waiting) in chosen.items():
        own = {
            parameter: Track(
                name=parameter, unit=unit, log=bool(positive[parameter]), campaigns=at, series=series,
                followed=follow(series, scatter[parameter].variance, limits.get(parameter, (math.inf, math.inf))),
            )
            for parameter, (at, unit, series) in raw[name].items()
        }  # fmt: skip
        rigs[name] = TrackedRig(
            name=name, campaigns=campaigns[name], version=version, waiting=waiting, tracks=own,
            incidents=_incidents(name, own, causes[name]),
        )  # fmt: skip
    return Fleet(
        baseline=baseline, rigs=rigs, scatter=scatter, limits=limits, false_per_month=allowed,
        siblings=_siblings(rigs), notes=tuple(notes),
    )  # fmt: skip


def _by_rig(dated: pd.DataFrame) -> Iterator[Rows]:
    # Sorted by rig. A table for each of many rigs would take most of the time.
    days = np.asarray((dated.started - EPOCH) / timedelta(days=1), dtype=np.float64)
    columns: Rows = {str(key): values.to_numpy() for key, values in dated.items()} | {"started": days}
    bounds = [0, *np.flatnonzero(_differs(columns["rig"])) + 1, len(dated)]
    for begin, end in pairwise(bounds):
        yield {key: values[begin:end] for key, values in columns.items()}


def _differs(values: NDArray[Any]) -> NDArray[np.bool_]:
    # Of neighbours, shape (n - 1,).
    return np.asarray(values[1:] != values[:-1])


def _one_version(rows: Rows) -> tuple[Rows, str, int]:
    # A new program version can itself change values, so a rig is tracked in one version only: the newest of those that have
    # diagnosed most of its campaigns. Until the newest version has diagnosed as many, its campaigns wait.
    content: dict[str, set[str]] = {}
    for name, each in zip(rows["version"], rows["content"], strict=True):
        content.setdefault(name, set()).add(each)
    version = max(content, key=lambda v: (len(content[v]), _ordered(v)))
    kept, waiting = rows["version"] == version, set().union(*content.values()) - content[version]
    return {key: values[kept] for key, values in rows.items()}, version, len(waiting)


def _ordered(version: str) -> tuple[tuple[int, str], ...]:
    return tuple((int(part), "") if part.isdigit() else (-1, part) for part in version.split("."))


def _without(named: Sequence[NewCause], campaigns: Sequence[DiagnosedCampaign]) -> frozenset[int]:
    # Campaigns of a rig with a cause whose model lacks it: their values are biased and not compared. A cause that as many
    # successive campaigns do not name as decide on a new one is gone.
    found: set[int] = set()
    for one in named:
        absent: list[int] = []
        for k in range(one.begun, len(campaigns)):
            if one.cause in campaigns[k].causes or one.cause in campaigns[k].alike:
                found.update(absent)
                absent = []
            else:
                absent.append(k)
                if len(absent) >= POLICY.successive:
                    absent = []
                    break
        found.update(absent)
    return frozenset(found)


def _raw_tracks(
    rows: Rows, positive: pd.Series[bool], left_out: frozenset[int]
) -> dict[str, tuple[tuple[int, ...], str, Series]]:
    at = _in_rig(rows)
    names, units, values, stds = (rows[k] for k in ("parameter", "unit", "value", "std"))
    places: dict[str, list[int]] = {}
    compared = np.isfinite(values) & np.isfinite(stds) & ~np.isin(at, list(left_out))
    for k in np.flatnonzero(compared).tolist():
        places.setdefault(names[k], []).append(k)
    found = {}
    for name, own in places.items():
        value, std = values[own], stds[own]
        if positive[name]:
            value, std = np.log(value), std / value
        found[name] = (tuple(at[own].tolist()), units[own[0]], Series(time=rows["started"][own], value=value, std=std))
    return found


def _in_rig(rows: Rows) -> NDArray[np.int64]:
    # Index of each row's campaign in the rig's list: rows are sorted by time, those of a campaign are adjacent.
    return np.cumsum(np.append(False, _differs(rows["content"])))


def _campaigns(rows: Rows) -> tuple[DiagnosedCampaign, ...]:
    first = np.flatnonzero(np.diff(_in_rig(rows), prepend=-1))
    columns = (rows[k][first].tolist() for k in ("campaign", "verdict", "cause", "alike", "content", "path", "started"))
    return tuple(
        DiagnosedCampaign(
            name=name, started=day, verdict=verdict, causes=_split(cause), alike=_split(alike), content=content, path=path
        )
        for name, verdict, cause, alike, content, path, day in zip(*columns, strict=True)
    )


def _split(causes: str) -> frozenset[str]:
    return frozenset(part for part in causes.split(" + ") if part)


def _tests_per_month(tracked: Iterable[Series]) -> float:
    steps = (np.diff(series.time) for series in tracked)
    return sum(MONTH / max(float(np.median(days)) if len(days) else POLICY.unknown_interval, 1e-3) for days in steps)


def _named(campaigns: Sequence[DiagnosedCampaign]) -> list[NewCause]:
    found = []
    for cause in sorted(frozenset().union(*(c.causes for c in campaigns))):
        named = [cause in c.causes for c in campaigns]
        near = [cause in c.causes or cause in c.alike for c in campaigns]
        clean, standing = 0, False
        for k in range(len(campaigns)):
            recent = range(max(k - POLICY.successive + 1, 0), k + 1)
            if not standing and named[k] and sum(named[i] for i in recent) >= POLICY.naming:
                first = next(i for i in recent if named[i])
                if clean >= POLICY.unnamed_before:
                    found.append(NewCause(cause=cause, begun=_begun(campaigns, first), first=first, alarm=k))
                standing = True
            # Successive campaigns without a similar cause before the tested ones.
            before = near[max(k - POLICY.successive + 1, 0)]
            clean = 0 if before else clean + (k - POLICY.successive + 1 >= 0)
            if standing and not any(near[i] for i in recent):
                standing = False
    return found


def _begun(campaigns: Sequence[DiagnosedCampaign], first: int) -> int:
    # A campaign that no model explains, right before the first that names a cause, may already have it; unless the rig never was
    # explained.
    begun = first
    while begun > 0 and campaigns[begun - 1].verdict == UNEXPLAINED:
        begun -= 1
    return begun if begun > 0 else first


def _incidents(rig: str, tracks: Mapping[str, Track], named: Sequence[NewCause]) -> tuple[Incident, ...]:
    # Changes with overlapping intervals (from the last campaign before to the alarm) belong to one date.
    single = []
    for track in tracks.values():
        for change in track.followed.changes:
            # The last campaign before it is one that was compared.
            places = (max(change.earliest - 1, 0), change.latest, change.first, change.alarm)
            before, after, first, alarm = (track.campaigns[k] for k in places)
            single.append(
                Incident(
                    rig=rig, changes=((track, change),), named=(), last_before=before, first_after=after, first=first, alarm=alarm
                )
            )
    for n in named:
        before = max(n.begun - 1, 0)
        single.append(
            Incident(rig=rig, changes=(), named=(n,), last_before=before, first_after=n.first, first=n.begun, alarm=n.alarm)
        )
    groups: list[list[Incident]] = []
    for one in sorted(single, key=lambda i: (i.last_before, i.first_after, i.first, i.alarm, len(i.named))):
        if groups and one.last_before < max(max(each.first_after, each.alarm) for each in groups[-1]):
            groups[-1].append(one)
        else:
            groups.append([one])
    return tuple(map(_joined, groups))


def _joined(group: Sequence[Incident]) -> Incident:
    # Dated by the most significant parameter change; if there is none, by the first new cause.
    changed = sorted((one for one in group if one.changes), key=lambda one: -abs(one.changes[0][1].size))
    named = [one for one in group if one.named]
    significant = changed and abs(changed[0].changes[0][1].size) >= POLICY.dating_change
    main = changed[0] if significant or not named else min(named, key=lambda one: one.first)
    return replace(
        main, changes=tuple(pair for one in changed for pair in one.changes), named=tuple(n for one in named for n in one.named),
        alarm=min(one.alarm for one in group),
    )  # fmt: skip


def _siblings(rigs: Mapping[str, TrackedRig]) -> dict[str, Siblings]:
    levels: dict[str, dict[str, float]] = {}
    for rig in rigs.values():
        for name, track in rig.tracks.items():
            levels.setdefault(name, {})[rig.name] = track.followed.level
    return {name: siblings(own, POLICY.outlier_risk / len(levels)) for name, own in sorted(levels.items())}
