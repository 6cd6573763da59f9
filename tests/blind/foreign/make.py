"""Write sealed campaigns of rigs that the project did not simulate, and their answers.

`python tests/blind/foreign/make.py OUT_DIR --family wire_bonder,chain --seeds 0-9` writes a recording and an answer for every
seed; the families take turns. What is not given is drawn by the seed.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from effects import EFFECTS
from foreign_campaign import Setting, draw
from rigs import FAMILIES

SEVERITIES = {"full": 1.0, "third": 1.0 / 3.0}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--family", default=",".join(FAMILIES), help="one or several of " + ", ".join(FAMILIES))
    parser.add_argument("--seeds", default="0-9", help="first-last")
    parser.add_argument("--severity", choices=SEVERITIES, default=None)
    parser.add_argument("--soiled", action=argparse.BooleanOptionalAction, default=None)
    parser.add_argument("--effects", default=None, help="none, one, two, or names with commas: " + ", ".join(EFFECTS))
    args = parser.parse_args()
    first, _, last = args.seeds.partition("-")
    families = args.family.split(",")
    setting = Setting(
        severity=SEVERITIES.get(args.severity),
        soiled=args.soiled,
        effects=tuple(args.effects.split(",")) if args.effects else None,
    )
    args.out.mkdir(parents=True, exist_ok=True)
    for seed in range(int(first), int(last or first) + 1):
        family = families[seed % len(families)]
        made = draw(family, seed, setting, args.out)
        print(f"{seed} {family}: {made[0] if made else 'no place for these effects'}", flush=True)


if __name__ == "__main__":
    main()
