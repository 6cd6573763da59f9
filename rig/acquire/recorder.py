"""Blocks from an instrument onto disk: a bounded queue, a writer behind it, a ledger of what was lost.

The working file is a log (`journal`): what was written once is never touched again, so a kill takes no more than was
still in memory, and a power loss no more than came after the last sync. Samples are raw integers with their scale.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import msgspec
import numpy as np

from isorig.drivers.block import Block, Input
from isorig.rig.acquire.block_queue import Waiting
from isorig.rig.acquire.journal import LONGEST, SYNC, Journal
from isorig.rig.acquire.layout import TIMING, Begin, End, Kind, Layout, layout_of, pack
from isorig.rig.acquire.plan import Plan
from isorig.rig.errors import OutputError
from isorig.rig.files.output import reason, replaced

#: Seconds of samples that may wait for a slow disk, and seconds that are gathered and then written at once.
QUEUE_SECONDS = 5.0
GATHER = 0.1
#: Seconds without progress after which the disk counts as stuck.
STUCK = 10.0
#: Bytes that must stay free on the disk: where fewer are left the session ends while the file can still be closed.
RESERVE = 16 << 20
#: Bytes of samples in a block of the log: what a damaged block costs at most.
BLOCK = 1 << 20


def working_file(output: Path) -> Path:
    """Where a session writes while it lasts."""
    return output.with_name(output.name + ".partial")


def lay_out(path: Path, plan: Plan, inputs: Sequence[Input]) -> None:
    """Create the working file, with the layout of all that will be written.

    Raises
    ------
    OutputError
        Where the place cannot be written.
    """
    layout = msgspec.json.encode(layout_of(plan, inputs))
    if len(layout) > LONGEST:
        raise OutputError(f"the plan has {len(plan.runs)} runs, more than {path} can hold; split it into several plans")
    with replaced(path) as temporary:
        try:
            Journal.create(temporary, Kind.LAYOUT, layout)
        except OSError as error:
            raise OutputError(f"{path} cannot be written ({reason(error)}); choose another place with -o") from None


@contextmanager
def recording_into(
    path: Path, plan: Plan, inputs: Sequence[Input], *, sync: float = SYNC, after: datetime | None = None
) -> Iterator[WorkingFile]:
    """The working file that `lay_out` has made, open for writing.

    Parameters
    ----------
    path
        Where it is.
    plan, inputs
        With what it was laid out.
    sync
        Seconds between two syncs; 0 syncs every block.
    after
        When the runs of an earlier part of the session had ended; none here begins before that, even where this machine's
        clock was set back meanwhile.

    Raises
    ------
    OutputError
        Where the file cannot be written.
    """
    file = WorkingFile(Journal(path, sync=sync), layout_of(plan, inputs), after=after)
    try:
        yield file
    finally:
        file.close()


class WorkingFile:
    """The working file of a session that lasts: runs are written into it one after the other."""

    def __init__(self, journal: Journal, layout: Layout, *, after: datetime | None = None) -> None:
        self.journal, self.layout = journal, layout
        self._takes = 0
        # Runs are told apart by when they began: within a session by a clock that nobody sets.
        self._opened_ns = max(time.time_ns(), 0 if after is None else round(after.timestamp() * 1e9))
        self._ticking_ns = time.monotonic_ns()

    def begin(self, run_id: str, *, sample_rate: float, period: int | None) -> tuple[int, int]:
        """Begin a run, once more where it was taken before; its place in the plan, and how many were begun before it.

        Raises
        ------
        OSError
            Where the disk refuses.
        """
        run = next(k for k, planned in enumerate(self.layout.runs) if planned.id == run_id)
        take, self._takes = self._takes, self._takes + 1
        started = self._opened_ns + time.monotonic_ns() - self._ticking_ns
        begin = Begin(started_ns=started, period=period, sample_rate=sample_rate, layout=self.layout)
        self.journal.append(Kind.BEGIN, run, take, msgspec.json.encode(begin))
        self.journal.sync()
        return run, take

    def close(self) -> None:
        """Sync and let go of the file.

        Raises
        ------
        OutputError
            Where the disk refuses.
        """
        try:
            self.journal.close()
        except OSError as error:
            raise OutputError(f"{self.journal.path} cannot be written any more ({reason(error)})") from None


@dataclass
class Tally:
    """What a run came to so far: ticks stored, ticks lost, blocks that came with an overload."""

    stored: int = 0
    lost: int = 0
    overloads: int = 0


class RunWriter:
    """Writes one run of the working file from a thread of its own.

    Parameters
    ----------
    file
        The working file.
    run_id
        Which run.
    columns
        The input of each channel, by channel name.
    sample_rate
        Hz; sets the length of the queue.
    period
        Samples per period of a periodic drive.

    Raises
    ------
    OutputError
        Where the disk refuses to write.
    """

    def __init__(
        self,
        file: WorkingFile,
        run_id: str,
        columns: Mapping[str, int],
        *,
        sample_rate: float,
        period: int | None,
    ) -> None:
        self._file = file
        self._columns = [columns[name] for name in file.layout.channels]
        self._waiting = Waiting(int(QUEUE_SECONDS * sample_rate) + 1)
        self.tally = Tally()
        self.error: OSError | None = None
        self._next = 0
        try:
            self._run, self._take = file.begin(run_id, sample_rate=sample_rate, period=period)
        except OSError as error:
            self.error = error
            raise self._refused() from None
        self._planned = file.layout.runs[self._run].planned
        self._thread = threading.Thread(target=self._work, name=f"writer of {run_id}", daemon=True)
        self._thread.start()

    def put(self, block: Block) -> None:
        """Hand over a block; waits where the disk is too far behind, so that the wire's own buffers fill before anything is lost.

        Raises
        ------
        OutputError
            Where the disk refused to write, or has been stuck for long.
        """
        if not self._waiting.put(block, STUCK):
            raise OutputError(f"the disk has not written for {STUCK:g} s; record to another place")
        if self.error is not None:
            raise self._refused()

    def finish(self, counted: int | None, *, whole: bool = True) -> Tally:
        """Write what is waiting and close the run; ticks that the instrument counted and never sent are lost.

        The run is done where nothing ended it and all ticks that were planned are accounted for.

        Raises
        ------
        OutputError
            Where the disk refuses.
        """
        self._waiting.end()
        self._thread.join()
        if self.error is None:
            self._account(self._next if counted is None else max(counted, self._next))
            end = End(whole=whole and self._next >= self._planned, counted=self._next)
            try:
                self._file.journal.append(Kind.END, self._run, self._take, msgspec.json.encode(end))
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
            f"the recording cannot be written any more ({reason(self.error)}); make room, then go on with --resume"
        )

    def _work(self) -> None:
        while (blocks := self._waiting.take(GATHER)) is not None:
            if self.error is not None:
                continue
            try:
                self._store(blocks)
                self._look()
            except OSError as error:
                self.error = error

    def _look(self) -> None:
        # Others may remove the file, or fill the disk.
        self._in_place()
        folder = self._file.journal.path.parent
        if shutil.disk_usage(folder).free < RESERVE:
            raise OSError(f"less than {RESERVE >> 20} MiB are free in {folder}")

    def _in_place(self) -> None:
        journal = self._file.journal
        if journal.put_back():
            raise OSError(f"its working file was removed by another program; what was measured stands in {journal.path} again")

    def _store(self, blocks: Sequence[Block]) -> None:
        # What came twice is left out, what never came is counted; stretches without a gap are written at once.
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
            self.tally.overloads += int(bool(block.status & 1))
            device = np.nan if block.device_time is None else block.device_time
            gain = np.nan if block.gain is None else block.gain
            rows.append((first, block.host_time, device, gain, int(block.status)))
        self._append(begin, rows, whole)

    def _append(self, first: int, rows: Sequence[tuple[int, float, float, float, int]], parts: Sequence[np.ndarray]) -> None:
        if not parts:
            return
        samples = parts[0] if len(parts) == 1 else np.concatenate(parts)
        # A single block of the instrument may be longer than one of the log.
        most = max(LONGEST // 2 // max(self._file.layout.row, 1), 1)
        for start in range(0, len(samples), most):
            part = samples[start : start + most]
            content = pack(
                self._file.layout,
                first + start,
                np.array(rows if start == 0 else [], TIMING),
                [part[:, k] for k in self._columns],
            )
            self._file.journal.append(Kind.SAMPLES, self._run, self._take, content)
            self.tally.stored += len(part)

    def _account(self, tick: int) -> None:
        # The gap itself is seen from the ticks of the next block, or from the end's count.
        self.tally.lost += tick - self._next
        self._next = tick
