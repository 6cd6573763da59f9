"""The same estimate from data and from simulation: every run beside its double, driven by the same record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.isolation import BROAD
from analysis.measured import Channel, ComplexArray, FloatArray, Run
from analysis.model import RigModel
from analysis.spectra import estimate
from analysis.trials import Trial, expected

#: Distance of lines in Hz (short runs have fewer, of at least this many segments), and the coherence from which a line speaks.
RESOLUTION, SEGMENTS = 0.5, 10
SPEAKS = 0.5


@dataclass(frozen=True, kw_only=True)
class Double:
    """A run as measured and as simulated.

    Parameters
    ----------
    trial
        Where it comes from.
    measured, simulated
        Two runs with the same drive.
    """

    trial: Trial
    measured: Run
    simulated: Run


@dataclass(frozen=True, kw_only=True)
class Lines:
    """Transfer functions of a response, measured and simulated, over the drive's band.

    Parameters
    ----------
    frequency
        Hz, shape (lines,).
    measured, simulated
        Complex, shape (lines,).
    std
        Relative standard deviation of the measured one's magnitude, shape (lines,).
    coherence, simulated_coherence
        Shape (lines,).
    averages
        Effective number of averages.
    """

    frequency: FloatArray
    measured: ComplexArray
    simulated: ComplexArray
    std: FloatArray
    coherence: FloatArray
    simulated_coherence: FloatArray
    averages: float

    @property
    def ratio(self) -> ComplexArray:
        """Measured over simulated, shape (lines,)."""
        return np.asarray(self.measured / self.simulated)


def doubles(model: RigModel, trials: Sequence[Trial]) -> tuple[Double, ...]:
    """Every run beside its simulation; none of a trial that is judged by its drive."""
    return tuple(_double(model, trial) for trial in trials if trial.motion is None)


def _double(model: RigModel, trial: Trial) -> Double:
    drive = _channel(model.drive.channel, trial.excitation.recorded)
    predicted = expected(model, trial)
    runs = (
        replace(trial.run, channels={c.name: c for c in (drive, *map(_channel, trial.channels, rows))}, gaps=(), spectra=())
        for rows in (trial.measured, predicted)
    )
    measured, simulated = runs
    return Double(trial=trial, measured=measured, simulated=simulated)


def _channel(name: str, values: FloatArray) -> Channel:
    return Channel(name=name, samples=values)


def halves(pairs: Sequence[Double]) -> tuple[list[Double], list[Double]]:
    """The first and the second halves of runs: how far they disagree tells what chance does to an estimate."""

    def cut(run: Run, part: slice) -> Run:
        return replace(run, channels={name: _channel(name, run.read(name)[part]) for name in run.channels})

    parts: tuple[list[Double], list[Double]] = [], []
    for pair in pairs:
        middle = len(pair.measured) // 2
        for found, part in zip(parts, (slice(0, middle), slice(middle, 2 * middle)), strict=True):
            found.append(replace(pair, measured=cut(pair.measured, part), simulated=cut(pair.simulated, part)))
    return parts


def lines(pairs: Sequence[Double], response: str, reference: str, *, coherence: float = SPEAKS) -> Lines | None:
    """The response's transfer functions averaged over runs of one rate; None where no line has that much coherence."""
    resolution = max(RESOLUTION, *(SEGMENTS / p.measured.duration for p in pairs))
    measured, simulated = (
        estimate(runs, references=[reference], channels=[response], resolution=resolution).frf(response, reference)
        for runs in ([p.measured for p in pairs], [p.simulated for p in pairs])
    )
    bands = [p.trial.run.band for p in pairs if p.trial.run.band is not None]
    low, high = (max(b[0] for b in bands), min(b[1] for b in bands)) if bands else (1.0, pairs[0].trial.sample_rate / 2.56)
    f = measured.frequency
    kept = (f >= max(low, resolution)) & (f <= high) & (measured.coherence > coherence) & (np.abs(simulated.value) > 0.0)
    if kept.sum() < 3:
        return None
    return Lines(
        frequency=f[kept], measured=measured.value[kept], simulated=simulated.value[kept],
        std=measured.magnitude_std[kept] / np.abs(measured.value[kept]), coherence=measured.coherence[kept],
        simulated_coherence=simulated.coherence[kept], averages=measured.averages,
    )  # fmt: skip


def alike(pairs: Sequence[Double]) -> dict[tuple[str, float], list[Double]]:
    """Broad-band runs by configuration and gain, in the order in which they were measured."""
    groups: dict[tuple[str, float], list[Double]] = {}
    for pair in pairs:
        run = pair.trial.run
        if run.excitation in BROAD:
            groups.setdefault((run.configuration, run.gain), []).append(pair)
    return groups
