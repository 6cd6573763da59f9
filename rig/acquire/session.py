"""A session: the plan's runs in turn, from the instrument into the working file, and at the end a recording."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py

from analysis.measured import Run
from drivers.instrument import Exciter, Stream
from rig.acquire.check import Verdict, check_run
from rig.acquire.instruments import opened, opened_analyzer
from rig.acquire.plan import Plan, RunPlan
from rig.acquire.preflight import check_room, preflight, refuse
from rig.acquire.recorder import RESERVE, Tally, lay_out, working_file
from rig.acquire.records import measure_run
from rig.acquire.recover import Recovered, campaign_of, read_working, recovered
from rig.acquire.take import Live, take
from rig.errors import OutputError, PlanError, RecordingError
from rig.recording import read, write


@dataclass(frozen=True, kw_only=True)
class Taken:
    """A run that was taken: its tally, the check right after it, and how much faster the device counts than the host's clock."""

    id: str
    tally: Tally
    verdict: Verdict
    drift_ppm: float | None = None


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


def acquire(
    plan: Plan, port: str, output: Path, operator: Operator, *, resume: bool = False, force: bool = False
) -> tuple[Path, list[Taken]]:
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
        Go on with a session that was broken off: whole runs are kept, the others taken.
    force
        Begin runs that the look before them speaks against.

    Raises
    ------
    DriverError, RigError
        Where the instrument or the disk fails.
    """
    partial = working_file(output)
    no_room = check_room(plan, output)
    if no_room is not None and not force:
        raise OutputError(f"{no_room}; --force begins all the same")
    done = _done(partial, output, plan, resume=resume)
    if plan.instrument.analyzer:
        return output, _with_analyzer(plan, port, output, operator, done)
    taken: list[Taken] = []
    with opened(plan, port) as instrument:
        _check_against(instrument, plan)
        lay_out(partial, plan, instrument.inputs)
        try:
            with _single_writer(partial) as file:
                configuration = ""
                for run, repeat, name in _wanted(plan, done):
                    if run.configuration != configuration:
                        _set_up(instrument, run.configuration, operator)
                        configuration = run.configuration
                    if not force:
                        refuse(name, preflight(instrument, plan, run))
                    tally = take(instrument, file, plan, run, repeat, name, operator.watch)
                    found = recovered(file[f"runs/{name}"], name)
                    taken.append(Taken(id=name, tally=tally, verdict=check_run(found), drift_ppm=found.drift_ppm))
                    operator.taken(taken[-1])
        finally:
            _keep(partial, output, done)
    if not output.exists():
        raise RecordingError(f"not one sample arrived, so {output} was not written; check the instrument and begin again")
    return output, taken


def _with_analyzer(plan: Plan, port: str, output: Path, operator: Operator, done: dict[str, Run]) -> list[Taken]:
    # A record is whole or not there: the recording is written anew after each.
    taken: list[Taken] = []
    configuration = ""
    with opened_analyzer(plan, port) as instrument:
        for run, _, name in _wanted(plan, done):
            if run.configuration != configuration:
                operator.lock(run.configuration)
                configuration = run.configuration
            done[name], overloads = measure_run(instrument, plan, run, name)
            write(output, campaign_of(plan.rig, list(done.values()), str(output)))
            found = Recovered(
                id=name, finished=True, begun=True, run=done[name], stored=len(done[name]), lost=0, overloads=overloads,
                drift_ppm=None,
            )  # fmt: skip
            taken.append(Taken(id=name, tally=Tally(stored=found.stored, overloads=overloads), verdict=check_run(found)))
            operator.taken(taken[-1])
    return taken


def _wanted(plan: Plan, done: Mapping[str, Run]) -> Iterator[tuple[RunPlan, int, str]]:
    for run in plan.runs:
        for repeat, name in enumerate(run.ids()):
            if name not in done:
                yield run, repeat, name


def _check_against(instrument: Stream, plan: Plan) -> None:
    asked = plan.instrument.sample_rate
    highest = max(channel.input for channel in plan.channels.values())
    rate = instrument.prepare(sample_rate=asked, channels=[channel.input for channel in plan.channels.values()])
    if highest >= len(instrument.inputs):
        raise PlanError(f"the instrument has {len(instrument.inputs)} inputs and the plan uses input {highest}; correct it")
    if abs(rate / asked - 1.0) > 1e-6:
        raise PlanError(
            f"the instrument's nearest rate to {asked:.9g} Hz is {rate:.9g} Hz; write that as sample_rate in the plan"
        )
    played = next((run.id for run in plan.runs if run.played), None)
    if played is not None and not isinstance(instrument, Exciter):
        raise PlanError(
            f"run {played!r} needs a drive and a {plan.instrument.kind} instrument plays none; drive the rig by other means "
            'and call the excitation "other"'
        )


def _set_up(instrument: Stream, configuration: str, operator: Operator) -> None:
    if not isinstance(instrument, Exciter) or not instrument.set_configuration(configuration):
        operator.lock(configuration)


def _done(partial: Path, output: Path, plan: Plan, *, resume: bool) -> dict[str, Run]:
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
    # A run that was broken off is shorter than planned.
    rate = plan.instrument.sample_rate
    needed = {name: 1 if plan.instrument.analyzer else run.ticks(rate) for run in plan.runs for name in run.ids()}
    return {
        name: run for name, run in done.items() if len(run) + sum(gap.count for gap in run.gaps) >= needed.get(name, 0)
    }  # fmt: skip


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
        if shutil.disk_usage(partial.parent).free < partial.stat().st_size + RESERVE:
            raise OutputError(
                f"the disk is nearly full: what was measured is in {partial}; make room and go on with --resume, or save it "
                "elsewhere with rig recover"
            )
        write(output, campaign_of(known, list(runs.values()), str(partial)))
    partial.unlink()
