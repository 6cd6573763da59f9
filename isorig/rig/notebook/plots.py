"""Figures of results for notebooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from isorig.analysis.campaign import Campaign, FloatArray, Run
from isorig.analysis.isolation.ratio import IsolationRatio
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.parameters.joint_fit import Characterization
from isorig.analysis.simulate.free_run import Response
from isorig.analysis.spectra.modal_analysis import ModalModel
from isorig.analysis.spectra.welch import Frf
from isorig.analysis.views import shows
from isorig.analysis.wording import displayed_unit, words
from isorig.rig.frf.transfer import Transfer
from isorig.rig.report.misfit import HeldOutRecord
from isorig.rig.report.sketch import picture

if TYPE_CHECKING:
    from isorig.rig.frf.figures import Figure, View

#: Symbols of poles by what the order before them agrees with.
MARKS: Mapping[str, str] = {"new": ".", "frequency": "x", "stable": "o"}
#: Seconds of a run that are shown if none are named: more cannot be resolved.
SHOWN = 5.0


def records_figure(records: Mapping[str, Mapping[str, tuple[FloatArray, FloatArray]]], units: Mapping[str, str]) -> Figure:
    """Channels over time: a panel for each channel, a curve for each record, {record: {channel: (time, values)}}."""
    from isorig.rig.frf.figures import Figure, gridded

    names = list(dict.fromkeys(name for record in records.values() for name in record))
    figure = Figure(figsize=(9.0, 1.2 + 1.6 * len(names)), layout="constrained")
    axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for axis, name in zip(axes, names, strict=True):
        for label, record in records.items():
            if name in record:
                axis.plot(*record[name], lw=0.9, label=label)
        axis.set_ylabel(f"{name}, {displayed_unit(units.get(name, ''))}")
    axes[-1].set_xlabel("time, s")
    if len(records) > 1:
        axes[0].legend(fontsize=8)
    return gridded(figure)


def second_figure(record: HeldOutRecord) -> Figure:
    """A channel, measured and simulated, and the residuals below."""
    from isorig.rig.frf.figures import Figure, gridded

    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(record.time, record.measured, "k", lw=1.2, label="measured")
    for (name, _), values in record.models.items():
        above.plot(record.time, values, "--", lw=1.0, label=name)
        below.plot(record.time, values - record.measured, lw=1.0, label=name)
    if record.noise > 0.0:
        below.axhspan(-2.0 * record.noise, 2.0 * record.noise, color="0.8", label="sensor noise, ±2 σ")
    above.set(ylabel=f"{record.channel}, {displayed_unit(record.unit)}", title=f"run {record.run}, held-out data")
    below.set(ylabel=f"residual, {displayed_unit(record.unit)}", xlabel="time, s")
    above.legend(fontsize=8)
    below.legend(fontsize=8)
    return gridded(figure)


class Drawing(str):
    """An SVG picture, which a notebook shows as one."""

    def _repr_svg_(self) -> str:
        return str(self)


@shows(RigModel, "plot")
def plot_rig(model: RigModel) -> Drawing:
    """The rig's sketch."""
    return Drawing(picture(model))


@shows(Run, "plot")
def plot_run(run: Run, *others: Run, channels: Sequence[str] = (), seconds: tuple[float, float] | None = None) -> Figure:
    """Channels over time, of one or more runs; the first seconds if none are named."""
    names = list(channels) or list(run.sensors)
    records = {
        one.id: _part({name: one.read(name) for name in names if name in one.channels}, one.sample_rate, seconds)
        for one in (run, *others)
    }
    return records_figure(records, {name: run.channel(name).unit for name in names})


def _part(
    channels: Mapping[str, FloatArray], rate: float, seconds: tuple[float, float] | None
) -> dict[str, tuple[FloatArray, FloatArray]]:
    # Times and values within the seconds, or within the first ones.
    start, stop = seconds or (0.0, SHOWN)
    part = slice(max(round(start * rate), 0), round(stop * rate))
    return {name: (np.arange(len(values))[part] / rate, values[part]) for name, values in channels.items()}


@shows(Campaign, "plot")
def plot_campaign(campaign: Campaign, *others: Campaign, channels: Sequence[str] = (), **more: Any) -> Figure:
    """The first run, with the same run of other campaigns (a prediction, an earlier recording) overlaid."""
    first = campaign.runs[0]
    same = [next((run for run in other.runs if run.id == first.id), other.runs[0]) for other in others]
    named = [replace(run, id=f"{run.id} ({k + 2})") for k, run in enumerate(same)]
    return plot_run(first, *named, channels=channels, **more)


@shows(Response, "plot")
def plot_response(response: Response, *others: Response, seconds: tuple[float, float] | None = None) -> Figure:
    """Sensors over time."""
    records = {
        f"response {k + 1}" if others else "response": _part(one.channels, one.sample_rate, seconds)
        for k, one in enumerate((response, *others))
    }
    return records_figure(records, response.units)


@shows(Frf, "plot")
def plot_frf(frf: Frf, *others: Frf, view: View = "bode", band: tuple[float, float] | None = None) -> Figure:
    """Magnitude, phase and coherence of one or more transfer functions, or another view, within the drive's band."""
    from isorig.rig.frf.figures import frf_view

    named = {}
    for one in (frf, *others):
        label = one.label if isinstance(one, Transfer) else f"{one.response} over {one.reference}"
        if label in named and isinstance(one, Transfer):
            label = f"{one.response} over {one.reference}, {label}"
        while label in named:
            label += " (again)"
        named[label] = one.within_band() if isinstance(one, Transfer) else one
    low = min(float(one.frequency[one.frequency > 0.0][0]) for one in named.values())
    return frf_view(named, band or (low, max(float(one.frequency[-1]) for one in named.values())), view)


@shows(IsolationRatio, "plot")
def plot_ratio(found: IsolationRatio, *others: IsolationRatio) -> Figure:
    """The stitched ratio with its band of one standard deviation."""
    from isorig.rig.frf.figures import ratio_figure

    curves = {
        "isolation ratio" if k == 0 else f"isolation ratio {k + 1}": (one.frequency, one.ratio, one.std)
        for k, one in enumerate((found, *others))
    }
    return ratio_figure(curves, "unlocked / locked", "1")


@shows(Characterization, "plot")
def plot_parameters(found: Characterization, *others: Characterization) -> Figure:
    """Each parameter relative to the first table's value, with its standard uncertainty."""
    from isorig.rig.frf.figures import Figure, gridded

    first = {name: entry.value for name, entry in found.table.items() if entry.value and not entry.fixed}
    figure = Figure(figsize=(8.0, 1.2 + 0.3 * len(first)), layout="constrained")
    axis = figure.subplots()
    for k, one in enumerate((found, *others)):
        shown = [
            (place, entry.value / value, (entry.std or 0.0) / abs(value))
            for place, (name, value) in enumerate(first.items())
            if (entry := one.table.get(name)) is not None and entry.value
        ]
        places, ratios, widths = np.array(shown).reshape(-1, 3).T
        axis.errorbar(100.0 * (ratios - 1.0), places + 0.15 * k, xerr=100.0 * widths, fmt="o", ms=4, label=f"{k + 1}")
    axis.set_yticks(range(len(first)), labels=list(map(words, first)))
    axis.invert_yaxis()
    axis.set_xlabel("difference from the first value, %")
    if others:
        axis.legend(fontsize=8)
    return gridded(figure)


@shows(ModalModel, "plot")
def plot_modes(found: ModalModel) -> Figure:
    """The stabilization diagram over the transfer functions, and the shapes."""
    from isorig.rig.frf.figures import Figure

    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(2.0, 1.0))
    f = found.frequency
    for i, response in enumerate(found.responses):
        for j, reference in enumerate(found.references):
            (line,) = above.semilogy(f, np.abs(found.measured[i, j]), lw=0.9, label=f"{response} over {reference}")
            above.semilogy(f, np.abs(found.fitted[i, j]), "--", lw=1.0, color=line.get_color())
    orders = above.twinx()
    for status, mark in MARKS.items():
        poles = [(pole.frequency, pole.order) for pole in found.poles if pole.status == status]
        if poles:
            orders.plot(*zip(*poles, strict=True), mark, ms=4, color="0.4", mfc="none", label=status)
    orders.set_ylabel("order")
    above.set(xlabel="frequency, Hz", ylabel="magnitude; dashed: fitted", xlim=(f[0], f[-1]))
    above.legend(fontsize=8, loc="upper left")
    if found.poles:
        orders.legend(fontsize=8, loc="upper right")
    for mode in found.modes:
        above.axvline(mode.frequency, color="0.6", lw=0.8)
        below.plot(mode.shape.real, "o-", label=f"{mode.frequency:.4g} Hz, {100.0 * mode.damping:.2g} %")
    below.set_xticks(range(len(found.responses)), labels=list(found.responses))
    below.set_ylabel("shape, real part")
    below.axhline(0.0, color="0.6", lw=0.8)
    below.legend(fontsize=8)
    return figure
