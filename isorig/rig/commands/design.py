"""How soft the isolation may be for given moves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from isorig.rig.options import Method, Output

#: Largest number of points and of draws.
MOST = 100_000


def design(
    plan: Path,
    *,
    output: Output,
    model: str | None = None,
    parameters: Path | None = None,
    method: Method = "joint",
    points: int = 100,
    draws: int = 100,
    offset: tuple[float, ...] = (0.0, 0.01, 0.02),
    rocking_frequency: float = 30.0,
    seed: int = 0,
) -> None:
    """Find the values of chosen parameters with the smallest transmissibility, ratio or rms within the limits of a rig.

    The plan names the parameters that may vary, with their bounds, and the target. A plan without them has the moves of the wire
    bonder: the result is then the largest stroke over the isolation frequency, and the lowest frequency within a limit.

    Example: rig design plan.toml --model absorber -o design

    Example: rig design moves.toml --parameters parameters/parameters.json -o design

    Parameters
    ----------
    plan
        The plan, a TOML file.
    output
        The folder for design.json, tables and figures, and designed.toml, the description with the best values.
    model
        The rig: a description, the name of one that rig describe lists, or a model.json; by default the wire bonder.
    parameters
        The parameters.json of the present rig, with uncertainties; by default the values are those of the model, for the moves
        of the wire bonder those of the thesis.
    method
        For the moves of the wire bonder: the values of the joint fit, or those by half-power.
    points
        Number of designs before the refinement, and of points in each sweep; for the moves the number of isolation frequencies.
    draws
        Number of parameter sets drawn from the uncertainties.
    offset
        For the moves of the wire bonder: distances of the drive from the motor's centre of gravity to study, m.
    rocking_frequency
        For the moves of the wire bonder: frequency at which the motor rocks on its bearings, Hz.
    seed
        Random seed of the draws.
    """
    from isorig.rig.design.parameters import is_parameter_plan
    from isorig.rig.errors import PlanError

    if not 2 <= points <= MOST or not 0 <= draws <= MOST:
        raise PlanError(f"{points} points and {draws} draws are not possible; give two points or more, and up to {MOST} of each")
    if is_parameter_plan(plan):
        _parameters(plan, output, model or "wire-bonder", parameters, points=points, draws=draws, seed=seed)
        return
    if model is not None:
        raise PlanError(
            f"{plan} has no [[vary]] with parameter, low and high, which a design of another rig needs; add it, or omit --model"
        )
    _moves(plan, output, parameters, method, points, draws, offset, rocking_frequency, seed)


def _parameters(plan: Path, output: Path, model: str, table: Path | None, *, points: int, draws: int, seed: int) -> None:
    from rich.console import Console

    from isorig.rig.design.parameters import designed_parameters, read_parameter_plan, write_parameter_design
    from isorig.rig.files.rigfile import read_rig

    read = read_parameter_plan(plan)
    with Console(stderr=True).status("simulating designs"):
        found = designed_parameters(read, read_rig(model), table, points=points, draws=draws, seed=seed)
        sentences = write_parameter_design(output, found)
    for sentence in sentences:
        print(sentence)
    print(output)


def _moves(
    profile: Path, output: Path, parameters: Path | None, method: Method, points: int, draws: int,
    offset: tuple[float, ...], rocking_frequency: float, seed: int,
) -> None:  # fmt: skip
    import numpy as np

    from isorig.rig.files.output import write_csv, write_json
    from isorig.rig.frf.figures import save
    from isorig.rig.process.terminal import show_table
    from isorig.rig.wire_bonder.design_figures import bond_figure, history_figure, level_figure, offset_figure, stroke_figure
    from isorig.rig.wire_bonder.design_study import ISOLATED, RATE, designed, read_design, rigs_of, with_head
    from isorig.rig.wire_bonder.figures import isolation_figure
    from isorig.rig.wire_bonder.parameters import read_rig_values

    plan = read_design(profile)
    table = with_head(read_rig_values(parameters, method), plan)
    rigs = rigs_of(table, plan, draws=draws, seed=seed)
    found = designed(plan, rigs, points=points, offsets=offset, rocking_frequency=rocking_frequency)
    columns = {"frequency_hz": found.studies["with friction"].frequency}
    for name, study in found.studies.items():
        plain = _plain(name)
        columns[f"stroke_{plain}_m"] = study.stroke
        if len(study.draws):
            columns[f"stroke_{plain}_std_m"] = study.draws.std(axis=0, ddof=1)
    write_csv(output / "strokes.csv", columns)
    times = {"time_s": np.arange(len(found.head)) / RATE, "head_m_s2": found.head}
    for name, bodies in found.histories.items():
        plain = _plain(name)
        times |= {f"{plain}_{body}_m": values for body, values in bodies.items()}
    write_csv(output / "histories.csv", times)
    levels = {"acceleration_m_s2": next(iter(found.levels.values())).acceleration}
    for name, item in found.levels.items():
        plain = _plain(name)
        levels[f"isolated_{plain}"] = item.isolation
        levels[f"largest_{plain}_m"] = np.array([r.largest for r in item.unlocked])
        levels[f"settling_{plain}_s"] = np.array([r.settling for r in item.unlocked])
    write_csv(output / "moves.csv", levels)
    save(level_figure(found.levels), output / "moves.png")
    save(bond_figure(found.rigs, plan.bond), output / "bond.png")
    save(stroke_figure(found), output / "strokes.png")
    save(history_figure(found), output / "histories.png")
    save(isolation_figure(found.ratios, {}), output / "ratio.png")
    if found.offsets:
        save(offset_figure(found), output / "offset.png")
    content: dict[str, Any] = {
        "format": "rig-design", "format_version": 1, "limit_m": plan.limit, "safety_factor": plan.safety,
        "present_frequency_hz": found.present,
        "studies": {
            name: {
                "lowest_hz": _finite(s.lowest), "std_hz": s.std, "recommended_hz": _finite(s.recommended), "draws": len(s.draws),
            }
            for name, s in found.studies.items()
        },
        "median_ratio_5_to_15_hz": {
            name: float(np.median(r.ratio[(r.frequency >= 5.0) & (r.frequency <= 15.0)])) for name, r in found.ratios.items()
        },
        "assumed": list(table.assumed), "notes": table.remarks,
        "bond": {
            "distance_m": plan.bond.distance, "seconds": plan.bond.seconds, "tolerance_m": plan.bond.tolerance,
            "cases": {
                name: {"largest_m": r.largest, "settling_s": _finite(r.settling), "stroke_m": found.stroke(name)}
                for name, r in found.bonds.items()
            },
        },
        "drive_offsets": [
            {"offset_m": o, "rocking_rad": d.rocking, "stroke_m": d.stroke, "ratio_over_none": d.worst}
            for o, d in found.offsets.items()
        ],
    }  # fmt: skip
    write_json(output / "design.json", content)
    rows = [
        (name, _shown(s.lowest), f"{s.std:.2g}", _shown(s.recommended)) for name, s in found.studies.items()
    ]  # fmt: skip
    allowed = 1e3 * plan.limit / plan.safety
    show_table(f"stroke within {allowed:.3g} mm", ("", "lowest, Hz", "std, Hz", "recommended, Hz"), rows)
    for name, response in found.bonds.items():
        still = "does not settle" if np.isnan(response.settling) else f"settles {1e3 * response.settling:.0f} ms after the move"
        print(
            f"{name}: in a move of {1e3 * plan.bond.distance:g} mm in {1e3 * plan.bond.seconds:g} ms the heatblock moves "
            f"{1e6 * response.largest:.2g} µm relative to the table (allowed ±{1e6 * plan.bond.tolerance:g} µm) and {still}"
        )
    for sentence in table.remarks:
        print(sentence)
    for item in content["drive_offsets"]:
        print(
            f"drive offset {1e3 * item['offset_m']:g} mm: the motor rocks by {1e3 * item['rocking_rad']:.3g} mrad, "
            f"the ratio from {ISOLATED[0]:g} to {ISOLATED[1]:g} Hz is at worst {item['ratio_over_none']:.3g} times "
            "that without offset"
        )
    print(output)


def _plain(name: str) -> str:
    # The name of a case as a column name.
    return name.replace(",", "").replace(" ", "_")


def _finite(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


def _shown(value: float) -> str:
    return f"{value:.3g}" if abs(value) < float("inf") else "none"
