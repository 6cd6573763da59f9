"""A session: the plan's runs in turn, from the instrument into the working file, and at the end a recording."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py
import msgspec
import numpy as np

from analysis.measured import Run
from drivers.errors import ConnectionLostError
from drivers.framed import FramedInstrument
from rig.acquire.check import Verdict, check_run
from rig.acquire.drive import drive_of
from rig.acquire.plan import Plan, RunPlan
from rig.acquire.recorder import RunWriter, Tally, lay_out, working_file
from rig.acquire.recover import campaign_of, read_working, recovered
from rig.errors import OutputError, PlanError
from rig.recording import read, write

#: Seconds without a block after which a run is over, and seconds between two looks at the levels.
SILENCE = 2.0
LOOK = 0.25


class Live(msgspec.Struct, frozen=True, kw_only=True):
    """What is to be seen while a run lasts; rms and peak of each channel in its unit, since the last look."""

    run: str
    seconds: float
    of: float
    rms: dict[str, float]
    peak: dict[str, float]
    overloads: int
    lost: int


@dataclass(frozen=True, kw_only=True)
class Taken:
    """A run that was taken: its tally and what the check right after it says."""

    id: str
    tally: Tally
    verdict: Verdict


@dataclass(frozen=True, kw_only=True)
class Operator:
    """The person at the rig, or what stands in.

    Parameters
    ----------
    lock
        Asked to bring the rig into a configuration; returns when it is done.
    watch
        Told what is to be seen.
    taken
        Told of each run that was taken.
    """

    lock: Callable[[str], None]
    watch: Callable[[Live], None]
    taken: Callable[[Taken], None]


def acquire(plan: Plan, port: str, output: Path, operator: Operator, *, resume: bool = False) -> tuple[Path, list[Taken]]:
    """Take the runs of a plan and write them as a recording.

    Whatever ends the session early (the operator, the instrument, a full disk), what was measured is in the recording or, after
    a kill, in the working file beside it.

    Parameters
    ----------
    plan
        What is to be measured.
    port
        The instrument's port.
    output
        The recording.
    operator
        Who locks, and who is told.
    resume
        Go on with a session that was broken off: finished runs are kept, the others taken.

    Raises
    ------
    DriverError, RigError
        Where the instrument or the disk fails.
    """
    partial = working_file(output)
    done = _done(partial, output, resume=resume)
    taken: list[Taken] = []
    with FramedInstrument(port, baud_rate=plan.instrument.baud_rate) as instrument:
        columns = {name: channel.input for name, channel in plan.channels.items()}
        rate = instrument.prepare(sample_rate=plan.instrument.sample_rate, channels=list(columns.values()))
        if abs(rate / plan.instrument.sample_rate - 1.0) > 1e-6:
            raise PlanError(
                f"the instrument's nearest rate to {plan.instrument.sample_rate:g} Hz is {rate:g} Hz; write that in the plan"
            )
        lay_out(partial, plan, instrument.inputs)
        try:
            with _single_writer(partial) as file:
                configuration = ""
                for run in plan.runs:
                    for repeat, name in enumerate(run.ids()):
                        if name in done:
                            continue
                        if run.configuration != configuration:
                            if not instrument.set_configuration(run.configuration):
                                operator.lock(run.configuration)
                            configuration = run.configuration
                        tally = _take(instrument, file, plan, run, repeat, name, operator.watch)
                        taken.append(Taken(id=name, tally=tally, verdict=check_run(recovered(file[f"runs/{name}"], name))))
                        operator.taken(taken[-1])
        finally:
            _keep(partial, output, done)
    return output, taken


def _done(partial: Path, output: Path, *, resume: bool) -> dict[str, Run]:
    if not resume:
        if partial.exists():
            raise OutputError(
                f"{partial} is left of a session that was broken off; go on with --resume, or recover and remove it"
            )
        return {}
    if not partial.exists() and not output.exists():
        raise OutputError(f"there is neither {output} nor {partial} to go on with; start without --resume")
    done = {run.id: run for run in read(output).runs} if output.exists() else {}
    if partial.exists():
        known, found = read_working(partial)
        done |= {item.id: item.run for item in found if item.finished and item.run is not None}
        # The old working file stays until what is kept of it is safe in the recording.
        if done:
            write(output, campaign_of(known, list(done.values()), str(partial)))
        partial.unlink()
    return done


@contextmanager
def _single_writer(partial: Path) -> Iterator[h5py.File]:
    with h5py.File(partial, "r+", libver="latest") as file:
        file.swmr_mode = True
        yield file


def _keep(partial: Path, output: Path, done: Mapping[str, Run]) -> None:
    # What was measured becomes a recording however the session ended; the working file goes only once that is safe.
    known, found = read_working(partial)
    runs = {**{item.id: item.run for item in found if item.run is not None}, **done}
    if runs:
        write(output, campaign_of(known, list(runs.values()), str(partial)))
    partial.unlink()


def _take(
    instrument: FramedInstrument,
    file: h5py.File,
    plan: Plan,
    run: RunPlan,
    repeat: int,
    name: str,
    watch: Callable[[Live], None],
) -> Tally:
    rate = plan.instrument.sample_rate
    drive, period = drive_of(run, repeat, rate)
    instrument.set_gain(run.gain)
    if not instrument.load_drive(drive):
        raise PlanError(
            f"the instrument plays no drive, which run {name!r} needs; drive the rig by hand or take another instrument"
        )
    columns = {channel: about.input for channel, about in plan.channels.items()}
    factors = {channel: instrument.inputs[about.input].per_count / about.sensitivity for channel, about in plan.channels.items()}
    writer = RunWriter(file, name, columns, sample_rate=rate, period=period)
    counted: int | None = None
    looked = heard = time.monotonic()
    end_tick = 0
    try:
        instrument.start()
        while end_tick < len(drive):
            block = instrument.read(0.1)
            now = time.monotonic()
            if block is None:
                if now - heard > SILENCE:
                    break
                continue
            heard, end_tick = now, max(end_tick, block.end_tick)
            writer.put(block)
            if now - looked > LOOK:
                looked = now
                watch(_look(name, writer, end_tick / rate, run.seconds, columns, factors))
        counted = instrument.stop()
        while (block := instrument.read(0.1)) is not None:
            writer.put(block)
    except ConnectionLostError:
        counted = None
        raise
    finally:
        tally = writer.finish(counted)
    watch(_look(name, writer, end_tick / rate, run.seconds, columns, factors))
    return tally


def _look(
    name: str, writer: RunWriter, seconds: float, of: float, columns: Mapping[str, int], factors: Mapping[str, float]
) -> Live:
    latest = writer.latest
    rms, peak = {}, {}
    if latest is not None:
        for channel, column in columns.items():
            values = latest[:, column] * factors[channel]
            rms[channel], peak[channel] = float(np.sqrt(np.mean(values**2))), float(np.abs(values).max())
    return Live(
        run=name, seconds=min(seconds, of), of=of, rms=rms, peak=peak, overloads=writer.tally.overloads, lost=writer.tally.lost
    )
