"""How often the whole diagnosis is right on foreign rigs: place and kind of every cause, on sealed campaigns of `make.py`.

`python tests/blind/foreign/diagnosed.py --seeds 1300-1329 --csv FILE` draws campaigns, diagnoses each from its recording alone,
opens its answer afterwards and prints the counts by group. Every campaign has a line in FILE; those that are there are not drawn
again, so that it can be stopped at any time. `--campaigns DIR` keeps the recordings.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1]))

from foreign_campaign import Setting, draw
from ranked import answers
from rigs import FAMILIES
from study_table import append

from isorig.analysis.deadline import Deadline
from isorig.analysis.diagnose.diagnosis import Diagnosis, diagnose
from isorig.analysis.diagnose.kinds import kind_of
from isorig.rig.choices import TIME_LIMIT
from isorig.rig.files.recording import read
from isorig.rig.model.baseline import baseline_model

COLUMNS = "seed", "family", "group", "outcome", "hidden", "verdict", "named", "processor_s"
#: Outcomes: every cause is named and no other ("right"; a sound rig: adequate), a disturbance of the rig is named, one of two is,
#: nothing is, or something that is not in the rig.
OUTCOMES = "right", "disturbance", "one of two", "no name", "wrong"


def group_of(truth: Mapping[str, object]) -> str:
    """Name of a campaign's line in the table."""
    count = len(truth["effects"])  # type: ignore[arg-type]
    if count == 0:
        name = "no cause"
    else:
        name = f"{'one cause' if count == 1 else 'two causes'}, {'full size' if truth['severity'] == 1.0 else 'a third'}"
    return f"{name}, {'2 % of disturbances' if truth['soiled'] else 'clean'}"


def judged(truth: dict[str, object], steps: Sequence[Collection[tuple[str, str]]], verdict: str) -> str:
    """One of `OUTCOMES`.

    Parameters
    ----------
    truth
        The answer of the generator.
    steps
        Kind and place of each named cause and of those that the diagnosis reports as indistinguishable from it.
    verdict
        The diagnosis's.
    """
    right, disturbances = answers(truth)
    if not truth["effects"] and verdict == "adequate":
        return "right"
    if any(not right & set(step) and not disturbances & set(step) for step in steps):
        return "wrong"
    if not steps:
        return "no name"
    hidden = [answers({**truth, "effects": [one]})[0] for one in truth["effects"]]  # type: ignore[attr-defined]
    missed = sum(not any(own & set(step) for step in steps) for own in hidden)
    if missed == len(hidden):
        return "disturbance"
    return "one of two" if missed else "right"


def named(found: Diagnosis) -> list[list[tuple[str, str]]]:
    """Kind and place of each named cause, and of those that the diagnosis reports as indistinguishable from it."""
    return [
        [(step.kind, step.location), *((kind_of(cause), place) for cause, place in step.indistinguishable)]
        for step in found.steps
    ]


@dataclass(frozen=True, kw_only=True)
class Line:
    """A campaign and what was found."""

    seed: int
    family: str
    group: str
    outcome: str
    hidden: str
    verdict: str
    named: str
    processor_s: float


def diagnosed(recording: Path, answer: Path, *, say: bool = False) -> Line:
    """The line of one campaign; `say` prints each stage with the processor time until then."""
    campaign = read(recording)
    began = time.process_time()

    def progress(text: str) -> None:
        if say:
            print(f"{time.process_time() - began:6.1f} s  {text}", flush=True)

    with Deadline(TIME_LIMIT):
        found = diagnose(campaign, baseline_model(campaign), progress=progress)
    seconds = time.process_time() - began
    truth = json.loads(answer.read_text())
    return Line(
        seed=truth["seed"], family=truth["family"], group=group_of(truth),
        outcome=judged(truth, named(found), found.verdict),
        hidden="; ".join(f"{one['effect']} at {one['place']}" for one in truth["effects"]), verdict=found.verdict,
        named="; ".join(f"{step.cause} at {step.location}" for step in found.steps), processor_s=round(seconds, 1),
    )  # fmt: skip


def table(lines: Sequence[Line]) -> str:
    """Counts by group, the shares that are right and wrong, and the median processor time."""
    groups = Counter((line.group, line.outcome) for line in lines)
    rows = [f"{'':44s}" + "".join(f"{name:>13s}" for name in OUTCOMES)]
    rows += [
        f"{group:44s}" + "".join(f"{groups[group, name]:13d}" for name in OUTCOMES) for group in sorted({g for g, _ in groups})
    ]
    seconds = sorted(line.processor_s for line in lines)
    return "\n".join([*rows, f"processor time: median {seconds[len(seconds) // 2]:.1f} s, most {seconds[-1]:.1f} s"])


def lines_of(path: Path) -> list[Line]:
    """The lines of a table; none if there is none yet."""
    if not path.exists():
        return []
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return [Line(**{**row, "seed": int(row["seed"]), "processor_s": float(row["processor_s"])}) for row in rows]  # type: ignore[arg-type]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1300-1329", help="first-last")
    parser.add_argument("--csv", type=Path, required=True)
    parser.add_argument("--family", default=",".join(FAMILIES))
    parser.add_argument("--severity", type=float, default=None)
    parser.add_argument("--soiled", action=argparse.BooleanOptionalAction, default=None)
    parser.add_argument("--effects", default=None, help="none, one, two, or names with commas")
    parser.add_argument("--minutes", type=float, default=None, help="begin no campaign after this time")
    parser.add_argument("--campaigns", type=Path, default=None, help="folder of the recordings and answers, which are kept")
    parser.add_argument("--say", action="store_true", help="print each stage")
    args = parser.parse_args()
    first, _, last = args.seeds.partition("-")
    setting = Setting(
        severity=args.severity, soiled=args.soiled, effects=tuple(args.effects.split(",")) if args.effects else None
    )  # fmt: skip
    known = {line.seed for line in lines_of(args.csv)}
    families = args.family.split(",")
    end = time.monotonic() + 60.0 * args.minutes if args.minutes is not None else float("inf")
    for seed in (seed for seed in range(int(first), int(last or first) + 1) if seed not in known):
        if time.monotonic() > end:
            break
        with tempfile.TemporaryDirectory() as temporary:
            folder = args.campaigns or Path(temporary)
            folder.mkdir(parents=True, exist_ok=True)
            pair = folder / f"{seed}.h5", folder / f"{seed}.json"
            if not all(path.exists() for path in pair) and draw(families[seed % len(families)], seed, setting, folder) is None:
                continue
            line = diagnosed(*pair, say=args.say)
        append(args.csv, COLUMNS, vars(line))
        print(", ".join(str(value) for value in vars(line).values()), flush=True)
    print(table(lines_of(args.csv)))


if __name__ == "__main__":
    main()
