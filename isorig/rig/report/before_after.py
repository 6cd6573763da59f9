"""Charts that show a cause: the force at its place, the second of the largest error, errors as bars; before and after.

They take plain arrays of held-out data, whatever computed them: a free run of two models, or equations of motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.wording import sized_unit, with_article
from isorig.rig.report.charts import Chart, ChartTrace, Panel, Role, Style
from isorig.rig.report.sections import unit, words

#: Names and roles of the curves.
BASELINE: tuple[str, Role] = ("baseline", "simulated")
EXTENDED: tuple[str, Role] = ("extended model", "extended")
#: Points of a force drawn as dots, bins of its mean curve with equal counts, and the share of samples outside of them.
DOTS, BINS, OUTSIDE = 900, 60, 0.002
#: Seconds of the interval in which the models differ most.
SECOND = 1.0

Over = Literal["deflection", "velocity", "time"]


@dataclass(frozen=True, kw_only=True)
class Force:
    """The force in a joint, measured or of a model: deflection, velocity and force in SI units, each shape (samples,)."""

    deflection: FloatArray
    velocity: FloatArray
    force: FloatArray


@dataclass(frozen=True, kw_only=True)
class PlaceForce:
    """The force at a place in a run.

    Parameters
    ----------
    place, run
        Names, for the caption.
    time
        Seconds since the start of the run, shape (samples,).
    measured
        The force from the records.
    models
        That of each model by name and role, the baseline's first.
    spring
        Stiffness whose force is subtracted over the velocity, N/m, so that friction and damping remain.
    rotary
        Whether deflections are angles and forces torques.
    """

    place: str
    run: str
    time: FloatArray
    measured: Force
    models: Mapping[tuple[str, Role], Force]
    spring: float = 0.0
    rotary: bool = False

    @property
    def errors(self) -> list[float]:
        """Standard deviation of the error of each model's force, N."""
        return [float(np.std(one.force - self.measured.force)) for one in self.models.values()]

    @property
    def misfit(self) -> float:
        """Error of the baseline's force, as a share of the measured force."""
        return self.errors[0] / max(float(np.std(self.measured.force)), 1e-300)

    @property
    def improvement(self) -> float:
        """By how much the extension reduces the error of the force, N; without one, the error."""
        before, *after = self.errors
        return before - sum(after)


def force_chart(at: PlaceForce, over: Over) -> Chart:
    """The measured force with those of the models: dots and mean curves over deflection or velocity, lines over time."""
    quantity, length, force_unit = ("torque", "rad", "N m") if at.rotary else ("force", "m", "N")
    spring = at.spring if over == "velocity" else 0.0

    def y(one: Force) -> FloatArray:
        return one.force - spring * one.deflection

    def x(one: Force) -> FloatArray:
        return one.velocity if over == "velocity" else one.deflection

    y_scale, y_name = sized_unit(float(np.abs(y(at.measured)).max(initial=0.0)), force_unit)
    if over == "time":
        how, x_label = ".", "time, s"
        traces = [ChartTrace(name="measured", x=at.time, y=y(at.measured) / y_scale)]
        traces += [
            ChartTrace(name=name, x=at.time, y=y(one) / y_scale, role=role, style="dash")
            for (name, role), one in at.models.items()
        ]
    else:
        how = (
            ": from the records (drive minus inertia of the bodies beyond it), and from each model's simulation. Lines are means "
            "over bins."
        )
        x_unit = f"{length}/s" if over == "velocity" else length
        x_scale, x_name = sized_unit(float(np.abs(x(at.measured)).max(initial=0.0)), x_unit)
        x_label = f"{over}, {x_name}"
        some = slice(None, None, max(1, len(at.time) // DOTS))
        dots = x(at.measured)[some] / x_scale, y(at.measured)[some] / y_scale
        traces = [ChartTrace(name="measured, samples", x=dots[0], y=dots[1], role="noise", style="dots")]
        for (name, role), one in [(("measured, mean", "measured"), at.measured), *at.models.items()]:
            at_x, mean = mean_over(x(one), y(one))
            style: Style = "dash" if name == BASELINE[0] else "solid"
            traces.append(ChartTrace(name=name, x=at_x / x_scale, y=mean / y_scale, role=role, style=style))
    without = " without the linear spring's" if spring else ""
    return Chart(
        name=f"force-{at.place}",
        caption=f"{quantity.capitalize()} in {with_article(at.place)}{without} over {over}, run {at.run}, held-out data{how}",
        panels=[Panel(label=f"{quantity}, {y_name}")], traces=traces, x_label=x_label, x_log=False,
    )  # fmt: skip


def mean_over(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean of y and of x in bins of x with equal counts, each shape (bins,)."""
    edges = np.quantile(x, np.linspace(OUTSIDE, 1.0 - OUTSIDE, BINS + 1))
    place = np.searchsorted(edges, x, side="right") - 1
    kept = (place >= 0) & (place < BINS)
    count = np.bincount(place[kept], minlength=BINS)
    there = count > 0
    sums = [np.bincount(place[kept], values[kept], minlength=BINS)[there] / count[there] for values in (x, y)]
    return np.asarray(sums[0]), np.asarray(sums[1])


@dataclass(frozen=True, kw_only=True)
class HeldOutRecord:
    """A channel of a run on held-out data: measured and simulated, each shape (samples,), in `unit`; `noise` is its sensor's."""

    run: str
    channel: str
    unit: str
    sample_rate: float
    start: float
    measured: FloatArray
    models: Mapping[tuple[str, Role], FloatArray]
    noise: float = 0.0
    size: float = 1.0

    @property
    def time(self) -> FloatArray:
        """Seconds since the start of the run, shape (samples,)."""
        return self.start + np.arange(len(self.measured)) / self.sample_rate


def worst_second(records: Sequence[HeldOutRecord]) -> HeldOutRecord | None:
    """The second in which the first model's error relative to its channel's `size` is largest; None without a record."""
    seconds: list[tuple[float, HeldOutRecord]] = []
    for record in records:
        n = max(round(SECOND * record.sample_rate), 2)
        if len(record.measured) < n or record.size <= 0.0:
            continue
        simulated = next(iter(record.models.values()))
        total = np.concatenate([[0.0], np.cumsum((simulated - record.measured) ** 2)])
        power = (total[n:] - total[:-n]) / n
        k = int(np.argmax(power))
        models = {key: values[k : k + n] for key, values in record.models.items()}
        second = replace(record, measured=record.measured[k : k + n], models=models, start=record.start + k / record.sample_rate)
        seconds.append((float(np.sqrt(power[k])) / record.size, second))
    return max(seconds, key=lambda pair: pair[0])[1] if seconds else None


def second_chart(records: Sequence[HeldOutRecord]) -> Chart | None:
    """The second in which the first model's error is largest (`worst_second`), with the residuals below."""
    record = worst_second(records)
    if record is None:
        return None
    measured, seconds = record.measured, record.time
    traces = [ChartTrace(name="measured", x=seconds, y=measured)]
    for (name, role), values in record.models.items():
        traces.append(ChartTrace(name=name, x=seconds, y=values, role=role, style="dash"))
        traces.append(ChartTrace(name=name, x=seconds, y=values - measured, role=role, panel=1))
    if record.noise > 0.0:
        band = ChartTrace(
            name="sensor noise, ±2 σ", x=seconds[[0, -1]], y=np.zeros(2), spread=np.full(2, 2.0 * record.noise), role="noise",
            panel=1, style="dot",
        )  # fmt: skip
        traces.append(band)
    label = unit(record.unit)
    return Chart(
        name=f"second-{record.run}-{record.channel}",
        caption=f"The second of held-out data with the largest error: {record.channel}, run {record.run}; "
        "free-run simulation from the start of the run. Below: the residuals, simulated minus measured.",
        panels=[Panel(label=f"{record.channel}, {label}"), Panel(label=f"residual, {label}")],
        traces=traces, x_label="time, s", x_log=False,
    )  # fmt: skip


def bars_chart(name: str, caption: str, label: str, names: Sequence[str], sets: Mapping[tuple[str, Role], FloatArray]) -> Chart:
    """Positive values by name as bars on a logarithmic axis, a set for each model and for the noise; NaN leaves a bar out."""
    traces = [
        ChartTrace(name=title, x=list(names), y=np.asarray(values, dtype=float), role=role, style="bars")
        for (title, role), values in sets.items()
    ]
    return Chart(name=name, caption=caption, panels=[Panel(label="")], traces=traces, x_label=label, x_log=True)


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
        "alone; a fault raises every equation that contains its force, or a motion without a sensor that follows from it, so the "
        "longest bar alone does not give its place."
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
