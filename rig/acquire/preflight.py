"""The look before a run: a second of rest and a second of drive, and what must not be so is refused with the remedy."""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from isorig.analysis.campaign import FloatArray, Run
from isorig.drivers.block import Block, Status
from isorig.drivers.instrument import Records, Stream
from isorig.rig.acquire.block_stream import Incoming
from isorig.rig.acquire.drive import drive_of, load
from isorig.rig.acquire.plan import Plan, RunPlan
from isorig.rig.errors import PlanError

#: Seconds of rest and of drive; seconds without a sample after which the look is over.
REST, DRIVEN = 0.25, 0.75
SILENCE = 1.0
#: How much livelier a channel must be under drive than at rest, and how far rates may lie apart by the instrument's clock and by
#: this machine's, within the second of the look.
LIVELIER = 1.2
OWN, HOST = 0.01, 0.25
#: Share of full scale that counts as the end of an input.
END = 0.999
#: What the instrument, or its driver, may say of a block that speaks against a run.
REPORTED = {
    Status.OVERLOAD: "the instrument reports an overload; choose a larger range or a lower gain",
    Status.FAULT: "the instrument reports a fault of its own; switch it off and on, and check it",
    Status.LOST: "the instrument loses samples inside; give it a lower rate or fewer inputs",
    Status.DISAGREES: "the instrument's counter, frame numbers and clock disagree; check its firmware and the cable",
}


def check_room(plan: Plan, output: Path, bytes_per_sample: int = 4) -> str | None:
    """Whether the disk holds the session twice: while it is written, and as the recording made of it."""
    ticks = sum(run.ticks(plan.instrument.sample_rate) * run.repeats for run in plan.runs)
    needed = int(2.2 * ticks * len(plan.channels) * bytes_per_sample) + (32 << 20)
    folder = next((f for f in output.absolute().parents if f.exists()), Path("/"))
    free = shutil.disk_usage(folder).free
    if free >= needed:
        return None
    return (
        f"{folder} has {free >> 20} MiB free and the session needs {needed >> 20} MiB; make room or choose another place with -o"
    )


def preflight(instrument: Stream, plan: Plan, run: RunPlan) -> list[str]:
    """What speaks against taking this run, each in a sentence with the remedy."""
    rate = plan.instrument.sample_rate
    rest, driven = round(REST * rate), round(DRIVEN * rate)
    drive = drive_of(*plan.original(run, 0), rate)[:driven] if run.played else np.zeros(driven)
    load(instrument, run, np.concatenate([np.zeros(rest), drive]))
    blocks = list(_blocks(instrument, rest + driven, rate))
    if not blocks:
        return ["no sample arrives; check that the instrument is on and scans"]
    raw = np.concatenate([block.samples for block in blocks])
    ticks = np.concatenate([np.arange(block.first_tick, block.end_tick) for block in blocks])
    found = _rate(blocks, rate)
    for status, sentence in REPORTED.items():
        if any(block.status & status for block in blocks):
            found.append(sentence)
    for name, about in plan.channels.items():
        source = instrument.inputs[about.input]
        values = raw[:, about.input].astype(np.float64)
        found += _channel(name, values, None if source.full_scale is None else source.full_scale / source.per_count)
    if run.played and not found:
        found += _response(plan, {n: raw[:, c.input].astype(np.float64) for n, c in plan.channels.items()}, ticks < rest)
    return found


def look_at_analyzer(instrument: Records) -> list[str]:
    """What speaks against a measurement of an analyzer, before it is begun."""
    if instrument.status() & Status.OVERLOAD:
        return ["the analyzer reports an overload; choose a larger range or a lower gain"]
    return []


def look_at_record(measured: Run, plan: Plan) -> list[str]:
    """What speaks against the record that came, before it is kept."""
    if abs(measured.sample_rate / plan.instrument.sample_rate - 1.0) <= OWN:
        return []
    return [
        f"the record has {measured.sample_rate:.6g} samples a second, not {plan.instrument.sample_rate:g}; correct sample_rate, "
        "or the span on its panel"
    ]


def refuse(run: str, found: list[str]) -> None:
    """Raise what was found as one sentence.

    Raises
    ------
    PlanError
        Where anything was found.
    """
    if found:
        raise PlanError(f"run {run!r} was not taken: {'; '.join(found)}; --force takes it all the same")


def _blocks(instrument: Stream, ticks: int, rate: float) -> Iterable[Block]:
    incoming = Incoming(instrument, ticks, rate, away=SILENCE)
    instrument.start()
    yield from incoming.blocks()
    instrument.stop()
    yield from incoming.rest()


def _rate(blocks: list[Block], rate: float) -> list[str]:
    # The instrument's own clock against its own count; where it has none, this machine's, which sees what arrived only.
    first, last = blocks[0], blocks[-1]
    if first.device_time is not None and last.device_time is not None:
        passed, count, whose, tolerance = last.device_time - first.device_time, last.first_tick - first.first_tick, "its own", OWN
    else:
        passed, count, whose, tolerance = last.host_time - first.host_time, last.end_tick - first.end_tick, "this machine's", HOST
    if passed <= 0.0 or abs(count / passed / rate - 1.0) <= tolerance:
        return []
    return [f"the instrument takes {count / passed:.6g} samples a second by {whose} clock, not {rate:g}; correct sample_rate"]


def _channel(name: str, values: FloatArray, full: float | None) -> list[str]:
    if full is not None and np.abs(values).max() >= END * full:
        if np.median(np.abs(values)) >= END * full:
            return [f"{name} stands at the end of its input's range; the sensor is open or has no supply, check its cable"]
        return [f"{name} goes beyond its input's range; choose a larger range or a lower gain"]
    if np.ptp(values) == 0.0:
        return [f"{name} does not change by a single count; the sensor is dead or not plugged in, check its cable and supply"]
    return []


def _response(plan: Plan, values: dict[str, FloatArray], resting: np.ndarray) -> list[str]:
    if not resting.any() or resting.all():
        return []
    livelier = {
        name: float(v[~resting].std()) / max(float(v[resting].std()), 1e-9) for name, v in values.items()
    }  # fmt: skip
    still = [name for name, ratio in livelier.items() if ratio < LIVELIER]
    if len(still) == len(livelier):
        return ["the drive has no response on any channel; switch its amplifier on and check its cable"]
    return [f"{name} does not respond to the drive; check that its sensor is mounted and plugged in" for name in still]
