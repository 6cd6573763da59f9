"""Files of the design study: its values, tables and figures."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.rig.files.output import write_csv, write_json
from isorig.rig.frf.figures import Figure, gridded, save
from isorig.rig.virtual.levels import MOVE_RATE
from isorig.rig.wire_bonder.design_study import ISOLATED, BondPlan, Designed, DesignPlan
from isorig.rig.wire_bonder.figures import isolation_figure
from isorig.rig.wire_bonder.move_isolation import MoveIsolation, MoveResponse
from isorig.rig.wire_bonder.parameters import RigValues

#: Milliseconds of the bond's move that are shown, from its start.
SHOWN = 120.0


def write_design(folder: Path, plan: DesignPlan, values: RigValues, found: Designed) -> list[str]:
    """Write design.json, tables and figures; the sentences about moves and drive offsets."""
    columns = {"frequency_hz": found.studies["with friction"].frequency}
    for name, study in found.studies.items():
        columns[f"stroke_{_plain(name)}_m"] = study.stroke
        if len(study.draws):
            columns[f"stroke_{_plain(name)}_std_m"] = study.draws.std(axis=0, ddof=1)
    write_csv(folder / "strokes.csv", columns)
    times = {"time_s": np.arange(len(found.head)) / MOVE_RATE, "head_m_s2": found.head}
    moves: dict[str, FloatArray] = {}
    for name, case in found.cases.items():
        times |= {f"{_plain(name)}_{body}_m": positions for body, positions in case.histories.items()}
        moves |= {
            "acceleration_m_s2": case.levels.acceleration, f"isolated_{_plain(name)}": case.levels.isolation,
            f"largest_{_plain(name)}_m": case.levels.unlocked, f"settling_{_plain(name)}_s": case.levels.settling,
        }  # fmt: skip
    write_csv(folder / "histories.csv", times)
    write_csv(folder / "moves.csv", moves)
    save(level_figure({name: case.levels for name, case in found.cases.items()}), folder / "moves.png")
    save(bond_figure({name: case.bond for name, case in found.cases.items()}, plan.bond), folder / "bond.png")
    save(stroke_figure(found), folder / "strokes.png")
    save(history_figure(found), folder / "histories.png")
    save(isolation_figure({name: case.ratio for name, case in found.cases.items()}, {}), folder / "ratio.png")
    if found.offsets:
        save(offset_figure(found), folder / "offset.png")
    write_json(folder / "design.json", _content(plan, values, found))
    return [*_bond_sentences(plan, found), *values.remarks, *_offset_sentences(found)]


def _content(plan: DesignPlan, values: RigValues, found: Designed) -> dict[str, Any]:
    bond = plan.bond
    return {
        "format": "rig-design", "format_version": 1, "limit_m": plan.limit, "safety_factor": plan.safety,
        "present_frequency_hz": found.present,
        "studies": {
            name: {"lowest_hz": s.lowest, "std_hz": s.std, "recommended_hz": s.recommended, "draws": len(s.draws)}
            for name, s in found.studies.items()
        },
        "median_ratio_5_to_15_hz": {name: case.median_ratio for name, case in found.cases.items()},
        "assumed": list(values.assumed), "notes": values.remarks,
        "bond": {
            "distance_m": bond.distance, "seconds": bond.seconds, "tolerance_m": bond.tolerance,
            "cases": {
                name: {"largest_m": r.largest, "settling_s": r.settling, "stroke_m": case.stroke}
                for name, case in found.cases.items() for r in (case.bond["unlocked"],)
            },
        },
        "drive_offsets": [
            {"offset_m": o, "rocking_rad": d.rocking, "stroke_m": d.stroke, "ratio_over_none": d.worst}
            for o, d in found.offsets.items()
        ],
    }  # fmt: skip


def _bond_sentences(plan: DesignPlan, found: Designed) -> Iterator[str]:
    bond = plan.bond
    for name, case in found.cases.items():
        response = case.bond["unlocked"]
        still = "does not settle" if np.isnan(response.settling) else f"settles {1e3 * response.settling:.0f} ms after the move"
        yield (
            f"{name}: in a move of {1e3 * bond.distance:g} mm in {1e3 * bond.seconds:g} ms the heatblock moves "
            f"{1e6 * response.largest:.2g} µm relative to the table (allowed ±{1e6 * bond.tolerance:g} µm) and {still}"
        )


def _offset_sentences(found: Designed) -> Iterator[str]:
    for offset, seen in found.offsets.items():
        yield (
            f"drive offset {1e3 * offset:g} mm: the motor rocks by {1e3 * seen.rocking:.3g} mrad, the ratio from "
            f"{ISOLATED[0]:g} to {ISOLATED[1]:g} Hz is at worst {seen.worst:.3g} times that without offset"
        )


def _plain(name: str) -> str:
    # The name of a case as a column name.
    return name.replace(",", "").replace(" ", "_")


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
    axis.legend(fontsize=8)
    return gridded(figure)


def history_figure(designed: Designed) -> Figure:
    """Displacement of all bodies over time for each case."""
    figure = Figure(figsize=(9.0, 3.0 * len(designed.cases) + 1.0), layout="constrained")
    axes = figure.subplots(len(designed.cases), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (name, case) in zip(axes, designed.cases.items(), strict=True):
        for body, values in case.histories.items():
            # The heatblock moves with the table, so its line is dashed and on top.
            dash = "--" if body == "heatblock" else "-"
            axis.plot(np.arange(len(values)) / MOVE_RATE, 1e3 * values, dash, lw=1.0, label=body)
        axis.set(title=name, ylabel="displacement, mm")
    axes[0].legend(fontsize=8)
    axes[-1].set(xlabel="time, s")
    return gridded(figure)


def offset_figure(designed: Designed) -> Figure:
    """Isolation ratio without friction for each distance of the drive from the motor's centre of gravity."""
    figure = Figure(figsize=(9.0, 4.5), layout="constrained")
    axis = figure.subplots()
    for offset, seen in designed.offsets.items():
        axis.plot(seen.frequency, seen.ratio, lw=1.2, label=f"offset {1e3 * offset:g} mm: rocks by {1e3 * seen.rocking:.2g} mrad")
    axis.set(xscale="log", yscale="log", xlabel="frequency, Hz", ylabel="ratio, unlocked / locked")
    axis.legend(fontsize=8)
    return gridded(figure)


def level_figure(by_case: Mapping[str, MoveIsolation]) -> Figure:
    """Isolation during moves over their acceleration, and the heatblock's largest displacement with the bond's tolerance."""
    figure = Figure(figsize=(9.0, 7.0), layout="constrained")
    share, size = figure.subplots(2, 1, sharex=True)
    for name, item in by_case.items():
        (line,) = share.plot(item.acceleration, 100.0 * item.isolation, "o-", ms=3, lw=1.1, label=name)
        size.plot(item.acceleration, 1e6 * item.unlocked, "o-", ms=3, lw=1.1, color=line.get_color(), label=f"unlocked, {name}")
    any_ = next(iter(by_case.values()))
    size.plot(any_.acceleration, 1e6 * any_.locked, "k--", lw=1.1, label="locked")
    size.axhline(1e6 * any_.tolerance, color="tab:red", lw=1.0, label=f"the bond's ±{1e6 * any_.tolerance:g} µm")
    share.set(ylabel="isolation during a move, %", title="Heatblock relative to the table, unlocked compared with locked")
    size.set(
        yscale="log", ylabel="heatblock relative to table, largest, µm", xlabel="peak of the head's acceleration, m/s²",
        xscale="log",
    )  # fmt: skip
    share.legend(fontsize=8)
    size.legend(fontsize=8)
    return gridded(figure)


def bond_figure(by_case: Mapping[str, Mapping[str, MoveResponse]], bond: BondPlan) -> Figure:
    """The heatblock relative to the table during the bond's move, locked and unlocked, with tolerance and settling time."""
    figure = Figure(figsize=(9.0, 3.2 * len(by_case) + 0.6), layout="constrained")
    axes = figure.subplots(len(by_case), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (name, responses) in zip(axes, by_case.items(), strict=True):
        for (configuration, seen), colour in zip(responses.items(), ("0.4", "tab:blue"), strict=True):
            kept = 1e3 * seen.time < SHOWN
            settled = f"settled {1e3 * seen.settling:.0f} ms after the move" if np.isfinite(seen.settling) else "does not settle"
            axis.plot(1e3 * seen.time[kept], 1e6 * seen.motion[kept], lw=1.0, color=colour, label=f"{configuration}: {settled}")
        axis.axhspan(-1e6 * bond.tolerance, 1e6 * bond.tolerance, color="tab:red", alpha=0.2, lw=0, label="the bond's tolerance")
        axis.axvline(1e3 * bond.seconds, color="0.2", ls=":", lw=1.0, label="end of the move")
        axis.set(ylabel="heatblock relative to table, µm", title=name)
        axis.legend(fontsize=8, loc="upper right")
    figure.axes[-1].set(xlabel="time, ms")
    return gridded(figure)
