"""The thesis's four set-ups compared with the joint fit: plain values for files, figures, and a page with every fit."""

from pathlib import Path
from typing import Any

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.fitting.uncertainty import CALIBRATION
from isorig.analysis.parameters.joint_fit import Characterization
from isorig.analysis.spectra.modal_fit import Mode
from isorig.analysis.spectra.quality import without
from isorig.analysis.wording import with_std, words
from isorig.rig.files.output import write_text
from isorig.rig.frf.figures import save
from isorig.rig.model.baseline import baseline_model
from isorig.rig.report.charts import Chart, ChartTrace, Panel, unjoined
from isorig.rig.report.frequency import frf_panels, frf_traces
from isorig.rig.report.measurement import fits_page
from isorig.rig.report.page import Section, Table
from isorig.rig.report.sections import with_unit
from isorig.rig.wire_bonder.figures import set_ups_figure, surface_figure
from isorig.rig.wire_bonder.four_set_ups import ErrorSurface, FourSetUps, SetUp, evaluated_set_ups

BIASED = (
    "Single peaks of the coupled rig, as in the thesis, without friction in the model, so that friction counts as damping. "
    "The joint fit is the better estimate; these values show the result of a linear evaluation of the same runs."
)

STATED = (
    "The standard uncertainties of the joint fit are computed from its residuals, leaving out each frequency bin in turn in all "
    "channels, given the recorded head acceleration. They include the simulation's time step and the recorder's filter and, if "
    "the model misfits, also the differences between the runs and the size of the misfit."
)
CALIBRATED = "The given uncertainties of the sensors' calibration and of the weighed masses are propagated through the fit."
EXACT = (
    f"The recording gives no uncertainty of its sensors' calibration ({CALIBRATION}), so they are treated as exact: an error of "
    "the head's sensor or mass affects the friction in full and the table's mass in part."
)


def write_set_ups(folder: Path, campaign: Campaign, found: Characterization) -> FourSetUps:
    """Write fits.html, set-ups.png and error-surface.png; the evaluated set-ups."""
    read = evaluated_set_ups(without(campaign, found.faults, ("head", "motor", "table", "heatblock")), baseline_model(campaign))
    if read.set_ups:
        save(set_ups_figure(read.set_ups), folder / "set-ups.png")
    if read.surface is not None:
        save(surface_figure(read.surface), folder / "error-surface.png")
    write_text(folder / "fits.html", _page(campaign, found, read))
    return read


def set_ups_content(read: FourSetUps) -> dict[str, Any]:
    """The evaluated set-ups as plain values, by the names of the parameter table."""
    rows: dict[str, Any] = {}
    for item in read.set_ups:
        half = item.half_power
        rows[item.name] = {
            **_of_mode(item.mode), "method": item.method, "note": item.refused or (item.fit.warning if item.fit else ""),
            "half_power": {**_of_mode(half.mode), "refused": half.refused, "note": half.refused or half.warning},
            "resolution_hz": item.frf.resolution, "averages": item.frf.averages,
        }  # fmt: skip
    if read.surface is not None:
        mass, damping, error = read.surface.best
        rows["error_surface"] = {
            "table_mass": {"value": mass, "std": read.surface.std[0]},
            "table_damping": {"value": damping, "std": read.surface.std[1]}, "mean_relative_error": error,
        }  # fmt: skip
    return {**rows, "refused": read.refused}


def _of_mode(mode: Mode | None) -> dict[str, Any]:
    names = {"frequency_hz": "frequency", "damping": "damping"}
    return {key: {"value": getattr(mode, name, None), "std": getattr(mode, f"{name}_std", None)} for key, name in names.items()}


def _page(campaign: Campaign, found: Characterization, read: FourSetUps) -> str:
    text = [BIASED, STATED, CALIBRATED if found.calibrated else EXACT]
    return fits_page(
        campaign, found, Section(title="Parameters", text=text, tables=[_compared(found, read)]),
        [*map(_set_up_section, read.set_ups), *([] if read.surface is None else [_surface_section(read.surface)])],
        [f"{words(name).capitalize()}: not available, because {reason}." for name, reason in read.refused.items()],
    )  # fmt: skip


def _compared(found: Characterization, read: FourSetUps) -> Table:
    by_name: dict[str, SetUp] = {item.name: item for item in read.set_ups}
    surface = {} if read.surface is None else {"table_mass": read.surface.best[0], "table_damping": read.surface.best[1]}
    rows = []
    for name, entry in found.table.items():
        body, _, what = name.partition("_")
        item = by_name.get(body) if what in ("frequency", "damping") else None
        modes = (None, None) if item is None else (item.mode, item.half_power.mode)
        rows.append(
            (
                words(name), with_unit(entry.value, entry.unit, entry.uncertainty),
                *(with_unit(None if mode is None else getattr(mode, what), entry.unit) for mode in modes),
                with_unit(surface.get(name), entry.unit),
                entry.note,
            )
        )  # fmt: skip
    return Table(columns=("parameter", "joint fit ± std", "fit of modes", "half-power", "error surface", "note"), rows=rows)


def _set_up_section(item: SetUp) -> Section:
    frf, half = item.frf.within(item.band), item.half_power
    traces = frf_traces(frf, "measured")
    if item.fit is not None:
        x, fitted = item.fit.frequency, item.fit.fitted
        traces.append(ChartTrace(name="fit", x=x, y=np.abs(fitted), role="simulated"))
        traces.append(ChartTrace(name="fit", x=x, y=unjoined(np.degrees(np.angle(fitted))), role="simulated", panel=1))
    if half.mode is not None:
        points = half.amplitude * np.array([0.5**0.5, 1.0, 0.5**0.5])
        traces.append(
            ChartTrace(
                name="half-power points", x=np.array([half.low, half.peak, half.high]), y=points, role="second", style="markers"
            )
        )
    text = []
    if item.mode is not None:
        m = item.mode
        text.append(
            f"By {item.method}: {with_std(m.frequency, m.frequency_std)} Hz, damping ratio "
            f"{with_std(m.damping, m.damping_std)}, {m.bins:.1f} frequency bins of {frf.resolution:.3g} Hz in the bandwidth."
        )
    text += [f"No fit: {item.refused}."] if item.refused else []
    if half.mode is None:
        text.append(f"Half-power is not applicable: {half.refused}.")
    else:
        text.append(
            f"Half-power: {half.mode.frequency:.4f} Hz, damping ratio {with_std(half.mode.damping, half.mode.damping_std)}"
            + (f"; {half.warning}." if half.warning else ".")
        )
    chart = Chart(
        name=f"set-up-{item.name}", caption=f"{frf.response} over {frf.reference}.", x_log=False,
        panels=frf_panels(frf), traces=traces,
    )  # fmt: skip
    return Section(title=f"{item.name.capitalize()}: {frf.reference} to {frf.response}", text=text, charts=[chart])


def _surface_section(surface: ErrorSurface) -> Section:
    mass, damping, error = surface.best
    row, column = (int(np.argmin(np.abs(axis - best))) for axis, best in ((surface.damping, damping), (surface.mass, mass)))
    text = (
        f"The mean relative error of the simulated magnitude has its minimum, {100 * error:.1f} %, at a table of "
        f"{with_std(mass, surface.std[0])} kg with a damping ratio of {with_std(damping, surface.std[1])} "
        "(standard uncertainties from the measurement's error bars only); error-surface.png shows the surface."
    )
    charts = [
        Chart(
            name="error-surface-fit", caption="Head to table at the surface's minimum.", x_log=False,
            panels=[Panel(label="|table / head|, m/s² per m/s²", log=True)],
            traces=[
                ChartTrace(name="measured", x=surface.frequency, y=surface.measured),
                ChartTrace(name="simulated", x=surface.frequency, y=surface.simulated, role="simulated"),
            ],
        ),
        *(
            Chart(
                name=f"error-over-{one}", caption=f"The error over the table's {one}, at the best {other}.", x_label=label,
                panels=[Panel(label="mean relative error")], traces=[ChartTrace(name="error", x=x, y=y)],
            )
            for one, other, label, x, y in (
                ("mass", "damping", "table mass, kg", surface.mass, surface.error[row]),
                ("damping", "mass", "damping ratio", surface.damping, surface.error[:, column]),
            )
        ),
    ]  # fmt: skip
    return Section(title="Effective table: error surface", text=[text], charts=charts)
