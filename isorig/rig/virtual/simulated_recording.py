"""Synthetic drives and whole sessions of any rig, and recordings of a simulation with the forces inside the rig."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import timedelta

import msgspec
import numpy as np

from isorig.analysis.campaign import SI_UNIT, Campaign, Channel, FloatArray, Quantity, Run
from isorig.analysis.excitations import SyntheticExcitation
from isorig.analysis.model.rig_model import Drive, RigModel
from isorig.analysis.simulate import Change, excitation, trace
from isorig.analysis.simulate.free_run import excitation_of
from isorig.rig.errors import PlanError
from isorig.rig.files.rigfile import GivenRig, description_text
from isorig.rig.model.prediction import predicted, seconds_from
from isorig.rig.virtual.levels import BEGIN, HEAD_PER_GAIN, MOVE_PER_GAIN

#: Periods of a synthetic multisine.
PERIODS = 4
#: Duration of a synthetic half sine, and its start, seconds.
PULSE, PULSE_START = 0.1, 0.1
#: Duration of a hammer hit, time between hits and before the first, seconds: a hard tip, and time for the rig to come to rest.
HIT, HIT_EVERY, HIT_START = 0.005, 4.0, 0.5
#: Maximum samples of a synthetic drive: an hour at 20 kHz, half a gigabyte for each channel.
SAMPLES_MOST = 72_000_000
#: Level of a synthetic drive that is not an acceleration: for a force in N (thesis, Fig. 6), for others 1.
FORCE_LEVEL = 500.0
#: Drive levels of a session relative to the usual one, which are its gains; one is measured twice, with another wave.
LEVELS = (1.0, 1.0, 0.5)
#: Noise of a drive's channel relative to that of sensors: what drives is measured better than what answers.
DRIVE_NOISE = 0.1
#: Seconds between two runs.
PAUSE = 10.0


@dataclass(frozen=True, kw_only=True)
class SyntheticDrive:
    """A synthetic drive."""

    #: Band-limited noise, odd random-phase multisine, logarithmic sweep, one half sine, consecutive moves, or none at all (a mass
    #: that is released).
    excitation: SyntheticExcitation
    level: float | None  #: rms (noise, multisine) or peak (others) in the drive channel's unit; by default from the gain.
    band: tuple[float, float] | None  #: Hz, for noise, multisine and sweep.
    seconds: float
    sample_rate: float  #: Hz.
    configuration: str
    gain: float = 70.0
    seed: int = 0


def usual_run(model: RigModel, configuration: str) -> SyntheticDrive:
    """A run as the rig's description says that it is usually driven."""
    return SyntheticDrive(configuration=configuration, **msgspec.structs.asdict(model.usual))


def synthetic_drive(model: RigModel, plan: SyntheticDrive) -> Campaign:
    """A campaign of one run that contains the drive only. Raises PlanError if a number of the plan cannot be used."""
    rate = plan.sample_rate
    for name, value in {"sample-rate": rate, "seconds": plan.seconds, "gain": plan.gain}.items():
        if not 0.0 < value < float("inf"):
            raise PlanError(f"--{name} is {value:g}; it must be positive and finite, so correct it")
    n = round(plan.seconds * rate)
    if n < 2:
        raise PlanError(f"{plan.seconds:g} s at {rate:g} Hz are {n} samples; at least two are needed, so increase --seconds")
    if n > SAMPLES_MOST:
        raise PlanError(
            f"{plan.seconds:g} s at {rate:g} Hz are {n:.3g} samples; at most {SAMPLES_MOST:.3g} are allowed, so reduce --seconds"
        )
    band = plan.band or ((0.5, 20.0) if plan.gain > 10.0 else (0.5, 0.39 * rate))
    if not 0.0 < band[0] < band[1] <= rate / 2.0:
        raise PlanError(f"--band is {band[0]:g} to {band[1]:g} Hz; it must ascend from above 0 to at most {rate / 2.0:g} Hz")
    if plan.level is not None and not 0.0 <= plan.level < float("inf"):
        raise PlanError(f"--level is {plan.level:g}; it must be finite and not negative, so correct it")
    period = n // PERIODS if plan.excitation == "multisine" else None
    channels = {}
    for k, drive in enumerate(model.drives):
        values = _wave(plan, n, band, _level(plan, drive), plan.seed + k)
        channels[drive.channel] = Channel(
            name=drive.channel, samples=values, quantity=drive.quantity, unit=SI_UNIT[drive.quantity]
        )
    run = Run(
        id="made_up", configuration=plan.configuration, sample_rate=rate, gain=plan.gain, channels=channels,
        excitation="other" if plan.excitation in ("half-sine", "hits") else plan.excitation, started=BEGIN,
        band=None if plan.excitation in ("half-sine", "hits", "moves", "free") else band, period=period,
    )  # fmt: skip
    return Campaign(runs=(run,), source="a made-up drive")


def _level(plan: SyntheticDrive, drive: Drive) -> float:
    if plan.level is not None:
        return plan.level
    if drive.quantity != "acceleration":
        return FORCE_LEVEL if drive.quantity == "force" else 1.0
    return plan.gain * (HEAD_PER_GAIN if plan.excitation in ("random", "multisine") else MOVE_PER_GAIN)


def _wave(plan: SyntheticDrive, n: int, band: tuple[float, float], level: float, seed: int) -> FloatArray:
    rate, values = plan.sample_rate, np.zeros(n)
    match plan.excitation:
        case "random":
            values = excitation.random(samples=n, sample_rate=rate, rms=level, band=band, seed=seed)
        case "multisine":
            values, _ = excitation.multisine(
                period=n // PERIODS, periods=PERIODS, sample_rate=rate, rms=level, band=band, seed=seed
            )
        case "sweep":
            values = excitation.sweep(samples=n, sample_rate=rate, peak=level, band=band)
        case "half-sine":
            values = excitation.half_sine(samples=n, sample_rate=rate, peak=level, length=PULSE, start=PULSE_START)
        case "hits":
            values = excitation.hits(
                samples=n, sample_rate=rate, peak=level, length=HIT, every=HIT_EVERY, start=HIT_START, seed=seed
            )
        case "moves":
            values = excitation.moves(samples=n, sample_rate=rate, peak=level)
    return values


def with_forces(given: GivenRig, campaign: Campaign) -> tuple[Campaign, Mapping[str, tuple[Change, ...]]]:
    """The runs with simulated responses and internal forces, and all stick and slip events by run.

    In addition to the sensors' channels there are `<contact>_friction` and `<link>_force` in N, transmitted from body a to body
    b, and `<contact>_held`, the share of each sample's time in which the contact sticks; see `isorig.analysis.simulate.Trace`.
    Raises RecordingError if a run lacks the drive or has a configuration that the model does not have; PlanError if a sensor has
    the name of one of these channels.
    """
    model = given.model
    simulated = predicted(model, campaign, origin=given.origin)
    runs, changes = [], {}
    for run in simulated.runs:
        drive = excitation_of(model, run)
        found = trace(model, drive, configuration=run.configuration, start_time=seconds_from(campaign, run, given.origin))
        channels = dict(run.channels)
        inner: list[tuple[str, FloatArray, Quantity]] = []
        for name, force in found.friction.items():
            inner += [(f"{name}_friction", force, "force"), (f"{name}_held", found.held[name], "gain")]
        inner += [(f"{name}_force", force, "force") for name, force in found.transmitted.items()]
        for name, values, quantity in inner:
            if name in channels:
                raise PlanError(f"the rig has a sensor {name!r}, which is the name of an internal force; rename the sensor")
            channels[name] = Channel(name=name, samples=values, quantity=quantity, unit=SI_UNIT[quantity])
        runs.append(replace(run, channels=channels))
        changes[run.id] = found.changes
    return replace(simulated, runs=tuple(runs), description=simulated.description or given.description), changes


def events_table(changes: Mapping[str, tuple[Change, ...]]) -> str:
    """All stick and slip events as text lines: run, time (s) from its first sample, contact, 0 or the sliding direction."""
    lines = [f"{run},{change.time:.12g},{change.contact},{change.slides}" for run, found in changes.items() for change in found]
    return "\n".join(["run,time,contact,slides", *lines]) + "\n"


def described_campaign(
    given: GivenRig, *, seed: int = 0, noise: float = 1e-3, seconds: float | None = None, truth: RigModel | None = None
) -> Campaign:
    """A session on a rig: in every configuration three runs, at the usual level twice and at half of it.

    It carries the rig's description. Every sensor's noise has the standard deviation `noise` as a share of the channel's rms in
    the first run; a run has its usual length if no seconds are given. `truth` is the simulated rig, if the description has
    starting values. Raises PlanError if the description's usual drive cannot be made.
    """
    model = given.model if truth is None else truth
    generator = np.random.default_rng(seed)
    runs = []
    sizes: dict[str, float] = {}
    start = 0.0
    for name in model.configurations:
        for k, level in enumerate(LEVELS):
            plan = usual_run(model, name)
            plan = replace(plan, seed=int(generator.integers(2**31)), seconds=seconds or plan.seconds)
            drive = synthetic_drive(model, plan).runs[0]
            scaled = {key: replace(channel, scale=level * channel.scale) for key, channel in drive.channels.items()}
            drive = replace(drive, id=f"{name}_{k + 1}", gain=level, channels=scaled, started=BEGIN + timedelta(seconds=start))
            start += drive.duration + PAUSE
            run = predicted(model, Campaign(runs=(drive,)), as_recorded=True).runs[0]
            channels = {}
            for key, channel in run.channels.items():
                values = channel.read()
                share = noise * (DRIVE_NOISE if key in model.drive_channels else 1.0)
                size = sizes.setdefault(key, share * float(np.std(values)))
                channels[key] = replace(channel, samples=values + generator.normal(0.0, size, len(values)), scale=1.0)
            runs.append(replace(run, channels=channels))
    return Campaign(runs=tuple(runs), description=given.description or description_text(given.model), source="a virtual rig")
