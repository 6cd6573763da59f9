"""Writes blocks from an instrument to disk: a bounded queue, a writer thread, a count of lost samples.

The working file is a log (`journal`): written data are never changed, so a kill loses only what was still in memory, and a power
loss only what came after the last sync. Samples are raw integers with a scale.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.drivers.block import Block, Input, Status
from isorig.rig.acquire.journal import LONGEST, SYNC, Journal
from isorig.rig.acquire.layout import BlockKind, Layout, RunBegin, RunEnd, layout_of, pack, pack_log
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.policy import SESSION_WAITS, SessionWaits
from isorig.rig.errors import OutputError
from isorig.rig.files.output import reason, replaced

#: Seconds that are collected and then written at once.
GATHER = 0.1
#: Bytes that must remain free on the disk: below this the session ends while the file can still be closed.
RESERVE = 16 << 20
#: Bytes of samples in a block of the log: the maximum loss due to a damaged block.
BLOCK = 1 << 20


def working_file(output: Path) -> Path:
    """Path of the working file of a session."""
    return output.with_name(output.name + ".partial")


@contextmanager
def recording_into(
    path: Path, plan: Plan, inputs: Sequence[Input], *, sync: float = SYNC, after: datetime | None = None, real_time: bool = True
) -> Iterator[WorkingFileWriter]:
    """Create the working file, with the layout of all data to be written, and open it for writing.

    It is synced every `sync` seconds, with 0 after every block. No run here starts before `after`, the end time of the runs of an
    earlier part of the session, even if the host's clock was set back. Raises OutputError if the file cannot be written.
    """
    layout = layout_of(plan, inputs, real_time=real_time)
    content = msgspec.json.encode(layout)
    if len(content) > LONGEST:
        raise OutputError(f"the plan has {len(plan.runs)} runs, more than {path} can hold; split it into several plans")
    with replaced(path) as temporary:
        try:
            Journal.create(temporary, BlockKind.LAYOUT, content)
        except OSError as error:
            raise OutputError(f"{path} cannot be written ({reason(error)}); choose another place with -o") from None
    with closing(WorkingFileWriter(Journal(path, sync=sync), layout, after=after)) as file:
        yield file


class WorkingFileWriter:
    """The working file of a running session: runs are written into it in sequence."""

    def __init__(self, journal: Journal, layout: Layout, *, after: datetime | None) -> None:
        self.journal, self.layout = journal, layout
        self._takes = 0
        # Start times identify runs: within a session they come from a monotonic clock.
        self._opened_ns = max(time.time_ns(), 0 if after is None else round(after.timestamp() * 1e9))
        self._ticking_ns = time.monotonic_ns()

    def begin(self, run_id: str, period: int | None) -> tuple[int, int]:
        """Start a run, or repeat it; returns its index in the plan, and the number of runs started before. Raises OSError if the
        disk refuses."""
        run = next(k for k, planned in enumerate(self.layout.runs) if planned.id == run_id)
        take, self._takes = self._takes, self._takes + 1
        started = self._opened_ns + time.monotonic_ns() - self._ticking_ns
        begin = RunBegin(started_ns=started, period=period, sample_rate=self.layout.sample_rate, layout=self.layout)
        self.journal.append(BlockKind.BEGIN, run, take, msgspec.json.encode(begin))
        self.journal.sync()
        return run, take

    def close(self) -> None:
        """Sync and close the file. Raises OutputError if the disk refuses."""
        try:
            self.journal.close()
        except OSError as error:
            raise OutputError(f"{self.journal.path} cannot be written any more ({reason(error)})") from None


@dataclass
class Tally:
    """Totals of a run so far: ticks stored, ticks lost, blocks with an overload."""

    stored: int = 0
    lost: int = 0
    overloads: int = 0


class BlockQueue:
    """Blocks between two threads: one puts them, another takes all of them; at most `most` samples wait, in any blocks."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._blocks: deque[Block] = deque()
        self._samples = 0
        self._ended = False
        self._changed = threading.Condition()

    def put(self, block: Block, timeout: float) -> bool:
        """Add a block; False if there was no room within `timeout` seconds."""
        with self._changed:
            room = self._changed.wait_for(lambda: self._samples < self._most, timeout)
            if room:
                self._blocks.append(block)
                self._samples += len(block.samples)
                if len(self._blocks) == 1 or self._samples > self._most // 2:
                    self._changed.notify_all()
            return room

    def get_all(self, gather: float) -> list[Block] | None:
        """All blocks that arrived within `gather` seconds, earlier if the queue is half full; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._blocks or self._ended)
            self._changed.wait_for(lambda: self._samples > self._most // 2 or self._ended, gather)
            blocks, self._samples = list(self._blocks), 0
            self._blocks.clear()
            self._changed.notify_all()
            return blocks or None

    def end(self) -> None:
        """Declare that nothing more will be added."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()


class RunWriter:
    """Writes one run to the working file from a separate thread; its methods raise OutputError if the disk refuses or is stuck.

    A periodic drive has a `period` in samples.
    """

    def __init__(self, file: WorkingFileWriter, run_id: str, *, period: int | None, waits: SessionWaits = SESSION_WAITS) -> None:
        self._file, self._patience = file, waits.disk
        self._waiting = BlockQueue(int(waits.queue * file.layout.sample_rate) + 1)
        self.tally = Tally()
        self.error: OSError | None = None
        self._next = 0
        self._logged: deque[tuple[int, FloatArray]] = deque()
        try:
            self._run, self._take = file.begin(run_id, period)
        except OSError as error:
            self.error = error
            raise self._refused() from None
        self._planned = file.layout.runs[self._run].planned
        self._thread = threading.Thread(target=self._work, name=f"writer of {run_id}", daemon=True)
        self._thread.start()

    def put(self, block: Block) -> None:
        """Add a block; waits if the disk is too far behind, so that the instrument's buffers fill before anything is lost."""
        if not self._waiting.put(block, self._patience):
            raise OutputError(f"the disk has not written for {self._patience:g} s; record to another disk")
        if self.error is not None:
            raise self._refused()

    def log(self, number: int, rows: FloatArray) -> None:
        """Add rows of a logger; may be called from several threads."""
        self._logged.append((number, rows))

    def finish(self, counted: int | None, *, whole: bool = True, enough: bool = False) -> Tally:
        """Write the waiting blocks and close the run; ticks that the instrument counted but did not send are lost.

        The run is complete if nothing interrupted it and all planned ticks are stored or counted as lost, or `enough` of them.
        """
        self._waiting.end()
        self._thread.join()
        if self.error is None:
            self._account(self._next if counted is None else max(counted, self._next))
            end = RunEnd(whole=whole and (enough or self._next >= self._planned), counted=self._next)
            try:
                self._store_logs()
                self._file.journal.append(BlockKind.END, self._run, self._take, msgspec.json.encode(end))
                self._file.journal.sync()
                self._in_place()
            except OSError as error:
                self.error = error
        if self.error is not None and whole:
            raise self._refused()
        return self.tally

    def _refused(self) -> OutputError:
        assert self.error is not None
        return OutputError(
            f"the recording cannot be written any more ({reason(self.error)}); make room, then continue with --resume"
        )

    def _work(self) -> None:
        while (blocks := self._waiting.get_all(GATHER)) is not None:
            if self.error is not None:
                continue
            try:
                self._store(blocks)
                self._store_logs()
                self._check_disk()
            except OSError as error:
                self.error = error

    def _check_disk(self) -> None:
        # Other programs may remove the file, or fill the disk.
        self._in_place()
        folder = self._file.journal.path.parent
        if shutil.disk_usage(folder).free < RESERVE:
            raise OSError(f"less than {RESERVE >> 20} MiB are free in {folder}")

    def _in_place(self) -> None:
        journal = self._file.journal
        if journal.put_back():
            raise OSError(f"its working file was removed by another program; the measured data are in {journal.path} again")

    def _store(self, blocks: Sequence[Block]) -> None:
        # Duplicates are dropped, missing samples are counted; stretches without a gap are written at once.
        whole: list[np.ndarray] = []
        rows: list[tuple[int, float, float, float, int]] = []
        begin = waiting = 0
        for block in blocks:
            samples = block.samples[max(self._next - block.first_tick, 0) :]
            if not len(samples):
                continue
            first = max(block.first_tick, self._next)
            if first > self._next or waiting >= BLOCK:
                self._append(begin, rows, whole)
                whole, rows, waiting = [], [], 0
                self._account(first)
            if not whole:
                begin = first
            whole.append(samples)
            waiting += samples.nbytes
            self._next = first + len(samples)
            self.tally.overloads += int(bool(block.status & Status.OVERLOAD))
            device = np.nan if block.device_time is None else block.device_time
            gain = np.nan if block.gain is None else block.gain
            rows.append((first, block.host_time, device, gain, int(block.status)))
        self._append(begin, rows, whole)

    def _store_logs(self) -> None:
        while self._logged:
            self._file.journal.append(BlockKind.LOG, self._run, self._take, pack_log(*self._logged.popleft()))

    def _append(self, first: int, rows: Sequence[tuple[int, float, float, float, int]], parts: Sequence[np.ndarray]) -> None:
        if not parts:
            return
        samples = parts[0] if len(parts) == 1 else np.concatenate(parts)
        # A block of the instrument may be longer than a block of the log.
        most = max(LONGEST // 2 // max(self._file.layout.row, 1), 1)
        for start in range(0, len(samples), most):
            part = samples[start : start + most]
            content = pack(self._file.layout, first + start, rows if start == 0 else [], part)
            try:
                self._file.journal.append(BlockKind.SAMPLES, self._run, self._take, content)
            except OSError:
                if start > 0 or len(parts) == 1:
                    raise
                # The disk may take some of these blocks.
                half = len(parts) // 2
                self._append(first, rows[:half], parts[:half])
                self._append(first + sum(map(len, parts[:half])), rows[half:], parts[half:])
                return
            self.tally.stored += len(part)

    def _account(self, tick: int) -> None:
        # The gap itself is found from the ticks of the next block, or from the count at the end.
        self.tally.lost += tick - self._next
        self._next = tick
