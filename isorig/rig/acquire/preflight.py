"""The pre-run check: a quarter of a second at rest and three with drive; refuses a faulty set-up and names the remedy.

A sample rate that looks wrong by the host's clock is observed for up to ten seconds, because a busy host may be late for one.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from isorig.analysis.campaign import FloatArray, Run
from isorig.drivers.alignment import WIRE
from isorig.drivers.block import Block, Status
from isorig.drivers.instrument import Records, Stream, in_real_time
from isorig.rig.acquire import policy
from isorig.rig.acquire.block_stream import BlockStream
from isorig.rig.acquire.drive import drive_of, load
from isorig.rig.acquire.pace import ClockDrift, Pace
from isorig.rig.acquire.plan import Plan, RunPlan
from isorig.rig.acquire.response_limits import Guard
from isorig.rig.acquire.waits import SessionWaits
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
    guard = Guard(plan, instrument)
    blocks = []
    watched = _Watched(rate) if in_real_time(instrument) else None
    for block in _blocks(instrument, rest + driven, rate, watched):
        guard.check(block)
        blocks.append(block)
    if not blocks:
        return ["no sample arrives; check that the instrument is on and scans"]
    raw = np.concatenate([block.samples for block in blocks])
    ticks = np.concatenate([np.arange(block.first_tick, block.end_tick) for block in blocks])
    found = _rate(blocks, rate, watched)
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
    """Raise the findings as one sentence.

    Raises
    ------
    PlanError
        There are findings.
    """
    if reasons:
        raise PlanError(f"run {run!r} was not started: {'; '.join(reasons)}; --force starts it anyway")


class _Watched:
    """The sample rate by the host's clock while blocks arrive."""

    def __init__(self, rate: float) -> None:
        self._rate, self._pace = rate, Pace(rate)
        self._first: Block | None = None
        self._last: Block | None = None

    def add(self, block: Block) -> None:
        """Add a block."""
        self._first, self._last = self._first or block, block
        self._pace.add(np.array([float(block.end_tick)]), np.array([block.host_time]))

    def known(self, ticks: int) -> bool:
        """Whether the rate is right as far as so many ticks show it, or was observed for long enough."""
        if self._last is None or self._last.end_tick < ticks:
            return False
        return self._passed >= policy.RATE_SECONDS or not self._wrong(self._pace.drift(), certain=False)

    @property
    def wrong(self) -> float | None:
        """The rate in Hz if it is certainly wrong."""
        drift = self._pace.drift()
        if not self._wrong(drift, certain=True):
            return None
        return self._few if drift is None else self._rate * (1.0 + 1e-6 * drift.ppm)

    @property
    def _passed(self) -> float:
        return 0.0 if self._first is None or self._last is None else self._last.host_time - self._first.host_time

    @property
    def _few(self) -> float:
        assert self._first is not None
        assert self._last is not None
        return (self._last.end_tick - self._first.end_tick) / self._passed

    def _wrong(self, drift: ClockDrift | None, *, certain: bool) -> bool:
        if drift is not None:
            return drift.beyond(policy.RATE_REFUSED) if certain else abs(drift.ppm) > 1e6 * policy.RATE_REFUSED
        return self._passed > 0.0 and abs(self._few / self._rate - 1.0) > policy.FEW_BLOCKS


def _blocks(instrument: Stream, ticks: int, rate: float, watched: _Watched | None) -> Iterable[Block]:
    incoming = BlockStream(
        instrument, ticks if watched is None else ENDLESS, rate, waits=IMPATIENT,
        stopped=lambda: watched is not None and watched.known(ticks),
    )  # fmt: skip
    instrument.start()
    for block in incoming.blocks():
        if watched is not None:
            watched.add(block)
        yield block
    instrument.stop()
    yield from incoming.rest()


def _rate(blocks: list[Block], rate: float, watched: _Watched | None) -> list[str]:
    # By the host's clock, which decides; and by the instrument's own, which is more accurate in so short a time.
    measured = None if watched is None else watched.wrong
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
    if full is not None and np.abs(values).max() >= policy.FULL_SCALE_SHARE * full:
        if np.median(np.abs(values)) >= policy.FULL_SCALE_SHARE * full:
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
    still = [name for name, ratio in livelier.items() if ratio < policy.RESPONSE_RATIO]
    if len(still) == len(livelier):
        return ["the drive causes no response on any channel; switch its amplifier on and check its cable"]
    return [f"{name} does not respond to the drive; check that its sensor is mounted and connected" for name in still]
