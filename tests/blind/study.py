"""The study: envelopes by the hundred, diagnosed as `rig diagnose` does it, one line each in a table that grows.

`python tests/blind/study.py --minutes 60` goes on where the table ends; it can be stopped at any time. Nothing of an
envelope but its recording reaches the diagnosis: the draw is opened after the answer was written.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from decisions import keep, recorded_files
from envelopes import CAUSES, OUTSIDE, Envelope, draw_envelope, is_right
from study_table import append, done

from isorig.rig.files.recording import write
from isorig.rig.files.rigfile import read_model
from isorig.rig.model.prediction import predicted

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "docs" / "study" / "results.csv"
COLUMNS = (
    "kind", "size", "seed", "truth", "verdict", "named", "alike", "right", "baseline", "extended", "floor",
    "later_baseline", "later_extended", "parameters",
)  # fmt: skip
#: Sound rigs of one round, and everything else, which is drawn in every size.
SOUND, HIDDEN = 20, (*CAUSES, *(f"outside: {name}" for name in OUTSIDE), "two", "two")
SIZES = (1.0, 0.33, 0.1)


def plan(seed: int) -> list[tuple[str, float, int]]:
    """Kind, size and seed of every envelope of one round, in a random order: any first part is a fair sample."""
    whole = [("none", 1.0)] * SOUND + [(kind, size) for kind in HIDDEN for size in SIZES]
    order = np.random.default_rng(seed).permutation(len(whole))
    return [(*whole[k], 1000 * seed + int(k)) for k in order]


def scored(envelope: Envelope, size: float, seed: int, folder: Path) -> dict[str, object]:
    """Open the envelope beside the answer."""
    found = json.loads((folder / "findings.json").read_text())
    named = [(step["cause"], step["location"]) for step in found["steps"]]
    alike = {tuple(sorted((x["cause"], x["location"]) for x in group)) for group in found["indistinguishable"]}
    reach = {step: {step} | {x for group in alike if step in group for x in group} for step in named}
    right = is_right(envelope.kind, envelope.truth, envelope.outside, found["verdict"], named, reach)
    said = {k: v["value"] for step in found["steps"] for k, v in step["parameters"].items()}
    return {
        "kind": envelope.kind, "size": size, "seed": seed, "truth": _places(envelope.truth or envelope.outside),
        "verdict": found["verdict"],
        "named": _places(named), "alike": " | ".join(_places(group) for group in sorted(alike)), "right": int(right),
        "baseline": f"{found['holdout']['baseline']:.5g}", "extended": f"{found['holdout']['extended']:.5g}",
        "floor": f"{found['holdout']['noise_floor']:.5g}",
        "later_baseline": f"{later_error(envelope, folder / 'baseline.json'):.5g}",
        "later_extended": f"{later_error(envelope, folder / 'model.json'):.5g}",
        "parameters": " ".join(f"{k}={v:.5g}/{said.get(k, float('nan')):.5g}" for k, v in envelope.parameters.items()),
    }  # fmt: skip


def later_error(envelope: Envelope, model: Path) -> float:
    """The model's error on the runs that the diagnosis never had: median over runs and channels."""
    rig, origin, _ = read_model(model)
    guess = predicted(rig, envelope.later, origin=origin, as_recorded=True)
    errors = [
        np.sqrt(np.mean((run.read(name) - other.read(name)) ** 2) / np.mean(run.read(name) ** 2))
        for run, other in zip(envelope.later.runs, guess.runs, strict=True)
        for name in run.channels
        if name != "head"
    ]
    return float(np.median(errors))


def _places(pairs: object) -> str:
    return "+".join(f"{cause} at {place}" for cause, place in pairs)  # type: ignore[attr-defined]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="stop after the batch that passes this time")
    parser.add_argument("--table", type=Path, default=TABLE)
    parser.add_argument("--kinds", nargs="*", default=None, help="only these kinds")
    parser.add_argument("--sizes", nargs="*", type=float, default=None)
    parser.add_argument("--seed", type=int, default=1, help="first round")
    parser.add_argument("--rounds", type=int, default=1000)
    args = parser.parse_args()
    known = done(args.table)
    todo = [job for seed in range(args.seed, args.seed + args.rounds) for job in plan(seed) if job not in known]
    if args.kinds:
        todo = [job for job in todo if job[0] in args.kinds]
    if args.sizes:
        todo = [job for job in todo if job[1] in args.sizes]
    end = time.monotonic() + 60.0 * args.minutes
    while todo and time.monotonic() < end:
        batch, todo = todo[:8], todo[8:]
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            envelopes: dict[str, tuple[Envelope, float, int]] = {}
            for k, (kind, size, seed) in enumerate(batch):
                envelopes[f"sealed-{k}"] = draw_envelope(kind, size, seed), size, seed
                write(folder / f"sealed-{k}.h5", envelopes[f"sealed-{k}"][0].campaign)
            for outcome in recorded_files([(folder / f"{name}.h5", folder / name) for name in envelopes], "coulomb"):
                envelope, size, seed = envelopes[outcome.campaign]
                if outcome.refusal:
                    print(f"{envelope.kind}: refused: {outcome.refusal}", flush=True)
                    continue
                row = scored(envelope, size, seed, folder / outcome.campaign)
                append(args.table, COLUMNS, row)
                keep(folder / outcome.campaign, args.table)
                print(", ".join(f"{row[k]}" for k in COLUMNS), flush=True)


if __name__ == "__main__":
    main()
