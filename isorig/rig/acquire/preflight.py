"""The pre-run check: one second at rest and one second with drive; refuses a faulty set-up and names the remedy."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from isorig.analysis.campaign import FloatArray, Run
from isorig.drivers.alignment import WIRE
from isorig.drivers.block import Block, Status
from isorig.drivers.instrument import Records, Stream, in_real_time
from isorig.rig.acquire.block_stream import Incoming
from isorig.rig.acquire.drive import drive_of, load
from isorig.rig.acquire.pace import REFUSED, Pace
from isorig.rig.acquire.plan import Plan, RunPlan
from isorig.rig.acquire.response_limits import Guard
from isorig.rig.errors import PlanError

#: Seconds at rest and with drive; seconds without a sample after which the check ends.
REST, DRIVEN = 0.25, 0.75
SILENCE = 1.0
#: Factor by which a channel must increase under drive, and allowed relative rate errors by the instrument's clock, and by the
#: host's clock if too few blocks arrive to estimate its uncertainty.
LIVELIER = 1.2
OWN, FEW = 0.01, 0.25
#: Share of full scale that counts as overload.
END = 0.999
#: Status flags of the instrument or its driver that prevent a run.
REPORTED = {
    Status.OVERLOAD: "the instrument reports an overload; choose a larger range or a lower gain",
    Status.FAULT: "the instrument reports a fault; switch it off and on, and check it",
    Status.LOST: "the instrument loses samples internally; give it a lower rate or fewer inputs",
    Status.UNSURE: f"nothing shows which of the samples belong to which input after a lost byte; {WIRE}",
    Status.DISAGREES: "the instrument's counter, frame numbers and clock disagree; check its firmware and the cable",
}


def check_room(plan: Plan, output: Path, bytes_per_sample: int = 4) -> str | None:
    """Check that the disk has room for the session twice: for the working file and for the recording."""
    ticks = sum(run.ticks(plan.instrument.sample_rate) * run.repeats for run in plan.runs)
    needed = int(2.2 * ticks * len(plan.channels) * bytes_per_sample) + (32 << 20)
    folder = next((f for f in output.absolute().parents if f.exists()), Path("/"))
    free = shutil.disk_usage(folder).free
    if free >= needed:
        return None
    return (
        f"{folder} has {free >> 20} MiB free but the session needs {needed >> 20} MiB; make room or choose another place with -o"
    )


def preflight(instrument: Stream, plan: Plan, run: RunPlan) -> list[str]:
    """The reasons against starting this run, each as a sentence with the remedy."""
    rate = plan.instrument.sample_rate
    rest, driven = round(REST * rate), round(DRIVEN * rate)
    drive = drive_of(*plan.original(run, 0), rate)[:driven] if run.played else np.zeros(driven)
    load(instrument, run, np.concatenate([np.zeros(rest), drive]), plan.limits)
    guard = Guard(plan, instrument)
    blocks = []
    for block in _blocks(instrument, rest + driven, rate):
        guard.check(block)
        blocks.append(block)
    if not blocks:
        return ["no sample arrives; check that the instrument is on and scans"]
    raw = np.concatenate([block.samples for block in blocks])
    ticks = np.concatenate([np.arange(block.first_tick, block.end_tick) for block in blocks])
    found = _rate(instrument, blocks, rate)
    for status, sentence in REPORTED.items():
        if any(block.status & status for block in blocks):
            found.append(sentence)
    sensors = {name: about for name, about in plan.channels.items() if not instrument.inputs[about.input].counts}
    for name, about in sensors.items():
        source = instrument.inputs[about.input]
        values = raw[:, about.input].astype(np.float64)
        found += _channel(name, values, None if source.full_scale is None else source.full_scale / source.per_count)
    if run.played and not found:
        found += _response({name: raw[:, about.input].astype(np.float64) for name, about in sensors.items()}, ticks < rest)
    return found


def look_at_analyzer(instrument: Records) -> list[str]:
    """The reasons against starting a measurement with an analyzer."""
    if instrument.status() & Status.OVERLOAD:
        return ["the analyzer reports an overload; choose a larger range or a lower gain"]
    return []


def look_at_record(measured: Run, plan: Plan) -> list[str]:
    """The reasons against keeping a record."""
    if abs(measured.sample_rate / plan.instrument.sample_rate - 1.0) <= OWN:
        return []
    return [
        f"its sample rate is {measured.sample_rate:.6g} Hz, not {plan.instrument.sample_rate:g} Hz; correct sample_rate, "
        "or the span on its panel"
    ]


def refuse(run: str, found: list[str]) -> None:
    """Raise the findings as one sentence.

    Raises
    ------
    PlanError
        There are findings.
    """
    if found:
        raise PlanError(f"run {run!r} was not started: {'; '.join(found)}; --force starts it anyway")


def _blocks(instrument: Stream, ticks: int, rate: float) -> Iterable[Block]:
    incoming = Incoming(instrument, ticks, rate, away=SILENCE)
    instrument.start()
    yield from incoming.blocks()
    instrument.stop()
    yield from incoming.rest()


def _rate(instrument: Stream, blocks: list[Block], rate: float) -> list[str]:
    # By the host's clock, which decides; and by the instrument's own, which is more accurate in so short a time.
    measured = _by_host(blocks, rate) if in_real_time(instrument) else None
    if measured is not None:
        return [f"the instrument's sample rate is {measured:.6g} Hz by the host's clock, not {rate:g} Hz; correct sample_rate"]
    first, last = blocks[0], blocks[-1]
    if first.device_time is None or last.device_time is None or last.device_time <= first.device_time:
        return []
    own = (last.first_tick - first.first_tick) / (last.device_time - first.device_time)
    if abs(own / rate - 1.0) <= OWN:
        return []
    return [f"the instrument's sample rate is {own:.6g} Hz by its own clock, not {rate:g} Hz; correct sample_rate"]


def _by_host(blocks: list[Block], rate: float) -> float | None:
    # The rate if it is certainly wrong.
    pace = Pace(rate)
    pace.add(np.array([float(block.end_tick) for block in blocks]), np.array([block.host_time for block in blocks]))
    drift = pace.drift()
    if drift is not None:
        return rate * (1.0 + 1e-6 * drift.ppm) if drift.beyond(REFUSED) else None
    passed, count = blocks[-1].host_time - blocks[0].host_time, blocks[-1].end_tick - blocks[0].end_tick
    return None if passed <= 0.0 or abs(count / passed / rate - 1.0) <= FEW else count / passed


def _channel(name: str, values: FloatArray, full: float | None) -> list[str]:
    if full is not None and np.abs(values).max() >= END * full:
        if np.median(np.abs(values)) >= END * full:
            return [
                f"{name} remains at the end of its input's range; the sensor is disconnected or has no supply, check its cable"
            ]
        return [f"{name} exceeds its input's range; choose a larger range or a lower gain"]
    if np.ptp(values) == 0.0:
        return [f"{name} is constant to the last count; the sensor is dead or not connected, check its cable and supply"]
    return []


def _response(values: dict[str, FloatArray], resting: np.ndarray) -> list[str]:
    if not resting.any() or resting.all() or not values:
        return []
    livelier = {
        name: float(v[~resting].std()) / max(float(v[resting].std()), 1e-9) for name, v in values.items()
    }  # fmt: skip
    still = [name for name, ratio in livelier.items() if ratio < LIVELIER]
    if len(still) == len(livelier):
        return ["the drive causes no response on any channel; switch its amplifier on and check its cable"]
    return [f"{name} does not respond to the drive; check that its sensor is mounted and connected" for name in still]
