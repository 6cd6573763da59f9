"""Pictures: a result in, a matplotlib Figure out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from analysis.diagnose.judge import Score
from analysis.measured import FloatArray
from analysis.model import RigModel
from analysis.simulate import simulate
from analysis.trials import Trial


def misfit_figure(baseline: RigModel, extended: RigModel, trials: Sequence[Trial]) -> Figure:
    """Amplitude spectra measured and simulated, one row per run and one column per channel."""
    columns = len(trials[0].channels)
    figure = Figure(figsize=(4.2 * columns, 2.3 * len(trials)), layout="constrained")
    axes = figure.subplots(len(trials), columns, squeeze=False)
    for row, trial in enumerate(trials):
        for model, colour, label in ((baseline, "tab:red", "baseline"), (extended, "tab:blue", "extended")):
            response = simulate(
                model, trial.excitation, configuration=trial.run.configuration, start_time=trial.start_time,
                as_recorded=True,
            )  # fmt: skip
            for column, name in enumerate(trial.channels):
                frequency, error = _spectrum(response.channels[name] - trial.measured[column], trial.run.sample_rate)
                axes[row, column].loglog(frequency, error, color=colour, lw=0.8, label=f"error of the {label}")
        for column, name in enumerate(trial.channels):
            axis = axes[row, column]
            axis.loglog(
                *_spectrum(trial.measured[column], trial.run.sample_rate),
                color="0.3",
                lw=0.8,
                label="measured",
            )
            axis.axhline(
                trial.noise[column] * np.sqrt(2.0 / trial.run.sample_rate),
                color="0.7",
                lw=0.8,
                ls="--",
                label="noise",
            )
            axis.set_title(f"{trial.run.id} ({trial.run.configuration}, gain {trial.run.gain:g}): {name}", fontsize=8)
            axis.tick_params(labelsize=7)
    axes[0, 0].legend(fontsize=6)
    figure.supxlabel("frequency, Hz", fontsize=8)
    figure.supylabel("amplitude density, unit / sqrt(Hz)", fontsize=8)
    return figure


def _spectrum(values: FloatArray, rate: float, segments: int = 24) -> tuple[FloatArray, FloatArray]:
    n = len(values) // segments
    window = np.hanning(n)
    blocks = values[: n * segments].reshape(segments, n) * window
    power = (np.abs(np.fft.rfft(blocks, axis=1)) ** 2).mean(axis=0) * 2.0 / (rate * (window**2).sum())
    return np.asarray(np.fft.rfftfreq(n, 1.0 / rate)[1:], dtype=np.float64), np.asarray(np.sqrt(power[1:]), dtype=np.float64)


def scores_figure(scores: tuple[Score, Score], trials: Sequence[Trial]) -> Figure:
    """Held-out error of each run and channel, baseline beside extended model."""
    names = [f"{t.run.id} {c}" for t in trials for c in t.channels]
    figure = Figure(figsize=(9.0, 0.24 * len(names) + 1.0), layout="constrained")
    axis = figure.subplots()
    place = np.arange(len(names))
    for score, label, shift in ((scores[0], "baseline", -0.2), (scores[1], "extended", 0.2)):
        axis.barh(place + shift, score.error.ravel(), height=0.38, label=label)
    axis.set_yticks(place, names, fontsize=7)
    axis.set_xscale("log")
    axis.set_xlabel("rms(predicted - measured) / rms(measured)")
    axis.invert_yaxis()
    axis.legend(fontsize=8)
    return figure
