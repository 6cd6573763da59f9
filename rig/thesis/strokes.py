"""Figures 33 to 36: how soft the isolation may be, what is assumed, and a drive off the centre of gravity."""

from __future__ import annotations

import msgspec
import numpy as np

from analysis.design import frictionless, stroke_study
from analysis.measured import FloatArray
from rig.design_figures import history_figure, offset_figure, stroke_figure
from rig.designed import RATE, Designed, DesignPlan, HeadPlan, MovePlan, designed, rigs_of
from rig.figures import isolation_figure
from rig.thesis.step import Row, Step

#: Consecutive moves of 3 mm at 17 g with pauses of 50 ms; +-5 mm. The head and the number of moves are assumed.
PLAN = DesignPlan(
    moves=(MovePlan(distance=3e-3, acceleration=166.7, pause=0.05, repeat=10),),
    limit=5e-3, head=HeadPlan(mass=6.5, std=0.2), after=False,
)  # fmt: skip
HEADS, REPEATS = (5.5, 6.0, 7.0, 7.5), (5, 7, 20, 40)


def lowest(points: int, *, mass: float = 6.5, repeat: int = 10, after: bool = False) -> float:
    """Lowest frequency inside the limit without friction for another head (kg) and number of moves, Hz."""
    moves = (msgspec.structs.replace(PLAN.moves[0], repeat=repeat),)
    plan = msgspec.structs.replace(PLAN, head=HeadPlan(mass=mass), moves=moves, after=after)
    rigs = [frictionless(rig) for rig in rigs_of(None, plan, draws=0, seed=0)]
    grid = np.geomspace(*plan.frequencies, points)
    return stroke_study(rigs, grid, plan.drive(), RATE, limit=plan.limit).lowest


def strokes(*, points: int = 100, draws: int = 50) -> Step:
    """The worst case and how its answer hangs on what was assumed."""
    found: Designed = designed(PLAN, rigs_of(None, PLAN, draws=draws, seed=0), points=points, offsets=(0.0, 0.01, 0.02))
    free, rough = found.studies["without friction"], found.studies["with friction"]
    middle = {name: _median(r.frequency, r.ratio) for name, r in found.ratios.items()}
    present, soft = middle.values()
    rows = [
        Row(
            what="Fig. 34: lowest frequency within ±5 mm while moves go on, no friction, Hz", thesis="0.6",
            here=f"{free.lowest:.3f} ± {free.std:.2g} (head of 6.5 ± 0.2 kg)", remark="agrees within the head's mass",
        ),
        Row(
            what="the same with 20 N of friction, Hz", thesis="not studied", here=f"{rough.lowest:.2f}",
            remark="friction holds the motor where a move left it, so moves add up until the springs overcome it",
        ),
        Row(
            what="Fig. 35: ratio from 5 to 15 Hz, soft without friction over present with friction (medians)", thesis="curves",
            here=f"{soft:.4f} over {present:.2f}: {present / soft:.0f} times better", remark="agrees in kind",
        ),
        *(
            Row(
                what=f"Fig. 36: drive {1e3 * o:g} mm off the centre of gravity", thesis="a moment and rocking, to be studied",
                here=f"rocks by {1e3 * seen.rocking:.2g} mrad, ratio 5 to 50 Hz at worst {seen.worst:.3g} times that without",
                remark="rocking at 30 Hz, radius of gyration 100 mm assumed",
            )
            for o, seen in found.offsets.items()
            if o
        ),
        *(
            Row(
                what=f"lowest frequency, head of {mass:g} kg, Hz", thesis="", here=f"{lowest(points, mass=mass):.3f}",
                remark="goes with the head's mass",
            )
            for mass in HEADS
        ),
        *(
            Row(
                what=f"lowest frequency, {repeat} moves, Hz", thesis="",
                here=f"{lowest(points, repeat=repeat):.3f} while they go on, "
                f"{lowest(points, repeat=repeat, after=True):.3f} with the swing after the last one",
                remark="",
            )
            for repeat in REPEATS
        ),
    ]  # fmt: skip
    text = (
        "**Assumed:** the head's mass and the number of moves. Moves that go on are a steady pull on the spring; from seven "
        "on their number "
        "no longer matters. But the last move ends that pull, and where the motor happens to swing with it, the swing "
        "afterwards is the "
        "larger one: up to twice as far, for a number of moves that lasts half a period. So 0.6 Hz is safe for moves that go "
        "on, and a "
        "machine that may stop at any time needs about 1 Hz. `rig design` counts the swing afterwards unless the profile says "
        "`after = false`. Flexures instead of bearings are the rows without friction; springs that are not linear are laws "
        "of a link "
        "(`cubic`, `bounded_softening`, `end_stop`) in any model that `rig simulate` plays, and causes that `rig diagnose` names."
    )
    return Step(
        title="Fig. 33-36: strokes and drive offset", rows=rows, text=[text],
        pictures={
            "strokes": stroke_figure(found), "histories": history_figure(found),
            "design-ratio": isolation_figure(found.ratios, {}), "offset": offset_figure(found),
        },
    )  # fmt: skip


def _median(frequency: FloatArray, values: FloatArray) -> float:
    return float(np.median(values[(frequency >= 5.0) & (frequency <= 15.0)]))
