"""rig design: how soft the isolation may be for given moves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter


def design(
    profile: Path,
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    parameters: Path | None = None,
    method: Literal["joint", "half-power"] = "joint",
    points: int = 100,
    draws: int = 100,
    offset: tuple[float, ...] = (0.0, 0.01, 0.02),
    rocking_frequency: float = 30.0,
    seed: int = 0,
) -> None:
    """Compute the largest stroke over the isolation frequency for given moves, and the lowest frequency within a limit.

    Example: rig design moves.toml --parameters parameters/parameters.json -o design

    Parameters
    ----------
    profile
        The moves, the limit and the safety factor, a TOML file.
    output
        The folder for design.json, strokes.csv, moves.csv, histories.csv and figures.
    parameters
        The parameters.json of the present rig, with uncertainties; by default the thesis's table.
    method
        The values to use: those of the joint fit, or those by half-power.
    points
        Number of isolation frequencies.
    draws
        Number of parameter sets drawn from the uncertainties.
    offset
        Distances of the drive from the motor's centre of gravity to study, m.
    rocking_frequency
        Frequency at which the motor rocks on its bearings, Hz.
    seed
        Random seed of the draws.
    """
    import numpy as np

    from isorig.rig.design_figures import bond_figure, history_figure, level_figure, offset_figure, stroke_figure
    from isorig.rig.design_study import RATE, designed, read_design, rigs_of, with_head
    from isorig.rig.errors import PlanError
    from isorig.rig.figures import isolation_figure, save
    from isorig.rig.files.output import write_csv, write_json
    from isorig.rig.files.parameter_seed import read_seed
    from isorig.rig.terminal import show_table

    if not 2 <= points <= 100_000 or not 0 <= draws <= 100_000:
        raise PlanError(f"{points} points and {draws} draws are not possible; give 2 to 100000 points and up to 100000 draws")
    plan = read_design(profile)
    table = with_head(read_seed(parameters, method), plan)
    rigs = rigs_of(table, plan, draws=draws, randomness=seed)
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
            name: {"lowest_hz": _told(s.lowest), "std_hz": s.std, "recommended_hz": _told(s.recommended), "draws": len(s.draws)}
            for name, s in found.studies.items()
        },
        "median_ratio_5_to_15_hz": {
            name: float(np.median(r.ratio[(r.frequency >= 5.0) & (r.frequency <= 15.0)])) for name, r in found.ratios.items()
        },
        "assumed": list(table.assumed), "notes": table.told,
        "bond": {
            "distance_m": plan.bond.distance, "seconds": plan.bond.seconds, "tolerance_m": plan.bond.tolerance,
            "cases": {
                name: {"largest_m": r.largest, "settling_s": _told(r.settling), "stroke_m": found.stroke(name)}
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
    for sentence in table.told:
        print(sentence)
    for item in content["drive_offsets"]:
        print(
            f"drive offset {1e3 * item['offset_m']:g} mm: the motor rocks by {1e3 * item['rocking_rad']:.3g} mrad, "
            f"the ratio from 5 to 50 Hz is at worst {item['ratio_over_none']:.3g} times that without offset"
        )
    print(output)


def _plain(name: str) -> str:
    # The name of a case as a column name.
    return name.replace(",", "").replace(" ", "_")


def _told(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


def _shown(value: float) -> str:
    return f"{value:.3g}" if abs(value) < float("inf") else "none"
