"""The displayed content of a session: a picture created at each reading, from samples that are read once."""

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
from isorig.rig.view.messages import Judgement, Planned
from isorig.rig.view.running_frfs import RESOLUTION, GrowingSpectra, groups_of, ratio_rows, transfer_rows
from isorig.rig.view.sources import Reading, beginning_of
from isorig.rig.wire_bonder.description import wire_bonder

#: Minimum duration of a run, seconds, before advice on its levels.
EARLY = 2.0
#: Number of samples between two pictures; number of samples above which a run is not read as a whole, because of memory.
PART, LONGEST = 1 << 20, 1 << 24


class Plot(msgspec.Struct, frozen=True, kw_only=True):
    """Rows of numbers to plot, the first along x, and the names of the columns."""

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
    """All displayed content after a reading: the started runs, and the plots, by name, and findings on the current run.

    `shown` is the run whose levels and traces are shown (empty before the first), and `grown` the arrival time of its last
    samples on the monotonic clock. `averaged` and `isolated` are sentences on the progress of the transfer functions, and on the
    ratio of two configurations.
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
        self.n, self.drawn = 0, (0, 0)
        planned = Planned(id=run.id, configuration=run.configuration, gain=run.gain, seconds=0.0, broad=False)
        self.shown = ShownRun(planned=planned, seconds=0.0, lost=0, levels=(), whole=False, judged=None)


class SnapshotBuilder:
    """Follows a session and creates its displayed content; complete runs are checked here unless the session itself does so."""

    def __init__(self, planned: Sequence[Planned] = (), *, judge: bool) -> None:
        self._planned = {item.id: item for item in planned}
        self._judge = judge
        self._tracks: dict[str, _Track] = {}
        self._picture = Snapshot()
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
            if len(run) > track.n or whole > track.shown.whole:
                self._add(track, run, whole=whole)
                publish(self._picture)

    def _add(self, track: _Track, run: Run, *, whole: bool) -> None:
        track.levels.add(run)
        track.response.add(run)
        # Not added to the previous data: a reading that failed halfway may have added some.
        drawn, track.drawn = track.drawn, (track.levels.seen, track.response.segments)
        new, averaged = (now != before for now, before in zip(track.drawn, drawn, strict=True))
        track.n, lost = len(run), sum(gap.count for gap in run.gaps)
        judged = track.shown.judged
        if whole and not track.shown.whole:
            judged = self._judged(run, lost) if self._judge and len(run) <= LONGEST else None
            track.response.close()
        track.shown = ShownRun(
            # The planned gain; the streamed gain is stored with the samples.
            planned=self._planned.get(run.id, track.shown.planned), seconds=(len(run) + lost) / run.sample_rate, lost=lost,
            levels=track.levels.levels() if new or not track.shown.levels else track.shown.levels,
            whole=whole or track.shown.whole, judged=judged,
        )  # fmt: skip
        plots = dict(self._picture.plots)
        if new or self._picture.shown != run.id:
            plots["time"] = _plot(track.levels.recent(), track.levels.trace())
        texts = self._averages(plots, track) if averaged or run.id != self._picture.shown else {}
        self._picture = replace(
            self._picture, runs={name: item.shown for name, item in self._tracks.items()}, shown=run.id, plots=plots,
            grown=time.monotonic() if new else self._picture.grown, advice=tuple(_advice(track, run, self._rig)), **texts,
        )  # fmt: skip

    def _averages(self, plots: dict[str, Plot], track: _Track) -> dict[str, str]:
        # Adds the plots of averages; the texts about them.
        response, drive, over = self._rig.usual_ratio
        groups = groups_of({name: item.response for name, item in self._tracks.items()}, self._planned, drive)
        texts: dict[str, str] = {}
        here = groups.get((track.response.configuration, track.response.gain))
        if here is not None:
            plots["frf"] = _plot(*transfer_rows(here))
            texts["averaged"] = here.text(alone=len(self._rig.configurations) == 1)
        ratio = ratio_rows(groups, response, drive, (over[0], over[1])) if len(over) == 2 else None
        if ratio is not None:
            plots["isolation"] = _plot(*ratio)
            texts["isolated"] = f"|{response} / {drive}|, {over[0]} divided by {over[1]}, at {', '.join(ratio[0])}."
        return texts

    def _judged(self, run: Run, lost: int) -> Judgement:
        planned = self._planned.get(run.id)
        asked = len(run) + lost if planned is None else round(planned.seconds * run.sample_rate)
        verdict = check_run(
            Recovered(
                id=run.id, finished=len(run) + lost >= asked, begun=True, run=run, stored=len(run), lost=lost,
                planned=asked, overloads=0, planned_gain=run.gain if planned is None else planned.gain, drift=None,
            ),
            rig=self._rig, others=[other for other in self._whole if other.id != run.id],
        )  # fmt: skip
        return Judgement(good=verdict.good, advice=verdict.advice)


def _plot(names: Iterable[str], rows: FloatArray) -> Plot:
    return Plot(names=tuple(names), rows=rows.astype(np.float32))


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
    if track.shown.lost:
        yield f"{track.shown.lost} samples were lost in transmission so far."
    levels = track.shown.levels
    for level in levels:
        if level.over:
            yield f"{level.name} reached the end of its range; choose a larger range or a lower gain."
    if track.shown.seconds < EARLY:
        return
    inside = {level.name: level.held for level in levels if not level.over}
    yield from advice(inside, {level.name: level.full for level in levels if level.full is not None})
    recent = track.levels.recent()

    def parts(one: str, other: str) -> list[tuple[FloatArray, FloatArray]] | None:
        return [(recent[one], recent[other])] if {one, other} <= set(recent) else None

    sliding = least_sliding(rig, run.configuration, parts)
    if sliding is not None and sliding.share < STICKING:
        yield f"{sliding.text}: friction is not overcome now. Measure a run at a higher gain as well."
