"""Seconds for 10 000 designs: 100 isolation frequencies for each of 100 sets of parameters, with friction."""

from __future__ import annotations

import time

import numpy as np
from table import Row, keep, options

from isorig.analysis.simulate.move_profile import Move, head_acceleration
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.stroke import frictionless, stroke_study

RATE = 2048.0


def main() -> list[Row]:
    """Two calls, for the first compiles."""
    kept = []
    generator = np.random.default_rng(0)
    rigs = [wire_bonder({**THESIS, "head_mass": mass}) for mass in generator.normal(6.5, 0.2, 100)]
    head = head_acceleration([Move(distance=3e-3, acceleration=166.7, pause=0.05)] * 10, RATE, tail=2.0)
    grid = np.geomspace(0.3, 6.0, 100)
    for name in ("first call", "again"):
        began = time.perf_counter()
        found = stroke_study(rigs, grid, head, RATE, limit=5e-3)
        seconds = time.perf_counter() - began
        print(
            f"{name}, with friction: {found.draws.size + found.stroke.size} designs of {len(head) / RATE:.2f} s "
            f"in {seconds:.2f} s, lowest {found.lowest:.3g} Hz"
        )
        kept.append(Row(what=f"{found.draws.size + found.stroke.size} designs with friction, {name}", unit="s", ours=seconds))
    free = stroke_study([frictionless(rig) for rig in rigs], grid, head, RATE, limit=5e-3)
    going_on = head_acceleration([Move(distance=3e-3, acceleration=166.7, pause=0.05)] * 10, RATE, tail=0.0)
    steady = stroke_study([frictionless(wire_bonder())], grid, going_on, RATE, limit=5e-3)
    print(
        f"without friction: lowest {free.lowest:.3f} ± {free.std:.3f} Hz with the swing after the last move, "
        f"{steady.lowest:.3f} Hz while moves go on (thesis: 0.6 Hz)"
    )
    return kept


if __name__ == "__main__":
    given = options(__doc__).parse_args()
    keep(main(), given.rows)
