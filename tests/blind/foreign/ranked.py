"""How often the equations of motion alone give the right place and kind on foreign rigs, without any simulation.

`python tests/blind/foreign/ranked.py --seeds 0-139` draws campaigns (`make.py` has the options), ranks the explanations of each
and prints the counts. With `--csv FILE` every campaign has a line there, with its best explanation.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from foreign_campaign import Setting, draw
from rigs import FAMILIES

from isorig.analysis.diagnose.suspects import SHOWN, suspects
from isorig.analysis.equations.system import equations_of
from isorig.rig.files.recording import read
from isorig.rig.model.baseline import baseline_model

#: Outcomes of a campaign with a cause: the best explanation is right, another suspected one is, none of them is although they
#: show clearly, or nothing clear is suspected.
OUTCOMES = "first", "suspected", "wrong", "silent"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What the equations say of a campaign.

    Parameters
    ----------
    truth
        The answer of the generator.
    outcome
        One of `OUTCOMES`; for a sound rig "silent", "said" (a disturbance that is in it) or "wrong".
    residuals, suspected
        Of each equation, and kind, place, name and score of the best explanations.
    seconds
        Processor time.
    """

    truth: dict[str, object]
    outcome: str
    residuals: dict[str, float]
    suspected: list[tuple[str, str, str, float]]
    seconds: float

    @property
    def hidden(self) -> list[tuple[str, str]]:
        """Effect and place of everything hidden."""
        return [(one["effect"], one["place"]) for one in self.truth["effects"]]  # type: ignore[attr-defined]

    @property
    def line(self) -> tuple[object, ...]:
        """Its line in a table: seed, family, group, outcome, what is hidden, and the best explanation."""
        hidden = "; ".join(f"{effect} at {place}" for effect, place in self.hidden)
        best = [f"{what} at {place} ({score})" for _, place, what, score in self.suspected[:1]]
        return self.truth["seed"], self.truth["family"], self.group, self.outcome, hidden, *(best or [""])

    @property
    def group(self) -> str:
        """Name of its line in the table."""
        count = len(self.hidden)
        size = "no effect" if count == 0 else "two causes" if count == 2 else "foreign form"
        if count == 1 and self.truth["effects"][0]["cause"]:  # type: ignore[index]
            size = "catalogued cause"
        full = f", {'full size' if self.truth['severity'] == 1.0 else 'a third'}" if count else ""
        return f"{size}{full}, {'2 % of disturbances' if self.truth['soiled'] else 'clean'}"


def answers(truth: dict[str, object]) -> tuple[set[tuple[str, str]], set[tuple[str, str]]]:
    """Kinds and places that are right, and those of the disturbances."""
    right = set()
    for one in truth["effects"]:  # type: ignore[attr-defined]
        right |= {(kind, one["place"]) for kind in one["kinds"]}
        if one["effect"] == "wrong_mass" and one["place"] == "head":
            right.add(("sensor", "head"))
    return right, {(kind, place) for kind, place in truth["disturbances"]}  # type: ignore[attr-defined]


def outcome(recording: Path, answer: Path) -> Outcome:
    """What the equations say of a recording."""
    truth = json.loads(answer.read_text())
    right, disturbances = answers(truth)
    campaign = read(recording)
    began = time.process_time()
    equations = equations_of(campaign, baseline_model(campaign))
    found = suspects(equations)
    seconds = time.process_time() - began
    residuals = equations.residuals()
    chosen = list(found.chosen) if found is not None and found.ranking.broken else []
    named = [(item.kind, item.place) for item in chosen]
    if not named or chosen[0].score < SHOWN:
        result = "silent"
    elif right:
        result = "first" if named[0] in right else "suspected" if right & set(named) else "wrong"
    else:
        result = "said" if named[0] in disturbances else "wrong"
    if result == "silent" and right & set(named):
        result = "suspected"
    listed = [(e.kind, e.place, e.what, round(e.score, 2)) for e in (found.ranking.explanations[:12] if found else ())]
    return Outcome(truth=truth, outcome=result, residuals=residuals, suspected=listed, seconds=seconds)


def outcomes(families: Sequence[str], seeds: Sequence[int], setting: Setting) -> Iterator[Outcome]:
    """The outcomes of drawn campaigns; families take turns."""
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            made = draw(families[seed % len(families)], seed, setting, Path(folder))
            if made is not None:
                yield outcome(*made)


def table(found: Sequence[Outcome]) -> str:
    """Counts by group."""
    groups = Counter((one.group, one.outcome) for one in found)
    names = (*OUTCOMES, "said")
    lines = [f"{'':52s}" + "".join(f"{name:>10s}" for name in names)]
    for group in sorted({group for group, _ in groups}):
        lines.append(f"{group:52s}" + "".join(f"{groups[group, name]:10d}" for name in names))
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--family", default=",".join(FAMILIES))
    parser.add_argument("--seeds", default="0-139", help="first-last")
    parser.add_argument("--severity", type=float, default=None)
    parser.add_argument("--soiled", action=argparse.BooleanOptionalAction, default=None)
    parser.add_argument("--effects", default=None, help="none, one, two, or names with commas")
    parser.add_argument("--csv", type=Path, default=None)
    args = parser.parse_args()
    first, _, last = args.seeds.partition("-")
    effects = tuple(args.effects.split(",")) if args.effects else None
    setting = Setting(severity=args.severity, soiled=args.soiled, effects=effects)
    found = list(outcomes(args.family.split(","), range(int(first), int(last or first) + 1), setting))
    if args.csv is not None:
        with args.csv.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(("seed", "family", "group", "outcome", "hidden", "best"))
            writer.writerows(one.line for one in found)
    print(table(found))


if __name__ == "__main__":
    main()
