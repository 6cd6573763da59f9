"""Runs prepared for fits of a rig: those that a simulation follows, from rest or from the state that their records show."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from isorig.analysis.campaign import MOTION, Campaign, FloatArray, Run, usable_stop
from isorig.analysis.errors import DataError
from isorig.analysis.fitting.by_drive import trials_by_drive
from isorig.analysis.fitting.held_out import fit_samples, lasting, with_decays_held_out, with_sweeps_held_out
from isorig.analysis.fitting.linear_spectra import SHORTEST
from isorig.analysis.fitting.motion_at_start import begins_in_motion, described_state, moving_start
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.lowpass import fast_length
from isorig.analysis.model.linear import drifts, floats
from isorig.analysis.model.rig_model import GROUND, RigModel
from isorig.analysis.rounding import deviation_by_median
from isorig.analysis.simulate.free_run import excitation_of
from isorig.analysis.simulate.natural import lowest_mode
from isorig.analysis.simulate.sampling import FLAT
from isorig.analysis.spectra.hits import looks_hit
from isorig.analysis.spectra.noise import noise_levels, noise_of_runs, rests
from isorig.analysis.spectra.zero_errors import SLOW, wandering

#: Share of its rms above which a drive acts. A drive that fades in does not act before: a rig held by friction moves like one
#: with a stiffer spring, which does not represent the rest of the run.
ACTS = 1.0
#: Runs from which on more than this share of them must show that they begin in motion. Chosen: an imperfect lock, hum and a
#: baseline without friction show it in a few runs that begin at rest; records cut out of a motion in nearly all.
MANY, MOST = 3, 0.5
#: Periods of the lowest mode for which a released rig moves from which on its records tell the state at their start better than
#: the description. Chosen: within one or two a state and a friction imitate each other.
DECAYS = 2.5


def relative(model: RigModel, measured: FloatArray, drive: FloatArray) -> FloatArray | None:
    """Records, shape (channels, n), relative to the motion that the drive imposes, shape (n,), where that is less of them.

    None without an imposed motion. A body that moves nearly as its base shows little of what is between them, and errors are
    compared with that.
    """
    if model.drive.imposes is None:
        return None
    absolute = [s.force_in is None and s.relative_to == GROUND and s.quantity == model.drive.quantity for s in model.sensors]
    pairs = zip(measured - drive * np.array(absolute)[:, None], measured, strict=True)
    return np.stack([min(pair, key=np.std) for pair in pairs])


def without_zero(model: RigModel, *, released: bool) -> frozenset[str]:
    """The channels whose mean in a run says nothing of the rig.

    That of a force that an imposed motion needs: a load cell's zero, what preloads a damper, and where a recorded speed began.
    That of a displacement after a release: friction holds a body off centre. That of an acceleration of a rig on springs, which
    stays.
    """
    unknown = {s.channel for s in model.sensors if s.force_in is not None and model.imposed}
    moved = model.free_free or floats(model)
    for sensor in model.sensors:
        order = MOTION.get(sensor.quantity)
        if (order == 0 and released) or (order == 2 and not moved):
            unknown.add(sensor.channel)
    return frozenset(unknown)


def zero_errors(campaign: Campaign, model: RigModel) -> dict[str, tuple[float, str]]:
    """The accelerometers on a rig that springs hold whose zero is wrong or wanders, as `wandering` gives them."""
    if model.free_free or model.imposed or floats(model) or not (lowest := lowest_mode(model)):
        return {}
    return wandering(campaign, model.drive.channel, lowest)


def drive_noises(campaign: Campaign, channel: str) -> list[float]:
    """Standard deviation of the drive channel's sensor noise in each run, in its unit.

    The spectrum of a drive with steps has no quiet part, but between its steps only noise changes: the level is that of
    `noise_of_runs`, or the white noise level from the median difference of neighbouring samples of any run if that is smaller
    than the least of these.
    """
    least = noise_levels(campaign, (channel,)).get(channel, np.inf)
    steps = [deviation_by_median(run.read(channel), 1) for run in campaign.runs if channel in run.channels and len(run) > 1]
    level = min([least, *steps])
    level = level if np.isfinite(level) else 0.0
    own = (noise.get(channel, 0.0) for noise in noise_of_runs(campaign, (channel,)))
    return [each if each > least else level for each in own]


def prepare(campaign: Campaign, model: RigModel, *, oversample: int = 4) -> tuple[Trial, ...]:
    """Prepare the campaign's runs for fits of this rig; a run at rest is used for the noise only.

    Parameters
    ----------
    campaign
        The measurement.
    model
        The rig: its drive and sensors determine the required channels.
    oversample
        Simulation steps per sample for a drive up to half the sample rate; a drive limited to a low band gets fewer.

    Raises
    ------
    DataError
        A required channel is missing or no run remains.
    """
    noises = noise_of_runs(campaign, tuple(drive.channel for drive in model.drives))
    lowest, wrong = SLOW * lowest_mode(model), frozenset(zero_errors(campaign, model))
    trials, free, released = list[Trial](), set[str](), list[Run]()
    # Without a drive there is no force to judge by: a run-down is simulated from its described start.
    drifting = drifts(model, min((run.duration for run in campaign.runs), default=0.0)) and not all(
        rests(run.read(d.channel), noise.get(d.channel, 0.0))
        for run, noise in zip(campaign.runs, noises, strict=True) for d in model.drives
    )  # fmt: skip
    for run in campaign.runs:
        if run.configuration not in model.configurations:
            raise DataError(
                f"run {run.id!r} has configuration {run.configuration!r}, but the rig knows only "
                f"{', '.join(model.configurations)}; add it to the rig's description"
            )
    if drifting and (judged := trials_by_drive(campaign, model, noises)):
        return judged
    for run, noise, of_drive in zip(campaign.runs, noises, drive_noises(campaign, model.drive.channel), strict=True):
        stop = usable_stop(run)
        if stop < SHORTEST:
            continue
        drive = run.channel(model.drive.channel).read(0, stop)
        still = all(rests(run.channel(d.channel).read(0, stop), noise.get(d.channel, 0.0)) for d in model.drives)
        if still and not described_state(model, run.configuration):
            released.append(run)
            continue
        if still or looks_hit(run, model.drive.channel):
            free.add(run.id)
        names = tuple(sensor.channel for sensor in model.sensors)
        measured = np.stack([run.channel(name).read(0, stop) for name in names])
        low = run.band is not None and run.band[1] <= run.sample_rate / 20.0
        trials.append(
            Trial(
                run=run,
                start_time=campaign.seconds_since_start(run),
                excitation=excitation_of(model, run, oversample=max(2, oversample // 4) if low else oversample, stop=stop),
                channels=names,
                measured=measured,
                noise=np.array([noise.get(name, 0.0) for name in names]),
                fitted=0 if run.use == "holdout" else fast_length(fit_samples(measured)),
                ceiling=min(run.sample_rate / 2.0, 4.0 * run.band[1] if low and run.band else run.sample_rate / 2.0),
                onset=onset_of(drive),
                usable=min(run.usable, FLAT * run.sample_rate),
                drive_noise=of_drive,
                lowest=lowest,
                wandering=wrong,
                without_zero=without_zero(model, released=still),
                relative=relative(model, measured, drive),
            )
        )
    if not trials and released:
        raise DataError(
            f"nothing drives run {released[0].id!r}, and the description gives no start for it; give initial_position or "
            f"initial_velocity in configurations.{released[0].configuration}, or measure a run with a drive"
        )
    if not trials:
        raise DataError(f"{campaign.source or 'the campaign'} has no run that a fit can use; measure at least one")
    return with_sweeps_held_out(with_decays_held_out(_with_starts(trials, model), free))


def _with_starts(trials: Sequence[Trial], model: RigModel) -> tuple[Trial, ...]:
    # Runs of one campaign are cut alike: if most begin in motion, so do all whose initial state is not described. A described
    # state is as accurate as a hand and a trigger are, and a decay repeats its error for many periods, a rig that no spring holds
    # for good: the records tell more.
    rest, released = dict[int, Trial](), dict[int, Trial]()
    for index, trial in enumerate(trials):
        if trial.motion is None:
            (released if described_state(model, trial.run.configuration) else rest)[index] = trial
    moving = sum(begins_in_motion(model, run) for run in rest.values())
    if moving == 0 or (len(rest) >= MANY and moving <= MOST * len(rest)):
        rest = {}
    lowest = lowest_mode(model)
    long = DECAYS / lowest if lowest else 0.0
    decays = {index: run for index, run in released.items() if lasting(run) >= long}
    starts = {index: moving_start(model, run) for index, run in (rest | decays).items()}
    return tuple(replace(trial, moving=starts.get(index)) for index, trial in enumerate(trials))


def onset_of(drive: FloatArray) -> int:
    """First sample of a record that exceeds `ACTS` of its rms relative to its value at the start."""
    away = np.abs(drive - drive[0])
    return int(np.argmax(away > ACTS * np.sqrt(np.mean(away**2)))) if away.any() else 0
