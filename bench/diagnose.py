"""How long a diagnosis takes: a sound campaign of the lab's usual length, and campaigns with an effect hidden in them.

`python bench/diagnose.py` prints seconds on the clock and of the processor, the answer beside what was hidden.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

from envelopes import draw_envelope

from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.rig.baseline import baseline_model

SEED = 101
KINDS = ("none", "hardening_stiffness", "stribeck_friction", "extra_mode", "sensor_gain", "outside: hose")


def main() -> None:
    print(f"{'hidden':22s} {'clock, s':>8s} {'processor, s':>12s}  answer")
    for kind in KINDS:
        envelope = draw_envelope(kind, 1.0, SEED)
        model = baseline_model(envelope.campaign, "coulomb")
        began, spent = time.perf_counter(), time.process_time()
        found = diagnose(envelope.campaign, model)
        clock, processor = time.perf_counter() - began, time.process_time() - spent
        named = ", ".join(f"{step.cause} at {step.location}" for step in found.steps) or "-"
        print(f"{kind:22s} {clock:8.1f} {processor:12.1f}  {found.verdict}: {named}", flush=True)


if __name__ == "__main__":
    main()
