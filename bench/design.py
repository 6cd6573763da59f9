"""Seconds for 10 000 designs: 100 isolation frequencies for each of 100 sets of parameters, with friction."""

from __future__ import annotations

import time

import numpy as np

from analysis.design import stroke_study
from analysis.profile import Move, head_acceleration
from analysis.rigs import THESIS, wire_bonder

RATE = 2048.0


def main() -> None:
    generator = np.random.default_rng(0)
    rigs = [wire_bonder({**THESIS, "head_mass": mass}) for mass in generator.normal(6.5, 0.2, 100)]
    head = head_acceleration([Move(distance=3e-3, acceleration=166.7, pause=0.05)] * 10, RATE, tail=2.0)
    grid = np.geomspace(0.3, 6.0, 100)
    for name in ("first call", "again"):
        began = time.perf_counter()
        found = stroke_study(rigs, grid, head, RATE, limit=5e-3)
        seconds = time.perf_counter() - began
        print(
            f"{name}: {found.draws.size + found.stroke.size} designs of {len(head) / RATE:.2f} s in {seconds:.2f} s, "
            f"lowest {found.lowest:.3g} Hz"
        )


if __name__ == "__main__":
    main()
