"""Measured/simulated pairs: every run and its simulation with the same drive, estimated in the same way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from isorig.analysis.campaign import BROAD, Channel, ComplexArray, FloatArray, Run
from isorig.analysis.fitting.trials import Trial, expected
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.spectra.welch import Spectra, estimate

#: Frequency resolution in Hz (coarser for short runs, with at least this many segments), and minimum coherence of a usable bin.
RESOLUTION, SEGMENTS = 0.5, 10
SPEAKS = 0.5


@dataclass(frozen=True, kw_only=True)
class Double:
    """A measured/simulated pair of a run."""

    trial: Trial  #: Its origin.
    #: Two runs with the same drive.
    measured: Run
    simulated: Run
    drive: str  #: The drive channel.


@dataclass(frozen=True, kw_only=True)
class Lines:
    """Transfer functions of a response, measured and simulated, within the drive's band."""

    frequency: FloatArray  #: Hz, shape (bins,).
    #: Complex, shape (bins,).
    measured: ComplexArray
    simulated: ComplexArray
    std: FloatArray  #: Relative standard deviation of the measured one's magnitude, shape (bins,).
    #: Shape (bins,); the simulated one with the sensor's noise.
    coherence: FloatArray
    simulated_coherence: FloatArray
    averages: float  #: Effective number of averages.

    @property
    def ratio(self) -> ComplexArray:
        """Measured divided by simulated, shape (bins,)."""
        return np.asarray(self.measured / self.simulated)


@dataclass(frozen=True)
class Group:
    """Runs of one configuration and gain, in order of measurement; their spectra are estimated once."""

    pairs: tuple[Double, ...]

    @cached_property
    def spectra(self) -> tuple[Spectra, Spectra]:
        """Measured and simulated spectra of all channels, averaged over the runs."""
        reference = [self.pairs[0].drive]
        return (
            estimate([p.measured for p in self.pairs], references=reference, resolution=self.resolution, jackknife=False),
            estimate([p.simulated for p in self.pairs], references=reference, resolution=self.resolution, jackknife=False),
        )

    @property
    def resolution(self) -> float:
        """Frequency resolution, Hz."""
        return max(RESOLUTION, *(SEGMENTS / p.measured.duration for p in self.pairs))

    def lines(self, response: str, *, coherence: float = SPEAKS) -> Lines | None:
        """The response's transfer functions from the drive; None if no frequency bin has the required coherence."""
        measured, simulated = (spectra.frf(response, self.pairs[0].drive) for spectra in self.spectra)
        bands = [p.trial.run.band for p in self.pairs if p.trial.run.band is not None]
        top = self.pairs[0].trial.sample_rate / 2.56
        low, high = (max(b[0] for b in bands), min(b[1] for b in bands)) if bands else (1.0, top)
        f = measured.frequency
        kept = (f >= max(low, self.resolution)) & (f <= high) & (measured.coherence > coherence) & (np.abs(simulated.value) > 0.0)
        if kept.sum() < 3:
            return None
        return Lines(
            frequency=f[kept], measured=measured.value[kept], simulated=simulated.value[kept],
            std=measured.magnitude_std[kept] / np.abs(measured.value[kept]), coherence=measured.coherence[kept],
            simulated_coherence=simulated.coherence[kept] * self._clean_share(response)[kept], averages=measured.averages,
        )  # fmt: skip

    def _clean_share(self, response: str) -> FloatArray:
        # Share of a recorded power due to the simulated motion: the sensor's noise lowers the coherence by it.
        trial = self.pairs[0].trial
        density = 2.0 * trial.noise[trial.channels.index(response)] ** 2 / trial.sample_rate
        power = self.spectra[1].density(response)
        return np.asarray(power / np.maximum(power + density, 1e-300))

    @cached_property
    def halves(self) -> tuple[Group, Group]:
        """The first and the second halves of the runs: their difference shows the random error of an estimate."""

        def cut(pair: Double, second: bool) -> Double:
            middle = len(pair.measured) // 2
            part = slice(middle, 2 * middle) if second else slice(0, middle)
            measured, simulated = (
                replace(run, channels={name: Channel(name=name, samples=run.read(name)[part]) for name in run.channels})
                for run in (pair.measured, pair.simulated)
            )
            return replace(pair, measured=measured, simulated=simulated)

        first, second = (Group(tuple(cut(pair, last) for pair in self.pairs)) for last in (False, True))
        return first, second


@dataclass(frozen=True)
class Doubles:
    """All measured/simulated pairs; none for a trial that is judged by its drive."""

    pairs: tuple[Double, ...]

    @cached_property
    def groups(self) -> dict[tuple[str, float], Group]:
        """Broad-band runs by configuration and gain, in order of measurement."""
        found: dict[tuple[str, float], list[Double]] = {}
        for pair in self.pairs:
            run = pair.trial.run
            if run.excitation in BROAD:
                found.setdefault((run.configuration, run.gain), []).append(pair)
        return {key: Group(tuple(pairs)) for key, pairs in found.items()}


def doubles(model: RigModel, trials: Sequence[Trial]) -> Doubles:
    """Every run with its simulation."""
    return Doubles(tuple(_double(model, trial) for trial in trials if trial.motion is None))


def _double(model: RigModel, trial: Trial) -> Double:
    drive = Channel(name=model.drive.channel, samples=trial.excitation.recorded)
    measured, simulated = (
        replace(
            trial.run, gaps=(), spectra=(),
            channels={
                drive.name: drive,
                **{name: Channel(name=name, samples=row) for name, row in zip(trial.channels, rows, strict=True)},
            },
        )
        for rows in (trial.measured, expected(model, trial))
    )  # fmt: skip
    return Double(trial=trial, measured=measured, simulated=simulated, drive=drive.name)
