"""Every allowed run instead of the statement that none distinguishes two causes: each is taken and diagnosed.

`python tests/blind/every_run.py --minutes 20` goes through the investigations of the study that ended with that statement. Every
candidate run within the limits is added to the runs of the investigation, one at a time, and the whole is diagnosed again. A line
of the table says how many runs there were, and after how many of them a single cause was left.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1]))

import study
from investigated import sealed
from investigation_study import LIMIT, RUNS, TABLE, allowed, groups, investigated, new_runs
from study_table import Job, append, done

from isorig.rig.acquire.plan import RunPlan
from isorig.rig.diagnose.many import diagnose_file
from isorig.rig.files.rivals import read_rivals
from isorig.rig.next.investigation import RECORDING
from isorig.rig.next.plan_file import with_runs
from isorig.rig.next.proposal import propose, situation
from isorig.rig.next.runs import planned
from isorig.rig.next.stages import Investigation, diagnosis_folder

ANSWERS = study.TABLE.with_name("every-run.csv")
COLUMNS = ("kind", "size", "seed", "open", "candidates", "single", "which")
SAID = "No allowed run"


def single_after(job: Job, seconds: float) -> dict[str, object]:
    """A line of the table; `seconds` is the time after which no further run is taken."""
    end = time.monotonic() + seconds
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rig = sealed(*job)
        course, _ = investigated(rig, folder, Investigation(plan="sealed", baseline="coulomb", tolerance=0.0), propose, RUNS)
        stage = next(stage for stage in reversed(course.stages) if stage.verdict)
        plans: dict[str, RunPlan] = {run.id: run for run in course.runs}
        now = situation([read_rivals(folder / diagnosis_folder(stage))], rig.limits, plans)
        tried, single = 0, []
        for run in allowed(now, new_runs(now)):
            if time.monotonic() > end:
                break
            recording, answer = folder / f"{tried}.h5", folder / f"answer-{tried}"
            recording.write_bytes((folder / RECORDING).read_bytes())
            rig.measure(with_runs(rig.plan, [*course.runs, planned(run, "added")]), recording)
            diagnose_file(recording, answer, "coulomb", limit=LIMIT, page=False)
            after = read_rivals(answer)
            tried += 1
            if after.named and not after.open:
                single.append(f"{run.configuration} {run.excitation} {run.gain:g}")
            print(tried, run.configuration, run.excitation, run.gain, after.named, len(after.open), flush=True)
    return {
        **dict(zip(("kind", "size", "seed"), job, strict=True)), "candidates": tried, "single": len(single),
        "open": groups(stage), "which": " | ".join(single),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=20.0, help="take no further run after this time")
    parser.add_argument("--table", type=Path, default=TABLE, help="table of investigations")
    parser.add_argument("--answers", type=Path, default=ANSWERS)
    args = parser.parse_args()
    found = pd.read_csv(args.table, keep_default_na=False)
    said = found[(found["way"] == "proposed") & found["ended"].str.contains(SAID)]
    known = done(args.answers)
    end = time.monotonic() + 60.0 * args.minutes
    for kind, size, seed in said[["kind", "size", "seed"]].itertuples(index=False):
        job, left = (str(kind), float(size), int(seed)), end - time.monotonic()
        if job in known or left < 0.0:
            continue
        line = single_after(job, left)
        append(args.answers, COLUMNS, line)
        print(line, flush=True)


if __name__ == "__main__":
    main()
