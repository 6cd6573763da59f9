"""Runs made ready for fitting: the drive interpolated once, the measured responses, their noise, and what is held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.errors import DataError
from analysis.hum import hum
from analysis.inverse import DECIMATION, Motion, decimated, floats, motion_from, required_drive
from analysis.measured import Campaign, FloatArray, Run
from analysis.model import GROUND, RigModel
from analysis.simulate import Excitation, record, simulate, true_drive

#: Share of every run that a fit may see; the rest takes part in no fit.
FIT_SHARE = 0.6
#: Samples that a run must have before its first gap.
SHORTEST = 256
#: Errors below this share of a channel's rms are not worth a parameter: weights add it to the noise.
SIGNAL_SHARE = 0.01


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run made ready.

    Parameters
    ----------
    run
        The run it comes from.
    start_time
        Seconds since the campaign began.
    excitation
        The drive as recorded, interpolated.
    channels
        The responses' names, in the order of the model's sensors.
    measured
        What they recorded, shape (channels, n).
    noise
        Standard deviation of each channel's sensor noise, shape (channels,).
    fitted
        Number of leading samples that fits may see.
    ceiling
        Highest frequency in Hz at which residuals count while a fit converges.
    motion
        Of a rig that no spring holds: what its bodies did. Such a trial is judged by its drive: `measured` is its channel,
        decimated, and `shaken` the same motion with the sensors' noise put on once more.
    """

    run: Run
    start_time: float
    excitation: Excitation
    channels: tuple[str, ...]
    measured: FloatArray
    noise: FloatArray
    fitted: int
    ceiling: float
    motion: Motion | None = None
    shaken: Motion | None = None

    @property
    def sample_rate(self) -> float:
        """Of what is compared, Hz."""
        return self.excitation.sample_rate

    @property
    def samples(self) -> int:
        """Length of the record."""
        return int(self.measured.shape[1])


def expected(model: RigModel, trial: Trial, motion: Mapping[str, FloatArray] | None = None) -> FloatArray:
    """What a rig's sensors would have recorded in a trial, running free from its first sample, shape (channels, n).

    Parameters
    ----------
    model
        The rig with the faults of its measurement chain. The phase of a hum is taken from what fits may see.
    trial
        The run.
    motion
        The true values of drive and sensors where they are known already; simulated where None.

    Raises
    ------
    SimulationError
        Where the motion grows without bound.
    """
    if trial.motion is not None:
        return required_drive(model, trial.motion)[None, : trial.samples if motion is None else trial.fitted]
    if motion is None:
        motion = true_motion(model, trial, trial.samples)
    recorded = record(model, motion, trial.sample_rate)
    predicted = np.stack([recorded[name] for name in trial.channels])
    for row, name in enumerate(trial.channels):
        mains = model.sensor(name).chain.mains_frequency
        if mains is not None and trial.fitted > 0:
            n = min(trial.fitted, predicted.shape[1])
            left = trial.measured[row, :n] - predicted[row, :n]
            predicted[row] += hum(left, trial.sample_rate, mains, predicted.shape[1])
    return predicted


def true_motion(model: RigModel, trial: Trial, samples: int | None = None) -> dict[str, FloatArray]:
    """The true values of drive and sensors in a trial by channel, each shape (samples,); none of a trial judged by its drive."""
    if trial.motion is not None:
        return {}
    response = simulate(
        model, trial.excitation, configuration=trial.run.configuration, start_time=trial.start_time, samples=samples
    )
    return {model.drive.channel: true_drive(model, trial.excitation)[:samples], **response.channels}


def noise_levels(campaign: Campaign) -> dict[str, float]:
    """Standard deviation of each channel's sensor noise, in the channel's unit.

    The noise is taken as white. Its level is the lowest median power of any run in any quarter of the spectrum below
    0.95 of half the sample rate: somewhere neither the drive nor friction reaches. The median of a chi-square
    variable with 2 degrees of
    freedom is ln 2 times its mean.
    """
    levels: dict[str, float] = {}
    for run in campaign.runs:
        for name in run.channels:
            values = run.read(name)
            n = len(values)
            if n < 256:
                continue
            power = np.abs(np.fft.rfft(values * np.hanning(n))) ** 2 / (n * 0.375)
            top = int(0.95 * len(power))
            quarters = [np.median(part) / np.log(2.0) for part in np.array_split(power[n // 64 : top], 6)]
            level = float(np.sqrt(min(quarters)))
            levels[name] = min(level, levels.get(name, np.inf))
    return levels


def prepare(
    campaign: Campaign,
    model: RigModel,
    *,
    oversample: int = 4,
    share: float = FIT_SHARE,
    seconds: float | None = None,
    runs: Sequence[Run] | None = None,
) -> tuple[Trial, ...]:
    """Make the campaign's runs ready for fits of this rig.

    Parameters
    ----------
    campaign
        What was measured.
    model
        The rig: its drive and sensors say which channels are needed.
    oversample
        Fine steps per sample for a drive up to half the sample rate; a drive limited to a low band gets fewer.
    share
        Share of each run that fits may see; a run marked as held out gives none.
    seconds
        Cut the runs to this length (for a first look at many candidates).
    runs
        Take only these runs.

    Raises
    ------
    DataError
        Where a needed channel is missing or no run is left.
    """
    noise = noise_levels(campaign)
    trials = []
    for run in campaign.runs if runs is None else runs:
        if run.configuration not in model.configurations:
            raise DataError(
                f"run {run.id!r} has configuration {run.configuration!r}, but the rig knows only "
                f"{', '.join(model.configurations)}; add it to the rig's description"
            )
        # What comes after a gap began in a state that nobody knows.
        whole = min((gap.first_tick for gap in run.gaps), default=len(run))
        stop = whole if seconds is None else min(whole, round(seconds * run.sample_rate))
        if stop < SHORTEST:
            continue
        if floats(model):
            trials.append(_by_drive(campaign, model, run, stop, noise, share))
            continue
        drive = run.channel(model.drive.channel).read(0, stop)
        names = tuple(sensor.channel for sensor in model.sensors)
        measured = np.stack([run.channel(name).read(0, stop) for name in names])
        low = run.band is not None and run.band[1] <= run.sample_rate / 20.0
        trials.append(
            Trial(
                run=run,
                start_time=campaign.seconds_since_start(run),
                excitation=Excitation.prepare(drive, run.sample_rate, oversample=max(2, oversample // 4) if low else oversample),
                channels=names,
                measured=measured,
                noise=np.array([noise.get(name, 0.0) for name in names]),
                fitted=0 if run.use == "holdout" else round(stop * share),
                ceiling=min(run.sample_rate / 2.0, 4.0 * run.band[1] if low and run.band else run.sample_rate / 2.0),
            )
        )
    if not trials:
        raise DataError(f"{campaign.source or 'the campaign'} has no run that a fit can use; measure at least one")
    return tuple(trials)


def _by_drive(campaign: Campaign, model: RigModel, run: Run, stop: int, noise: Mapping[str, float], share: float) -> Trial:
    sensors = {sensor.body: sensor for sensor in model.sensors}
    other = next((s for s in model.sensors if s.quantity != "displacement" or s.relative_to != GROUND), None)
    if other is not None or len(sensors) != len(model.bodies):
        raise DataError(
            f"the rig {model.name!r} has a body that no spring holds, so it is judged by the force of its drive; "
            "that takes the absolute position of every body, so measure those or add the spring to the description"
        )
    generator = np.random.default_rng(5)
    positions = {body: run.channel(sensor.channel).read(0, stop) for body, sensor in sensors.items()}
    shaken = {
        body: values + generator.normal(0.0, noise.get(sensors[body].channel, 0.0), stop) for body, values in positions.items()
    }
    force = decimated(run.channel(model.drive.channel).read(0, stop))
    rate = run.sample_rate / DECIMATION
    return Trial(
        run=run, start_time=campaign.seconds_since_start(run), excitation=Excitation.prepare(force, rate, oversample=1),
        channels=(model.drive.channel,), measured=force[None, :],
        noise=np.array([noise.get(model.drive.channel, 0.0) / np.sqrt(DECIMATION)]),
        fitted=0 if run.use == "holdout" else round(len(force) * share), ceiling=rate / 2.0,
        motion=motion_from(positions, run.sample_rate), shaken=motion_from(shaken, run.sample_rate),
    )  # fmt: skip
