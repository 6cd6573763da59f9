"""One run: the drive into the instrument, its blocks to the writer, levels to whoever watches."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress

import h5py
import msgspec
import numpy as np

from drivers.block import Block
from drivers.errors import ConnectionLostError, DriverError
from drivers.instrument import Stream
from rig.acquire.drive import drive_of, load
from rig.acquire.live import RunningCoherence
from rig.acquire.plan import Plan, RunPlan
from rig.acquire.recorder import RunWriter, Tally

#: Seconds without a block after which a run is over, and seconds between two looks at the levels.
SILENCE = 2.0
LOOK = 0.25


class Live(msgspec.Struct, frozen=True, kw_only=True):
    """What is to be seen while a run lasts.

    rms and peak of each channel in its unit since the last look, its full scale where it is known, and the median coherence with
    the drive inside its band so far.
    """

    run: str
    seconds: float
    of: float
    rms: dict[str, float]
    peak: dict[str, float]
    full_scale: dict[str, float]
    coherence: dict[str, float]
    overloads: int
    lost: int
    damaged: int


class Look:
    """Sums up blocks between two looks."""

    def __init__(self, plan: Plan, run: RunPlan, instrument: Stream) -> None:
        self._instrument, self._run = instrument, run
        self._columns = {name: about.input for name, about in plan.channels.items()}
        inputs = instrument.inputs
        self._scale = {name: inputs[about.input].per_count / about.sensitivity for name, about in plan.channels.items()}
        self._full = {
            name: abs(full / about.sensitivity)
            for name, about in plan.channels.items()
            if (full := inputs[about.input].full_scale) is not None
        }
        self._rate = plan.instrument.sample_rate
        self._coherence = (
            None if run.band is None else RunningCoherence(tuple(self._columns), drive=plan.drive, band=run.band, rate=self._rate)
        )
        self._blocks: list[Block] = []
        self._seconds = 0.0
        self._at = time.monotonic()

    def add(self, block: Block) -> None:
        """Take note of a block."""
        self._blocks.append(block)

    def due(self) -> bool:
        """Whether it is time for a look."""
        return time.monotonic() - self._at > LOOK

    def take(self, name: str, tally: Tally) -> Live:
        """What was to be seen since the last look."""
        values = {}
        if self._blocks:
            raw = np.concatenate([block.samples for block in self._blocks])
            values = {key: raw[:, column] * self._scale[key] for key, column in self._columns.items()}
            if self._coherence is not None:
                self._coherence.add(values)
            self._seconds = self._blocks[-1].end_tick / self._rate
        self._blocks, self._at = [], time.monotonic()
        return Live(
            run=name, seconds=min(self._seconds, self._run.seconds), of=self._run.seconds,
            rms={key: float(np.sqrt(np.mean(v**2))) for key, v in values.items()},
            peak={key: float(np.abs(v).max()) for key, v in values.items()}, full_scale=self._full,
            coherence={} if self._coherence is None else self._coherence.medians(),
            overloads=tally.overloads, lost=tally.lost, damaged=getattr(self._instrument, "damaged", 0),
        )  # fmt: skip


def take(
    instrument: Stream, file: h5py.File, plan: Plan, run: RunPlan, repeat: int, name: str, watch: Callable[[Live], None]
) -> Tally:
    """Take one run.

    Raises
    ------
    DriverError, OutputError
        Where the instrument or the disk fails; what was measured until then is in the file.
    """
    rate = plan.instrument.sample_rate
    drive, period = drive_of(run, repeat, rate)
    load(instrument, run, drive)
    writer = RunWriter(file, name, columns_of(plan), sample_rate=rate, period=period)
    look = Look(plan, run, instrument)
    counted, whole = None, False
    try:
        instrument.start()
        _stream(instrument, run.ticks(rate), writer, look, lambda: watch(look.take(name, writer.tally)))
        counted = instrument.stop()
        while (block := instrument.read(0.1)) is not None:
            look.add(block)
            writer.put(block)
        whole = True
    except ConnectionLostError:
        raise
    except BaseException:
        # The operator, or the disk: the drive must not go on.
        _quietly_stop(instrument)
        raise
    finally:
        tally = writer.finish(counted, whole=whole)
    watch(look.take(name, tally))
    return tally


def columns_of(plan: Plan) -> Mapping[str, int]:
    """The input of each channel."""
    return {name: about.input for name, about in plan.channels.items()}


def _stream(instrument: Stream, ticks: int, writer: RunWriter, look: Look, seen: Callable[[], None]) -> None:
    heard = time.monotonic()
    end_tick = 0
    while end_tick < ticks:
        block = instrument.read(0.1)
        now = time.monotonic()
        if block is None:
            if now - heard > SILENCE:
                return
            continue
        heard, end_tick = now, max(end_tick, block.end_tick)
        writer.put(block)
        look.add(block)
        if look.due():
            seen()


def _quietly_stop(instrument: Stream) -> None:
    with suppress(DriverError):
        instrument.stop()
