"""Runs in fits: the drive interpolated once, the measured responses, their noise, the held-out part, and their predictions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from threading import Lock
from typing import NamedTuple

import msgspec
import numpy as np

from isorig.analysis.campaign import FloatArray, Run
from isorig.analysis.fitting.initial_state import MovingStart, State
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate import Excitation, record, simulate
from isorig.analysis.simulate.free_run import NOWHERE, true_drives
from isorig.analysis.simulate.inverse import (
    Motion,
    required_drive,
)
from isorig.analysis.simulate.sampling import TAPS, within
from isorig.analysis.spectra.hum import hum

#: Duration for which the end of a record of an imposed motion disturbs its derivatives, in periods of the corner frequency of its
#: low-pass, and the inverse of its largest share of a record. Chosen: after as many the error is below the noise.
ENDS, SHORTER = 2.5, 20
#: Errors below this share of a channel's rms do not justify a parameter: weights add it to the noise.
SIGNAL_SHARE = 0.01
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
