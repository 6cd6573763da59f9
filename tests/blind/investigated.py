"""Sealed rigs behind an investigation: what is hidden plays every run that is asked for, and only its records come back.

Whether a run kept the limits is known here alone: the rig's own motion says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path

import numpy as np
from envelopes import drawn_rig
from foreign.instrument import converted
from other_envelopes import hide_other
from scipy.signal import resample
from small_rigs import UNITS, guessed

from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.model.limits import Limits
from isorig.analysis.proposals.limits import simulated_peaks
from isorig.analysis.simulate import Excitation
from isorig.rig.acquire.drive import drive_of
from isorig.rig.acquire.plan import ChannelPlan, InstrumentPlan, Plan, RunPlan
from isorig.rig.files.recording import read, write
from isorig.rig.files.rigfile import description_text
from isorig.rig.next.investigation import MeasuredRuns
from isorig.rig.virtual.levels import BEGIN, BITS, FULL_SCALE, HEAD_PER_GAIN, VIRTUAL
from isorig.rig.wire_bonder.effects import Hidden, amplitudes_of, drawn_effect, generator_of
from isorig.rig.wire_bonder.session import known_of

RATE, NOISE = 1024.0, 1e-3


@dataclass(frozen=True, kw_only=True)
class OtherDrive:
    """How a rig that is not the wire bonder is driven: samples per second, largest rms of the drive, and band in Hz."""

    rate: float
    rms: float
    band: tuple[float, float]


#: By the drive's quantity; the rms values are those of the highest level in the sessions of the other study.
OTHER_DRIVE = {
    "voltage": OtherDrive(rate=200.0, rms=3.5, band=(0.5, 20.0)), "force": OtherDrive(rate=400.0, rms=13.7, band=(0.5, 60.0)),
}  # fmt: skip
#: Seconds between two runs, and more where the motor is locked or unlocked.
PAUSE, LOCKING = 30.0, 60.0
#: Records of an instrument with converters of its own are simulated at this multiple of the sample rate.
OVER = 4
#: Gains and band that an investigation may use, and its stroke over the largest deflection of the standard plan.
GAINS, BAND, STROKE = (0.0, 100.0), (0.5, 400.0), 1.5


@dataclass(frozen=True, kw_only=True)
class Bench:
    """What a lab knows of a rig, and how it measures.

    Parameters
    ----------
    rate
        Samples per second.
    channels
        The sensors at the instrument's inputs.
    known
        The rig in the plan: known values, or its description.
    noise, full_scale
        Standard deviation of the noise and largest value by channel, in its unit.
    """

    rate: float
    channels: dict[str, ChannelPlan]
    known: dict[str, float | str]
    noise: Mapping[str, float]
    full_scale: Mapping[str, float]


@dataclass
class SealedRig:
    """A rig with something hidden in it.

    Parameters
    ----------
    hidden
        What plays.
    bench
        What the lab knows of it.
    limits
        What no run may exceed.
    seed
        Of the sensors' noise.
    converter
        The filter of the instrument's converters, one of `foreign.instrument.CONVERTERS`; None for the simulator's own.
    broken
        What every run that exceeded a limit exceeded, filled on the way.
    """

    hidden: Hidden
    bench: Bench
    limits: Limits
    seed: int
    converter: str | None = None
    broken: list[str] = field(default_factory=list)

    @property
    def plan(self) -> Plan:
        """A plan without runs: what a lab knows of the rig, and its limits."""
        instrument = InstrumentPlan(kind="framed", port="virtual", sample_rate=self.bench.rate)
        return Plan(instrument=instrument, channels=self.bench.channels, rig=self.bench.known, limits=self.limits)

    def measure(self, plan: Plan, recording: Path) -> MeasuredRuns:
        """Play the runs that the recording does not hold yet, and add them to it."""
        held = list(read(recording).runs) if recording.exists() else []
        names = {run.id for run in held}
        for run in plan.runs:
            if run.id not in names:
                held.append(self._played(plan, run, held))
        known = {name: value for name, value in plan.rig.items() if not isinstance(value, str)}
        text = plan.rig.get("description")
        description = None if text is None else str(text)
        write(recording, Campaign(runs=tuple(held), known=known, description=description, source="sealed rig"))
        return MeasuredRuns(names=[run.id for run in held])

    def _played(self, plan: Plan, asked: RunPlan, before: list[Run]) -> Run:
        rate = self.bench.rate
        n = asked.ticks(rate)
        head = np.zeros(n)
        drive = drive_of(plan.original(asked, 0)[0], 0, rate)
        head[: len(drive)] = asked.gain * drive[0 : len(drive)]
        start = _start(asked, before)
        hidden = self.hidden
        model = hidden.model
        excitation = Excitation.prepare(head, rate, oversample=16)
        broken = simulated_peaks([model], excitation, asked.configuration, start).beyond(self.limits, usable=1.0)
        if broken:
            self.broken.append(f"{asked.id}: {broken}")
        about_run = {"configuration": asked.configuration, "gain": asked.gain, "start_time": start, "run": asked.id}
        if self.converter is None:
            records = hidden.records(head, rate, **about_run)
        else:
            fine = hidden.records(resample(head, OVER * n), OVER * rate, **about_run)
            records = dict(zip(fine, converted(np.stack(list(fine.values())), OVER, self.converter, n), strict=True))
        generator = np.random.default_rng([self.seed, len(before)])
        channels = {}
        for name, values in records.items():
            whole = self.bench.full_scale[name]
            step = 2.0 * whole / 2**BITS
            shaken = values + generator.normal(0.0, self.bench.noise[name], n)
            about = self.bench.channels[name]
            channels[name] = Channel(
                name=name, samples=np.round(shaken / step).astype(np.int32), scale=step, full_scale=whole, about=VIRTUAL,
                quantity=about.quantity, unit=about.unit,
            )  # fmt: skip
        period = round(asked.period * rate) if asked.excitation == "multisine" else None
        return Run(
            id=asked.id, configuration=asked.configuration, sample_rate=rate, gain=asked.gain, channels=channels,
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
    """The wire bonder that `draw_envelope` hides under these words, for an investigation."""
    draw = generator_of(seed, kind)
    model = drawn_rig(draw)
    stroke = STROKE * amplitudes_of(model).deflection["isolation"]
    limits = Limits(stroke={"isolation": stroke}, gains=GAINS, band=BAND, seconds=60.0, lock_price=LOCKING)
    hidden = drawn_effect(kind, model, size, draw)
    names = (model.drive.channel, *(sensor.channel for sensor in model.sensors))
    bench = Bench(
        rate=RATE, channels={name: ChannelPlan(input=k, sensitivity=0.2) for k, name in enumerate(names)},
        known={**known_of(hidden.model), **hidden.known}, noise=dict.fromkeys(names, NOISE),
        full_scale=dict.fromkeys(names, FULL_SCALE),
    )  # fmt: skip
    return SealedRig(hidden=hidden, bench=bench, limits=limits, seed=seed)


def sealed_other(kind: str, size: float, seed: int) -> SealedRig:
    """A chain, two carts or a stage, described with values up to a quarter off, with something hidden in it."""
    found = hide_other(kind, size, generator_of(seed, kind))
    guess, motion = guessed(found.sound, seed), found.motion
    drive = guess.drive
    quantities = {drive.channel: drive.quantity, **{sensor.channel: sensor.quantity for sensor in guess.sensors}}
    peaks = {drive.channel: OTHER_DRIVE[drive.quantity].rms, **motion.peak}
    about = OTHER_DRIVE[drive.quantity]
    bench = Bench(
        rate=about.rate,
        channels={
            name: ChannelPlan(input=k, sensitivity=1.0, unit=UNITS[quantity], quantity=quantity)
            for k, (name, quantity) in enumerate(quantities.items())
        },
        known={"description": description_text(guess)},
        noise={name: (1e-4 if name == drive.channel else 3e-4) * peak for name, peak in peaks.items()},
        full_scale={name: 4.0 * peak for name, peak in peaks.items()},
    )  # fmt: skip
    stroke = {name: STROKE * size for name, size in motion.deflection.items()}
    gains = (0.0, float(f"{about.rms / HEAD_PER_GAIN:.3g}"))
    hidden = Hidden(
        model=found.hidden, truth=tuple((cause, place) for cause, _, place in found.truth if cause),
        outside=tuple((kind, place) for cause, kind, place in found.truth if not cause),
    )  # fmt: skip
    return SealedRig(
        hidden=hidden, bench=bench, limits=Limits(stroke=stroke, gains=gains, band=about.band, seconds=60.0), seed=seed
    )
