"""Charts that compare simulation and measurement: spectra of the errors, parts of the records, errors and residuals as bars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.fitting.score import Score
from isorig.analysis.fitting.trials import Trial, expected
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.spectra.windows import hanning, segment_spectra
from isorig.analysis.wording import displayed_unit, sized_unit, words
from isorig.rig.report.charts import Chart, ChartTrace, Panel, Role, spread_over
from isorig.rig.report.sections import label

if TYPE_CHECKING:
    from isorig.analysis.diagnose.diagnosis import Diagnosis

#: A model in charts: its name in the legend, and its role.
Named = tuple[str, Role]
BASELINE: Named = ("baseline", "simulated")
EXTENDED: Named = ("extended model", "extended")
#: Points of an amplitude spectrum, number of segments and least samples of one, and seconds of a time interval.
POINTS = 400
SEGMENTS, SHORTEST = 24, 8
SECONDS = 1.5
#: Seconds of the interval in which the models differ most.
SECOND = 1.0
#: Seconds at the end of a record that are not shown: there the interpolation of the drive lacks its next samples.
ENDS = 0.1

#: A model's responses by run and channel, each shape (n,).
Simulated = Mapping[str, Mapping[str, FloatArray]]


def simulated(model: RigModel, trials: Sequence[Trial]) -> Simulated:
    """The model's prediction of each run's responses."""
    return {trial.run.id: dict(zip(trial.channels, expected(model, trial), strict=True)) for trial in trials}


def both_simulated(diagnosis: Diagnosis) -> dict[Named, Simulated]:
    """The predictions of a diagnosis's baseline, and of its extended model if there is one."""
    models = {BASELINE: diagnosis.baseline.model} | ({EXTENDED: diagnosis.extended.model} if diagnosis.steps else {})
    return {name: simulated(model, diagnosis.trials) for name, model in models.items()}


def _distinct(trials: Sequence[Trial]) -> list[tuple[Trial, str]]:
    # One run of each configuration, gain and excitation, with its name; a single configuration needs none.
    alone = len({trial.run.configuration for trial in trials}) == 1
    first: dict[tuple[str, float, str], Trial] = {}
    for trial in trials:
        first.setdefault((trial.run.configuration, trial.run.gain, trial.run.excitation), trial)
    return [(trial, label(trial.run, alone)) for trial in first.values()]


def misfit_charts(trials: Sequence[Trial], models: Mapping[Named, Simulated]) -> list[Chart]:
    """A chart for each kind of run: spectra of the measurement, of each model's error, and of the noise."""
    charts: list[Chart] = []
    for trial, name in _distinct(trials):
        rate = trial.sample_rate
        traces = []
        for panel, channel in enumerate(trial.channels):
            frequency, measured = _amplitude(trial.measured[panel], rate)
            kept = spread_over(frequency, POINTS)
            traces.append(ChartTrace(name="measured", x=frequency[kept], y=measured[kept], panel=panel))
            for (title, role), responses in models.items():
                _, error = _amplitude(responses[trial.run.id][channel] - trial.measured[panel], rate)
                traces.append(ChartTrace(name=f"error of the {title}", x=frequency[kept], y=error[kept], role=role, panel=panel))
            quiet = np.full(2, trial.noise[panel] * np.sqrt(2.0 / rate))
            if quiet[0] > 0.0:
                ends = frequency[[0, -1]]
                traces.append(ChartTrace(name="sensor noise", x=ends, y=quiet, role="noise", style="dash", panel=panel))
        # Text common to all charts is printed once.
        about = "." if charts else ": amplitude density of each channel and of the models' errors."
        panels = [Panel(label=f"{channel}, {displayed_unit(trial.unit_of(channel))}/√Hz", log=True) for channel in trial.channels]
        charts.append(
            Chart(name=f"misfit-{trial.run.id}", caption=f"{name}{about}", panels=panels, traces=traces, link="spectra")
        )
    return charts


def _amplitude(values: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    n = max(len(values) // SEGMENTS, min(len(values), SHORTEST))
    window = hanning(n)
    power = (np.abs(segment_spectra(values, window, n)) ** 2).mean(axis=0) * 2.0 / (rate * (window**2).sum())
    return np.asarray(np.fft.rfftfreq(n, 1.0 / rate)[1:]), np.asarray(np.sqrt(power[1:]))


def time_charts(trials: Sequence[Trial], models: Mapping[Named, Simulated]) -> list[Chart]:
    """A held-out interval of each kind of run in the first run's configuration: measured, and simulated with each model."""
    charts: list[Chart] = []
    for trial, name in _distinct(trials):
        if trial.run.configuration != trials[0].run.configuration:
            continue
        rate = trial.sample_rate
        part = slice(trial.samples - round(1.5 * SECONDS * rate), trial.samples - round(0.5 * SECONDS * rate))
        seconds = np.arange(trial.samples)[part] / rate
        traces, panels = [], []
        for panel, channel in enumerate(trial.channels):
            measured = trial.measured[panel][part]
            scale, unit_name = sized_unit(float(np.abs(measured).max(initial=0.0)), trial.unit_of(channel))
            panels.append(Panel(label=f"{channel}, {unit_name}"))
            traces.append(ChartTrace(name="measured", x=seconds, y=measured / scale, panel=panel))
            for (title, role), responses in models.items():
                y = responses[trial.run.id][channel][part] / scale
                traces.append(ChartTrace(name=title, x=seconds, y=y, role=role, panel=panel, style="dash"))
        about = "." if charts else f": {SECONDS:g} s of held-out data; {trial.prediction}."
        charts.append(
            Chart(
                name=f"time-{trial.run.id}", caption=f"{name}{about}", panels=panels, traces=traces, x_label="time, s",
                x_log=False,
            )
        )  # fmt: skip
    return charts


@dataclass(frozen=True, kw_only=True)
class HeldOutRecord:
    """A channel of a run on held-out data: measured and simulated over `time`, each shape (samples,), in `unit`.

    `noise` is its sensor's, `size` the channel's largest standard deviation over the runs, and `prediction` says how the models'
    values were predicted.
    """

    run: str
    channel: str
    unit: str
    time: FloatArray
    measured: FloatArray
    models: Mapping[Named, FloatArray]
    noise: float = 0.0
    size: float = 1.0
    prediction: str = ""


def worst_second(trials: Sequence[Trial], judged: Sequence[Trial], models: Mapping[Named, Simulated]) -> HeldOutRecord | None:
    """The second of held-out data in which the first model's error relative to the size of its channel is largest.

    Held out is the part of the `judged` runs after their `fitted` samples. None if no run has a second.
    """
    held = {trial.run.id: trial for trial in judged}
    trials = [trial for trial in trials if trial.run.id in held]
    # A channel that hardly moves in a run is judged by how it moves in the others.
    sizes: dict[str, float] = {}
    for trial in trials:
        for row, name in enumerate(trial.channels):
            sizes[name] = max(sizes.get(name, 0.0), float(np.std(trial.measured[row])))
    records = []
    for trial in trials:
        part = held[trial.run.id].held_out
        part = slice(part.start, part.stop - round(ENDS * trial.sample_rate))
        for row, name in enumerate(trial.channels):
            records.append(
                HeldOutRecord(
                    run=trial.run.id, channel=name, unit=trial.unit_of(name),
                    time=np.arange(trial.samples)[part] / trial.sample_rate, measured=trial.measured[row][part],
                    models={key: responses[trial.run.id][name][part] for key, responses in models.items()},
                    noise=float(trial.noise[row]), size=sizes[name], prediction=trial.prediction,
                )
            )  # fmt: skip
    return worst_of(records)


def worst_of(records: Sequence[HeldOutRecord]) -> HeldOutRecord | None:
    """The second of the records in which the first model's error relative to their `size` is largest; None if none has one."""
    seconds: list[tuple[float, HeldOutRecord]] = []
    for record in records:
        n = max(round(SECOND / (record.time[1] - record.time[0])), 2) if len(record.time) > 1 else 2
        if len(record.measured) < n or record.size <= 0.0:
            continue
        error = next(iter(record.models.values())) - record.measured
        total = np.concatenate([[0.0], np.cumsum(error**2)])
        power = (total[n:] - total[:-n]) / n
        k = int(np.argmax(power))
        part = slice(k, k + n)
        models = {key: values[part] for key, values in record.models.items()}
        second = replace(record, time=record.time[part], measured=record.measured[part], models=models)
        seconds.append((float(np.sqrt(power[k])) / record.size, second))
    return max(seconds, key=lambda pair: pair[0])[1] if seconds else None


def second_chart(record: HeldOutRecord | None) -> Chart | None:
    """The second in which the first model's error is largest, with the residuals below."""
    if record is None:
        return None
    scale, unit_name = sized_unit(float(np.abs(record.measured).max()), record.unit)
    traces = [ChartTrace(name="measured", x=record.time, y=record.measured / scale)]
    for (name, role), values in record.models.items():
        traces.append(ChartTrace(name=name, x=record.time, y=values / scale, role=role, style="dash"))
        traces.append(ChartTrace(name=name, x=record.time, y=(values - record.measured) / scale, role=role, panel=1))
    if record.noise > 0.0:
        band = ChartTrace(
            name="sensor noise, ±2 σ", x=record.time[[0, -1]], y=np.zeros(2), spread=np.full(2, 2.0 * record.noise / scale),
            role="noise", panel=1, style="dot",
        )  # fmt: skip
        traces.append(band)
    return Chart(
        name=f"second-{record.run}-{record.channel}",
        caption=f"The second of held-out data with the largest error: {record.channel}, run {record.run}; "
        f"{record.prediction}. Below: the residuals, simulated minus measured.",
        panels=[Panel(label=f"{what}, {unit_name}") for what in (record.channel, "residual")],
        traces=traces, x_label="time, s", x_log=False,
    )  # fmt: skip


def bars_chart(name: str, caption: str, label: str, names: Sequence[str], sets: Mapping[Named, FloatArray]) -> Chart:
    """Positive values by name as bars on a logarithmic axis, a set for each model and for the noise; NaN leaves a bar out."""
    traces = [ChartTrace(name=title, x=names, y=values, role=role, style="bars") for (title, role), values in sets.items()]
    return Chart(name=name, caption=caption, panels=[Panel(label="")], traces=traces, x_label=label)


def scores_chart(scores: Mapping[Named, Score], trials: Sequence[Trial]) -> Chart:
    """Held-out error of each run and channel."""
    return bars_chart(
        "held-out-error", "rms(predicted − measured) / rms(measured) of each run and channel on held-out data.",
        "held-out error, % of the signal", [f"{trial.run.id} {channel}" for trial in trials for channel in trial.channels],
        {key: 100.0 * score.error.ravel() for key, score in scores.items()},
    )  # fmt: skip


def residual_chart(before: Mapping[str, float], after: Mapping[str, float] | None = None) -> Chart | None:
    """Residual of each equation of motion divided by its noise, before and after a cause, if there is one; None without
    equations.

    Equations have names, for example "table + motor" for the forces on both.
    """
    if not before:
        return None
    sets = {BASELINE: np.array(list(before.values()))}
    caption = (
        "Equations of motion in the records, without simulation: the residual of each divided by its noise. About 1 is noise "
        "alone; disturbances and small errors of sensors raise all equations, a fault every one that contains its force, or a "
        "motion without a sensor that follows from it, so the longest bar alone does not give its place."
    )
    if after is not None:
        extended = np.array([after.get(name, np.nan) for name in before])
        if np.isfinite(extended).any():
            sets[EXTENDED] = extended
        else:
            caption += " The extended model has no bars: its equations need motions that were not recorded."
    return bars_chart("equations", caption, "residual / noise", [_equation(name) for name in before], sets)


def _equation(name: str) -> str:
    # Equations are named after their bodies, and those of locks and stuck contacts after these.
    if name.startswith("lock of "):
        return words(name)
    return f"{words(name.removeprefix('stuck '))}, stuck" if name.startswith("stuck ") else f"forces on {words(name)}"
