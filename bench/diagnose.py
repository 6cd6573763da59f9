"""How long a diagnosis takes: a sound campaign of the lab's usual length, and campaigns with an effect hidden in them.

`python bench/diagnose.py` prints seconds on the clock and of the processor, the answer beside what was hidden: of three kinds, of
all six with `--all`, of a sound campaign and one other with `--quick`.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "blind"))

from envelopes import draw_envelope
from table import Row, keep, options

from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.rig.model.baseline import baseline_model

SEED = 101
KINDS = ("none", "sensor_gain", "hardening_stiffness", "stribeck_friction", "extra_mode", "outside: hose")


def main(kinds: tuple[str, ...]) -> list[Row]:
    """A row for each kind of effect."""
    kept = []
    print(f"{'hidden':22s} {'clock, s':>8s} {'processor, s':>12s}  answer")
    for kind in kinds:
        envelope = draw_envelope(kind, 1.0, SEED)
        model = baseline_model(envelope.campaign, "coulomb")
        began, spent = time.perf_counter(), time.process_time()
        found = diagnose(envelope.campaign, model)
        clock, processor = time.perf_counter() - began, time.process_time() - spent
        named = ", ".join(f"{step.cause} at {step.location}" for step in found.steps) or "-"
        print(f"{kind:22s} {clock:8.1f} {processor:12.1f}  {found.verdict}: {named}", flush=True)
        hidden = "nothing" if kind == "none" else kind
        kept.append(Row(what=f"hidden: {hidden}; answer: {found.verdict}, {named}", unit="s of the processor", ours=processor))
    return kept


if __name__ == "__main__":
    parser = options(__doc__)
    parser.add_argument("--all", action="store_true", help="all six kinds: about five minutes")
    given = parser.parse_args()
    keep(main(KINDS if given.all else KINDS[: 2 if given.quick else 3]), given.rows)
