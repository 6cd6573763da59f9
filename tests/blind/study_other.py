"""The study of rigs unlike any model: forms outside the catalogue, disturbances and rest, one line for each envelope.

`python tests/blind/study_other.py --minutes 30` draws chains, carts and stages, with `--rigs bonders` wire bonders; it goes on
where the table ends and can be stopped at any time. The description and the recording are all that reaches the diagnosis; the
draw is opened after the answer was written.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import msgspec
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1]))

import other_envelopes
import unlike_bonders
from decisions import keep, recorded_files
from other_envelopes import OtherEnvelope, answer_of, draw_other
from study_table import append, done
from unlike_bonders import draw_bonder

from isorig.rig.files.recording import write
from isorig.rig.files.rigfile import read_model
from isorig.rig.model.prediction import predicted

STUDY = Path(__file__).parents[2] / "docs" / "study"
COLUMNS = (
    "kind", "size", "soil", "rest", "seed", "rig", "truth", "verdict", "named", "answer", "baseline", "extended", "floor",
    "later_baseline", "later_extended",
)  # fmt: skip
#: Sizes, dirt and rest of every kind in a round.
SETTINGS = ((1.0, 0.0, False), (1.0, 0.02, False), (0.33, 0.0, True))


class Drawing(Protocol):
    """Draws an envelope."""

    def __call__(self, kind: str, size: float, seed: int, *, soil: float = 0.0, rest: bool = False) -> OtherEnvelope: ...


@dataclass(frozen=True)
class Rigs:
    """What can be hidden in a family of rigs, how an envelope is drawn, its table, and whether the file has a description."""

    kinds: tuple[str, ...]
    draw: Drawing
    table: Path
    described: bool


FAMILIES = {
    "other": Rigs(other_envelopes.KINDS, draw_other, STUDY / "other-rigs.csv", described=True),
    "bonders": Rigs(unlike_bonders.KINDS, draw_bonder, STUDY / "unlike-bonders.csv", described=False),
}


def plan(rigs: Rigs, round_: int) -> list[tuple[str, float, float, bool, int]]:
    """Kind, size, dirt, rest and seed of every envelope of one round, in a random order: any first part is a fair sample."""
    kinds = ("none", "none", *(kind for kind in rigs.kinds if kind != "none"), "two", "two")
    whole = [(kind, *setting) for kind in kinds for setting in SETTINGS]
    order = np.random.default_rng(round_).permutation(len(whole))
    return [(*whole[k], 1000 * round_ + int(k)) for k in order]


def toml_of(value: Any) -> str:
    """A value in TOML, tables inline."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {toml_of(v)}" for k, v in value.items() if v is not None) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_of(v) for v in value) + "]"
    return json.dumps(value)


def described(envelope: OtherEnvelope) -> str:
    """The rig's description as a lab would have written it."""
    tree = msgspec.to_builtins(envelope.guess)
    return "\n".join(f"{key} = {toml_of(value)}" for key, value in tree.items() if value is not None)


def later_error(envelope: OtherEnvelope, model: Path) -> float:
    """The model's error on runs that the diagnosis never had: rms over runs and channels."""
    rig, origin, _ = read_model(model)
    guess = predicted(rig, envelope.later, origin=origin, as_recorded=True)
    drive = envelope.guess.drive.channel
    powers = [
        np.mean((run.read(name) - other.read(name)) ** 2) / np.mean(run.read(name) ** 2)
        for run, other in zip(envelope.later.runs, guess.runs, strict=True)
        for name in run.channels
        if name != drive
    ]
    return float(np.sqrt(np.mean(np.minimum(powers, 4.0))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0, help="stop after the batch that passes this time")
    parser.add_argument("--rigs", choices=FAMILIES, default="other")
    parser.add_argument("--table", type=Path, default=None, help="another table than that of these rigs")
    parser.add_argument("--first", type=int, default=300, help="first round")
    parser.add_argument("--rounds", type=int, default=1000)
    args = parser.parse_args()
    rigs = FAMILIES[args.rigs]
    table = args.table or rigs.table
    known = done(table)
    rounds = range(args.first, args.first + args.rounds)
    todo = [job for k in rounds for job in plan(rigs, k) if (job[0], job[1], job[-1]) not in known]
    end = time.monotonic() + 60.0 * args.minutes
    while todo and time.monotonic() < end:
        batch, todo = todo[:6], todo[6:]
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            sealed = {}
            for k, (kind, size, soil, rest, seed) in enumerate(batch):
                envelope = rigs.draw(kind, size, seed, soil=soil, rest=rest)
                campaign = replace(envelope.campaign, description=described(envelope)) if rigs.described else envelope.campaign
                write(folder / f"sealed-{k}.h5", campaign)
                sealed[f"sealed-{k}"] = envelope, (kind, size, soil, int(rest), seed)
            for outcome in recorded_files([(folder / f"{name}.h5", folder / name) for name in sealed], "coulomb"):
                envelope, job = sealed[outcome.campaign]
                if outcome.refusal:
                    print(f"{envelope.kind}: refused: {outcome.refusal}", flush=True)
                    continue
                row = scored(envelope, job, folder / outcome.campaign)
                append(table, COLUMNS, row)
                keep(folder / outcome.campaign, table)
                print(", ".join(f"{row[k]}" for k in COLUMNS), flush=True)


def scored(envelope: OtherEnvelope, job: tuple[str, float, float, int, int], folder: Path) -> dict[str, object]:
    """Open the envelope and compare it with the answer."""
    found = json.loads((folder / "findings.json").read_text())
    alike = [{(x["cause"], x["location"]) for x in group} for group in found["indistinguishable"]]
    named = [(step["cause"], step["form"], step["location"]) for step in found["steps"]]
    kind, size, soil, rest, seed = job
    return {
        "kind": kind, "size": size, "soil": soil, "rest": rest, "seed": seed, "rig": envelope.guess.name,
        "truth": "+".join(f"{cause or what} at {place}" for cause, what, place in envelope.truth), "verdict": found["verdict"],
        "named": "+".join(f"{cause} at {place}" for cause, _, place in named), "answer": answer_of(envelope, named, alike),
        "baseline": f"{found['holdout']['baseline']:.5g}", "extended": f"{found['holdout']['extended']:.5g}",
        "floor": f"{found['holdout']['noise_floor']:.5g}",
        "later_baseline": f"{later_error(envelope, folder / 'baseline.json'):.5g}",
        "later_extended": f"{later_error(envelope, folder / 'model.json'):.5g}",
    }  # fmt: skip


if __name__ == "__main__":
    main()
