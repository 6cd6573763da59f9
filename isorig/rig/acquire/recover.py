"""Reads a working file: the data of each planned run, for a finished, a running or a killed session."""

import struct
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.lib.recfunctions import unstructured_to_structured
from numpy.typing import NDArray

from isorig.analysis.campaign import Campaign, Channel, Gap, Run, Samples
from isorig.drivers.block import Status
from isorig.rig.acquire.journal import JournalBlock, Reader
from isorig.rig.acquire.layout import (
    SAMPLES,
    TIMING,
    BlockKind,
    Layout,
    LogLayout,
    RunBegin,
    RunEnd,
    RunLayout,
    log_of,
    samples_of,
)
from isorig.rig.acquire.pace import ClockDrift, Pace
from isorig.rig.acquire.policy import RATE_REPORTED
from isorig.rig.acquire.recorder import working_file
from isorig.rig.errors import RecordingError
from isorig.rig.files.recording import open_recording

T = TypeVar("T")
#: Index entry of each block of samples: its number, its offset, its first tick, its size.
ENTRY = np.dtype([(name, "<i8") for name in ("number", "place", "first", "rows", "blocks")])
PACKED = struct.Struct("<5q")


class Saved:
    """A sequence stored in the blocks of a file and read by slice: `counts` items at the offsets `places`, shape (blocks,)."""

    def __init__(self, reader: Reader, counts: NDArray[np.int64], places: NDArray[np.int64], dtype: np.dtype[Any]) -> None:
        self._reader, self._ends, self._places, self._dtype = reader, np.cumsum(counts), places, dtype
        self.shape = (int(self._ends[-1]) if len(counts) else 0,)

    def __getitem__(self, key: slice, /) -> NDArray[Any]:
        start, stop, step = key.indices(self.shape[0])
        if step != 1:
            return self[:][key]
        items, size = np.empty(max(stop - start, 0), self._dtype), self._dtype.itemsize
        done, k = start, int(np.searchsorted(self._ends, start, side="right"))
        while done < stop:
            begin = int(self._ends[k - 1]) if k else 0
            upto = min(int(self._ends[k]), stop)
            part = self._reader.read(int(self._places[k]) + (done - begin) * size, (upto - done) * size)
            items[done - start : upto - start] = np.frombuffer(part, self._dtype)
            done, k = upto, k + 1
        return items


class _Steps:
    """A value that changes at some of the samples: `changes` has the index of the first sample of each value, and the value."""

    def __init__(self, changes: Sequence[tuple[int, float]], samples: int) -> None:
        self._starts, self._values = (np.array(column) for column in zip(*changes, strict=True))
        self._starts[0] = 0
        self.shape = (samples,)

    def __getitem__(self, key: slice, /) -> NDArray[np.float64]:
        at = np.arange(*key.indices(self.shape[0]))
        return np.asarray(self._values[np.searchsorted(self._starts, at, side="right") - 1], np.float64)

    def median(self) -> float:
        """Median over all samples."""
        order = np.argsort(self._values)
        passed = np.cumsum(np.diff(self._starts, append=self.shape[0])[order])
        return float(self._values[order][np.searchsorted(passed, passed[-1] / 2)])


@dataclass(frozen=True, kw_only=True)
class Recovered:
    """The measured part of a planned run."""

    id: str
    planned_gain: float  #: The gain in the plan; the run has the streamed one.
    finished: bool = False  #: Whether it is complete.
    begun: bool = False  #: Whether it was started.
    run: Run | None = None  #: Its samples, read from the open file on demand; None if there are none.
    #: Ticks in the plan, ticks in the file, ticks lost.
    planned: int
    stored: int = 0
    lost: int = 0
    damaged: int = 0  #: The part of `lost` that may have been stored in blocks that are damaged now.
    overloads: int = 0  #: Number of blocks with an overload.
    drift: ClockDrift | None = None  #: Of the instrument's clock relative to the host's; None if it cannot be estimated.
    timing: Samples | None = None  #: Arrival time and status of each block of the instrument, as `TIMING`; None if not stored.
    sensors: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  #: Description of each channel's sensor.
    #: Rows of the loggers that ran along, shape (rows,), with the fields time (s since the first sample, by the host's clock) and
    #: channels.
    logs: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    log_layouts: Mapping[str, LogLayout] = field(default_factory=dict)  #: Rate and units of these loggers.

    @property
    def text(self) -> str:
        """Saved and lost samples, in a sentence."""
        if not self.begun:
            return f"{self.id}: not started."
        lost = f", {self.lost} lost in transmission" if self.lost else ", none lost"
        if self.damaged:
            lost = f", {self.lost} lost, up to {self.damaged} of them in damaged parts of the file"
        if self.drift is not None and self.drift.beyond(RATE_REPORTED):
            lost += f"; by the host's clock its sample rate deviates by {self.drift.percent}"
        if self.finished:
            return f"{self.id}: complete, {self.stored} samples saved{lost}."
        return f"{self.id}: incomplete, {self.stored} of {self.planned} samples saved{lost}."


class _StartedRun:
    """A started run: index of its blocks, and sums over their status."""

    def __init__(self, run: int, rate: float) -> None:
        self.run, self.pace = run, Pace(rate)
        self.begin: tuple[int, RunBegin] | None = None
        self.end: tuple[int, RunEnd] | None = None
        self.overloads = self.stored = 0
        self.next = 0
        # The streamed gain where it changes, with the number of samples before.
        self.gains: list[tuple[int, float]] = []
        self.logs: dict[str, list[NDArray[np.float64]]] = {}
        # Numbers of the blocks with rows of loggers, between those with samples.
        self.logged: list[int] = []
        self._index = bytearray()

    @property
    def entries(self) -> NDArray[Any]:
        """Its blocks, in the order of their ticks."""
        return np.frombuffer(bytes(self._index), ENTRY)

    def add(self, block: JournalBlock, first: int, rows: int, timing: NDArray[Any]) -> None:
        """Add a block of samples to the index; one that goes back in time is omitted."""
        if first < self.next:
            return
        known = timing[np.isfinite(timing["gain"])]
        changed = known[np.diff(known["gain"], prepend=self.gains[-1][1] if self.gains else np.nan) != 0.0]
        self.gains += zip(
            (self.stored + np.clip(changed["tick"] - first, 0, rows)).tolist(), changed["gain"].tolist(), strict=True
        )
        self._index += PACKED.pack(block.number, block.place, first, rows, len(timing))
        self.next = first + rows
        self.stored += rows
        self.overloads += int((timing["status"] & Status.OVERLOAD).astype(bool).sum())
        sound = np.isfinite(timing["host_time"])
        ends = np.append(timing["tick"], self.next)[1:]
        self.pace.add(ends[sound], timing["host_time"][sound])


class WorkingFileReader:
    """A working file that is finished, being written, or was left by a killed session. Raises RecordingError if the file is not a
    working file."""

    def __init__(self, path: Path) -> None:
        self._reader = Reader(path)
        self._takes: dict[int, _StartedRun] = {}
        try:
            # The first block contains the layout; if it is damaged, the start of a run has a copy.
            layout = next(filter(None, map(_layout, self._reader.blocks())), None)
            if layout is None:
                raise RecordingError(
                    f"{path} is not a session's working file; give one that ends in .partial, or rig check a finished recording"
                )
            self._layout = layout
            self._reader.rewind()
            self.refresh()
        except BaseException:
            self.close()
            raise

    @property
    def known(self) -> dict[str, float | str]:
        """The known values of the rig."""
        return self._layout.known

    @property
    def replaced(self) -> bool:
        """Whether its path now belongs to another file, or to none."""
        return self._reader.replaced()

    def refresh(self) -> None:
        """Read what was written since the last time."""
        layout = self._layout
        for block in self._reader.blocks():
            if block.kind == BlockKind.LAYOUT:
                continue
            if block.take not in self._takes:
                self._takes[block.take] = _StartedRun(block.run, layout.sample_rate)
            take = self._takes[block.take]
            if take.run != block.run:
                # Blocks of one take are of one run; what names another one is not filed, and counts as damaged.
                continue
            if block.kind == BlockKind.BEGIN and (begin := _decoded(block, RunBegin)) is not None:
                take.begin = block.number, begin
                take.pace = Pace(begin.sample_rate)
            elif block.kind == BlockKind.END and (end := _decoded(block, RunEnd)) is not None:
                take.end = block.number, end
            elif block.kind == BlockKind.LOG and (logged := log_of(layout, block.content)) is not None:
                take.logs.setdefault(logged[0], []).append(logged[1])
                take.logged.append(block.number)
            elif block.kind == BlockKind.SAMPLES and (samples := samples_of(layout, block.content)) is not None:
                take.add(block, *samples)

    def runs(self) -> list[Recovered]:
        """The measured part of every planned run, in the plan's order."""
        return [self._recovered(k) for k in range(len(self._layout.runs))]

    def run(self, name: str) -> Recovered:
        """The run with that id, after a `refresh`."""
        self.refresh()
        return self._recovered(next(k for k, run in enumerate(self._layout.runs) if run.id == name))

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def _recovered(self, k: int) -> Recovered:
        planned = self._layout.runs[k]
        takes = [take for take in self._takes.values() if take.run == k]
        if not takes:
            return Recovered(id=planned.id, planned=planned.planned, planned_gain=planned.gain)
        # Of a repeated run, the last complete take; if there is none, the longest.
        best = next((take for take in reversed(takes) if _finished(take)), max(takes, key=lambda take: take.stored))
        gaps, damaged = _gaps(best)
        return Recovered(
            id=planned.id, finished=_finished(best), begun=True,
            run=self._measured(planned, best, gaps) if best.stored else None,
            stored=best.stored, lost=sum(gap.count for gap in gaps), damaged=damaged, planned=planned.planned,
            overloads=best.overloads, planned_gain=planned.gain, timing=self._timing(best),
            drift=best.pace.drift() if self._layout.real_time else None,
            sensors={name: channel.description for name, channel in self._layout.channels.items()},
            logs=self._logs(best), log_layouts=self._layout.logs,
        )  # fmt: skip

    def _logs(self, take: _StartedRun) -> dict[str, NDArray[Any]]:
        if not take.stored:
            return {}
        # A simulated instrument that is faster than real time has sent its first samples at its beginning.
        began = take.pace.began if self._layout.real_time else None
        began = float(self._timing(take)[:1]["host_time"][0]) if began is None else began
        tables = {}
        for name, parts in take.logs.items():
            rows = np.concatenate(parts)
            rows = rows[np.argsort(rows[:, 0], kind="stable")]
            fields = [("time", "<f8"), *((channel, "<f8") for channel in self._layout.logs[name].units)]
            rows[:, 0] -= began
            tables[name] = unstructured_to_structured(rows, np.dtype(fields))
        return tables

    def _measured(self, planned: RunLayout, take: _StartedRun, gaps: tuple[Gap, ...]) -> Run:
        channels = {}
        entries = take.entries
        offset = SAMPLES.size + TIMING.itemsize * entries["blocks"]
        for name, about in self._layout.channels.items():
            channels[name] = Channel(
                name=name, samples=Saved(self._reader, entries["rows"], entries["place"] + offset, about.stored),
                quantity=about.quantity, unit=about.unit, scale=about.scale, offset=about.offset,  # type: ignore[arg-type]
                full_scale=about.full_scale,
            )  # fmt: skip
            offset = offset + entries["rows"] * about.stored.itemsize
        gain = planned.gain
        if take.gains:
            streamed = _Steps(take.gains, take.stored)
            gain = streamed.median()
            channels["gain"] = Channel(name="gain", samples=streamed, quantity="gain", unit="1")
        begin = None if take.begin is None else take.begin[1]
        rate = self._layout.sample_rate if begin is None else begin.sample_rate
        return Run(
            id=planned.id, configuration=planned.configuration, sample_rate=rate, gain=gain, channels=channels,
            excitation=planned.excitation, use=planned.use, band=planned.band, repeat_of=planned.repeat_of, gaps=gaps,
            started=None if begin is None else datetime.fromtimestamp(begin.started_ns / 1e9, UTC),
            period=None if begin is None else begin.period,
            # An instrument's own rate may be slightly below the planned one.
            usable_to=None if self._layout.usable_to is None else min(self._layout.usable_to, rate / 2.0),
        )  # fmt: skip

    def _timing(self, take: _StartedRun) -> Saved:
        entries = take.entries
        return Saved(self._reader, entries["blocks"], entries["place"] + SAMPLES.size, TIMING)


def _finished(take: _StartedRun) -> bool:
    return take.end is not None and take.end[1].whole


def _gaps(take: _StartedRun) -> tuple[tuple[Gap, ...], int]:
    # Ticks in no block, and how many may have been stored: the numbers of the adjacent blocks are not consecutive.
    entries = take.entries
    if not len(entries):
        return (), 0
    begin = -1 if take.begin is None else take.begin[0]
    ends = entries["first"] + entries["rows"]
    last = ends[-1], entries["number"][-1]
    counted, closed = last if take.end is None else (max(take.end[1].counted, last[0]), take.end[0])
    begins = np.concatenate([[0], ends])
    counts = np.concatenate([entries["first"], [counted]]) - begins
    numbers = np.concatenate([[begin], entries["number"], [closed]])
    torn = np.diff(numbers - np.searchsorted(take.logged, numbers)) > 1
    gaps = tuple(Gap(first_tick=int(begins[k]), count=int(counts[k])) for k in np.flatnonzero(counts))
    return gaps, int(counts[torn].sum())


def _layout(block: JournalBlock) -> Layout | None:
    if block.kind == BlockKind.LAYOUT:
        return _decoded(block, Layout)
    begin = _decoded(block, RunBegin) if block.kind == BlockKind.BEGIN else None
    return None if begin is None else begin.layout


def _decoded(block: JournalBlock, kind: type[T]) -> T | None:
    try:
        return msgspec.json.decode(block.content, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return None


@contextmanager
def working(path: Path) -> Iterator[tuple[dict[str, float | str], list[Recovered]]]:
    """The known values of the rig, and every planned run, from a working file: finished, being written, or left by a killed
    session. Raises RecordingError if the file is not a working file."""
    with closing(WorkingFileReader(path)) as file:
        yield file.known, file.runs()


def campaign_of(known: Mapping[str, float | str], runs: Sequence[Run], source: str) -> Campaign:
    """The campaign of these runs, in the order of their measurement. Raises RecordingError if there is no run."""
    if not runs:
        raise RecordingError(f"{source} contains no sample; there is nothing to recover, so acquire again")
    description = known.get("description")
    return Campaign(
        runs=tuple(sorted(runs, key=lambda run: run.started or datetime.max.replace(tzinfo=UTC))),
        known={key: value for key, value in known.items() if not isinstance(value, str)},
        description=description if isinstance(description, str) else None, source=source,
    )  # fmt: skip


def follow(output: Path, *, every: float = 1.0, shortest: float = 0.0, patience: float = 30.0) -> Iterator[tuple[Campaign, bool]]:
    """The campaign that a session is writing, each time it has grown, and whether it is the finished recording (the last one).

    The writer is not delayed and may be another process. Read each campaign before requesting the next. `every` are the seconds
    between two readings; runs shorter than the seconds `shortest` are omitted until the recording is finished. Raises
    RecordingError if no session is writing there, or the writer has stopped without finishing: no new sample came for `patience`
    seconds.
    """
    partial = working_file(output)
    file: WorkingFileReader | None = None
    size, grown = 0, time.monotonic()
    try:
        while partial.exists():
            # It may be about to be created, or has just become the recording.
            with suppress(RecordingError):
                file = _opened(file, partial)
                runs = [item.run for item in file.runs() if item.run is not None]
                if (now := sum(len(run) for run in runs)) > size:
                    size, grown = now, time.monotonic()
                    kept = [run for run in runs if run.duration >= shortest]
                    if kept:
                        yield campaign_of(file.known, kept, str(partial)), False
            if time.monotonic() - grown > patience:
                raise RecordingError(f"{partial} has not grown for {patience:g} s; its writer has ended, so use rig recover")
            time.sleep(every)
    finally:
        if file is not None:
            file.close()
    with open_recording(output) as campaign:
        yield campaign, True


def _opened(file: WorkingFileReader | None, partial: Path) -> WorkingFileReader:
    # Blocks are read only once.
    if file is None or file.replaced:
        if file is not None:
            file.close()
        return WorkingFileReader(partial)
    file.refresh()
    return file
