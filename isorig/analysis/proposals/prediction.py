"""Predictions of models for a possible run, and their distance after the rival is refitted.

A run's prediction is the weighted record of every sensor, in units of the allowed error of one frequency bin (noise and accuracy
of the simulation). Before two models are compared, the fitted one takes a linear step of all its parameters, given all existing
and new runs (T-criterion of Atkinson and Fedorov 1975; without the step, runs rank high whose differences the rival can absorb).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TypeVar

import msgspec
import numpy as np

from isorig.analysis.campaign import Channel, FloatArray, Run
from isorig.analysis.deadline import ask_time
from isorig.analysis.errors import ModelError, OutOfTimeError
from isorig.analysis.fitting.excess import SIMULATION_LIMIT
from isorig.analysis.fitting.held_out import FIT_SHARE
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.screen import Progress
from isorig.analysis.fitting.solve import Free, at_coordinates, coordinates_of, jacobian_of, slopes_of
from isorig.analysis.fitting.trials import Trial
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.proposals.limits import LargestMotions, simulated_peaks
from isorig.analysis.proposals.menu import CandidateRun
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.simulate import Excitation

#: A cause and its place.
Key = tuple[str, str]
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Variant:
    """A model to be distinguished from others: its fitted parameters, and their uncertainty."""

    #: Names in the findings; both empty for the rig as described.
    cause: str
    location: str
    #: The rig and its fitted parameters; none for a hypothetical cause.
    model: RigModel
    free: tuple[Free, ...] = ()
    #: Of the fitted values, in their units, shape (k, k).
    covariance: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    #: Hum on a channel: (channel, amplitude in its unit, frequency in Hz); None for no hum.
    hum: tuple[str, float, float] | None = None
    detail: str = ""  #: What distinguishes it from others of the same cause and place, in words; empty if it is the only one.

    @property
    def key(self) -> Key:
        """Cause and location."""
        return self.cause, self.location

    @property
    def coordinates(self) -> FloatArray:
        """Search coordinates of the fitted values, shape (k,)."""
        return coordinates_of(self.model, self.free)

    @property
    def covariance_of_coordinates(self) -> FloatArray:
        """Covariance of the search coordinates, shape (k, k)."""
        slope = slopes_of(self.model, self.free)
        return np.asarray(self.covariance / np.outer(slope, slope))

    def at(self, coordinates: FloatArray) -> RigModel:
        """The model with fitted values at other search coordinates, shape (k,). Raises ModelError if physics excludes them."""
        return at_coordinates(self.model, self.free, coordinates)


@dataclass(frozen=True, kw_only=True)
class Prospect:
    """A run with its drive, to be predicted."""

    run: CandidateRun
    drive: FloatArray  #: The recorded drive channel, in its unit, shape (n,).
    sample_rate: float  #: Hz.
    start_time: float  #: Seconds from the campaign's first sample.

    def shortened(self, seconds: float) -> Prospect:
        """The same run with at most this duration."""
        if seconds >= self.run.seconds:
            return self
        return replace(self, run=replace(self.run, seconds=seconds), drive=self.drive[: round(seconds * self.sample_rate)])

    def excitation(self, *, whole: bool = False) -> Excitation:
        """The prepared drive: the part needed for comparisons, or the whole."""
        n = len(self.drive) if whole or self.run.excitation == "sweep" else round(POLICY.simulated_seconds * self.sample_rate)
        return Excitation.prepare(self.drive[:n], self.sample_rate, oversample=POLICY.steps_per_sample)

    def measured(self, channels: Mapping[str, FloatArray]) -> Run:
        """The run with records, each of shape (n,), in the channels' units."""
        return Run(
            id="prospect", configuration=self.run.configuration, sample_rate=self.sample_rate, gain=self.run.gain,
            channels={name: Channel(name=name, samples=values) for name, values in channels.items()},
        )  # fmt: skip

    def peaks(self, models: Sequence[RigModel], *, whole: bool = False) -> LargestMotions:
        """The largest motions of any of the models, in the part needed for comparisons or in the whole run."""
        return simulated_peaks(models, self.excitation(whole=whole), self.run.configuration, self.start_time)


@dataclass(frozen=True, kw_only=True)
class Moments:
    """Products of a difference between two models' predictions and the derivatives of the fitted one, by channel, for one run.

    All are means over the frequency bins of the records, in units of the allowed error.
    """

    square: FloatArray  #: Mean square of the difference, shape (channels,).
    slope: FloatArray  #: Difference times derivatives, shape (channels, k).
    normal: FloatArray  #: Derivatives times derivatives, shape (channels, k, k).
    weight: float  #: Number of frequency bins of the run in a fit.


@dataclass(frozen=True, kw_only=True)
class Slopes:
    """A fitted model's derivatives in a run, shape (channels, bins, k), and their products, shape (channels, k, k)."""

    rows: FloatArray
    normal: FloatArray


class Predicted:
    """A possible run as simulated with models; the noise is its standard deviation by channel, including the drive.

    The response of the model `reference` determines the allowed error: the sensors' noise, the noise of the drive propagated
    through the rig, and `SIMULATION_LIMIT` of the response.
    """

    def __init__(self, prospect: Prospect, noise: Mapping[str, float], reference: RigModel) -> None:
        excitation, rate = prospect.excitation(), prospect.sample_rate
        self.prospect = prospect
        self.channels = tuple(sensor.channel for sensor in reference.sensors)
        self._n = len(excitation.recorded)
        shaken = np.random.default_rng(7).normal(0.0, noise.get(reference.drive.channel, 0.0), self._n)
        clean, other = (
            self._records(self._problem(Excitation.prepare(drive, rate, oversample=POLICY.steps_per_sample)), [reference])[0]
            for drive in (excitation.recorded, excitation.recorded + shaken)
        )
        own = np.array([noise.get(name, 0.0) for name in self.channels])
        through = np.mean((clean - other) ** 2, axis=1)
        #: Allowed error in each channel, in its unit, shape (channels,).
        self.allowed = np.sqrt(own**2 + through + SIMULATION_LIMIT**2 * np.mean(clean**2, axis=1))
        self._whole = self._problem(excitation)

    @property
    def weight(self) -> float:
        """Number of frequency bins of the run's full length in a fit."""
        return FIT_SHARE * self.prospect.run.seconds * self.prospect.sample_rate

    def records(self, variants: Sequence[Variant]) -> FloatArray:
        """The sensors' records as frequency bins, in units of the allowed error, shape (variants, channels, bins).

        NaN if a motion grows without bound.
        """
        found = self._records(self._whole, [variant.model for variant in variants]) / self.allowed[:, None]
        for k, variant in enumerate(variants):
            if variant.hum is not None:
                channel, amplitude, frequency = variant.hum
                row = self.channels.index(channel)
                wave = amplitude * np.sin(2.0 * np.pi * frequency * np.arange(self._n) / self.prospect.sample_rate)
                # As `Waveform` transforms a record of unit noise.
                spectrum = np.fft.rfft(wave) * np.sqrt(2.0 / self._n)
                found[k, row] += np.concatenate([spectrum.real, spectrum.imag]) / self.allowed[row]
        return np.asarray(found)

    def slopes(self, variant: Variant) -> Slopes:
        """Derivatives of its records with respect to the search coordinates of its fitted values."""
        here = self._whole.residuals([_bare(variant.model)])[0]
        columns = jacobian_of(self._whole, lambda c: _bare(variant.at(c)), variant.coordinates, variant.free, here)
        rows = np.moveaxis(self._by_channel(columns.T), 0, -1) / self.allowed[:, None, None]
        return Slopes(rows=rows, normal=np.einsum("clk,clm->ckm", rows, rows, optimize=True) / rows.shape[1])

    def moments(self, truth: FloatArray, fitted: FloatArray, slopes: Slopes) -> Moments:
        """The products for a true cause's records, shape (channels, bins), and a fitted model with other predictions."""
        difference = fitted - truth
        return Moments(
            square=np.mean(difference**2, axis=1), weight=self.weight, normal=slopes.normal,
            slope=np.einsum("cl,clk->ck", difference, slopes.rows) / truth.shape[1],
        )  # fmt: skip

    def record(self, lines: FloatArray, channel: str) -> FloatArray:
        """A channel's record of frequency bins, shape (bins,), transformed to time in its unit, shape (n,)."""
        row = self.channels.index(channel)
        real, imaginary = np.split(lines * self.allowed[row], 2)
        return np.asarray(np.fft.irfft((real + 1j * imaginary) / np.sqrt(2.0 / self._n), self._n))

    def _problem(self, excitation: Excitation) -> Problem:
        silent = Trial(
            run=self.prospect.measured({}), start_time=self.prospect.start_time, excitation=excitation, channels=self.channels,
            measured=np.zeros((len(self.channels), self._n)), noise=np.ones(len(self.channels)), fitted=self._n,
            ceiling=self.prospect.sample_rate / 2.0,
        )  # fmt: skip
        return Problem([silent], share=0.0)

    def _records(self, problem: Problem, models: Sequence[RigModel]) -> FloatArray:
        return self._by_channel(problem.residuals([_bare(model) for model in models]))

    def _by_channel(self, rows: FloatArray) -> FloatArray:
        # Real parts of all channels come first, then imaginary ones: shape (models, channels, bins).
        parts = rows.reshape(len(rows), 2, len(self.channels), -1)
        return np.concatenate([parts[:, 0], parts[:, 1]], axis=2)


def _bare(model: RigModel) -> RigModel:
    # The phase of a hum is unknown before it is measured.
    if all(sensor.chain.mains_frequency is None for sensor in model.sensors):
        return model
    chains = {s.channel: msgspec.structs.replace(s.chain, mains_frequency=None) for s in model.sensors}
    return msgspec.structs.replace(
        model, sensors=tuple(msgspec.structs.replace(s, chain=chains[s.channel]) for s in model.sensors)
    )


def refit(free: Sequence[Free], moments: Sequence[Moments]) -> FloatArray:
    """The linear step of a model's search coordinates that minimizes its distance from a true cause in several runs, shape (k,).

    NaN if a motion grows without bound.
    """
    normal, slope = np.diag(prior_precision(free)), np.zeros(len(free))
    for run in moments:
        normal = normal + run.weight * run.normal.sum(axis=0)
        slope = slope + run.weight * run.slope.sum(axis=0)
    if not (np.isfinite(slope).all() and np.isfinite(normal).all()):
        return np.full(len(free), np.nan)
    return np.asarray(-np.linalg.solve(normal, slope)) if len(free) else slope


def remaining_distance(run: Moments, step: FloatArray) -> FloatArray:
    """Distance of a true cause from a rival after its linear step, shape (channels,): root mean square over a run's bins.

    In units of the allowed error: standard errors of one frequency bin. Infinite if a motion grows without bound.
    """
    square = run.square + 2.0 * run.slope @ step + np.einsum("ckm,k,m->c", run.normal, step, step)
    return np.where(np.isfinite(square), np.sqrt(np.maximum(square, 0.0)), np.inf)


def distance(free: Sequence[Free], moments: Sequence[Moments], counted: Sequence[bool]) -> float:
    """Distance of a true cause from a refitted rival, in the worst channel of the counted runs; see `remaining_distance`.

    `moments` are those of all runs in the refit of the parameters, existing and new ones.
    """
    step = refit(free, moments)
    return max(
        (float(remaining_distance(run, step).max()) for run, counts in zip(moments, counted, strict=True) if counts), default=0.0
    )


def prior_precision(free: Sequence[Free]) -> FloatArray:
    """Prior knowledge of a model's search coordinates: the inverse of their variances, shape (k,)."""
    return np.array([(1.0 if f.log else 100.0 * f.step) * POLICY.trusted_deviation for f in free], dtype=np.float64) ** -2


def evaluated(prospects: Sequence[Prospect], evaluate: Callable[[Prospect], T], progress: Progress) -> list[tuple[Prospect, T]]:
    """Each run with its result, until the time of the deadline in force ends; `progress` is called before each."""
    found: list[tuple[Prospect, T]] = []
    with suppress(OutOfTimeError):
        for k, prospect in enumerate(prospects):
            ask_time()
            progress(f"comparing candidate {k + 1} of {len(prospects)}")
            found.append((prospect, evaluate(prospect)))
    return found


def models_within_limits(variant: Variant) -> tuple[RigModel, ...]:
    """The models of a remaining cause that must stay within the limits: the fitted one, and others drawn from its uncertainty."""
    return drawn_models(variant, POLICY.simulated_draws, 5) if variant.free else (variant.model,)


def drawn_models(variant: Variant, count: int, seed: int) -> tuple[RigModel, ...]:
    """The model and others drawn from its covariance, `count` in all; the standard deviation of a value is limited."""
    generator = np.random.default_rng(seed)
    covariance, theta = variant.covariance_of_coordinates, variant.coordinates
    most = prior_precision(variant.free) ** -0.5
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    shrink = np.minimum(1.0, most / np.maximum(std, 1e-300))
    sizes, axes = np.linalg.eigh(np.nan_to_num(covariance * np.outer(shrink, shrink)))
    found = [variant.model]
    while len(found) < count:
        moved = theta + axes @ (np.sqrt(np.maximum(sizes, 0.0)) * generator.normal(size=len(theta)))
        try:
            found.append(variant.at(moved))
        except ModelError:  # beyond what physics allows: the model itself is used instead
            found.append(variant.model)
    return tuple(found)
