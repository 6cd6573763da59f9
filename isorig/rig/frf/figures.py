"""Figures for files: matplotlib Figures of results."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.figure import Figure as MatplotlibFigure
from matplotlib.ticker import LogLocator, NullFormatter

from isorig.analysis.wording import unit_ratio
from isorig.rig.files.output import replaced

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.typing import ColorType

    from isorig.analysis.campaign import FloatArray
    from isorig.analysis.spectra.periodic import PeriodicFrf
    from isorig.analysis.spectra.welch import Frf


#: Unit of acceleration divided by acceleration.
PER = "m/s² per m/s²"
#: What a picture of transfer functions shows: magnitude, phase and coherence; real and imaginary parts; the complex plane.
View = Literal["bode", "parts", "nyquist"]
#: Columns of a figure in which curves are drawn.
COLUMNS = 1500
#: Ratio of the ends of a logarithmic axis up to which its minor ticks have values: more of them would touch.
LABELLED = 1e4
#: How much pictures are compressed, of 9.
COMPRESSED = 3
#: How curves are drawn that may lie on one another.
DASHES = ("-", "--", ":", "-.")


class Figure(MatplotlibFigure):
    """A figure that a notebook shows when it is a cell's result, whether or not pyplot is in use."""

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", dpi=80)
        return file.getvalue()


def save(figure: MatplotlibFigure, path: str | Path) -> None:
    """Write a figure atomically, in the format of its extension."""
    kind = str(path).rsplit(".", 1)[-1]
    # Half the time for a seventh more bytes.
    how: dict[str, Any] = {"pil_kwargs": {"compress_level": COMPRESSED}} if kind == "png" else {}
    with replaced(path) as temporary:
        figure.savefig(temporary, format=kind, dpi=150, **how)


def frf_view(frfs: Mapping[str, Frf], band: tuple[float, float], view: View) -> Figure:
    """Transfer functions by name in one of the views, within a band (Hz)."""
    return {"bode": frf_figure, "parts": parts_figure, "nyquist": nyquist_figure}[view](frfs, band)


def parts_figure(frfs: Mapping[str, Frf], band: tuple[float, float]) -> Figure:
    """Real and imaginary part of transfer functions by name, with bands of one standard deviation."""
    figure = Figure(figsize=(9.0, 6.5), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for k, (name, frf) in enumerate(frfs.items()):
        seen = frf.within(band)
        for axis, part in zip(axes, (seen.value.real, seen.value.imag), strict=True):
            # The error of each part is that of the magnitude: errors of an average are alike in all directions.
            banded(axis, seen.frequency, part, seen.magnitude_std, name, DASHES[k % 2], positive=False)
    first = next(iter(frfs.values()))
    ratio = f"{first.response} / {first.reference}, {unit_ratio(*first.units)}"
    axes[0].set(ylabel=f"real part of {ratio}")
    axes[1].set(ylabel=f"imaginary part of {ratio}", xlabel="frequency, Hz", xlim=band)
    axes[0].legend(fontsize=8)
    for axis in axes:
        axis.axhline(0.0, color="0.6", lw=0.8)
        axis.yaxis.label.set_fontsize(8)
    return gridded(figure)


def nyquist_figure(frfs: Mapping[str, Frf], band: tuple[float, float]) -> Figure:
    """Imaginary over real part of transfer functions by name, one scale on both axes."""
    figure = Figure(figsize=(7.5, 7.5), layout="constrained")
    axis = figure.subplots()
    for k, (name, frf) in enumerate(frfs.items()):
        seen = frf.within(band)
        f, value = seen.frequency, seen.value
        (line,) = axis.plot(value.real, value.imag, DASHES[k % 2], marker=".", ms=3, lw=0.8, label=name)
        if len(value):
            top = int(np.argmax(np.abs(value)))
            axis.annotate(f"{f[top]:.4g} Hz", (value[top].real, value[top].imag), fontsize=8, color=line.get_color())
    first = next(iter(frfs.values()))
    ratio = f"{first.response} / {first.reference}, {unit_ratio(*first.units)}"
    axis.set(xlabel=f"real part of {ratio}", ylabel=f"imaginary part of {ratio}", aspect="equal")
    axis.set_title(f"{band[0]:.4g} to {band[1]:.4g} Hz", fontsize=9)
    axis.axhline(0.0, color="0.6", lw=0.8)
    axis.axvline(0.0, color="0.6", lw=0.8)
    axis.legend(fontsize=8)
    return gridded(figure)


def frf_figure(frfs: Mapping[str, Frf], band: tuple[float, float]) -> Figure:
    """Magnitude, phase and coherence of transfer functions by name, with bands of one standard deviation.

    Every second one is dashed, so that coinciding curves remain visible.
    """
    # Fixed margins: a layout that fits them draws the figure twice.
    figure = Figure(figsize=(9.0, 7.5))
    figure.subplots_adjust(left=0.1, right=0.98, top=0.98, bottom=0.07, hspace=0.08)
    magnitude, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=(2.0, 1.0, 1.0))
    for k, (name, frf) in enumerate(frfs.items()):
        seen = _drawn(frf.within(band))
        line = banded(magnitude, seen.frequency, np.abs(seen.value), seen.magnitude_std, name, DASHES[k % 2])
        phase.plot(seen.frequency, np.degrees(np.angle(seen.value)), ".", ms=2, color=line)
        coherence.plot(seen.frequency, seen.coherence, lw=0.9, color=line)
    first = next(iter(frfs.values()))
    magnitude.set(xscale="log", yscale="log", ylabel=f"|{first.response} / {first.reference}|, {unit_ratio(*first.units)}")
    magnitude.legend(fontsize=8)
    phase.set(ylabel="phase, degrees", ylim=(-185, 185), yticks=(-180, -90, 0, 90, 180))
    coherence.set(ylabel="coherence", ylim=(0, 1.02), xlabel="frequency, Hz")
    coherence.set_xlim(max(band[0], float(first.frequency[first.frequency > 0.0][0])), band[1])
    return gridded(figure)


def _drawn(frf: Frf) -> Frf:
    # At most two bins of each column of the figure, those with the smallest and the largest magnitude.
    f = frf.frequency
    if len(f) <= COLUMNS:
        return frf
    column = np.searchsorted(np.geomspace(max(float(f[0]), frf.resolution), float(f[-1]), COLUMNS), f)
    order = np.lexsort((np.abs(frf.value), column))
    change = np.flatnonzero(np.diff(column[order]))
    return frf.bins(np.unique(order[np.concatenate([[0], change, change + 1, [len(order) - 1]])]))


def periods_figure(found: Mapping[str, PeriodicFrf]) -> Figure:
    """Magnitude and phase at the excited frequencies, with noise and distortion of the magnitude."""
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    magnitude, phase = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    for name, frf in found.items():
        colour = banded(magnitude, frf.frequency, np.abs(frf.value), frf.magnitude_std, name)
        magnitude.plot(frf.frequency, frf.noise, ".", ms=2, color=colour, label=f"{name}: noise of one realization")
        if np.isfinite(frf.distortion).any():
            magnitude.plot(frf.frequency, frf.distortion, "--", lw=0.8, color=colour, label=f"{name}: distortion")
        phase.plot(frf.frequency, np.degrees(np.angle(frf.value)), ".", ms=2, color=colour)
    first = next(iter(found.values()))
    magnitude.set(xscale="log", yscale="log", ylabel=f"|{first.response} / {first.reference}|, {PER}")
    magnitude.legend(fontsize=8)
    phase.set(ylabel="phase, degrees", ylim=(-185, 185), yticks=(-180, -90, 0, 90, 180), xlabel="frequency, Hz")
    return gridded(figure)


def ratio_figure(curves: Mapping[str, tuple[FloatArray, FloatArray, FloatArray]], title: str, unit: str) -> Figure:
    """Magnitudes over frequency by name, each with its standard deviation."""
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    axis = figure.subplots()
    for (name, (frequency, value, std)), dash in zip(curves.items(), DASHES * len(curves), strict=False):
        banded(axis, frequency, value, std, name, dash)
    axis.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="ratio" if unit == "1" else unit, title=title)
    axis.legend(fontsize=8)
    return gridded(figure)


def banded(
    axis: Axes, x: FloatArray, y: FloatArray, std: FloatArray, name: str, dash: str = "-", *, positive: bool = True
) -> ColorType:
    (line,) = axis.plot(x, y, dash, lw=1.0, label=name)
    colour = line.get_color()
    # On a logarithmic axis the band ends at a third of the value.
    axis.fill_between(x, np.maximum(y - std, y / 3.0) if positive else y - std, y + std, color=colour, alpha=0.25, lw=0)
    return colour


def gridded(figure: Figure) -> Figure:
    for axis in figure.axes:
        axis.grid(visible=True, which="both", alpha=0.25, lw=0.5)
        for one in (axis.xaxis, axis.yaxis):
            if one.get_scale() == "log":
                low, high = one.get_view_interval()
                # Plain numbers: drawing powers as formulas takes a third of the time of a figure.
                one.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
                one.set_major_formatter("{x:g}")
                one.set_minor_formatter("{x:g}" if high <= LABELLED * low else NullFormatter())
    return figure
