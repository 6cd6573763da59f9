"""Blocks from an instrument onto disk: a bounded queue, a writer behind it, a ledger of what was lost.

The working file is laid out whole before the first sample and then written in HDF5's single-writer mode, so that a reader may
follow it and a killed writer leaves a file that opens. Samples are raw integers with their scale.
"""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from drivers.block import Block, Input
from rig.acquire.plan import Plan, RunPlan
from rig.acquire.waiting import Waiting
from rig.errors import OutputError
from rig.output import replaced
from rig.recording import FORMAT, VERSION

#: Seconds of samples that may wait for a slow disk, and seconds that are gathered and then written at once.
QUEUE_SECONDS = 5.0
GATHER = 0.1
#: Seconds without progress after which the disk counts as stuck.
STUCK = 10.0
#: Bytes that must stay free on the disk: where fewer are left the session ends while the file can still be closed.
RESERVE = 16 << 20
#: Rows of a chunk.
CHUNK = 4096
PROGRESS = np.dtype([("state", "i4"), ("started_ns", "i8"), ("counted", "i8"), ("period", "i8"), ("sample_rate", "f8")])
GAPS = np.dtype([("first_tick", "i8"), ("count", "i8")])
TIMING = np.dtype([("tick", "i8"), ("host_time", "f8"), ("device_time", "f8"), ("gain", "f8"), ("status", "i4")])
#: States of a run in the working file.
PLANNED, RUNNING, DONE, BROKEN = 0, 1, 2, 3


def working_file(output: Path) -> Path:
    """Where a session writes while it lasts."""
    return output.with_name(output.name + ".partial")


def lay_out(path: Path, plan: Plan, inputs: Sequence[Input]) -> None:
    """Create the working file with everything that will be written.

    Raises
    ------
    OutputError
        Where the place cannot be written.
    """
    with replaced(path) as temporary:
        try:
            with h5py.File(temporary, "w", libver="latest") as file:
                file.attrs["format"], file.attrs["format_version"] = FORMAT, VERSION
                file.create_group("rig").attrs.update(plan.rig)
                for run in plan.runs:
                    for name in run.ids():
                        _lay_out_run(file.create_group(f"runs/{name}"), plan, run, inputs)
        except OSError as error:
            raise OutputError(f"{path} cannot be written ({error}); choose another place with -o") from None


def _lay_out_run(group: h5py.Group, plan: Plan, run: RunPlan, inputs: Sequence[Input]) -> None:
    rate = plan.instrument.sample_rate
    group.attrs.update(
        configuration=run.configuration, sample_rate=rate, gain=run.gain, excitation=run.excitation, use=run.use,
        planned=run.ticks(rate),
    )  # fmt: skip
    if run.excitation != "moves" and run.band is not None:
        group.attrs["band"] = run.band
    for channel, about in plan.channels.items():
        source = inputs[about.input]
        dataset = group.create_dataset(channel, (0,), source.dtype, maxshape=(None,), chunks=(CHUNK,), fletcher32=True)
        dataset.attrs.update(
            quantity=about.quantity, unit=about.unit, scale=source.per_count / about.sensitivity,
            offset=source.offset / about.sensitivity, **about.told,
        )  # fmt: skip
        if source.full_scale is not None:
            dataset.attrs["range"] = abs(source.full_scale / about.sensitivity)
    group.create_dataset("gaps", (0,), GAPS, maxshape=(None,), chunks=(256,), fletcher32=True)
    group.create_dataset("timing", (0,), TIMING, maxshape=(None,), chunks=(1024,), fletcher32=True)
    group.create_dataset("progress", (1,), PROGRESS)


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
        The working file, open for writing in single-writer mode.
    run_id
        Which run.
    columns
        The input of each channel, by channel name.
    sample_rate
        Hz; sets the length of the queue.
    period
        Samples per period of a periodic drive.
    """

    def __init__(
        self,
        file: h5py.File,
        run_id: str,
        columns: Mapping[str, int],
        *,
        sample_rate: float,
        period: int | None,
    ) -> None:
        group = file[f"runs/{run_id}"]
        self._file = file
        self._channels = [(group[name], column) for name, column in columns.items()]
        self._gaps, self._timing, self._state = group["gaps"], group["timing"], group["progress"]
        self._planned = int(group.attrs["planned"])
        self._waiting = Waiting(int(QUEUE_SECONDS * sample_rate) + 1)
        self.tally = Tally()
        self.error: OSError | None = None
        self._next = 0
        self._folder = Path(file.filename).parent
        self._progress = np.array([(RUNNING, time.time_ns(), 0, period or 0, sample_rate)], PROGRESS)
        self._state[...] = self._progress
        self._file.flush()
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
            try:
                if counted is not None and counted > self._next:
                    self._gap(counted - self._next)
                self._progress["state"] = DONE if whole and self._next >= self._planned else BROKEN
                self._progress["counted"] = self._next if counted is None else counted
                self._state[...] = self._progress
                self._file.flush()
            except OSError as error:
                self.error = error
        if self.error is not None and whole:
            raise self._refused()
        return self.tally

    def _refused(self) -> OutputError:
        return OutputError(f"the recording cannot be written any more ({self.error}); make room, then go on with --resume")

    def _work(self) -> None:
        while (blocks := self._waiting.take(GATHER)) is not None:
            if self.error is not None:
                continue
            try:
                self._store(blocks)
                self._flush()
            except (OSError, RuntimeError) as error:
                self.error = error if isinstance(error, OSError) else OSError(str(error))

    def _flush(self) -> None:
        self._file.flush()
        if shutil.disk_usage(self._folder).free < RESERVE:
            raise OSError(f"less than {RESERVE >> 20} MiB are free in {self._folder}")

    def _store(self, blocks: Sequence[Block]) -> None:
        # What came twice is left out, what never came is written down; stretches without a gap are written at once.
        whole: list[np.ndarray] = []
        rows = []
        for block in blocks:
            samples = block.samples[max(self._next - block.first_tick, 0) :]
            if not len(samples):
                continue
            first = max(block.first_tick, self._next)
            if first > self._next:
                self._append(whole)
                whole = []
                self._gap(first - self._next)
            whole.append(samples)
            self._next = first + len(samples)
            self.tally.overloads += int(bool(block.status & 1))
            device = np.nan if block.device_time is None else block.device_time
            gain = np.nan if block.gain is None else block.gain
            rows.append((first, block.host_time, device, gain, int(block.status)))
        self._append(whole)
        if rows:
            _append(self._timing, np.array(rows, TIMING))

    def _append(self, parts: Sequence[np.ndarray]) -> None:
        if not parts:
            return
        samples = np.concatenate(parts)
        for dataset, column in self._channels:
            _append(dataset, samples[:, column])
        self.tally.stored += len(samples)

    def _gap(self, count: int) -> None:
        _append(self._gaps, np.array([(self._next, count)], GAPS))
        self.tally.lost += count
        self._next += count


def _append(dataset: h5py.Dataset, values: np.ndarray) -> None:
    n = len(dataset)
    dataset.resize((n + len(values),))
    dataset[n:] = values
