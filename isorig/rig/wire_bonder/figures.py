"""Figures of the wire bonder's isolation ratio, of the thesis's four set-ups, and of their error surface."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from isorig.analysis.isolation.ratio import MOSTLY_STUCK, IsolationRatio
from isorig.analysis.wording import with_std
from isorig.rig.frf.figures import DASHES, PER, Figure, banded, gridded
from isorig.rig.wire_bonder.four_set_ups import ErrorSurface, SetUp


def isolation_figure(ratios: Mapping[str, IsolationRatio], stuck: Mapping[float, float], *, logarithmic: bool = True) -> Figure:
    """The isolation ratio from 0 to 15 Hz, and around the heatblock's peaks, measured and simulated.

    Gains at which the motor sticks are shaded, and the step at each stitch is labelled. The frequency axis is linear, as in the
    thesis's figures, or logarithmic on request.
    """
    figure = Figure(figsize=(9.0, 11.0), layout="constrained")
    wide, low, peak = figure.subplots(3, 1)
    for axis, top in ((wide, None), (low, 15.0)):
        for (name, ratio), dash in zip(ratios.items(), DASHES, strict=False):
            kept = np.full(len(ratio.frequency), True) if top is None else ratio.frequency <= top
            banded(axis, ratio.frequency[kept], ratio.ratio[kept], ratio.std[kept], name, dash)
        axis.axhline(1.0, color="0.6", lw=0.8)
        axis.set(yscale="log", ylabel="unlocked / locked", xlabel="frequency, Hz")
    wide.set(xscale="log" if logarithmic else "linear", title="Isolation ratio |heatblock / head|, unlocked / locked")
    shown = next(iter(ratios.values()))
    for gain, share in stuck.items():
        lines = shown.frequency[shown.gain == gain]
        if share > MOSTLY_STUCK and len(lines):
            wide.axvspan(lines[0], lines[-1], color="0.9", zorder=0)
            text = f"gain {gain:g}: motor stuck {100 * share:.0f} % of the time"
            middle = np.sqrt(lines[0] * lines[-1]) if logarithmic else 0.5 * (lines[0] + lines[-1])
            wide.text(float(middle), 0.02, text, ha="center", fontsize=8, transform=wide.get_xaxis_transform())
    for at, (step, std) in zip(shown.stitches, shown.steps, strict=True):
        wide.axvline(at, color="0.4", ls=":", lw=1.0)
        if np.isfinite(step):
            text = f" {at:g} Hz: step {with_std(step, std)}"
            wide.text(at, 0.94, text, fontsize=8, transform=wide.get_xaxis_transform())
    wide.legend(fontsize=8, loc="lower left")
    _peaks_at_their_places(peak, ratios)
    return gridded(figure)


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
            near = frf.bins(np.abs(frf.frequency / peaks.locked - 1.0) < 0.06)
            colour = banded(axis, near.frequency, np.abs(near.value), near.magnitude_std, f"{name}, {configuration}", dash)
            top = int(np.argmin(np.abs(frf.frequency - at)))
            axis.plot(frf.frequency[top], np.abs(frf.value[top]), "o", mfc="none", ms=6, color=colour)
    sentences = [
        f"{name} {with_std(r.peaks.ratio, r.peaks.std)} (at equal frequency {r.peaks.by_line:.3f})" for name, r in ratios.items()
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
        frf, half = item.frf.within(item.band), item.half_power
        line = banded(magnitude, frf.frequency, np.abs(frf.value), frf.magnitude_std, "measured")
        phase.plot(frf.frequency, np.degrees(np.angle(frf.value)), ".", ms=2, color=line)
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
    return gridded(figure)


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
