"""98 % predicted, 60 % measured: the isolation during a move over its acceleration, and the bond's specification."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.design_files import bond_figure, level_figure
from isorig.rig.wire_bonder.design_study import BOND, BondPlan, bonding
from isorig.rig.wire_bonder.move_isolation import MoveIsolation, MoveResponse, isolation_by_level, move_within
from isorig.rig.wire_bonder.stroke import frictionless, lowest_inside
from thesis.campaign import Played
from thesis.published_values import Stated, below
from thesis.step import Row, Step, judged

DISTANCE = 4e-3
#: Levels of the picture, m/s^2, those of the rows, and the thesis's 17 g.
LEVELS = np.array([8.0, 10.0, 12.5, 16.0, 20.0, 25.0, 30.0, 40.0, 50.0, 65.0, 80.0, 100.0, 130.0, 166.7, 208.0])
TOLD, HARDEST = (12.5, 20.0, 25.0, 30.0, 166.7), 166.7
PREDICTED, MEASURED = 0.98, 0.60
#: Moves that a rig on a bench is driven with, m/s^2: the level of the thesis's 60 % is not given.
BENCH = (12.5, 40.0)


def rigs(played: Played) -> dict[str, MoveIsolation]:
    """Isolation by level of the rig closest to the thesis, of Table 4 with 20 N, and without friction."""
    given = {
        played.candidate.name: played.rig,
        "Table 4 and 20 N": wire_bonder(),
        "without friction": frictionless(wire_bonder()),
    }
    return {name: isolation_by_level(rig, DISTANCE, LEVELS, tolerance=BOND.tolerance) for name, rig in given.items()}


def moves(played: Played, bond: BondPlan = BOND) -> Step:
    """Rows, table and pictures."""
    found, responses = rigs(played), bonding(played.rig, bond)
    smooth = found["without friction"]
    rough = {name: item for name, item in found.items() if item is not smooth}
    rows = [
        judged(
            f"isolated on a move of {1e3 * DISTANCE:g} mm at {HARDEST:g} m/s², without friction: transmitted share",
            Stated(words="98 % predicted", low=1.0 - PREDICTED, high=1.0 - PREDICTED, tolerance=0.5),
            1.0 - _at(smooth, HARDEST),
            here=f"{1.0 - _at(smooth, HARDEST):.3f} ({_at(smooth, HARDEST):.0%} isolated)",
        ),
        *(
            judged(
                f"{name}: acceleration above which moves isolate {MEASURED:.0%}, m/s²",
                Stated(
                    words="60 % measured, acceleration not given, typical of a bench", low=BENCH[0], high=BENCH[1], tolerance=0.1
                ),
                level_for(item, MEASURED),
            )
            for name, item in rough.items()
        ),
        *(_bonded(configuration, seen, bond) for configuration, seen in responses.items()),
    ]
    table = (
        ("peak of the head's acceleration, m/s²", *found),
        [(f"{level:g}", *(f"{_at(item, level):.0%}" for item in found.values())) for level in TOLD],
    )
    text = [
        "**98 % and 60 %** refer to moves: to the heatblock's displacement relative to the table, unlocked compared with locked. "
        "Friction is a constant force, so its effect depends on the acceleration of the move: " + _sentence(rough) + " The "
        "median of a transfer function is a different figure, further below.",
        f"**The bond** requires ±{1e6 * bond.tolerance:g} µm of the heatblock relative to the table after a move of "
        f"{1e3 * bond.distance:g} mm in {1e3 * bond.seconds:g} ms; with sinusoidal acceleration its peak is "
        f"{move_within(bond.distance, bond.seconds).acceleration:.0f} m/s² (with constant acceleration "
        f"{move_within(bond.distance, bond.seconds, shape='constant').acceleration:.0f}; 17 g is between the two). `rig design` "
        "computes both figures for any rig.",
    ]  # fmt: skip
    return Step(
        title="98 % and 60 %: isolation on a move", rows=rows, text=text, tables=[table],
        pictures={"moves": _levels(found), "bond": bond_figure({played.candidate.name: responses}, bond)},
    )  # fmt: skip


def level_for(levels: MoveIsolation, isolation: float) -> float:
    """Lowest acceleration above which moves isolate at least this much, m/s^2, linearly interpolated; NaN if there is none."""
    return lowest_inside(levels.acceleration, -levels.isolation, -isolation)


def _at(found: MoveIsolation, level: float) -> float:
    return float(np.interp(level, found.acceleration, found.isolation))


def _sentence(found: dict[str, MoveIsolation]) -> str:
    said = [
        f"with {name}, {_at(item, HARDEST):.0%} at 17 g and {_at(item, 12.5):.0%} at 12.5 m/s²" for name, item in found.items()
    ]
    lost = max(_at(item, HARDEST) for item in found.values())
    hardly = "At 17 g friction has little effect." if lost > 0.9 else "Even at 17 g friction has an effect."
    return "; ".join(said) + ". " + hardly


def _bonded(configuration: str, seen: MoveResponse, bond: BondPlan) -> Row:
    return judged(
        f"{configuration}: heatblock relative to table in a move of {1e3 * bond.distance:g} mm in {1e3 * bond.seconds:g} ms, "
        "largest, µm",
        below(f"±{1e6 * bond.tolerance:g} µm required", 1e6 * bond.tolerance, 0.01), 1e6 * seen.largest,
        here=f"{1e6 * seen.largest:.2g}, settled {1e3 * seen.settling:.0f} ms after the move",
    )  # fmt: skip


def _levels(found: dict[str, MoveIsolation]) -> Figure:
    figure = level_figure(found)
    axis = figure.axes[0]
    for share, words, at, side in ((PREDICTED, "98 % predicted", 0, "left"), (MEASURED, "60 % measured", -1, "right")):
        axis.axhline(100.0 * share, color="0.4", ls="--", lw=0.8)
        axis.text(LEVELS[at], 100.0 * share - 1.0, words, fontsize=8, ha=side, va="top")
    return figure
