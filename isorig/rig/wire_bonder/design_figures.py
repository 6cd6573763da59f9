"""Figures of the design study."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from isorig.analysis.model.rig_model import RigModel
from isorig.rig.wire_bonder.design_study import RATE, BondPlan, Designed
from isorig.rig.wire_bonder.move_isolation import MoveIsolation, move_within, on_move

#: Milliseconds of the bond's move that are shown, from its start.
SHOWN = 120.0


def _numbered(axis: Axes) -> None:
    # Labels at 1, 2 and 5 of every decade: powers of ten alone would leave an axis of one decade almost without labels.
    for side in (axis.xaxis, axis.yaxis):
        side.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        side.set_major_formatter("{x:g}")
        side.set_minor_formatter("{x:g}")
    axis.grid(visible=True, which="both", alpha=0.25, lw=0.5)


def stroke_figure(designed: Designed) -> Figure:
    """Largest stroke over isolation frequency with and without friction, the limit, and the spread due to the parameters."""
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    axis = figure.subplots()
    for name, study in designed.studies.items():
        (line,) = axis.plot(study.frequency, 1e3 * study.stroke, lw=1.4, label=name)
        if len(study.draws):
            low, high = np.quantile(study.draws, (0.05, 0.95), axis=0)
            axis.fill_between(study.frequency, 1e3 * low, 1e3 * high, color=line.get_color(), alpha=0.25, lw=0)
        if np.isfinite(study.recommended):
            axis.axvline(study.recommended, color=line.get_color(), ls=":", lw=1.0)
    allowed = next(iter(designed.studies.values())).allowed
    axis.axhline(1e3 * allowed, color="0.3", ls="--", lw=1.0, label=f"allowed, {1e3 * allowed:.3g} mm")
    axis.axvline(designed.present, color="0.6", lw=0.8, label=f"present, {designed.present:.2f} Hz")
    axis.set(xscale="log", yscale="log", xlabel="isolation frequency, Hz", ylabel="largest stroke, motor relative to table, mm")
    _numbered(axis)
    axis.legend(fontsize=8)
    return figure


def history_figure(designed: Designed) -> Figure:
    """Displacement of all bodies over time for each case."""
    figure = Figure(figsize=(9.0, 3.0 * len(designed.histories) + 1.0), layout="constrained")
    axes = figure.subplots(len(designed.histories), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (name, bodies) in zip(axes, designed.histories.items(), strict=True):
        for body, values in bodies.items():
            # The heatblock moves with the table, so its line is dashed and on top.
            dash = "--" if body == "heatblock" else "-"
            axis.plot(np.arange(len(values)) / RATE, 1e3 * values, dash, lw=1.0, label=body)
        axis.set(title=name, ylabel="displacement, mm")
        axis.grid(visible=True, alpha=0.25, lw=0.5)
    axes[0].legend(fontsize=8)
    axes[-1].set(xlabel="time, s")
    return figure


def offset_figure(designed: Designed) -> Figure:
    """Isolation ratio without friction for each distance of the drive from the motor's centre of gravity."""
    figure = Figure(figsize=(9.0, 4.5), layout="constrained")
    axis = figure.subplots()
    for offset, seen in designed.offsets.items():
        axis.plot(seen.frequency, seen.ratio, lw=1.2, label=f"offset {1e3 * offset:g} mm: rocks by {1e3 * seen.rocking:.2g} mrad")
    axis.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="ratio, unlocked / locked")
    _numbered(axis)
    axis.legend(fontsize=8)
    return figure


def level_figure(by_case: Mapping[str, MoveIsolation]) -> Figure:
    """Isolation during moves over their acceleration, and the heatblock's largest displacement with the bond's tolerance."""
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    share, size = figure.subplots(2, 1, sharex=True)
    for name, item in by_case.items():
        (line,) = share.plot(item.acceleration, 100.0 * item.isolation, "o-", ms=3, lw=1.1, label=name)
        unlocked = [1e6 * r.largest for r in item.unlocked]
        size.plot(item.acceleration, unlocked, "o-", ms=3, lw=1.1, color=line.get_color(), label=f"unlocked, {name}")
    any_ = next(iter(by_case.values()))
    size.plot(any_.acceleration, [1e6 * r.largest for r in any_.locked], "k--", lw=1.1, label="locked")
    size.axhline(1e6 * any_.tolerance, color="tab:red", lw=1.0, label=f"the bond's ±{1e6 * any_.tolerance:g} µm")
    share.set(ylabel="isolation during a move, %", title="Heatblock relative to the table, unlocked compared with locked")
    size.set(
        yscale="log",
        ylabel="heatblock relative to table, largest, µm",
        xlabel="peak of the head's acceleration, m/s²",
        xscale="log",
    )
    size.set_xticks([10, 20, 50, 100, 200], labels=["10", "20", "50", "100", "200"])
    size.xaxis.set_minor_formatter("")
    size.yaxis.set_major_formatter("{x:g}")
    for axis in (share, size):
        axis.grid(visible=True, which="both", alpha=0.25, lw=0.5)
        axis.legend(fontsize=8)
    return figure


def bond_figure(rigs: Mapping[str, RigModel], bond: BondPlan) -> Figure:
    """The heatblock relative to the table during the bond's move, locked and unlocked, with tolerance and settling time."""
    figure = Figure(figsize=(9.0, 3.2 * len(rigs) + 0.6), layout="constrained")
    move = move_within(bond.distance, bond.seconds)
    for axis, (name, rig) in zip(figure.subplots(len(rigs), 1, sharex=True, squeeze=False)[:, 0], rigs.items(), strict=True):
        for configuration, colour in (("locked", "0.4"), ("unlocked", "tab:blue")):
            seen = on_move(rig, move, tolerance=bond.tolerance, configuration=configuration)
            kept = 1e3 * seen.time < SHOWN
            settled = f"settled {1e3 * seen.settling:.0f} ms after the move" if np.isfinite(seen.settling) else "does not settle"
            axis.plot(1e3 * seen.time[kept], 1e6 * seen.motion[kept], lw=1.0, color=colour, label=f"{configuration}: {settled}")
        axis.axhspan(-1e6 * bond.tolerance, 1e6 * bond.tolerance, color="tab:red", alpha=0.2, lw=0, label="the bond's tolerance")
        axis.axvline(1e3 * bond.seconds, color="0.2", ls=":", lw=1.0, label="end of the move")
        axis.set(ylabel="heatblock relative to table, µm", title=name)
        axis.grid(visible=True, alpha=0.25, lw=0.5)
        axis.legend(fontsize=8, loc="upper right")
    figure.axes[-1].set(xlabel="time, ms")
    return figure
