"""Figures 22 to 24 and Table 4: the effective table, the joint fit, simulated over measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from analysis.characterize import Characterization
from analysis.classic import Classic
from analysis.measured import FloatArray
from analysis.model import RigModel
from analysis.rigs import THESIS, wire_bonder
from rig.figures import surface_figure
from rig.prediction import predicted
from rig.thesis.campaign import LOW, Played
from rig.thesis.step import Row, Step
from rig.transfer import transfer_functions

ACTUAL = 250.0
#: Where the thesis compares, Hz, and what it says of the simulation there.
COMPARED = {(5.0, 10.0): "too low", (10.6, 11.4): "too high", (11.5, 20.0): "too low"}


def sizes(played: Played, models: Mapping[str, RigModel]) -> tuple[FloatArray, dict[str, FloatArray]]:
    """|table / head| unlocked at gain 70: lines in Hz, measured and simulated by name, each shape (lines,)."""
    campaigns = {"measured": played.measured, **{name: predicted(model, played.measured) for name, model in models.items()}}
    found = {}
    for name, campaign in campaigns.items():
        wanted = [t for t in transfer_functions(campaign, responses=["table"]) if (t.configuration, t.gain) == ("unlocked", LOW)]
        frf = wanted[0].within_band()
        found[name] = np.abs(frf.value)
    return frf.frequency, found


def simulated_over_measured(played: Played, found: Characterization) -> Step:
    """Figures 22 and 24."""
    heavy = wire_bonder({**THESIS, "table_mass": ACTUAL})
    models = {
        f"{ACTUAL:g} kg": heavy, "80 kg without friction": played.smooth_rig, "joint fit": found.fit.model,
    }  # fmt: skip
    f, size = sizes(played, models)
    peak = {name: float(values.max()) for name, values in size.items()}
    rows = [
        Row(
            what=f"Fig. 22: peak of table over head with the actual {ACTUAL:g} kg, over the measured one", thesis="far too small",
            here=f"{peak[f'{ACTUAL:g} kg'] / peak['measured']:.2f}",
            remark="agrees: only part of the table moves in this mode, so its effective mass is less",
        )
    ]  # fmt: skip
    for (low, high), said in COMPARED.items():
        kept = (f >= low) & (f <= high)
        off = {name: float(np.median(size[name][kept] / size["measured"][kept])) for name in list(models)[1:]}
        without = off["80 kg without friction"]
        rows.append(
            Row(
                what=f"Fig. 24: simulated over measured, {low:g} to {high:g} Hz (median)", thesis=said,
                here=f"{without:.2f} without friction; {off['joint fit']:.3f} with the joint fit",
                remark=f"without friction {'agrees' if (without > 1.0) == (said == 'too high') else 'differs'}: the thesis's "
                "deviations are those of a simulation whose friction is too small",
            )
        )  # fmt: skip
    return Step(title="Fig. 22 and 24: simulated over measured", rows=rows, pictures={"overlay": _overlay(f, size)})


def _overlay(f: FloatArray, size: Mapping[str, FloatArray]) -> Figure:
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axis = figure.subplots()
    for name, values in size.items():
        axis.plot(f, values, lw=1.6 if name == "measured" else 1.0, ls="-" if name == "measured" else "--", label=name)
    axis.set(yscale="log", xlabel="frequency, Hz", ylabel="|table / head|", title="unlocked, gain 70")
    axis.grid(visible=True, which="both", alpha=0.25, lw=0.5)
    axis.legend(fontsize=8)
    return figure


def surface(rough: Classic, smooth: Classic) -> Step:
    """Figure 23."""
    assert rough.surface is not None
    assert smooth.surface is not None
    (mass, zeta, error), (bare, bare_zeta, bare_error) = rough.surface.best, smooth.surface.best
    row = Row(
        what="least of the error surface", thesis="80 kg, 0.015",
        here=f"{mass:.1f} kg, {zeta:.3f} (error {error:.0%}); without friction {bare:.1f} kg, {bare_zeta:.3f} ({bare_error:.1%})",
        remark="of the same size, but not what was put in (80 kg, 0.015): the readings beside it are those of coupled modes, and "
        "friction stands in the data and not in the simulation",
    )  # fmt: skip
    text = (
        "**The table's damping.** A minimum of the error surface is no measurement of it: with friction it lies "
        f"{mass / THESIS['table_mass'] - 1.0:+.0%} off in mass and {zeta / THESIS['table_damping'] - 1.0:+.0%} in damping, "
        "and an error of "
        f"{error:.0%} remains at its best, which says that the model is wrong. The joint fit below has friction in the model and "
        "finds what was put in."
    )
    return Step(
        title="Fig. 23: the error surface", rows=[row], text=[text], pictures={"error-surface": surface_figure(rough.surface)}
    )  # fmt: skip


def joint(found: Characterization) -> Step:
    """Table 4."""
    rows = []
    for name, entry in found.table.items():
        if entry.method == "given":
            continue
        off = (entry.value - THESIS[name]) / entry.std if entry.value is not None and entry.std else float("nan")
        rows.append(
            Row(
                what=f"{name.replace('_', ' ')}, {entry.unit}", thesis=f"{THESIS[name]:g}",
                here="–" if entry.value is None else f"{entry.value:.5g} ± {entry.std:.1g}", remark=f"{off:+.1f} deviations off",
            )
        )  # fmt: skip
    text = (
        "All runs at once with friction in the model (`rig characterize`): on held-out data it errs by "
        f"{100 * found.error:.2g} % of "
        f"the signal, where noise alone makes {100 * found.floor:.2g} %. The thesis's values were put in, so agreement here "
        "says that "
        "these runs suffice to find them, not that the thesis's are right."
    )
    return Step(title="Table 4: the parameters", rows=rows, text=[text])
