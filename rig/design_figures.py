"""Pictures of the design study."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rig.designed import RATE, Designed


def stroke_figure(found: Designed) -> Figure:
    """Largest stroke against isolation frequency with and without friction, the limit, and the spread of the parameters."""
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    axis = figure.subplots()
    for name, study in found.studies.items():
        (line,) = axis.plot(study.frequency, 1e3 * study.stroke, lw=1.4, label=name)
        if len(study.draws):
            low, high = np.quantile(study.draws, (0.05, 0.95), axis=0)
            axis.fill_between(study.frequency, 1e3 * low, 1e3 * high, color=line.get_color(), alpha=0.25, lw=0)
        if np.isfinite(study.recommended):
            axis.axvline(study.recommended, color=line.get_color(), ls=":", lw=1.0)
    allowed = next(iter(found.studies.values())).allowed
    axis.axhline(1e3 * allowed, color="0.3", ls="--", lw=1.0, label=f"allowed, {1e3 * allowed:.3g} mm")
    axis.axvline(found.present, color="0.6", lw=0.8, label=f"present, {found.present:.2f} Hz")
    axis.set(xscale="log", yscale="log", xlabel="isolation frequency, Hz", ylabel="largest stroke of the motor on the table, mm")
    axis.grid(visible=True, which="both", alpha=0.25, lw=0.5)
    axis.legend(fontsize=8)
    return figure


def history_figure(found: Designed) -> Figure:
    """Displacement of all bodies in time for each case."""
    figure = Figure(figsize=(9.0, 3.0 * len(found.histories) + 1.0), layout="constrained")
    axes = figure.subplots(len(found.histories), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (name, bodies) in zip(axes, found.histories.items(), strict=True):
        for body, values in bodies.items():
            axis.plot(np.arange(len(values)) / RATE, 1e3 * values, lw=1.0, label=body)
        axis.set(title=name, ylabel="displacement, mm")
        axis.grid(visible=True, alpha=0.25, lw=0.5)
    axes[0].legend(fontsize=8)
    axes[-1].set(xlabel="time, s")
    return figure


def offset_figure(found: Designed) -> Figure:
    """Isolation ratio without friction for each distance of the drive from the motor's centre of gravity."""
    figure = Figure(figsize=(9.0, 4.5), layout="constrained")
    axis = figure.subplots()
    for offset, seen in found.offsets.items():
        axis.plot(seen.frequency, seen.ratio, lw=1.2, label=f"{1e3 * offset:g} mm off: rocks by {1e3 * seen.rocking:.2g} mrad")
    axis.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="unlocked / locked")
    axis.grid(visible=True, which="both", alpha=0.25, lw=0.5)
    axis.legend(fontsize=8)
    return figure
