"""A session: measures the runs of a plan in sequence into the working file, and converts it to a recording at the end."""

from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial as partial_of
from pathlib import Path

import msgspec

from isorig.analysis.campaign import Run
from isorig.drivers.instrument import Exciter, Sourcing, Stream, in_real_time
from isorig.rig.acquire.display_thread import DisplayThread
from isorig.rig.acquire.instruments import opened, opened_analyzer, opened_loggers, prepare
from isorig.rig.acquire.journal import SYNC
from isorig.rig.acquire.live import LiveState
from isorig.rig.acquire.locks import output_locked, port_locked
from isorig.rig.acquire.measure_run import measure_run, measure_with_analyzer
from isorig.rig.acquire.plan import Plan, RunPlan
from isorig.rig.acquire.policy import SESSION_WAITS, SessionWaits
from isorig.rig.acquire.preflight import check_analyzer, check_record, check_room, preflight, refuse
from isorig.rig.acquire.recorder import Tally, recording_into, working_file
from isorig.rig.acquire.recover import Recovered, WorkingFileReader
from isorig.rig.acquire.remarks import Remarks
from isorig.rig.acquire.response_limits import check_responses
from isorig.rig.acquire.rig_operator import MeasuredRun, Operator, decoupled_operator
from isorig.rig.acquire.run_check import check_run
from isorig.rig.acquire.sensors import refuse_sensors
from isorig.rig.acquire.store import ended, keep_measured, keep_session, whole_runs
from isorig.rig.errors import OutputError, PlanError, RecordingError
from isorig.rig.files.output import remove_leftovers
from isorig.rig.process.interrupts import ended_by_signals


def acquire(
    plan: Plan, port: str, output: Path, operator: Operator, *, resume: bool = False, again: Set[str] = frozenset(),
    force: bool = False, sync: float = SYNC, waits: SessionWaits = SESSION_WAITS,
) -> list[MeasuredRun]:  # fmt: skip
    """Measure the runs of a plan and write them as a recording.

    If the session ends early for any reason (the operator, the instrument, a full disk), the measured data are in the recording
    or, after a kill, in the working file next to it. With `resume` an interrupted session is continued: complete runs are kept
    but for those to measure `again`. With `force` runs start even if the pre-run check fails. A power failure loses `sync`
    seconds of data at most; 0 syncs every block. Raises DriverError or RigError if the instrument or the disk fails.
    """
    display = DisplayThread()
    decoupled = decoupled_operator(operator, display)
    try:
        with output_locked(output), port_locked(port), ended_by_signals():
            # The leftovers of killed sessions take space, too.
            for path in (output, working_file(output)):
                remove_leftovers(path)
            no_room = check_room(plan, output)
            if no_room is not None and not force:
                raise OutputError(f"{no_room}; --force starts anyway")
            done = _done(working_file(output), output, plan, resume=resume) - _planned(again, plan)
            session = _Session(plan, output, decoupled, done, resume=resume, force=force, waits=waits)
            if plan.instrument.analyzer:
                session.with_analyzer(port)
            else:
                session.with_stream(port, sync)
            display.settle()
            return session.taken
    finally:
        display.end()


class _Session:
    """The runs of a plan that are not done, one after the other; `taken` are those that were measured."""

    def __init__(
        self, plan: Plan, output: Path, operator: Operator, done: Set[str], *, resume: bool, force: bool, waits: SessionWaits
    ) -> None:
        self._plan, self._output, self._operator = plan, output, operator
        self._resume, self._force, self._waits = resume, force, waits
        runs = ((run, repeat, name) for run in plan.runs for repeat, name in enumerate(run.ids()))
        self._wanted = [(run, repeat, name) for run, repeat, name in runs if name not in done]
        self.taken: list[MeasuredRun] = []

    def with_stream(self, port: str, sync: float) -> None:
        """Measure with an instrument that streams."""
        plan, output, partial = self._plan, self._output, working_file(self._output)
        if not self._force:
            check_responses(plan, ((run, repeat) for run, repeat, _ in self._wanted))
        with opened_loggers(plan, self._waits.drivers) as loggers, opened(plan, port, self._waits.drivers) as instrument:
            _check_against(instrument, plan)
            if not self._force:
                refuse_sensors(plan, instrument)
            after, real_time = ended(output) if self._resume else None, in_real_time(instrument)
            recording = ExitStack()
            file = recording.enter_context(
                recording_into(partial, plan, instrument.inputs, sync=sync, after=after, real_time=real_time)
            )

            def lock(configuration: str) -> None:
                if not isinstance(instrument, Exciter) or not instrument.set_configuration(configuration):
                    self._operator.lock(configuration)

            try:
                with recording, closing(WorkingFileReader(partial)) as saved:
                    for number, run, repeat, name in self._decided(lock):
                        if not self._force:
                            refuse(name, preflight(instrument, plan, run))
                        remarks = Remarks(plan.instrument.sample_rate)
                        tally = measure_run(
                            instrument, file, plan, run, repeat, replace(self._operator, watch=partial_of(self._watch, number)),
                            remarks, loggers=loggers, waits=self._waits, force=self._force,
                        )  # fmt: skip
                        self._keep(saved.run(name), tally, remarks, [saved.run(item.id).run for item in self.taken])
            finally:
                keep_session(partial, output, add=self._resume)
        if not output.exists():
            raise RecordingError(f"no sample arrived, so {output} was not written; check the instrument and start again")

    def with_analyzer(self, port: str) -> None:
        """Measure with an analyzer. A record is complete or absent: the recording is written again after each."""
        plan = self._plan
        with opened_analyzer(plan, port, self._waits.drivers) as instrument:
            if not self._force:
                refuse_sensors(plan, instrument)
            for _, run, _, name in self._decided(self._operator.lock):
                if run.source is not None and isinstance(instrument, Sourcing):
                    instrument.set_source(run.source)
                if not self._force:
                    refuse(name, check_analyzer(instrument))
                measured, overloads = measure_with_analyzer(instrument, plan, run, name)
                if not self._force:
                    refuse(name, check_record(measured, plan))
                keep_measured(self._output, plan, measured, add=self._resume or bool(self.taken))
                found = Recovered(
                    id=name, finished=True, begun=True, run=measured, stored=len(measured), planned=len(measured),
                    overloads=overloads, planned_gain=run.gain,
                )  # fmt: skip
                remarks = Remarks(measured.sample_rate)
                remarks.end(instrument)
                self._keep(found, Tally(stored=found.stored, overloads=overloads), remarks)

    def _decided(self, lock: Callable[[str], None]) -> Iterator[tuple[int, RunPlan, int, str]]:
        # The runs that the operator has confirmed, each in its configuration, with its number among all, from 1.
        configuration = ""
        for number, (run, repeat, name) in enumerate(self._wanted, 1):
            decision = self._operator.decide(name)
            if decision == "end":
                return
            if decision == "take":
                if run.configuration != configuration:
                    lock(run.configuration)
                    configuration = run.configuration
                yield number, run, repeat, name

    def _watch(self, number: int, live: LiveState) -> None:
        # With the number of the run in the session, and the remaining seconds of the session.
        left = live.of - live.seconds + sum(run.seconds for run, _, _ in self._wanted[number:])
        self._operator.watch(msgspec.structs.replace(live, number=number, runs=len(self._wanted), left=max(left, 0.0)))

    def _keep(self, found: Recovered, tally: Tally, remarks: Remarks, earlier: Sequence[Run | None] = ()) -> None:
        others = [run for run in earlier if run is not None]
        verdict = check_run(found, rig=self._plan.described(), against=remarks.against(), remarks=remarks.others(), others=others)
        self.taken.append(MeasuredRun(id=found.id, tally=tally, verdict=verdict, drift=found.drift))
        self._operator.taken(self.taken[-1])


def _check_against(instrument: Stream, plan: Plan) -> None:
    asked = plan.instrument.sample_rate
    rate = prepare(instrument, asked, [channel.input for channel in plan.channels.values()], "the instrument")
    if abs(rate / asked - 1.0) > 1e-6:
        raise PlanError(f"the instrument's nearest rate to {asked:.9g} Hz is {rate:.9g} Hz; set sample_rate to it in the plan")
    played = next((run.id for run in plan.runs if run.played), None)
    if played is not None and not isinstance(instrument, Exciter):
        raise PlanError(
            f"run {played!r} needs a drive and a {plan.instrument.kind} instrument plays none; drive the rig by other means "
            'and call the excitation "other"'
        )


def _planned(names: Set[str], plan: Plan) -> Set[str]:
    ids = [name for run in plan.runs for name in run.ids()]
    unknown = next((name for name in sorted(names) if name not in ids), None)
    if unknown is not None:
        raise PlanError(f"the plan has no run {unknown!r} to repeat; it has {', '.join(ids)}")
    return names


def _done(partial: Path, output: Path, plan: Plan, *, resume: bool) -> Set[str]:
    if not resume:
        if partial.exists():
            raise OutputError(
                f"{partial} was left by an interrupted session; continue it with --resume, or recover and remove it"
            )
        return frozenset()
    if not partial.exists() and not output.exists():
        raise OutputError(f"neither {output} nor {partial} exists, so there is no session to continue; start without --resume")
    if partial.exists():
        keep_session(partial, output, add=output.exists())
    return whole_runs(output, plan)
