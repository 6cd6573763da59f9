"""The pre-run check: a quarter of a second at rest and three with drive; refuses a faulty set-up and names the remedy.

A sample rate that looks wrong by the host's clock is observed for up to ten seconds, because a busy host may be late for one.
"""

import shutil
from collections.abc import Sequence
from math import inf
from pathlib import Path

import numpy as np

from isorig.analysis.campaign import FloatArray, Run
from isorig.analysis.spectra.overload import FULL
from isorig.drivers.alignment import WIRE
from isorig.drivers.block import Block, Status
from isorig.drivers.instrument import Records, Stream, in_real_time
from isorig.rig.acquire import policy
from isorig.rig.acquire.block_stream import BlockStream
from isorig.rig.acquire.drive import drive_of, load
from isorig.rig.acquire.pace import Pace
from isorig.rig.acquire.plan import Plan, RunPlan
from isorig.rig.acquire.policy import SessionWaits
from isorig.rig.acquire.response_limits import Guard
from isorig.rig.errors import PlanError

#: The check ends after a second without a sample.
IMPATIENT = SessionWaits(reconnection=1.0)
#: Bytes of a stored sample, at most.
BYTES = 4
#: More ticks than any check lasts.
ENDLESS = 1 << 62
#: Status flags of the instrument or its driver that prevent a run.
REPORTED = {
    Status.OVERLOAD: "the instrument reports an overload; choose a larger range or a lower gain",
    Status.FAULT: "the instrument reports a fault; switch it off and on, and check it",
    Status.LOST: "the instrument loses samples internally; give it a lower rate or fewer inputs",
    Status.UNSURE: f"nothing shows which of the samples belong to which input after a lost byte; {WIRE}",
    Status.DISAGREES: "the instrument's counter, frame numbers and clock disagree; check its firmware and the cable",
}


def check_room(plan: Plan, output: Path) -> str | None:
    """Check that the disk has room for the session twice: for the working file and for the recording."""
    ticks = sum(run.ticks(plan.instrument.sample_rate) * run.repeats for run in plan.runs)
    needed = int(2.2 * ticks * len(plan.channels) * BYTES) + (32 << 20)
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
    rest, driven = round(policy.REST_SECONDS * rate), round(policy.DRIVEN_SECONDS * rate)
    drive = drive_of(*plan.original(run, 0), rate)[:driven] if run.played else np.zeros(driven)
    load(instrument, run, np.concatenate([np.zeros(rest), drive]), plan.limits)
    blocks = _measured(instrument, rest + driven, rate, Guard(plan, instrument))
    if not blocks:
        return ["no sample arrives; check that the instrument is on and scans"]
    raw = np.concatenate([block.samples for block in blocks])
    ticks = np.concatenate([np.arange(block.first_tick, block.end_tick) for block in blocks])
    found = _rate(blocks, rate, real_time=in_real_time(instrument))
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


def check_analyzer(instrument: Records) -> list[str]:
    """The reasons against starting a measurement with an analyzer."""
    if instrument.status() & Status.OVERLOAD:
        return ["the analyzer reports an overload; choose a larger range or a lower gain"]
    return []


def check_record(measured: Run, plan: Plan) -> list[str]:
    """The reasons against keeping a record."""
    if abs(measured.sample_rate / plan.instrument.sample_rate - 1.0) <= policy.OWN_CLOCK:
        return []
    return [
        f"its sample rate is {measured.sample_rate:.6g} Hz, not {plan.instrument.sample_rate:g} Hz; correct sample_rate, "
        "or the span on its panel"
    ]


def refuse(run: str, reasons: list[str]) -> None:
    """Raise the findings, if there are any, as a PlanError of one sentence."""
    if reasons:
        raise PlanError(f"run {run!r} was not started: {'; '.join(reasons)}; --force starts it anyway")


def _measured(instrument: Stream, ticks: int, rate: float, guard: Guard) -> list[Block]:
    # In real time until the rate is known as well.
    watched, seen = in_real_time(instrument), CheckedRate(ticks, rate)
    incoming = BlockStream(
        instrument, ENDLESS if watched else ticks, rate, waits=IMPATIENT, stopped=lambda: watched and seen.known()
    )

    def keep(block: Block) -> None:
        guard.check(block)
        seen.blocks.append(block)

    incoming.run(keep)
    return seen.blocks


class CheckedRate:
    """The blocks of a pre-run check of so many ticks, and whether they show that the stated rate is right."""

    def __init__(self, ticks: int, rate: float) -> None:
        self._ticks, self._rate, self._next = ticks, rate, -inf
        self.blocks: list[Block] = []

    def known(self) -> bool:
        """Whether the rate is right as far as the ticks show it, or was observed for long enough.

        It is asked again and again, but the rate is estimated every `RATE_ESTIMATES` seconds only: this takes longer with each
        block, and meanwhile none is read.
        """
        if not self.blocks or self.blocks[-1].end_tick < self._ticks:
            return False
        now = self.blocks[-1].host_time
        if now - self.blocks[0].host_time >= policy.RATE_SECONDS:
            return True
        if now < self._next:
            return False
        self._next = now + policy.RATE_ESTIMATES
        return _wrong_rate(self.blocks, self._rate, certain=False) is None


def _wrong_rate(blocks: Sequence[Block], rate: float, *, certain: bool = True) -> float | None:
    # The rate in Hz by the host's clock if it is wrong, certainly or by what is known now.
    pace = Pace(rate)
    pace.add(np.array([block.end_tick for block in blocks], float), np.array([block.host_time for block in blocks]))
    drift = pace.drift()
    if drift is not None:
        wrong = drift.beyond(policy.RATE_REFUSED) if certain else abs(drift.ppm) > 1e6 * policy.RATE_REFUSED
        return rate * (1.0 + 1e-6 * drift.ppm) if wrong else None
    passed = blocks[-1].host_time - blocks[0].host_time
    few = (blocks[-1].end_tick - blocks[0].end_tick) / passed if passed > 0.0 else rate
    return few if abs(few / rate - 1.0) > policy.FEW_BLOCKS else None


def _rate(blocks: Sequence[Block], rate: float, *, real_time: bool) -> list[str]:
    # By the host's clock, which decides; and by the instrument's own, which is more accurate in so short a time.
    measured = _wrong_rate(blocks, rate) if real_time else None
    if measured is not None:
        return [f"the instrument's sample rate is {measured:.6g} Hz by the host's clock, not {rate:g} Hz; correct sample_rate"]
    first, last = blocks[0], blocks[-1]
    if first.device_time is None or last.device_time is None or last.device_time <= first.device_time:
        return []
    own = (last.first_tick - first.first_tick) / (last.device_time - first.device_time)
    if abs(own / rate - 1.0) <= policy.OWN_CLOCK:
        return []
    return [f"the instrument's sample rate is {own:.6g} Hz by its own clock, not {rate:g} Hz; correct sample_rate"]


def _channel(name: str, values: FloatArray, full: float | None) -> list[str]:
    if full is not None and np.abs(values).max() >= FULL * full:
        if np.median(np.abs(values)) >= FULL * full:
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
    livelier = {name: float(v[~resting].std()) / max(float(v[resting].std()), 1e-9) for name, v in values.items()}
    still = [name for name, ratio in livelier.items() if ratio < policy.RESPONSE_RATIO]
    if len(still) == len(livelier):
        return ["the drive causes no response on any channel; switch its amplifier on and check its cable"]
    return [f"{name} does not respond to the drive; check that its sensor is mounted and connected" for name in still]
