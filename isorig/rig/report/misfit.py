"""Charts that compare simulation and measurement: spectra of signal and error, time intervals, held-out errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.fitting.score import Score
from isorig.analysis.fitting.trials import Trial, expected
from isorig.analysis.model.rig_model import RigModel
from isorig.rig.report.before_after import bars_chart
from isorig.rig.report.charts import Chart, ChartTrace, Panel, Role, spread_over
from isorig.rig.report.sections import label, unit

#: Points of an amplitude spectrum, number of segments, and seconds of a time interval.
LINES = 400
SEGMENTS = 24
SECONDS = 1.5

Simulated = Mapping[str, Mapping[str, FloatArray]]


def simulated(model: RigModel, trials: Sequence[Trial]) -> Simulated:
    """The model's prediction of each run's responses, by run and channel, each shape (n,)."""
    return {trial.run.id: dict(zip(trial.channels, expected(model, trial), strict=True)) for trial in trials}


def distinct(trials: Sequence[Trial]) -> list[Trial]:
    """One run of each configuration, gain and excitation."""
    seen: dict[tuple[str, float, str], Trial] = {}
    for trial in trials:
        seen.setdefault((trial.run.configuration, trial.run.gain, trial.run.excitation), trial)
    return list(seen.values())


def misfit_charts(trials: Sequence[Trial], models: Mapping[tuple[str, Role], Simulated]) -> list[Chart]:
    """A chart for each kind of run: spectra of the measurement, of each model's error, and of the noise."""
    charts: list[Chart] = []
    for trial in distinct(trials):
        rate = trial.sample_rate
        traces = []
        for panel, name in enumerate(trial.channels):
            frequency, measured = _amplitude(trial.measured[panel], rate)
            kept = spread_over(frequency, LINES)
            traces.append(ChartTrace(name="measured", x=frequency[kept], y=measured[kept], panel=panel))
            for (title, role), responses in models.items():
                _, error = _amplitude(responses[trial.run.id][name] - trial.measured[panel], rate)
                traces.append(ChartTrace(name=f"error of the {title}", x=frequency[kept], y=error[kept], role=role, panel=panel))
            quiet = np.full(2, trial.noise[panel] * np.sqrt(2.0 / rate))
            if quiet[0] > 0.0:
                ends = frequency[[0, -1]]
                traces.append(ChartTrace(name="sensor noise", x=ends, y=quiet, role="noise", style="dash", panel=panel))
        # Text common to all charts is printed once.
        about = "." if charts else ": amplitude density of each channel and of the models' errors."
        charts.append(
            Chart(
                name=f"misfit-{trial.run.id}",
                caption=f"{label(trial.run, _alone(trials))}{about}",
                panels=[Panel(label=f"{name}, {unit(trial.unit_of(name))}/√Hz", log=True) for name in trial.channels],
                traces=traces,
                link="spectra",
            )
        )
    return charts


def _alone(trials: Sequence[Trial]) -> bool:
    # A single configuration needs no name.
    return len({trial.run.configuration for trial in trials}) == 1


def _amplitude(values: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    n = max(len(values) // SEGMENTS, 2)
    window = np.hanning(n)
    blocks = values[: len(values) // n * n].reshape(-1, n) * window
    power = (np.abs(np.fft.rfft(blocks, axis=1)) ** 2).mean(axis=0) * 2.0 / (rate * (window**2).sum())
    return np.asarray(np.fft.rfftfreq(n, 1.0 / rate)[1:]), np.asarray(np.sqrt(power[1:]))


def time_charts(trials: Sequence[Trial], models: Mapping[tuple[str, Role], Simulated]) -> list[Chart]:
    """A held-out interval of each kind of run in the first run's configuration: measured, and simulated with each model."""
    charts: list[Chart] = []
    for trial in (t for t in distinct(trials) if t.run.configuration == trials[0].run.configuration):
        rate = trial.sample_rate
        part = slice(trial.samples - round(1.5 * SECONDS * rate), trial.samples - round(0.5 * SECONDS * rate))
        seconds = np.arange(trial.samples)[part] / rate
        traces = []
        for panel, name in enumerate(trial.channels):
            traces.append(ChartTrace(name="measured", x=seconds, y=trial.measured[panel][part], panel=panel))
            for (title, role), responses in models.items():
                y = responses[trial.run.id][name][part]
                traces.append(ChartTrace(name=title, x=seconds, y=y, role=role, panel=panel, style="dash"))
        about = "." if charts else f": {SECONDS:g} s of held-out data; free-run simulation from the start of the run."
        charts.append(
            Chart(
                name=f"time-{trial.run.id}",
                caption=f"{label(trial.run, _alone(trials))}{about}",
                panels=[Panel(label=f"{name}, {unit(trial.unit_of(name))}") for name in trial.channels],
                traces=traces,
                x_label="time, s",
                x_log=False,
            )
        )
    return charts


def scores_chart(scores: Mapping[tuple[str, Role], Score], trials: Sequence[Trial]) -> Chart:
    """Held-out error of each run and channel."""
    return bars_chart(
        "held-out-error", "rms(predicted − measured) / rms(measured) of each run and channel on held-out data.",
        "held-out error, share of the signal", [f"{trial.run.id} {channel}" for trial in trials for channel in trial.channels],
        {key: score.error.ravel() for key, score in scores.items()},
    )  # fmt: skip
