"""Figures 22 to 24 and Table 4: the effective table, the joint fit, simulation divided by measurement."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from isorig.analysis.campaign import FloatArray
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.parameters.joint_fit import Characterization, Entry
from isorig.analysis.wording import in_per_cent, with_std, words
from isorig.rig.model.prediction import predicted
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.figures import surface_figure
from isorig.rig.wire_bonder.four_set_ups import FourSetUps
from isorig.rig.wire_bonder.stroke import frictionless
from thesis.campaign import CALIBRATION, Played
from thesis.figure_readings import HALF_POWER
from thesis.figures import ACTUAL, COMPARED, SEEN, Seen, heavy_peak, response
from thesis.published_values import above, below, printed
from thesis.step import Row, Step, judged, plain

#: Frequency resolution of the overlay, and its displayed band, Hz.
OVERLAID, SHOWN = 0.125, (1.0, 20.0)
#: Deviations from which on a value is not what was put in.
SURE = 3.0


def sizes(played: Played, models: Mapping[str, RigModel]) -> tuple[FloatArray, dict[str, FloatArray]]:
    """|table / head| unlocked at the high gain: lines in Hz, measured and simulated by name, each shape (lines,)."""
    campaigns = {"measured": played.measured, **{name: predicted(model, played.measured) for name, model in models.items()}}
    found = {name: response(campaign, "table", OVERLAID) for name, campaign in campaigns.items()}
    frequency = found["measured"].frequency
    kept = (frequency >= SHOWN[0]) & (frequency <= SHOWN[1])
    return frequency[kept], {name: np.abs(frf.value[kept]) for name, frf in found.items()}


def simulated_over_measured(seen: Seen, found: Characterization) -> Step:
    """Figures 22 and 24."""
    played = seen.played
    heavy = {**THESIS, "table_mass": ACTUAL, "table_damping": HALF_POWER}
    models = {
        f"{ACTUAL:g} kg, {HALF_POWER:g}, without friction": frictionless(wire_bonder(heavy)),
        "Table 4 without friction": played.smooth_rig, "Table 4 with 20 N": wire_bonder(), "joint fit": found.fit.model,
    }  # fmt: skip
    f, size = sizes(played, models)
    rows = [
        judged(
            f"Fig. 22: peak of table over head with the actual {ACTUAL:g} kg and Table 3's {HALF_POWER:g}, over the measured one",
            below("far too small", 1.0 / 3.0), heavy_peak(seen),
            why={"agrees": "only part of the table moves in this mode, so its effective mass is smaller"},
        )
    ]  # fmt: skip
    for (low, high), said in COMPARED.items():
        kept = (f >= low) & (f <= high)
        stated = above(said, 1.0 + SEEN) if said == "too high" else below(said, 1.0 - SEEN)
        for name in list(models)[1:]:
            off = float(np.median(size[name][kept] / size["measured"][kept]))
            what = f"Fig. 24: {name} over measured, {low:g} to {high:g} Hz (median)"
            rows.append(plain(what, f"{off:.3f}") if name == "joint fit" else judged(what, stated, off))
    at = int(np.argmin(np.abs(f - 5.0)))
    over = {name: float(size[name][at] / size["measured"][at]) for name in ("Table 4 without friction", "Table 4 with 20 N")}
    bare, coulomb = over.values()
    text = (
        f"At 5 Hz the simulation without friction is {bare:.2g} times and the one with 20 N {coulomb:.2g} times the "
        "measured value: a median over 5 to 10 Hz would hide this, so the band is split. The table of all candidates above shows "
        "for which rig the error of the simulation agrees with the thesis."
    )
    return Step(
        title="Fig. 22 and 24: simulation divided by measurement", rows=rows, text=[text], pictures={"overlay": _overlay(f, size)}
    )  # fmt: skip


def _overlay(f: FloatArray, size: Mapping[str, FloatArray]) -> Figure:
    figure = Figure(figsize=(8.0, 4.0), layout="constrained")
    axis = figure.subplots()
    for name, values in size.items():
        axis.plot(f, values, lw=1.6 if name == "measured" else 1.0, ls="-" if name == "measured" else "--", label=name)
    axis.set(yscale="log", xlim=SHOWN, xlabel="frequency, Hz", ylabel="|table / head|, m/s² per m/s²", title="unlocked, gain 70")
    axis.grid(visible=True, which="both", alpha=0.25, lw=0.5)
    axis.legend(fontsize=8)
    return figure


def surface(rough: FourSetUps, smooth: FourSetUps) -> Step:
    """Figure 23."""
    rows: list[Row] = []
    pictures: dict[str, Figure] = {}
    for name, read in (("", rough), (", without friction", smooth)):
        if read.surface is None:
            continue
        mass, zeta, error = read.surface.best
        rows += [
            judged(f"minimum of the error surface{name}: table mass, kg", printed(THESIS["table_mass"], 0.15), mass),
            judged(f"minimum of the error surface{name}: table damping", printed(THESIS["table_damping"], 0.35), zeta),
            plain(f"remaining error there{name}", f"{error:.0%}"),
        ]
        pictures.setdefault("error-surface", surface_figure(read.surface))
    text = (
        "**The table's damping.** The minimum of the error surface does not measure it: the values compared with it are "
        "those of coupled modes, the data contain friction but the simulation does not, and the remaining error shows that the "
        "model is wrong."
    )
    return Step(title="Fig. 23: the error surface", rows=rows, text=[text], pictures=pictures)


def joint(base: Characterization, own: Characterization) -> Step:
    """Table 4: the joint fit on the base campaign, and on the campaign whose rig is the model."""
    cells: list[tuple[str, ...]] = []
    for name, entry in own.table.items():
        if entry.fixed:
            continue
        there = base.table[name]
        off = (entry.value - THESIS[name]) / entry.std if entry.value is not None and entry.std else float("nan")
        within = f"{abs(off):.1f} standard uncertainties, {'consistent' if abs(off) < SURE else 'inconsistent'}"
        cells.append((words(name), entry.unit, f"{THESIS[name]:g}", _with_std(entry), within, _with_std(there)))
    heads = ("parameter", "unit", "thesis", "fit on a rig equal to the model", "difference", "fit on this page's rig")
    text = [
        "All runs fitted at once with Coulomb friction in the model (`rig characterize`). Uncertainties include a sensor "
        f"calibration of {CALIBRATION:.0%}, as given in the recording; otherwise they would include the noise only and be "
        "thousands of times smaller.",
        f"On a rig equal to the model (Table 4 and 20 N) the error of the fit is {in_per_cent(own.error)} of the signal on "
        f"held-out data, that of noise alone {in_per_cent(own.floor)}: agreement shows that these runs suffice to identify the "
        "values, not that the thesis's values are correct. "
        f"On this page's rig the error is {in_per_cent(base.error)}, that of noise "
        f"{in_per_cent(base.floor)}: "
        + (
            "the model explains it, and the fit gives the values of that rig, not those of the thesis."
            if base.adequate
            else "the model is wrong there, which is noted for every value, and `rig diagnose` searches for the cause."
        ),
    ]
    return Step(title="Table 4: the parameters", tables=[(heads, cells)], text=text)


def _with_std(entry: Entry) -> str:
    return f"none: {entry.note}" if entry.value is None else with_std(entry.value, entry.std or 0.0)
