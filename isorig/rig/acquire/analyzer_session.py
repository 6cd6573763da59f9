"""A session with an analyzer: each run is one measurement, and its records become channels and spectra."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from isorig.analysis.campaign import USABLE, Channel, Run, Spectrum
from isorig.analysis.errors import DataError
from isorig.drivers.block import InstrumentRecord, Status
from isorig.drivers.instrument import Records
from isorig.rig.acquire.plan import Plan, RunPlan

#: Seconds that a measurement may take in addition to the planned ones.
PATIENCE = 60.0


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
