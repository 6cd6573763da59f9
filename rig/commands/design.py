"""rig design: how soft the isolation may be for given moves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter


def design(
    profile: Path,
    *,
    output: Annotated[Path, Parameter(name=["-o", "--output"])],
    parameters: Path | None = None,
    points: int = 100,
    draws: int = 100,
    offset: tuple[float, ...] = (0.0, 0.01, 0.02),
    rocking_frequency: float = 30.0,
    seed: int = 0,
) -> None:
    """Find the largest stroke against isolation frequency for a move profile, and the lowest frequency inside a limit.

    Example: rig design moves.toml --parameters parameters/parameters.json -o design

    Parameters
    ----------
    profile
        The moves, the limit and the safety factor, a TOML file.
    output
        The folder for design.json, strokes.csv, histories.csv and pictures.
    parameters
        The parameters.json of the present rig, with deviations; the thesis's table where absent.
    points
        Isolation frequencies on the grid.
    draws
        Sets of parameters drawn from their deviations.
    offset
        Distances of the drive from the motor's centre of gravity to study, m.
    rocking_frequency
        Frequency at which the motor rocks on its bearings, Hz.
    seed
        Seed of the draws.
    """
    import numpy as np

    from rig.design_figures import history_figure, offset_figure, stroke_figure
    from rig.designed import RATE, designed, read_design, rigs_of
    from rig.errors import PlanError
    from rig.figures import isolation_figure, save
    from rig.output import write_csv, write_json
    from rig.terminal import show_table

    if not 2 <= points <= 100_000 or not 0 <= draws <= 100_000:
        raise PlanError(f"{points} points and {draws} draws cannot be studied; give 2 to 100000 points and up to 100000 draws")
    plan = read_design(profile)
    rigs = rigs_of(parameters, plan, draws=draws, seed=seed)
    found = designed(plan, rigs, points=points, offsets=offset, rocking_frequency=rocking_frequency)
    columns = {"frequency_hz": found.studies["with friction"].frequency}
    for name, study in found.studies.items():
        plain = name.replace(" ", "_")
        columns[f"stroke_{plain}_m"] = study.stroke
        if len(study.draws):
            columns[f"stroke_{plain}_std_m"] = study.draws.std(axis=0, ddof=1)
    write_csv(output / "strokes.csv", columns)
    times = {"time_s": np.arange(len(found.head)) / RATE, "head_m_s2": found.head}
    for name, bodies in found.histories.items():
        plain = name.split(",")[0].replace(" ", "_")
        times |= {f"{plain}_{body}_m": values for body, values in bodies.items()}
    write_csv(output / "histories.csv", times)
    save(stroke_figure(found), output / "strokes.png")
    save(history_figure(found), output / "histories.png")
    save(isolation_figure(found.ratios, {}), output / "ratio.png")
    if found.offsets:
        save(offset_figure(found), output / "offset.png")
    told: dict[str, Any] = {
        "format": "rig-design", "format_version": 1, "limit_m": plan.limit, "safety_factor": plan.safety,
        "present_frequency_hz": found.present,
        "studies": {
            name: {"lowest_hz": _told(s.lowest), "std_hz": s.std, "recommended_hz": _told(s.recommended), "draws": len(s.draws)}
            for name, s in found.studies.items()
        },
        "median_ratio_5_to_15_hz": {
            name: float(np.median(r.ratio[(r.frequency >= 5.0) & (r.frequency <= 15.0)])) for name, r in found.ratios.items()
        },
        "drive_offsets": [
            {"offset_m": o, "rocking_rad": d.rocking, "stroke_m": d.stroke, "ratio_over_none": d.worst}
            for o, d in found.offsets.items()
        ],
    }  # fmt: skip
    write_json(output / "design.json", told)
    rows = [
        (name, _shown(s.lowest), f"{s.std:.2g}", _shown(s.recommended)) for name, s in found.studies.items()
    ]  # fmt: skip
    allowed = 1e3 * plan.limit / plan.safety
    show_table(f"stroke within {allowed:.3g} mm", ("", "lowest, Hz", "std, Hz", "recommended, Hz"), rows)
    for item in told["drive_offsets"]:
        print(
            f"drive {1e3 * item['offset_m']:g} mm off: the motor rocks by {1e3 * item['rocking_rad']:.3g} mrad, "
            f"the ratio from 5 to 50 Hz is at worst {item['ratio_over_none']:.3g} times that without offset"
        )
    print(output)


def _told(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


def _shown(value: float) -> str:
    return f"{value:.3g}" if abs(value) < float("inf") else "none"
