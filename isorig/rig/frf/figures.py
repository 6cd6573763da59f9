"""Figures for files: matplotlib Figures of results."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure as MatplotlibFigure
from matplotlib.ticker import LogLocator

from isorig.rig.files.output import replaced

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.typing import ColorType

    from isorig.analysis.campaign import FloatArray
    from isorig.analysis.isolation.ratio import IsolationRatio
    from isorig.analysis.spectra.periodic import PeriodicFrf
    from isorig.analysis.spectra.welch import Frf
    from isorig.rig.wire_bonder.four_set_ups import ErrorSurface, SetUp


#: Unit of acceleration divided by acceleration.
PER = "m/s² per m/s²"
#: What a picture of transfer functions shows: magnitude, phase and coherence; real and imaginary parts; the complex plane.
View = Literal["bode", "parts", "nyquist"]
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
    with replaced(path) as temporary:
        figure.savefig(temporary, format=str(path).rsplit(".", 1)[-1], dpi=150)


def frf_view(frfs: Mapping[str, Frf], band: tuple[float, float], view: View = "bode") -> Figure:
    """Transfer functions by name in one of the views, within a band (Hz)."""
    return {"bode": frf_figure, "parts": parts_figure, "nyquist": nyquist_figure}[view](frfs, band)


def unit_of(frf: Frf) -> str:
    """The unit of a transfer function, as on an axis."""
    response, reference = (unit.replace("^2", "²") for unit in frf.units)
    return f"{response or 'unknown unit'} per {reference or 'unknown unit'}"


def parts_figure(frfs: Mapping[str, Frf], band: tuple[float, float]) -> Figure:
    """Real and imaginary part of transfer functions by name, with bands of one standard deviation."""
    figure = Figure(figsize=(9.0, 6.5), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for k, (name, frf) in enumerate(frfs.items()):
        kept = (frf.frequency >= band[0]) & (frf.frequency <= band[1])
        for axis, part in zip(axes, (frf.value.real, frf.value.imag), strict=True):
            # The error of each part is that of the magnitude: errors of an average are alike in all directions.
            _banded(axis, frf.frequency[kept], part[kept], frf.magnitude_std[kept], name, DASHES[k % 2], positive=False)
    first = next(iter(frfs.values()))
    ratio = f"{first.response} / {first.reference}, {unit_of(first)}"
    axes[0].set(ylabel=f"real part of {ratio}")
    axes[1].set(ylabel=f"imaginary part of {ratio}", xlabel="frequency, Hz", xlim=band)
    axes[0].legend(fontsize=8)
    for axis in axes:
        axis.axhline(0.0, color="0.6", lw=0.8)
        axis.yaxis.label.set_fontsize(8)
    return _gridded(figure)


def nyquist_figure(frfs: Mapping[str, Frf], band: tuple[float, float]) -> Figure:
    """Imaginary over real part of transfer functions by name, one scale on both axes."""
    figure = Figure(figsize=(7.5, 7.5), layout="constrained")
    axis = figure.subplots()
    for k, (name, frf) in enumerate(frfs.items()):
        kept = (frf.frequency >= band[0]) & (frf.frequency <= band[1])
        f, value = frf.frequency[kept], frf.value[kept]
        (line,) = axis.plot(value.real, value.imag, DASHES[k % 2], marker=".", ms=3, lw=0.8, label=name)
        if len(value):
            top = int(np.argmax(np.abs(value)))
            axis.annotate(f"{f[top]:.4g} Hz", (value[top].real, value[top].imag), fontsize=8, color=line.get_color())
    first = next(iter(frfs.values()))
    ratio = f"{first.response} / {first.reference}, {unit_of(first)}"
    axis.set(xlabel=f"real part of {ratio}", ylabel=f"imaginary part of {ratio}", aspect="equal")
    axis.set_title(f"{band[0]:.4g} to {band[1]:.4g} Hz", fontsize=9)
    axis.axhline(0.0, color="0.6", lw=0.8)
    axis.axvline(0.0, color="0.6", lw=0.8)
    axis.legend(fontsize=8)
    return _gridded(figure)


def frf_figure(frfs: Mapping[str, Frf], band: tuple[float, float]) -> Figure:
    """Magnitude, phase and coherence of transfer functions by name, with bands of one standard deviation.

    Every second one is dashed, so that coinciding curves remain visible.
    """
    figure = Figure(figsize=(9.0, 7.5), layout="constrained")
    magnitude, phase, coherence = figure.subplots(3, 1, sharex=True, height_ratios=(2.0, 1.0, 1.0))
    for k, (name, frf) in enumerate(frfs.items()):
        kept = (frf.frequency >= band[0]) & (frf.frequency <= band[1])
        f, size = frf.frequency[kept], np.abs(frf.value[kept])
        line = _banded(magnitude, f, size, frf.magnitude_std[kept], name, DASHES[k % 2])
        turned = np.degrees(np.angle(frf.value[kept]))
        phase.plot(f, turned, ".", ms=2, color=line)
        coherence.plot(f, frf.coherence[kept], lw=0.9, color=line)
    first = next(iter(frfs.values()))
    magnitude.set(xscale="log", yscale="log", ylabel=f"|{first.response} / {first.reference}|, {unit_of(first)}")
    magnitude.legend(fontsize=8)
    phase.set(ylabel="phase, degrees", ylim=(-185, 185), yticks=(-180, -90, 0, 90, 180))
    coherence.set(ylabel="coherence", ylim=(0, 1.02), xlabel="frequency, Hz")
    coherence.set_xlim(max(band[0], float(first.frequency[first.frequency > 0.0][0])), band[1])
    return _gridded(figure)


def periods_figure(found: Mapping[str, PeriodicFrf]) -> Figure:
    """Magnitude and phase at the excited frequencies, with noise and distortion of the magnitude."""
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    magnitude, phase = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
    for name, frf in found.items():
        colour = _banded(magnitude, frf.frequency, np.abs(frf.value), frf.magnitude_std, name)
        magnitude.plot(frf.frequency, frf.noise, ".", ms=2, color=colour, label=f"{name}: noise of one realization")
        if np.isfinite(frf.distortion).any():
            magnitude.plot(frf.frequency, frf.distortion, "--", lw=0.8, color=colour, label=f"{name}: distortion")
        phase.plot(frf.frequency, np.degrees(np.angle(frf.value)), ".", ms=2, color=colour)
    first = next(iter(found.values()))
    magnitude.set(xscale="log", yscale="log", ylabel=f"|{first.response} / {first.reference}|, {PER}")
    magnitude.legend(fontsize=8)
    phase.set(ylabel="phase, degrees", ylim=(-185, 185), yticks=(-180, -90, 0, 90, 180), xlabel="frequency, Hz")
    return _gridded(figure)


def ratio_figure(curves: Mapping[str, tuple[FloatArray, FloatArray, FloatArray]], title: str, unit: str) -> Figure:
    """Magnitudes over frequency by name, each with its standard deviation."""
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    axis = figure.subplots()
    for (name, (frequency, value, std)), dash in zip(curves.items(), DASHES * len(curves), strict=False):
        _banded(axis, frequency, value, std, name, dash)
    axis.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="ratio" if unit == "1" else unit, title=title)
    axis.legend(fontsize=8)
    return _gridded(figure)


def isolation_figure(
    ratios: Mapping[str, IsolationRatio], stuck: Mapping[float, float], *, logarithmic: bool = True
) -> Figure:  # fmt: skip
    """The isolation ratio from 0 to 15 Hz, and around the heatblock's peaks, measured and simulated.

    Gains at which the motor sticks are shaded, and the step at each stitch is labelled. The frequency axis is linear, as in the
    thesis's figures, or logarithmic on request.
    """
    figure = Figure(figsize=(9.0, 11.0), layout="constrained")
    wide, low, peak = figure.subplots(3, 1)
    for axis, top in ((wide, None), (low, 15.0)):
        for (name, ratio), dash in zip(ratios.items(), DASHES, strict=False):
            kept = np.full(len(ratio.frequency), True) if top is None else ratio.frequency <= top
            _banded(axis, ratio.frequency[kept], ratio.ratio[kept], ratio.std[kept], name, dash)
        axis.axhline(1.0, color="0.6", lw=0.8)
        axis.set(yscale="log", ylabel="unlocked / locked", xlabel="frequency, Hz")
    wide.set(xscale="log" if logarithmic else "linear", title="Isolation ratio |heatblock / head|, unlocked / locked")
    shown = next(iter(ratios.values()))
    for gain, share in stuck.items():
        lines = shown.frequency[shown.gain == gain]
        if share > 0.5 and len(lines):
            wide.axvspan(lines[0], lines[-1], color="0.9", zorder=0)
            text = f"gain {gain:g}: motor stuck {100 * share:.0f} % of the time"
            middle = np.sqrt(lines[0] * lines[-1]) if logarithmic else 0.5 * (lines[0] + lines[-1])
            wide.text(float(middle), 0.02, text, ha="center", fontsize=8, transform=wide.get_xaxis_transform())
    for at, (step, std) in zip(shown.stitches, shown.steps, strict=True):
        wide.axvline(at, color="0.4", ls=":", lw=1.0)
        if np.isfinite(step):
            text = f" {at:g} Hz: step {step:.3f} ± {std:.1g}"
            wide.text(at, 0.94, text, fontsize=8, transform=wide.get_xaxis_transform())
    wide.legend(fontsize=8, loc="lower left")
    _peaks_at_their_places(peak, ratios)
    return _gridded(figure)


def _peaks_at_their_places(axis: Axes, ratios: Mapping[str, IsolationRatio]) -> None:
    # The two transfer functions around the heatblock's peak, as in Fig. 32 of the thesis.
    for name, ratio in ratios.items():
        peaks = ratio.peaks
        if not np.isfinite(peaks.ratio):
            axis.text(0.5, 0.5, "the heatblock's peak is outside of the drive's band", ha="center", transform=axis.transAxes)
            return
        # Locked curves are dashed and on top, because the curves may coincide.
        for frf, at, configuration, dash in (
            (ratio.pieces[-1].unlocked, peaks.unlocked, "unlocked", "-"), (ratio.pieces[-1].locked, peaks.locked, "locked", "--")
        ):  # fmt: skip
            kept = np.abs(frf.frequency / peaks.locked - 1.0) < 0.06
            colour = _banded(
                axis, frf.frequency[kept], np.abs(frf.value[kept]), frf.magnitude_std[kept], f"{name}, {configuration}", dash
            )
            top = int(np.argmin(np.abs(frf.frequency - at)))
            axis.plot(frf.frequency[top], np.abs(frf.value[top]), "o", mfc="none", ms=6, color=colour)
    sentences = [
        f"{name} {r.peaks.ratio:.3f} ± {r.peaks.std:.1g} (at equal frequency {r.peaks.by_line:.3f})" for name, r in ratios.items()
    ]
    # A line for each ratio, so that no title is wider than its figure.
    title = "\n".join(["Ratio of the peaks at their own frequencies, unlocked / locked:", *sentences])
    axis.set(yscale="log", xlabel="frequency, Hz", ylabel=f"|heatblock / head|, {PER}", title=title)
    axis.title.set_fontsize(9)
    axis.legend(fontsize=8)


def set_ups_figure(set_ups: Sequence[SetUp]) -> Figure:
    """Magnitude and phase of each set-up, measured with error bars, with the modal fit and the half-power points."""
    figure = Figure(figsize=(4.6 * len(set_ups), 6.0), layout="constrained")
    axes = figure.subplots(2, len(set_ups), squeeze=False, sharex="col", height_ratios=(2.0, 1.0))
    for (magnitude, phase), item in zip(axes.T, set_ups, strict=True):
        frf, half = item.frf, item.half_power
        kept = (frf.frequency >= item.band[0]) & (frf.frequency <= item.band[1])
        line = _banded(magnitude, frf.frequency[kept], np.abs(frf.value[kept]), frf.magnitude_std[kept], "measured")
        phase.plot(frf.frequency[kept], np.degrees(np.angle(frf.value[kept])), ".", ms=2, color=line)
        if item.fit is not None:
            magnitude.plot(item.fit.frequency, np.abs(item.fit.fitted), "k--", lw=1.0, label="fit")
            phase.plot(item.fit.frequency, np.degrees(np.angle(item.fit.fitted)), "k--", lw=1.0)
        if half.mode is not None:
            points = half.amplitude * np.array([0.5**0.5, 1.0, 0.5**0.5])
            magnitude.plot([half.low, half.peak, half.high], points, "o", mfc="none", ms=6, color="C3", label="half-power")
        mode = item.mode
        found = "" if mode is None else f"\n{mode.frequency:.3f} Hz, {mode.damping:.4g}"
        magnitude.set(yscale="log", title=f"{frf.reference} → {frf.response}{found}", ylabel=f"magnitude, {PER}")
        magnitude.legend(fontsize=8)
        phase.set(xlabel="frequency, Hz", ylabel="phase, degrees", ylim=(-185, 185), yticks=(-180, -90, 0, 90, 180))
    return _gridded(figure)


def surface_figure(surface: ErrorSurface) -> Figure:
    """The error surface over table mass and damping, and the simulation at its minimum with the measurement."""
    figure = Figure(figsize=(10.0, 4.5), layout="constrained")
    plane, curve = figure.subplots(1, 2)
    levels = np.geomspace(surface.error.min(), surface.error.max() * 1.01, 25)
    mesh = plane.contourf(surface.mass, surface.damping, surface.error, levels=levels, norm=LogNorm(), cmap="viridis")
    plane.plot(*surface.best[:2], "w+", ms=12)
    plane.set(
        xscale="log", yscale="log", xlabel="table mass, kg", ylabel="damping ratio",
        title=f"minimum at {surface.best[0]:.4g} kg, {surface.best[1]:.3g}",
    )  # fmt: skip
    marks = [m for m in (20, 30, 50, 80, 120, 200, 300, 500) if m <= surface.mass[-1]]
    plane.set_xticks(marks, labels=[str(m) for m in marks])
    plane.xaxis.minorticks_off()
    figure.colorbar(mesh, ax=plane, label="mean relative error of |table / head|", format="%.2g")
    curve.plot(surface.frequency, surface.measured, lw=1.0, label="measured")
    curve.plot(surface.frequency, surface.simulated, "k--", lw=1.0, label="simulated at the minimum")
    curve.set(yscale="log", xlabel="frequency, Hz", ylabel=f"|table / head|, {PER}")
    curve.grid(visible=True, which="both", alpha=0.25, lw=0.5)
    curve.legend(fontsize=8)
    return figure


def _banded(
    axis: Axes, x: FloatArray, y: FloatArray, std: FloatArray, name: str, dash: str = "-", *, positive: bool = True
) -> ColorType:
    (line,) = axis.plot(x, y, dash, lw=1.0, label=name)
    colour = line.get_color()
    # On a logarithmic axis the band ends at a third of the value.
    axis.fill_between(x, np.maximum(y - std, y / 3.0) if positive else y - std, y + std, color=colour, alpha=0.25, lw=0)
    return colour


def _gridded(figure: Figure) -> Figure:
    for axis in figure.axes:
        axis.grid(visible=True, which="both", alpha=0.25, lw=0.5)
        if axis.get_xscale() == "log":
            axis.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
            axis.xaxis.set_major_formatter("{x:g}")
            axis.xaxis.set_minor_formatter("{x:g}")
    return figure
