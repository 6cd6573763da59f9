"""One run: loads the drive into the instrument, passes its blocks to the writer and its levels to the display.

With an analyzer it is one measurement, whose records become channels and spectra.
"""

from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime

import numpy as np

from isorig.analysis.campaign import USABLE, Channel, Run, Spectrum
from isorig.analysis.errors import DataError
from isorig.drivers.block import Block, InstrumentRecord, Status
from isorig.drivers.errors import DriverError, InstrumentError
from isorig.drivers.instrument import Records, Stream, in_real_time
from isorig.rig.acquire.block_stream import BlockStream
from isorig.rig.acquire.drive import drive_of, load
from isorig.rig.acquire.live import BlockSummary
from isorig.rig.acquire.loggers import RunLoggers
from isorig.rig.acquire.pace import Pace
from isorig.rig.acquire.plan import Plan, RunPlan
from isorig.rig.acquire.policy import RATE_REFUSED, RATE_SECONDS, SESSION_WAITS, SessionWaits
from isorig.rig.acquire.recorder import RunWriter, Tally, WorkingFileWriter
from isorig.rig.acquire.remarks import Remarks
from isorig.rig.acquire.response_limits import Guard
from isorig.rig.acquire.rig_operator import Operator

#: Seconds that a measurement may take in addition to the planned ones.
PATIENCE = 60.0


class PaceCheck:
    """Compares the rate of a running stream with the host's clock, every `RATE_SECONDS` seconds: a rate may become wrong."""

    def __init__(self, who: str, rate: float) -> None:
        self._who, self._rate = who, rate
        self._blocks: list[tuple[int, float]] = []

    def add(self, block: Block) -> None:
        """Add a block. Raises InstrumentError if the sample rate certainly deviates by more than `RATE_REFUSED`."""
        self._blocks.append((block.end_tick, block.host_time))
        if block.host_time - self._blocks[0][1] < RATE_SECONDS:
            return
        pace = Pace(self._rate)
        pace.add(*np.array(self._blocks).T)
        self._blocks = []
        drift = pace.drift()
        if drift is not None and drift.beyond(RATE_REFUSED):
            raise InstrumentError(
                f"{self._who} has a sample rate of {self._rate * (1.0 + 1e-6 * drift.ppm):.6g} Hz by the host's clock, not "
                f"{self._rate:g} Hz ({drift.percent}), so the run was ended; correct sample_rate or the instrument's clock, or "
                "record it all the same with --force"
            )


def measure_run(
    instrument: Stream,
    file: WorkingFileWriter,
    plan: Plan,
    run: RunPlan,
    repeat: int,
    operator: Operator,
    remarks: Remarks,
    *,
    loggers: Mapping[str, Stream] | None = None,
    waits: SessionWaits = SESSION_WAITS,
    force: bool = False,
) -> Tally:
    """Measure one run, while the `loggers` run along; the status of its blocks is added to `remarks`.

    Unless it is to `force` the run, a wrong sample rate by the host's clock ends it. Raises DriverError or OutputError if the
    instrument or the disk fails; the data measured until then are in the file.
    """
    rate, name = plan.instrument.sample_rate, run.ids()[repeat]
    drive = drive_of(*plan.original(run, repeat), rate)
    load(instrument, run, drive, plan.limits)
    writer = RunWriter(file, name, period=drive.period, waits=waits)
    summary = BlockSummary(file.layout, run, instrument, plan.drive)
    incoming = BlockStream(
        instrument, run.ticks(rate), rate, waits=waits, stopped=lambda: operator.stopped() or operator.answered()
    )
    guard = Guard(plan, instrument)
    pace = None if force or not in_real_time(instrument) else PaceCheck(instrument.identity, rate)
    along = RunLoggers(plan, loggers or {}, writer.log)
    whole = False

    def keep(block: Block) -> None:
        writer.put(block)
        remarks.add(block)
        guard.check(block)
        if pace is not None:
            pace.add(block)
        if summary.add(block):
            operator.watch(summary.state(name, writer.tally))

    try:
        along.start()
        incoming.run(keep)
        whole = True
    except BaseException:
        # Ended by the operator, the disk or the connection: the drive must stop.
        with suppress(DriverError):
            instrument.stop()
        raise
    finally:
        remarks.end(instrument, incoming.returned, along.stop())
        tally = writer.finish(incoming.counted, whole=whole, enough=operator.answered())
    operator.watch(summary.state(name, tally))
    return tally


def measure_with_analyzer(instrument: Records, plan: Plan, run: RunPlan, name: str) -> tuple[Run, int]:
    """Measure a run; returns the run, and the number of its records with an overload. Raises DriverError if the analyzer fails;
    DataError if its time records are inconsistent."""
    started = datetime.now(UTC)
    instrument.measure(run.seconds + PATIENCE)
    records = instrument.records()
    shown = list(zip(plan.instrument.shows, records, strict=True))
    time_records = {s.channel: r for s, r in shown if s.kind == "time"}
    channels = {channel: _channel(plan, channel, record) for channel, record in time_records.items()}
    spectra = tuple(
        Spectrum(
            name=f"{s.channel}-{s.kind}", kind=s.kind, response=s.channel, reference=s.reference, frequency=r.x, values=r.values,
            unit=s.unit, averages=r.averages or 1,
        )
        for s, r in shown
        if s.kind != "time"
    )  # fmt: skip
    rate = _rate(name, list(time_records.values()))
    taken = Run(
        id=name, configuration=run.configuration, sample_rate=rate, gain=run.gain, channels=channels, excitation=run.recorded_as,
        started=started, band=run.band, use=run.use, usable_to=plan.instrument.usable_to or USABLE * rate, spectra=spectra,
    )  # fmt: skip
    return taken, sum(bool(record.status & Status.OVERLOAD) for record in records)


def _channel(plan: Plan, name: str, record: InstrumentRecord) -> Channel:
    about = plan.channels[name]
    return Channel(
        name=name, samples=record.values.astype(np.float32), quantity=about.quantity, unit=about.unit,
        scale=1.0 / about.sensitivity,
    )  # fmt: skip


def _rate(run: str, records: list[InstrumentRecord]) -> float:
    first = records[0].x
    steps = np.diff(first)
    if len(first) < 2 or not np.allclose(steps, steps.mean(), rtol=1e-2) or steps.mean() <= 0.0:
        raise DataError(f"the time record of run {run!r} does not have equal time steps; show a time record on that display")
    if any(len(record.x) != len(first) or not np.allclose(record.x, first) for record in records[1:]):
        raise DataError(f"the time records of run {run!r} have different time axes; show records of one measurement")
    return float((len(first) - 1) / (first[-1] - first[0]))
