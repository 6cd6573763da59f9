"""Pictures of a modal analysis: stabilisation diagram, fit over the measured curves, mode shapes, MAC."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from isorig.analysis.campaign import ComplexArray, FloatArray
from isorig.analysis.spectra.modal import ModalModel, mac
from isorig.rig.modal.geometry import Geometry

#: Marks of poles by what they have in common with the order before.
MARKS = {"new": ("x", "0.6", 10), "frequency": ("o", "#d59a2a", 12), "stable": ("o", "#1f6f9f", 14)}
LABELS = {"new": "new pole", "frequency": "stable frequency", "stable": "stable frequency and damping"}


def stabilisation_figure(found: ModalModel, functions: ComplexArray) -> Figure:
    """Poles of every model order over the root sum of squares of the transfer functions (functions, lines)."""
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    axis = figure.subplots()
    size = axis.twinx()
    size.plot(found.frequency, np.sqrt((np.abs(functions) ** 2).sum(axis=0)), color="0.75", lw=0.9, zorder=0)
    size.set(yscale="log", ylabel="root sum of squares of all transfer functions")
    for status, (mark, colour, area) in MARKS.items():
        poles = [pole for pole in found.poles if pole.status == status]
        axis.scatter(
            [pole.frequency for pole in poles], [pole.order for pole in poles], s=area, c=colour, marker=mark, lw=0.8,
            label=LABELS[status],
        )  # fmt: skip
    for mode in found.modes:
        axis.axvline(mode.frequency, color="#c4481c", lw=0.8, ls="--")
    axis.set(xlabel="frequency, Hz", ylabel="model order", xlim=(found.frequency[0], found.frequency[-1]))
    axis.set_zorder(size.get_zorder() + 1)
    axis.patch.set_visible(False)
    axis.legend(fontsize=8, loc="upper right")
    axis.set_title("Stabilisation diagram; dashed: the modes of the fit", fontsize=10)
    return figure


def fit_figure(found: ModalModel) -> Figure:
    """Magnitude of every transfer function and of the fit, one panel for each response."""
    rows = len(found.responses)
    figure = Figure(figsize=(9.0, 1.2 + 1.3 * rows), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    for axis, name, measured, fitted in zip(axes, found.responses, found.measured, found.fitted, strict=True):
        for k, reference in enumerate(found.references):
            (line,) = axis.plot(
                found.frequency, np.abs(measured[k]), lw=0.8, label=f"over {reference}" if reference else "measured"
            )
            axis.plot(found.frequency, np.abs(fitted[k]), "--", lw=1.2, color=line.get_color())
        axis.set(yscale="log")
        axis.set_ylabel(name, fontsize=8)
        axis.tick_params(labelsize=7)
        axis.grid(visible=True, alpha=0.25, lw=0.5)
    axes[0].legend(fontsize=7, title="dashed: fit", title_fontsize=7)
    axes[-1].set(xlabel="frequency, Hz")
    return figure


def shapes_figure(found: ModalModel, geometry: Geometry) -> Figure:
    """Every mode shape, at both ends of its motion, over the points at rest."""
    modes = len(found.modes)
    columns = min(modes, 3)
    rows = -(-modes // columns)
    figure = Figure(figsize=(3.6 * columns, 0.6 + 3.6 * rows * geometry.height / geometry.width), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for k, axis in enumerate(axes):
        axis.set_axis_off()
        if k >= modes:
            continue
        mode = found.modes[k]
        parts = dict(zip(found.responses, mode.shape.real.tolist(), strict=True))
        for share, colour, width in ((0.0, "0.7", 0.8), (-1.0, "#9cc3dd", 1.0), (1.0, "#1f6f9f", 1.6)):
            moved = [share * parts.get(point.channel, 0.0) for point in geometry.points]
            x = [point.x + 0.5 * point.width + part * point.move_x for point, part in zip(geometry.points, moved, strict=True)]
            y = [point.y + 0.5 * point.height + part * point.move_y for point, part in zip(geometry.points, moved, strict=True)]
            axis.plot(x, y, "-o" if geometry.joined else "s", ms=3 if geometry.joined else 9, lw=width, color=colour)
        axis.set(xlim=(0.0, geometry.width), ylim=(geometry.height, 0.0), aspect="equal")
        axis.set_title(f"{k + 1}: {mode.frequency:.5g} Hz, {100.0 * mode.damping:.3g} %", fontsize=9)
    return figure


def auto_mac(found: ModalModel) -> FloatArray:
    """MAC of the mode shapes with each other, shape (modes, modes)."""
    shapes = found.shapes()
    return mac(shapes, shapes)


def mac_figure(found: ModalModel) -> Figure:
    """The MAC of the mode shapes with each other, with its values."""
    values = auto_mac(found)
    modes = len(values)
    figure = Figure(figsize=(2.0 + 0.55 * modes, 1.6 + 0.55 * modes), layout="constrained")
    axis = figure.subplots()
    picture = axis.imshow(values, vmin=0.0, vmax=1.0, cmap="Blues")
    for i in range(modes):
        for j in range(modes):
            axis.text(j, i, f"{values[i, j]:.2f}", ha="center", va="center", fontsize=7, color="w" if values[i, j] > 0.6 else "k")
    names = [f"{mode.frequency:.4g}" for mode in found.modes]
    axis.set_xticks(range(modes), names, rotation=90, fontsize=8)
    axis.set_yticks(range(modes), names, fontsize=8)
    axis.set(xlabel="mode, Hz", ylabel="mode, Hz", title="MAC")
    figure.colorbar(picture, ax=axis, shrink=0.8)
    return figure
