"""The displayed content of a session: a picture created at each reading, from samples that are read once."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import msgspec
import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import Campaign, FloatArray, Run
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.acquire.live import advice
from isorig.rig.acquire.policy import STICKING
from isorig.rig.acquire.recover import Recovered
from isorig.rig.acquire.run_check import check_run, least_sliding
from isorig.rig.errors import RigError
from isorig.rig.files.rigfile import rig_of
from isorig.rig.view.levels import ChannelLevel, Levels
from isorig.rig.view.messages import Judgement
from isorig.rig.view.responses import RESOLUTION, GrowingSpectra, groups_of, ratio_rows, transfer_rows
from isorig.rig.view.run_list import Planned
from isorig.rig.view.sources import Reading, beginning_of
from isorig.rig.wire_bonder.description import wire_bonder

#: Minimum duration of a run, seconds, before advice on its levels.
EARLY = 2.0
#: Number of samples between two pictures; number of samples above which a run is not read as a whole, because of memory.
PART, LONGEST = 1 << 20, 1 << 24


class Plot(msgspec.Struct, frozen=True, kw_only=True):
    """Rows of numbers to plot, the first along x; the names of the columns; and a number that changes when they do."""

    version: int
    names: tuple[str, ...]
    rows: NDArray[np.float32]


class ShownRun(msgspec.Struct, frozen=True, kw_only=True):
    """A run: seconds measured, samples lost, overloaded channels, and result of the post-run check."""

    planned: Planned
    seconds: float
    lost: int
    levels: tuple[ChannelLevel, ...]
    whole: bool
    judged: Judgement | None


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """All displayed content after a reading.

    Parameters
    ----------
    runs
        The started runs, by name.
    shown
        The run whose levels and traces are shown; empty before the first.
    grown
        Arrival time of its last samples, monotonic clock.
    plots
        The plots by name.
    averaged, isolated
        Progress of the transfer functions, and state of the ratio of two configurations, in a sentence each.
    advice
        Findings on the current run.
    """

    runs: Mapping[str, ShownRun] = field(default_factory=dict)
    shown: str = ""
    grown: float = 0.0
    plots: Mapping[str, Plot] = field(default_factory=dict)
    averaged: str = f"No average yet: the first needs {1.0 / RESOLUTION:g} seconds of a run with a broad-band drive."
    isolated: str = ""
    advice: tuple[str, ...] = ()


class _Track:
    """Stored data of one run."""

    def __init__(self, run: Run, drive: str) -> None:
        self.started: datetime | None = run.started
        self.levels, self.response = Levels(run), GrowingSpectra(run, drive)
        self.planned = Planned(id=run.id, configuration=run.configuration, gain=run.gain, seconds=0.0, broad=False)
        self.n = self.lost = 0
        self.drawn = (0, 0)
        self.rate = run.sample_rate
        self.whole = False
        self.judged: Judgement | None = None

    @property
    def seconds(self) -> float:
        return (self.n + self.lost) / self.rate

    def shown(self) -> ShownRun:
        return ShownRun(
            planned=self.planned, seconds=self.seconds, lost=self.lost, levels=self.levels.levels(), whole=self.whole,
            judged=self.judged,
        )  # fmt: skip


class Board:
    """Follows a session and creates its displayed content; complete runs are checked here unless the session itself does so."""

    def __init__(self, planned: Sequence[Planned] = (), *, judge: bool) -> None:
        self._planned = {item.id: item for item in planned}
        self._judge = judge
        self._tracks: dict[str, _Track] = {}
        self._picture = Snapshot()
        self._version = 0
        self._rig = wire_bonder()
        self._whole: tuple[Run, ...] = ()

    def see(self, reading: Reading, publish: Callable[[Snapshot], None]) -> None:
        """Process a reading; a picture is published after each new part of a run."""
        self._rig = _rig(reading.campaign)
        self._whole = tuple(run for run in reading.campaign.runs if run.id in reading.whole)
        if not self._tracks:
            self._picture = replace(self._picture, isolated=_missing_ratio(self._rig))
        for run in reading.campaign.runs:
            track = self._tracks.get(run.id)
            if track is None or track.started != run.started or len(run) < track.n:
                for earlier in self._tracks.values():
                    earlier.levels.close()
                track = self._tracks[run.id] = _Track(run, self._rig.drive.channel)
            whole = run.id in reading.whole
            for stop in range(track.n + PART, len(run), PART):
                self._add(track, beginning_of(run, stop), whole=False)
                publish(self._picture)
            if len(run) > track.n or whole > track.whole:
                self._add(track, run, whole=whole)
                publish(self._picture)

    def _add(self, track: _Track, run: Run, *, whole: bool) -> None:
        track.levels.add(run)
        track.response.add(run)
        # Not added to the previous data: a reading that failed halfway may have added some.
        drawn, track.drawn = track.drawn, (track.levels.seen, track.response.segments)
        new, averaged = (now != before for now, before in zip(track.drawn, drawn, strict=True))
        track.n, track.lost = len(run), sum(gap.count for gap in run.gaps)
        # The planned gain; the streamed gain is stored with the samples.
        track.planned = self._planned.get(run.id, track.planned)
        if whole and not track.whole:
            track.whole = True
            track.judged = self._judged(track, run) if self._judge and len(run) <= LONGEST else None
            track.response.close()
        plots = dict(self._picture.plots)
        if new or self._picture.shown != run.id:
            plots["time"] = self._plot(track.levels.recent().keys(), track.levels.trace())
        texts = self._averages(plots, track) if averaged or run.id != self._picture.shown else {}
        self._picture = replace(
            self._picture, runs={name: item.shown() for name, item in self._tracks.items()}, shown=run.id, plots=plots,
            grown=time.monotonic() if new else self._picture.grown, advice=tuple(_advice(track, run, self._rig)), **texts,
        )  # fmt: skip

    def _averages(self, plots: dict[str, Plot], track: _Track) -> dict[str, str]:
        # Adds the plots of averages; the texts about them.
        response, drive, over = self._rig.usual_ratio
        groups = groups_of({name: item.response for name, item in self._tracks.items()}, self._planned, drive)
        texts: dict[str, str] = {}
        here = groups.get((track.response.configuration, track.response.gain))
        if here is not None:
            plots["frf"] = self._plot(*transfer_rows(here))
            texts["averaged"] = here.text(alone=len(self._rig.configurations) == 1)
        ratio = ratio_rows(groups, response, drive, (over[0], over[1])) if len(over) == 2 else None
        if ratio is not None:
            plots["isolation"] = self._plot(*ratio)
            texts["isolated"] = f"|{response} / {drive}|, {over[0]} divided by {over[1]}, at {', '.join(ratio[0])}."
        return texts

    def _plot(self, names: Iterable[str], rows: FloatArray) -> Plot:
        self._version += 1
        return Plot(version=self._version, names=tuple(names), rows=rows.astype(np.float32))

    def _judged(self, track: _Track, run: Run) -> Judgement:
        planned = self._planned.get(run.id)
        asked = len(run) + track.lost if planned is None else round(planned.seconds * run.sample_rate)
        verdict = check_run(
            Recovered(
                id=run.id, finished=len(run) + track.lost >= asked, begun=True, run=run, stored=len(run), lost=track.lost,
                planned=asked, overloads=0, planned_gain=run.gain if planned is None else planned.gain, drift=None,
            ),
            rig=self._rig, others=[other for other in self._whole if other.id != run.id],
        )  # fmt: skip
        return Judgement(good=verdict.good, advice=verdict.advice)


def _rig(campaign: Campaign) -> RigModel:
    try:
        return rig_of(campaign)
    except RigError:
        return wire_bonder()


def _missing_ratio(rig: RigModel) -> str:
    response, drive, over = rig.usual_ratio
    if len(over) < 2:
        return ""
    return f"The ratio |{response} / {drive}| needs one gain measured {over[0]} and {over[1]}."


def _advice(track: _Track, run: Run, rig: RigModel) -> Iterator[str]:
    if track.lost:
        yield f"{track.lost} samples were lost in transmission so far."
    levels = track.levels.levels()
    for level in levels:
        if level.over:
            yield f"{level.name} reached the end of its range; choose a larger range or a lower gain."
    if track.seconds < EARLY:
        return
    inside = {level.name: level.held for level in levels if not level.over}
    yield from advice(inside, {level.name: level.full for level in levels if level.full is not None})
    recent = track.levels.recent()

    def parts(one: str, other: str) -> list[tuple[FloatArray, FloatArray]] | None:
        return [(recent[one], recent[other])] if {one, other} <= set(recent) else None

    sliding = least_sliding(rig, run.configuration, parts)
    if sliding is not None and sliding.share < STICKING:
        yield f"{sliding.text}: friction is not overcome now. Measure a run at a higher gain as well."
