"""A session: the plan's runs in turn, from the instrument into the working file, and at the end a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Set
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py

from drivers.instrument import Exciter, Stream
from rig.acquire.check import Verdict, check_run
from rig.acquire.instruments import opened, opened_analyzer
from rig.acquire.keep import keep_measured, keep_session, whole_runs
from rig.acquire.plan import Plan, RunPlan
from rig.acquire.preflight import check_room, look_at_analyzer, look_at_record, preflight, refuse
from rig.acquire.recorder import Tally, lay_out, working_file
from rig.acquire.records import measure_run
from rig.acquire.recover import Drift, Recovered, recovered
from rig.acquire.take import Live, take
from rig.errors import OutputError, PlanError, RecordingError


@dataclass(frozen=True, kw_only=True)
class Taken:
    """A run that was taken: its tally, the check right after it, and how its clock drifted."""

    id: str
    tally: Tally
    verdict: Verdict
    drift: Drift | None = None


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
    plan: Plan,
    port: str,
    output: Path,
    operator: Operator,
    *,
    resume: bool = False,
    again: Set[str] = frozenset(),
    force: bool = False,
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
    again
        Runs that are taken once more although they are whole, where a session is resumed.
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
    done = _done(partial, output, plan, resume=resume) - _planned(again, plan)
    if plan.instrument.analyzer:
        return output, _with_analyzer(plan, port, output, operator, done, resume=resume, force=force)
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
                    taken.append(Taken(id=name, tally=tally, verdict=check_run(found, drive=plan.drive), drift=found.drift))
                    operator.taken(taken[-1])
        finally:
            keep_session(partial, output, add=resume)
    if not output.exists():
        raise RecordingError(f"not one sample arrived, so {output} was not written; check the instrument and begin again")
    return output, taken


def _with_analyzer(
    plan: Plan, port: str, output: Path, operator: Operator, done: Set[str], *, resume: bool, force: bool
) -> list[Taken]:
    # A record is whole or not there: the recording is written anew after each.
    taken: list[Taken] = []
    configuration = ""
    with opened_analyzer(plan, port) as instrument:
        for run, _, name in _wanted(plan, done):
            if run.configuration != configuration:
                operator.lock(run.configuration)
                configuration = run.configuration
            if not force:
                refuse(name, look_at_analyzer(instrument))
            measured, overloads = measure_run(instrument, plan, run, name)
            if not force:
                refuse(name, look_at_record(measured, plan))
            keep_measured(output, plan, measured, add=resume or bool(taken))
            found = Recovered(
                id=name, finished=True, begun=True, run=measured, stored=len(measured), lost=0, planned=len(measured),
                overloads=overloads, planned_gain=run.gain, drift=None,
            )  # fmt: skip
            taken.append(
                Taken(id=name, tally=Tally(stored=found.stored, overloads=overloads), verdict=check_run(found, drive=plan.drive))
            )
            operator.taken(taken[-1])
    return taken


def _wanted(plan: Plan, done: Set[str]) -> Iterator[tuple[RunPlan, int, str]]:
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


def _planned(names: Set[str], plan: Plan) -> Set[str]:
    ids = [name for run in plan.runs for name in run.ids()]
    unknown = next((name for name in sorted(names) if name not in ids), None)
    if unknown is not None:
        raise PlanError(f"the plan has no run {unknown!r} to take again; it has {', '.join(ids)}")
    return names


def _done(partial: Path, output: Path, plan: Plan, *, resume: bool) -> Set[str]:
    if not resume:
        if partial.exists():
            raise OutputError(
                f"{partial} is left of a session that was broken off; go on with --resume, or recover and remove it"
            )
        return frozenset()
    if not partial.exists() and not output.exists():
        raise OutputError(f"there is neither {output} nor {partial} to go on with; start without --resume")
    if partial.exists():
        keep_session(partial, output, add=output.exists())
    return whole_runs(output, plan)


@contextmanager
def _single_writer(partial: Path) -> Iterator[h5py.File]:
    with h5py.File(partial, "r+", libver="latest") as file:
        file.swmr_mode = True
        yield file
