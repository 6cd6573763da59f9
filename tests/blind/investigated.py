"""Sealed rigs behind an investigation: what is hidden plays every run that is asked for, and only its records come back.

Whether a run kept the limits is known here alone: the rig's own motion says so.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path

import numpy as np

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.model.limits import Limits
from isorig.analysis.proposals.limits import simulated_peaks
from isorig.analysis.simulate import Excitation
from isorig.rig.acquire.drive import drive_of
from isorig.rig.acquire.plan import ChannelPlan, InstrumentPlan, Plan, RunPlan
from isorig.rig.files.recording import read, write
from isorig.rig.next.course import Measured
from isorig.rig.virtual.campaign import BEGIN, BITS, FULL_SCALE, VIRTUAL, known_of
from isorig.rig.virtual.effects import KINDS, Hidden, drawn_effect, drawn_rig, scale_of

RATE, NOISE = 1024.0, 1e-3
#: Seconds between two runs, and more where the motor is locked or unlocked.
PAUSE, LOCKING = 30.0, 60.0
#: Gains and band that an investigation may use, and its stroke over the largest deflection of the standard plan.
GAINS, BAND, STROKE = (0.0, 100.0), (0.5, 400.0), 1.5


@dataclass
class SealedRig:
    """A rig with something hidden in it.

    Parameters
    ----------
    hidden
        What plays.
    limits
        What no run may exceed.
    seed
        Of the sensors' noise.
    broken
        What every run that exceeded a limit exceeded, filled on the way.
    """

    hidden: Hidden
    limits: Limits
    seed: int
    broken: list[str] = field(default_factory=list)

    @property
    def plan(self) -> Plan:
        """A plan without runs: what a lab knows of the rig, and its limits."""
        model = self.hidden.model
        names = (model.drive.channel, *(sensor.channel for sensor in model.sensors))
        channels = {name: ChannelPlan(input=k, sensitivity=0.2) for k, name in enumerate(names)}
        instrument = InstrumentPlan(kind="framed", port="virtual", sample_rate=RATE)
        known: dict[str, float | str] = {**known_of(model), **self.hidden.known}
        return Plan(instrument=instrument, channels=channels, rig=known, limits=self.limits)

    def measure(self, plan: Plan, recording: Path) -> Measured:
        """Play the runs that the recording does not hold yet, and add them to it."""
        held = list(read(recording).runs) if recording.exists() else []
        names = {run.id for run in held}
        for run in plan.runs:
            if run.id not in names:
                held.append(self._played(plan, run, held))
        known = {name: value for name, value in plan.rig.items() if not isinstance(value, str)}
        write(recording, Campaign(runs=tuple(held), known=known, source="sealed rig"))
        return Measured(names=[run.id for run in held])

    def _played(self, plan: Plan, asked: RunPlan, before: list[Run]) -> Run:
        n = asked.ticks(RATE)
        head = np.zeros(n)
        drive = drive_of(plan.original(asked, 0)[0], 0, RATE)
        head[: len(drive)] = asked.gain * drive[0 : len(drive)]
        start = _start(asked, before)
        hidden = self.hidden
        model = hidden.model
        excitation = Excitation.prepare(head, RATE, oversample=16)
        broken = simulated_peaks([model], excitation, asked.configuration, start).beyond(self.limits, usable=1.0)
        if broken:
            self.broken.append(f"{asked.id}: {broken}")
        records = hidden.records(
            head, RATE, configuration=asked.configuration, gain=asked.gain, start_time=start, run=asked.id
        )  # fmt: skip
        generator = np.random.default_rng([self.seed, len(before)])
        records = {name: values + generator.normal(0.0, NOISE, n) for name, values in records.items()}
        step = 2.0 * FULL_SCALE / 2**BITS
        channels = {
            name: Channel(
                name=name, samples=np.round(values / step).astype(np.int32), scale=step, full_scale=FULL_SCALE, about=VIRTUAL
            )
            for name, values in records.items()
        }
        period = round(asked.period * RATE) if asked.excitation == "multisine" else None
        return Run(
            id=asked.id, configuration=asked.configuration, sample_rate=RATE, gain=asked.gain, channels=channels,
            excitation=asked.recorded_as, started=BEGIN + timedelta(seconds=start), period=period, band=asked.band,
            repeat_of=asked.repeat_of,
        )  # fmt: skip


def _start(asked: RunPlan, before: list[Run]) -> float:
    if not before:
        return 0.0
    last = before[-1]
    assert last.started is not None
    end = (last.started - BEGIN).total_seconds() + last.duration
    return end + PAUSE + (LOCKING if last.configuration != asked.configuration else 0.0)


def sealed(kind: str, size: float, seed: int) -> SealedRig:
    """The rig that `draw_envelope` hides under these words, for an investigation."""
    draw = np.random.default_rng([seed, KINDS.index(kind)])
    model = drawn_rig(draw)
    stroke = STROKE * scale_of(model).deflection["isolation"]
    limits = Limits(stroke={"isolation": stroke}, gains=GAINS, band=BAND, seconds=60.0, lock_price=LOCKING)
    return SealedRig(hidden=drawn_effect(kind, model, size, draw), limits=limits, seed=seed)
