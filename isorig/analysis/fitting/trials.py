"""Runs prepared for fits: the drive interpolated once, the measured responses, their noise, and the held-out part."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from threading import Lock
from typing import NamedTuple

import msgspec
import numpy as np

from isorig.analysis.campaign import MOTION, BoolArray, Campaign, FloatArray, IntArray, Run, usable_stop
from isorig.analysis.errors import DataError
from isorig.analysis.fitting.initial_state import (
    MovingStart,
    PreparedRun,
    State,
    begins_in_motion,
    described_state,
    moving_start,
)
from isorig.analysis.fitting.linear_spectra import SHORTEST
from isorig.analysis.lowpass import fast_length
from isorig.analysis.model.linear import drifts, floats
from isorig.analysis.model.rig_model import GROUND, RigModel, Sensor, weights_of
from isorig.analysis.rounding import deviation_by_median, is_command, sensor_noise
from isorig.analysis.simulate import Excitation, record, simulate
from isorig.analysis.simulate.free_run import NOWHERE, excitation_of, true_drives
from isorig.analysis.simulate.inverse import (
    DECIMATIONS,
    EDGE,
    Motion,
    decimated,
    driven_groups,
    motion_from,
    position_from,
    required_drive,
)
from isorig.analysis.simulate.natural import lowest_mode
from isorig.analysis.simulate.sampling import FLAT, TAPS, as_held, within
from isorig.analysis.spectra.hum import hum
from isorig.analysis.spectra.noise import noise_levels, noise_of_runs, rests
from isorig.analysis.spectra.zero_errors import SLOW, wandering

#: Share of every run used for fits; the rest is held out.
FIT_SHARE = 0.6
#: Blocks of a run whose motion is compared, and the share of the whole motion that the held-out end must have: half of its share
#: of the time. A run that has come to rest before has less.
BLOCKS, STILL_MOVES = 100, 0.5 * (1.0 - FIT_SHARE)
#: Share of the motion in the fit data of such a run. Chosen: at least half of two equal moves, and not the last of three.
BETWEEN = (0.4, 0.8)
#: Motion, as a share of its largest value, up to which a run is calm between two moves, and above which a decaying one lasts.
CALM, FADED = 0.01, 1e-3
#: Share of its rms above which a drive acts. A drive that fades in does not act before: a rig held by friction moves like one
#: with a stiffer spring, which does not represent the rest of the run.
ACTS = 1.0
#: Noise of a drive computed from the motion, as a share of the recorded one, or of a velocity as a share of its rms, up to which
#: no lower corner frequency is tried, and that of a drive up to which a group of bodies is used, besides the best one. Chosen: an
#: equation of more noise shows no parameter.
QUIET, LOUD = 0.02, 0.15
#: Noise of such a drive, as a share of the recorded one, from which on runs are simulated from a known rest instead. Chosen:
#: single pulls and coarse encoders, of which the drive showed nothing, had 0.1 to 0.8; thirteen rigs that it judges up to 0.06.
HARDLY = 0.1
#: Seconds at the start of a run in which a body at rest must not move, and the number of standard deviations of its sensor's
#: noise up to which it does not. Chosen: some tens of samples of white noise reach three.
AT_REST, AWAY = 0.1, 5.0
#: Misfit of the described rig, in multiples of that noise, from which such a group is used nonetheless. Chosen: five simulated
#: rigs without play in the joint reached 1.5 at most, two with it 8 and 32.
TOLD = 5.0
#: Frequency below which the deflection between two recorded velocities is unknown, in multiples of that at which the two bodies
#: oscillate on their link. Chosen: as the slow part of an integrated deflection in the equations of motion (`equations.system`).
UNKNOWN = 0.1
#: Minimum number of samples of the shortest run after a further decimation. Chosen: as many tell a curve of twenty points.
LEFT = 200
#: Duration for which the end of a record of an imposed motion disturbs its derivatives, in periods of the corner frequency of its
#: low-pass, and the inverse of its largest share of a record. Chosen: after as many the error is below the noise.
ENDS, SHORTER = 2.5, 20
#: Errors below this share of a channel's rms do not justify a parameter: weights add it to the noise.
SIGNAL_SHARE = 0.01
#: Runs from which on more than this share of them must show that they begin in motion. Chosen: an imperfect lock, hum and a
#: baseline without friction show it in a few runs that begin at rest; records cut out of a motion in nearly all.
MANY, MOST = 3, 0.5
#: Periods of the lowest mode for which a released rig moves from which on its records tell the state at their start better than
#: the description. Chosen: within one or two a state and a friction imitate each other.
DECAYS = 5.0
#: Number of simulated motions that a trial caches: those of the baseline, the model so far, and a candidate.
CACHED = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Disturbance:
    """What shakes a run's records and does not repeat with its drive."""

    frequency: FloatArray  #: Centres of frequency bands, Hz, shape (bands,).
    level: FloatArray  #: Standard deviation of white noise that has the disturbance's density in a band, shape (channels, bands).

    def at(self, frequency: FloatArray) -> FloatArray:
        """The level at frequencies in Hz, shape (channels, frequencies)."""
        return np.stack([np.interp(frequency, self.frequency, level) for level in self.level])


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One prepared run."""

    run: Run  #: The run it comes from.
    start_time: float  #: Seconds since the start of the campaign.
    excitation: Excitation  #: The drive as recorded, interpolated.
    #: The responses' names, in the order of the model's sensors; one for each group of bodies if the drive judges the trial.
    channels: tuple[str, ...]
    measured: FloatArray  #: Their records, shape (channels, n).
    noise: FloatArray  #: Standard deviation of each channel's sensor noise up to half the sample rate, shape (channels,).
    fitted: int  #: Number of leading samples for fits.
    ceiling: float  #: Highest frequency in Hz of the residuals while a fit converges.
    onset: int = 0  #: First sample at which the drive acts: before it the rig is at rest.
    #: For a rig that no spring holds: the motion of its bodies. Such a trial is judged by its drive: `measured` is its channel,
    #: decimated, and `noisy` the same motion with additional sensor noise.
    motion: Motion | None = None
    noisy: Motion | None = None
    usable: float = np.inf  #: Highest frequency in Hz at which errors count.
    #: The start of a run that begins in motion; None of a run that begins at rest, or in a described state.
    moving: MovingStart | None = None
    disturbance: Disturbance | None = None  #: What no fit can explain; None if repeated runs show none.
    drive_noise: float = 0.0  #: Standard deviation of the sensor noise in the recorded drive, in its unit.
    lowest: float = 0.0  #: Frequency in Hz below which errors of the channels `wandering` do not count: their zero wanders.
    wandering: frozenset[str] = frozenset()  #: Their names.
    without_zero: frozenset[str] = frozenset()  #: Names of channels whose mean says nothing of the rig: `without_zero`.
    relative: FloatArray | None = None  #: The records relative to an imposed motion, shape (channels, n); None without one.

    @property
    def signal(self) -> FloatArray:
        """The records with which errors are compared, shape (channels, n)."""
        return self.measured if self.relative is None else self.relative

    @property
    def sample_rate(self) -> float:
        """Sample rate of the compared signals, Hz."""
        return self.excitation.sample_rate

    @property
    def usable_noise(self) -> FloatArray:
        """Standard deviation of each channel's sensor noise up to the usable frequency, shape (channels,)."""
        return np.asarray(self.noise * np.sqrt(min(2.0 * self.usable / self.sample_rate, 1.0)))

    @property
    def samples(self) -> int:
        """Length of the record."""
        return int(self.measured.shape[1])

    @property
    def held_out(self) -> slice:
        """The held-out samples, on which models are judged; all samples of a run that is fitted as a whole."""
        return slice(self.fitted if self.fitted < self.samples else 0, self.samples)

    @property
    def uncertain_end(self) -> int:
        """Number of last samples for which an imposed motion and its derivatives depend on how it goes on."""
        excitation = self.excitation
        corner = min(drive.corner for drive in (excitation, *excitation.others))
        return TAPS + min(round(ENDS * self.sample_rate / corner), self.samples // SHORTER)

    @property
    def prediction(self) -> str:
        """How its records are predicted, in words."""
        if self.motion is not None:
            return "the drive that the recorded motion requires"
        return "free-run simulation from the run's first sample"

    def recorded(self, name: str) -> str:
        """The channel behind a compared signal: a drive that is computed from the motion of a group of bodies is the drive's."""
        return self.channels[0] if self.motion is not None else name

    def unit_of(self, name: str) -> str:
        """Unit of a compared signal."""
        return self.run.channel(self.recorded(name)).unit

    @cached_property
    def _cache(self) -> _Cache:
        return _Cache({}, {}, {}, Lock())

    def on_grid(self, oversample: int) -> Trial:
        """The trial with that many simulation steps per sample; prepared once."""
        if oversample == self.excitation.oversample:
            return self
        with self._cache.lock:
            if oversample not in self._cache.grids:
                self._cache.grids[oversample] = replace(self, excitation=self.excitation.resampled(oversample))
            return self._cache.grids[oversample]

    def seen_of(self, model: RigModel) -> bytes:
        """All of a model that determines its records in this trial, as a key for caches."""
        chains = [sensor.chain for sensor in model.sensors]
        return model.moving_in(self.run.configuration) + msgspec.msgpack.encode(chains, enc_hook=float)

    def motion_of(self, model: RigModel, samples: int) -> dict[str, FloatArray]:
        """The true values of drive and sensors by channel in a free run of `samples`, each shape (samples,).

        The last `CACHED` motions are kept; models that differ in their sensors' faults only share one.
        """
        sound, cache = model.without_faults, self._cache
        # The state at the start follows from the records, and so from their faults.
        key = (sound.moving_in(self.run.configuration) if self.moving is None else self.seen_of(model), samples)
        with cache.lock:
            motion = cache.motions.get(key)
        if motion is None:
            response = simulate(
                sound, self.excitation, configuration=self.run.configuration, start_time=self.start_time, samples=samples,
                start=self.start_of(model),
            )  # fmt: skip
            motion = {**true_drives(sound, self.excitation, samples), **response.channels}
            with cache.lock:
                while len(cache.motions) >= CACHED:
                    del cache.motions[next(iter(cache.motions))]
                cache.motions[key] = motion
        return motion

    def start_of(self, model: RigModel) -> State:
        """The state at the first sample of a run that begins in motion, with this model; empty of any other run."""
        if self.moving is None:
            return NOWHERE
        key, cache = self.seen_of(model), self._cache
        with cache.lock:
            start = cache.starts.get(key)
        if start is None:
            start = self.moving.state(model, self.excitation)
            with cache.lock:
                while len(cache.starts) >= CACHED:
                    del cache.starts[next(iter(cache.starts))]
                cache.starts[key] = start
        return start

    def about(self, model: RigModel) -> Trial:
        """The trial for models close to one: a run that begins in motion follows its state at the start by one linear step."""
        return self if self.moving is None else replace(self, moving=self.moving.about(model, self.excitation))


class _Cache(NamedTuple):
    # What a trial has computed: its simulated motions by model and number of samples and its states at the start by model, the
    # oldest first, and itself on other grids. Several threads may simulate one trial.
    motions: dict[tuple[bytes, int], dict[str, FloatArray]]
    starts: dict[bytes, State]
    grids: dict[int, Trial]
    lock: Lock


def expected(model: RigModel, trial: Trial, motion: Mapping[str, FloatArray] | None = None) -> FloatArray:
    """Predicted records of a rig's sensors in a trial, in a free run from its first sample, shape (channels, n).

    The first records of a run that begins in motion depend on the motion before, the last ones of an imposed motion on that after
    them, those above the usable frequency on the converter's filter, the slow part of a record whose zero wanders on that zero,
    and the mean of one whose zero is unknown on that. None of these is known: there a prediction has the record's own content.
    The difference of both has passed one filter.

    Parameters
    ----------
    model
        The rig with the faults of its measurement chain. The phase of a hum is determined from the fit data.
    trial
        The run.
    motion
        The true values of drive and sensors if known already; simulated if None.

    Raises
    ------
    SimulationError
        The motion grows without bound.
    """
    if trial.motion is not None:
        return required_drive(model, trial.motion)[:, : trial.samples if motion is None else trial.fitted]
    predicted = simulated(model, trial, true_motion(model, trial, trial.samples) if motion is None else motion)
    # What precedes the first samples of a moving rig and follows the last ones of an imposed motion is not known.
    first = TAPS if trial.moving is not None else 0
    whole = model.imposed and predicted.shape[1] == trial.samples
    last = trial.samples - trial.uncertain_end if whole else predicted.shape[1]
    for row, name in enumerate(trial.channels):
        if name in trial.without_zero:
            predicted[row] += np.mean(trial.measured[row, first:last] - predicted[row, first:last])
        for unknown in (slice(first), slice(last, predicted.shape[1])):
            predicted[row, unknown] = trial.measured[row, unknown]
        if name in trial.wandering:
            recorded = trial.measured[row, : predicted.shape[1]]
            predicted[row] = recorded + _quick(predicted[row] - recorded, trial.lowest, trial.sample_rate)
    if trial.usable >= trial.sample_rate / 2.0:
        return predicted
    measured = trial.measured[:, : predicted.shape[1]]
    return np.asarray(measured + within(predicted - measured, trial.usable, trial.sample_rate))


def _quick(error: FloatArray, lowest: float, rate: float) -> FloatArray:
    # Without its part below a frequency; without delay. The first sample may be wrong: no other part is mirrored about it.
    from scipy.signal import butter, sosfiltfilt

    return np.asarray(error - sosfiltfilt(butter(2, lowest, fs=rate, output="sos"), error, padtype="even"))


def relative(model: RigModel, measured: FloatArray, drive: FloatArray) -> FloatArray | None:
    """Records relative to the motion that the drive imposes, where that is less of them; None without an imposed motion.

    A body that moves nearly as its base shows little of what is between them, and errors are compared with that.

    Parameters
    ----------
    model
        The rig.
    measured
        Shape (channels, n).
    drive
        Shape (n,).
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


def simulated(model: RigModel, trial: Trial, motion: Mapping[str, FloatArray]) -> FloatArray:
    """Records of a rig's sensors at all frequencies, from the true values of drive and sensors, shape (channels, n)."""
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
    return trial.motion_of(model, trial.samples if samples is None else samples)


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
    if drifting and (judged := _by_drive(campaign, model, noises)):
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
        if still:
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
    return _with_decays_held_out(_with_starts(trials, model), free)


def _with_starts(trials: Sequence[Trial], model: RigModel) -> tuple[Trial, ...]:
    # Runs of one campaign are cut alike: if most begin in motion, so do all whose initial state is not described. A described
    # state is as accurate as a hand and a trigger are, and a decay repeats its error for many periods: the records tell more.
    rest, released = dict[int, PreparedRun](), dict[int, PreparedRun]()
    for index, trial in enumerate(trials):
        if trial.motion is None:
            described = described_state(model, trial.run.configuration)
            (released if described else rest)[index] = PreparedRun(
                configuration=trial.run.configuration, start_time=trial.start_time, excitation=trial.excitation,
                measured=trial.measured, noise=trial.noise,
            )  # fmt: skip
    moving = sum(begins_in_motion(model, run) for run in rest.values())
    if moving == 0 or (len(rest) >= MANY and moving <= MOST * len(rest)):
        rest = {}
    long = DECAYS / max(lowest_mode(model), 1e-9)
    decays = {index: run for index, run in released.items() if _lasting(trials[index]) >= long}
    starts = {index: moving_start(model, run, SIGNAL_SHARE) for index, run in (rest | decays).items()}
    return tuple(replace(trial, moving=starts.get(index)) for index, trial in enumerate(trials))


def _lasting(trial: Trial) -> float:
    # Seconds for which a run moves, of a decay without its end at rest.
    moving = np.diff(_course(trial.measured), prepend=0.0)
    return float(np.sum(moving > FADED * moving.max())) / BLOCKS * trial.samples / trial.sample_rate


def _with_decays_held_out(trials: Sequence[Trial], free: Collection[str]) -> tuple[Trial, ...]:
    # Of several decays of runs that nothing drives the second strongest is held out, and the others are fitted as a whole: the
    # end of a decay is its weakest part, where an effect of large motions does not show.
    alike = [k for k, trial in enumerate(trials) if trial.fitted > 0 and trial.run.id in free and decays(trial.measured)]
    if len(alike) < 2:
        return tuple(trials)
    _, judged, *_ = sorted(alike, key=lambda k: -float(np.mean(trials[k].measured ** 2)))
    fitted = {k: 0 if k == judged else trials[k].samples for k in alike}
    return tuple(replace(trial, fitted=fitted.get(k, trial.fitted)) for k, trial in enumerate(trials))


def decays(measured: FloatArray) -> bool:
    """Whether records, shape (channels, n), have a single move that decays, so that their end is at rest."""
    course = _course(measured)
    return _comes_to_rest(course) and not len(_between_moves(course))


def fit_samples(measured: FloatArray) -> int:
    """Number of leading samples of a run for fits: `FIT_SHARE` of it, or, if its end is at rest, some of its moves.

    The fit data of a run that comes to rest end at the calmest moment, so that whole moves are held out; those of a single move
    that decays end after `FIT_SHARE` of its time.

    Parameters
    ----------
    measured
        The responses, shape (channels, n).
    """
    samples = int(measured.shape[1])
    if samples < BLOCKS or not _comes_to_rest(course := _course(measured)):
        return round(FIT_SHARE * samples)
    moving, between = np.diff(course, prepend=0.0), _between_moves(course)
    if len(between):
        last = between[moving[between] <= moving[between].min()][-1]
    else:
        lasting = np.flatnonzero(moving > FADED * moving.max())
        last = lasting[round(FIT_SHARE * len(lasting)) - 1]
    return int(sum(part.shape[1] for part in np.array_split(measured, BLOCKS, axis=1)[: last + 1]))


def _course(measured: FloatArray) -> FloatArray:
    # Share of the motion until the end of each block of the run.
    power = np.stack([part.var(axis=1) for part in np.array_split(measured, BLOCKS, axis=1)])
    return np.asarray(np.cumsum(np.mean(power / np.maximum(power.sum(axis=0), 1e-300), axis=1)))


def _comes_to_rest(course: FloatArray) -> bool:
    return bool(course[-1] > 0.0 and course[-1] - course[round(FIT_SHARE * BLOCKS) - 1] < STILL_MOVES)


def _between_moves(course: FloatArray) -> IntArray:
    # Calm blocks, with enough of the motion before and after them.
    moving = np.diff(course, prepend=0.0)
    return np.flatnonzero((course >= BETWEEN[0]) & (course <= BETWEEN[1]) & (moving <= CALM * moving.max()))


def onset_of(drive: FloatArray) -> int:
    """First sample of a record that exceeds `ACTS` of its rms relative to its value at the start."""
    away = np.abs(drive - drive[0])
    return int(np.argmax(away > ACTS * np.sqrt(np.mean(away**2)))) if away.any() else 0


def _begins_at_rest(run: Run, sensors: Mapping[str, Sensor], noise: Mapping[str, float]) -> bool:
    # Whether no body moves in the first moment of a run, relative to the largest motion in such a time, and each is where a
    # simulation begins.
    first = min(max(round(AT_REST * run.sample_rate), 1), usable_stop(run) // 2)
    for sensor in sensors.values():
        values = run.channel(sensor.channel).read(0, usable_stop(run))
        most = float(np.abs(values[first:] - values[:-first] if MOTION[sensor.quantity] == 0 else values).max())
        if float(np.abs(values[:first]).max()) > max(CALM * most, AWAY * noise.get(sensor.channel, 0.0)):
            return False
    return True


def _by_drive(campaign: Campaign, model: RigModel, levels: Sequence[Mapping[str, float]]) -> tuple[Trial, ...]:
    # Empty where the motion hardly tells the drive, and simulations from a known rest tell more.
    sensors = _motion_sensors(model)
    if len(sensors) != len(model.bodies):
        raise DataError(
            f"the rig {model.name!r} has a body that no spring holds, so it is judged by the force of its drive; "
            "that takes the position or velocity of every body, absolute or relative to one whose own is measured, so measure "
            "those or add the spring to the description"
        )
    runs = [
        (run, usable_stop(run), noise) for run, noise in zip(campaign.runs, levels, strict=True) if usable_stop(run) >= SHORTEST
    ]  # fmt: skip
    if not runs:
        return ()
    shortest = min(stop for _, stop, _ in runs)
    least: tuple[float, list[tuple[Motion, Motion]], BoolArray] | None = None
    for decimation in DECIMATIONS:
        if least is not None and shortest < decimation * (LEFT + 2 * EDGE):
            break
        motions = [_motions(model, sensors, *run, decimation) for run in runs]
        noises, misfits = _shares_of_groups(model, motions)
        if least is None or float(noises.min()) < least[0]:
            least = float(noises.min()), motions, (noises <= max(LOUD, float(noises.min()))) | (misfits > TOLD * noises)
        if least[0] <= QUIET:
            break
    assert least is not None
    noise_share, motions, kept = least
    if noise_share > HARDLY and all(_begins_at_rest(run, sensors, noise) for run, _, noise in runs):
        return ()
    groups = [group for group, keep in zip(driven_groups(model), kept.tolist(), strict=True) if keep]
    names = [model.drive.channel, *(f"{model.drive.channel} of {' + '.join(group)}" for group in groups[1:])]
    found = []
    for (run, _, noise), pair in zip(runs, motions, strict=True):
        moved, noisy = (replace(motion, groups=tuple(groups)) for motion in pair)
        rate = run.sample_rate / moved.decimation
        force = decimated(moved.drive, moved.decimation)
        level = np.full(len(groups), noise.get(model.drive.channel, 0.0) / np.sqrt(moved.decimation))
        off = np.std(required_drive(model, moved) - required_drive(model, noisy), axis=1)
        found.append(
            Trial(
                run=run, start_time=campaign.seconds_since_start(run), channels=tuple(names),
                measured=np.tile(force, (len(groups), 1)), excitation=Excitation.prepare(force, rate, oversample=1), noise=level,
                fitted=0 if run.use == "holdout" else fit_samples(force[None]), ceiling=rate / 2.0, motion=moved,
                noisy=noisy, disturbance=Disturbance(frequency=np.array([0.0, rate]), level=np.tile(off[:, None], 2)),
            )
        )  # fmt: skip
    return tuple(found)


def _motion_sensors(model: RigModel) -> dict[str, Sensor]:
    # The sensor of each body's motion, that of the body to which it is relative before it. A position is preferred to a velocity,
    # whose integral counts from the start of the run.
    usable = [s for s in model.sensors if s.force_in is None and MOTION[s.quantity] < 2 and not s.arms]
    ordered, found = sorted(usable, key=lambda s: MOTION[s.quantity]), dict[str, Sensor]()
    while known := [s for s in ordered if s.body not in found and (s.relative_to == GROUND or s.relative_to in found)]:
        found[known[0].body] = known[0]
    return found


def _motions(
    model: RigModel, sensors: Mapping[str, Sensor], run: Run, stop: int, noise: Mapping[str, float], decimation: int
) -> tuple[Motion, Motion]:  # fmt: skip
    # The motion of a run with all groups of bodies, and the same with additional sensor noise.
    rate, generator = run.sample_rate, np.random.default_rng(5)

    def position(sensor: Sensor, values: FloatArray) -> FloatArray:
        return position_from(values, rate) if MOTION[sensor.quantity] else values

    clean, rough = {GROUND: np.zeros(stop)}, {GROUND: np.zeros(stop)}
    for body, sensor in sensors.items():
        values = run.channel(sensor.channel).read(0, stop)
        clean[body] = position(sensor, values) + clean[sensor.relative_to]
        with_noise = values + sensor_noise(values, noise.get(sensor.channel, 0.0), generator)
        rough[body] = position(sensor, with_noise) + rough[sensor.relative_to]
    del clean[GROUND], rough[GROUND]
    drive = run.channel(model.drive.channel).read(0, stop)
    drive = as_held(drive, 1) if is_command(drive) else drive
    # A velocity has less noise than the acceleration. Its own low-pass is as wide as that allows: a dry contact follows the sign
    # of the true velocity, which that of a low-passed one is not where a shaft oscillates above the corner frequency.
    for passed in DECIMATIONS[: DECIMATIONS.index(decimation) + 1]:
        moved, noisy = motion_from(clean, rate, drive, passed), motion_from(rough, rate, drive, passed)
        blur = {body: float(np.std(noisy.velocity[body] - moved.velocity[body])) for body in clean}
        if all(blur[body] <= QUIET * float(np.std(moved.velocity[body])) for body in clean):
            break
    channels = {body: sensor.channel for body, sensor in sensors.items()}
    groups, unknown = driven_groups(model), _unknown(model, {body for body, sensor in sensors.items() if MOTION[sensor.quantity]})
    return (
        replace(moved, blur=blur, channels=channels, groups=groups, decimation=decimation, unknown=unknown),
        replace(noisy, blur=blur, channels=channels, groups=groups, decimation=decimation, unknown=unknown),
    )


def _unknown(model: RigModel, integrated: Collection[str]) -> dict[str, float]:
    # The frequency in Hz below which the deflection of each link between two bodies with integrated velocities is unknown.
    found = {}
    for link in model.links:
        if {link.a, link.b} <= set(integrated) and link.stiffness > 0.0:
            weights = weights_of(model, link)
            of_both = sum(w**2 / body.mass for w, body in zip(weights.tolist(), model.bodies, strict=True))
            found[link.name] = UNKNOWN * float(np.sqrt(link.stiffness * of_both)) / (2.0 * np.pi)
    return found


def _shares_of_groups(model: RigModel, motions: Sequence[tuple[Motion, Motion]]) -> tuple[FloatArray, FloatArray]:
    # Noise and misfit of the drive that is computed from each group of bodies, as shares of the recorded drive.
    noise, misfit, size = 0.0, 0.0, 0.0
    for moved, noisy in motions:
        needed, drive = required_drive(model, moved), decimated(moved.drive, moved.decimation)
        noise = noise + np.mean((needed - required_drive(model, noisy)) ** 2, axis=1)
        misfit = misfit + np.mean((needed - drive) ** 2, axis=1)
        size += float(np.mean(drive**2))
    return np.sqrt(noise / max(size, 1e-300)), np.sqrt(misfit / max(size, 1e-300))
