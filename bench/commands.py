"""How long commands take from their call to their end: help, the check of a recording, its transfer functions, and the import.

Run `python bench/commands.py [--quick]`. Values are medians of repetitions in which the commands take turns: seconds on the clock
and of the processor, with those of processes that the command waits for. The recording is that of a virtual session like the
demo's, seven runs of 20 to 40 s.
"""

from __future__ import annotations

import compileall
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from table import Cost, Row, alternated, cost_of, keep, options, within

ROOT = Path(__file__).parents[1]
#: Repetitions, and those with `--quick`.
REPEATS, QUICK = 9, 3
#: Limits on the clock, s.
HELP, IMPORT, CHECK, FRF = 0.2, 0.15, 0.5, 2.0


def main(repeats: int) -> list[Row]:
    """A row for each command, on the clock and of the processor."""
    kept = []
    # As after an installation: where the environment forbids to write it, each call would compile all modules.
    compileall.compile_dir(ROOT / "isorig", quiet=1)
    with tempfile.TemporaryDirectory() as folder:
        recording, output = str(Path(folder) / "campaign.h5"), str(Path(folder) / "frf")
        rig = [sys.executable, "-m", "isorig"]
        subprocess.run([*rig, "virtual", "campaign", "-o", recording], check=True, stdout=subprocess.DEVNULL)
        calls = {
            "`rig --help`": ([*rig, "--help"], HELP),
            "`import isorig`, with Python's start": ([sys.executable, "-c", "import isorig"], IMPORT),
            "`rig check` of the demo's recording": ([*rig, "check", recording], CHECK),
            "`rig frf` of the demo's recording": ([*rig, "frf", recording, "-o", output], FRF),
        }
        costs: dict[str, list[Cost]] = {name: [] for name in calls}

        def spent(name: str) -> float:
            costs[name].append(cost_of(calls[name][0]))
            return costs[name][-1].clock

        # The first call fills the system's and matplotlib's caches.
        for name in calls:
            cost_of(calls[name][0])
        found = alternated({name: lambda name=name: spent(name) for name in calls}, repeats)
    for name, clock in found.items():
        processor, limit = [each.processor for each in costs[name]], within(statistics.median(clock), calls[name][1], "s")
        print(f"{name:40s} {statistics.median(clock):6.3f} s, of the processor {statistics.median(processor):6.3f} s; {limit}")
        kept.append(Row.of(name, "s", clock, limit=limit))
        kept.append(Row.of(f"{name}, of the processor", "s", processor))
    return kept


if __name__ == "__main__":
    given = options(__doc__).parse_args()
    keep(main(QUICK if given.quick else REPEATS), given.rows)
