"""Figures 33 to 36: softest isolation, assumptions, flexures, and a drive off the centre of gravity."""

from __future__ import annotations

import msgspec
import numpy as np

from isorig.analysis.simulate.move_profile import Move
from isorig.rig.virtual.levels import MOVE_RATE
from isorig.rig.wire_bonder.description import THESIS
from isorig.rig.wire_bonder.design_files import history_figure, offset_figure, stroke_figure
from isorig.rig.wire_bonder.design_study import Designed, DesignPlan, HeadPlan, designed, with_head
from isorig.rig.wire_bonder.figures import isolation_figure
from isorig.rig.wire_bonder.parameters import OF_THESIS
from isorig.rig.wire_bonder.stroke import DAMPING_RATIO, HEIGHT, RADIUS, frictionless, stroke_study
from thesis.flexure import SPRING_STEEL, thinnest
from thesis.published_values import above, printed
from thesis.step import Step, judged, plain

#: The thesis's answer, Hz, and its curves.
SOFT = 0.6
#: Consecutive moves of 3 mm at 17 g with pauses of 50 ms; +-5 mm. The head and the number of moves are assumed.
PLAN = DesignPlan(
    moves=(Move(distance=3e-3, acceleration=166.7, pause=0.05, repeat=10),),
    limit=5e-3, head=HeadPlan(mass=6.5, std=0.2), after=False, shown=SOFT,
)  # fmt: skip
HEADS, REPEATS = (5.5, 6.0, 7.0, 7.5), (5, 7, 20, 40)
#: Distances of the drive from the centre of gravity, m, and the frequency at which the motor rocks, Hz.
OFFSETS, ROCKING = (0.0, 0.01, 0.02), 30.0
#: Flexures tried: isolation frequencies, Hz, and widths of a leaf, m. The thesis's moves reach 400 Hz, the worst of them 60 Hz.
FLEXED, WIDTHS = (SOFT, 1.0, 2.0), (0.03, 0.1)
#: A parasitic mode below this lies in the band that the isolation is for, Hz.
CLEAR = 60.0


def lowest(points: int, *, mass: float = 6.5, repeat: int = 10, after: bool = False) -> float:
    """Lowest frequency inside the limit without friction for another head (kg) and number of moves, Hz."""
    moves = (msgspec.structs.replace(PLAN.moves[0], repeat=repeat),)
    plan = msgspec.structs.replace(PLAN, head=HeadPlan(mass=mass), moves=moves, after=after)
    rigs = [frictionless(with_head(OF_THESIS, plan).model)]
    grid = np.geomspace(*plan.frequencies, points)
    return stroke_study(rigs, grid, plan.drive(), MOVE_RATE, limit=plan.limit).lowest


def strokes(*, points: int = 100, draws: int = 50) -> Step:
    """The worst case and its dependence on the assumptions."""
    found = designed(
        PLAN, with_head(OF_THESIS, PLAN), draws=draws, points=points, offsets=OFFSETS, rocking_frequency=ROCKING
    )  # fmt: skip
    free, rough = found.studies["without friction"], found.studies["with friction"]
    middle = {name: case.median_ratio for name, case in found.cases.items()}
    present, soft = next(iter(middle.values())), list(middle.values())[-1]
    rows = [
        judged(
            "Fig. 34: lowest frequency within ±5 mm while moves continue, no friction, Hz", printed(SOFT, 0.1), free.lowest,
            here=f"{free.lowest:.3f} ± {free.std:.2g} (head of 6.5 ± 0.2 kg)",
        ),
        plain(
            "the same with 20 N of friction, Hz", f"{rough.lowest:.2f}", thesis="not studied",
            remark="friction holds the motor after each move, so displacements add up until the springs overcome it",
        ),
        judged(
            f"Fig. 35: ratio from 5 to 15 Hz, present with friction over {SOFT:g} Hz without (medians)",
            above("curves, the soft one lower", 2.0), present / soft,
            here=f"{present:.2f} over {soft:.4f}: {present / soft:.0f} times",
        ),
        *(
            plain(
                f"Fig. 36: drive {1e3 * o:g} mm off the centre of gravity, {SOFT:g} Hz without friction",
                f"rocks by {1e3 * seen.rocking:.2g} mrad, ratio 5 to 50 Hz at worst {seen.worst:.3g} times that without",
                thesis="a moment and rocking, to be studied",
            )
            for o, seen in found.offsets.items() if o
        ),
        *(plain(f"lowest frequency, head of {mass:g} kg, Hz", f"{lowest(points, mass=mass):.3f}") for mass in HEADS),
        *(
            plain(
                f"lowest frequency, {repeat} moves, Hz",
                f"{lowest(points, repeat=repeat):.3f} while they continue, "
                f"{lowest(points, repeat=repeat, after=True):.3f} with the oscillation after the last one",
            )
            for repeat in REPEATS
        ),
    ]  # fmt: skip
    ratios = {name: case.ratio for name, case in found.cases.items()}
    return Step(
        title="Fig. 33-36: strokes, flexures and drive offset", rows=rows, text=_text(),
        tables=[_cases(found, middle), _flexures()],
        pictures={
            "strokes": stroke_figure(found), "histories": history_figure(found),
            "design-ratio": isolation_figure(ratios, {}, logarithmic=False), "offset": offset_figure(found),
        },
    )  # fmt: skip


def _cases(found: Designed, middle: dict[str, float]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    rows: list[tuple[str, ...]] = []
    for name, case in found.cases.items():
        link, bond = case.rig.link("isolation"), case.bond["unlocked"]
        rows.append(
            (
                name, f"{link.stiffness:.0f}", f"{link.damping:.0f}", f"{1e3 * case.stroke:.2f}", f"{middle[name]:.4f}",
                f"{1e6 * bond.largest:.2g}", f"{1e3 * bond.settling:.0f}",
            )
        )  # fmt: skip
    heads = (
        "case", "stiffness, N/m", "damping, N s/m", "stroke during the moves, mm", "ratio 5 to 15 Hz (median)",
        "heatblock during the bond's move, µm", "settling time, ms",
    )  # fmt: skip
    return heads, rows


def _flexures() -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    rows: list[tuple[str, ...]] = []
    for frequency in FLEXED:
        for width in WIDTHS:
            leaf = thinnest(THESIS["motor_mass"], frequency, PLAN.limit, width=width)
            low = min(leaf.upright, leaf.leaf)
            rows.append(
                (
                    f"{frequency:g}", f"{1e3 * leaf.length:.0f} × {1e3 * width:g} × {1e3 * leaf.thickness:.2f}",
                    f"{leaf.stress / 1e6:.0f}", f"{leaf.buckling:.2g}", f"{leaf.upright:.0f}", f"{leaf.leaf:.0f}",
                    "clear" if low >= CLEAR else f"{low:.0f} Hz is within the band",
                )
            )  # fmt: skip
    heads = (
        "isolation, Hz", "leaf, mm (length × width × thickness)", "stress at ±5 mm, MPa", "buckling load over weight",
        "motor up and down, Hz", "leaf alone, Hz", f"parasitic modes below {CLEAR:g} Hz",
    )  # fmt: skip
    return heads, rows


def _text() -> list[str]:
    soft = thinnest(THESIS["motor_mass"], SOFT, PLAN.limit, width=WIDTHS[0])
    return [
        "**Assumed:** the head's mass and the number of moves; the damping ratio is that at 5.06 Hz "
        f"({THESIS['motor_damping']:g}). The drive off the centre of gravity: rocking at {ROCKING:g} Hz with a damping ratio of "
        f"{DAMPING_RATIO:g}, a radius of gyration of {1e3 * RADIUS:g} mm, springs and bearings {1e3 * HEIGHT:g} mm from the "
        "centre of gravity.",
        "**End of the moves.** Continuing moves load the spring with a constant mean force; above seven, their number no longer "
        "matters. The last move removes this force, and depending on the phase, the oscillation afterwards can be larger. "
        "`rig design` includes it unless the profile has `after = false`.",
        "**Flexures** instead of bearings have no friction: these are the cases without friction. Four vertical leaf springs of "
        f"{SPRING_STEEL.name} (E {SPRING_STEEL.modulus / 1e9:g} GPa, endurance limit {SPRING_STEEL.endurance / 1e6:g} MPa) are "
        "as thin as the stress at ±5 mm and lateral buckling under the motor's weight allow with a safety factor of 1.5 "
        f"(formulas in `thesis/flexure.py`). At {SOFT:g} Hz the weight determines their length, not the stroke: "
        f"{1e3 * soft.length:.0f} mm for any number and width. Nonlinear springs are laws of a link (`cubic`, "
        "`bounded_softening`, `end_stop`) in any model for `rig simulate`.",
    ]
