"""The study of investigations: sealed rigs that play every run they are asked for, a row for each in a table that grows.

`python tests/blind/investigation_study.py --minutes 20` goes on where the table ends; it can be stopped at any time. Every
envelope is investigated from nothing (`proposed`). Where a catalogued cause took further runs, it is investigated again from its
first stage on, with the last run repeated (`repeat`) and with allowed runs chosen at random (`random`) in place of the
proposals, up to twice as many runs. `--standard` diagnoses the standard plan of seven runs on the same envelopes, into a
table with the columns of `study.py`. Envelopes come in a fixed random order, so that those counted by any time are a fair sample.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1]))

import other_envelopes
import study
from envelopes import CAUSES, OUTSIDE, Place, draw_envelope, is_right
from foreign.instrument import CONVERTERS
from investigated import SealedRig, sealed, sealed_other
from study_table import Job, append, done

from isorig.analysis.campaign import Campaign
from isorig.analysis.proposals.limits import simulated_peaks
from isorig.analysis.proposals.menu import CandidateRun
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.proposals.prediction import drawn_models
from isorig.rig.diagnose.many import diagnose_file
from isorig.rig.errors import REFUSALS
from isorig.rig.files.output import write_json
from isorig.rig.files.recording import read, write
from isorig.rig.next.investigation import RECORDING, STATE, Terms, investigate, read_investigation
from isorig.rig.next.policy import POLICY as NEXT
from isorig.rig.next.proposal import Proposal, Proposed, Situation, propose
from isorig.rig.next.runs import candidate, prospect
from isorig.rig.next.stages import Investigation, InvestigationStage, diagnosis_folder

TABLE, PLANNED = (study.TABLE.with_name(f"{name}.csv") for name in ("investigations", "standard-plan"))
COLUMNS = (
    "kind", "size", "seed", "way", "truth", "verdict", "named", "open", "first_open", "right", "runs", "further", "seconds",
    "proposal", "broken", "ended",
)  # fmt: skip
#: Runs, and seconds of measuring, that an investigation may take.
RUNS, SECONDS = 8, 240.0
#: Sound rigs, and envelopes of every cause and foreign form and size, in a round.
SOUND, SIZES = 6, (1.0, 0.33)
#: Seconds after which a diagnosis ends: the default of `rig diagnose`.
LIMIT = 300.0


@dataclass(frozen=True, kw_only=True)
class Rigs:
    """A family of rigs: what can be hidden in them, how a rig is drawn, and its table."""

    kinds: tuple[str, ...]
    draw: Callable[[str, float, int], SealedRig]
    table: Path


FAMILIES = {
    "bonders": Rigs(kinds=(*CAUSES, *(f"outside: {name}" for name in OUTSIDE)), draw=sealed, table=TABLE),
    "others": Rigs(
        kinds=tuple(other_envelopes.EFFECTS), draw=sealed_other, table=TABLE.with_name("investigations-other-rigs.csv")
    ),
}


def jobs(rigs: Rigs, rounds: range) -> list[Job]:
    """Kind, size and seed of all envelopes of some rounds; each round in a random order."""
    found: list[Job] = []
    for number in rounds:
        hidden = [(kind, size) for kind in rigs.kinds for size in SIZES]
        whole = [*hidden, *[("none", 1.0)] * SOUND]
        order = np.random.default_rng(number).permutation(len(whole))
        found += [(*whole[k], 100_000 * number + int(k)) for k in order]
    return found


def repeated(now: Situation, **_: object) -> Proposal:
    """The last driven run once more."""
    last = next(plan for plan in reversed(now.plans.values()) if plan.played)
    again = replace(candidate(last), repeat_of=last.repeat_of or last.id)
    return Proposal(kind="rivals", runs=(Proposed(run=again),))


def allowed(now: Situation, runs: Iterable[CandidateRun]) -> Iterator[CandidateRun]:
    """Those of some runs in which the models that explain the runs so far keep the limits."""
    models = drawn_models(now.explains, POLICY.simulated_draws, 5)
    for run in runs:
        one = prospect(run, now.rivals.sample_rate, now.start_time, now.scale)
        if not simulated_peaks(models, one.excitation(whole=True), run.configuration, one.start_time).beyond(now.limits):
            yield run


def new_runs(now: Situation) -> list[CandidateRun]:
    """The candidate runs that repeat no earlier drive."""
    return [run for run in now.candidates() if run.repeat_of is None]


def at_random(seed: int) -> Callable[..., Proposal]:
    """Any allowed run, drawn anew each time."""
    draw = np.random.default_rng(seed)

    def chosen(now: Situation, **_: object) -> Proposal:
        menu = new_runs(now)
        run = next(allowed(now, (menu[k] for k in draw.permutation(len(menu)))), None)
        return Proposal(kind="rivals", runs=() if run is None else (Proposed(run=run),))

    return chosen


class Timed:
    """A choice of runs, and the most seconds that one took."""

    def __init__(self, choose: Callable[..., Proposal]) -> None:
        self._choose, self.most = choose, 0.0

    def __call__(self, now: Situation, **options: object) -> Proposal:
        begun = time.monotonic()
        found = self._choose(now, **options)
        self.most = max(self.most, time.monotonic() - begun)
        return found


def answer(course: Investigation) -> InvestigationStage | None:
    """The last stage that was diagnosed."""
    return next((stage for stage in reversed(course.stages) if stage.verdict), None)


def right(rig: SealedRig, kind: str, stage: InvestigationStage | None) -> bool:
    """Whether a stage's answer is right."""
    if stage is None:
        return False
    alike: dict[Place, set[Place]] = {}
    for group in stage.open:
        for key in group:
            alike.setdefault(key, set()).update(group)
    return is_right(kind, rig.hidden.truth, rig.hidden.outside, stage.verdict, list(stage.named), alike)


def further(course: Investigation) -> int:
    """Driven runs after the first stage."""
    return sum(run.plan.excitation != "free" for stage in course.stages[1:] for run in stage.runs)


def row(job: Job, way: str, rig: SealedRig, course: Investigation, choice: Timed) -> dict[str, object]:
    """A line of the table."""
    stage = answer(course)
    return {
        **dict(zip(("kind", "size", "seed"), job, strict=True)), "way": way,
        "truth": _places(rig.hidden.truth or rig.hidden.outside),
        "verdict": stage.verdict if stage else "", "named": _places(stage.named) if stage else "",
        "open": groups(stage), "first_open": groups(next((stage for stage in course.stages if stage.verdict), None)),
        "right": int(right(rig, job[0], stage)),
        "runs": len(course.runs), "further": further(course), "seconds": f"{course.seconds:g}",
        "proposal": f"{choice.most:.1f}", "broken": " | ".join(rig.broken), "ended": course.ended,
    }  # fmt: skip


def investigated(
    rig: SealedRig, folder: Path, begun: Investigation, choose: Callable[..., Proposal], runs: int
) -> tuple[Investigation, Timed]:
    """A whole investigation of a sealed rig; one that is refused ends with the refusal."""
    choice = Timed(choose)
    terms = Terms(
        most_runs=runs, seconds=SECONDS, limits=rig.limits,
        work=NEXT.comparison_seconds, measure=rig.measure, choose=choice, limit=LIMIT,
        tell=lambda text: print("   ", text.replace("\n", "\n    "), flush=True),
    )  # fmt: skip
    try:
        return investigate(rig.plan, folder, begun, terms), choice
    except REFUSALS as refusal:
        return msgspec.structs.replace(read_investigation(folder) or begun, ended=f"refused: {refusal}"), choice


def first_stage(course: Investigation, source: Path, folder: Path) -> Investigation:
    """An investigation set back to its first stage, in a folder of its own."""
    stage = course.stages[0]
    names = {run.plan.id for run in stage.runs}
    whole = read(source / RECORDING)
    kept = tuple(run for run in whole.runs if run.id in names)
    folder.mkdir()
    write(folder / RECORDING, Campaign(runs=kept, known=whole.known, source=whole.source))
    (folder / diagnosis_folder(stage)).symlink_to((source / diagnosis_folder(stage)).resolve())
    begun = msgspec.structs.replace(course, stages=[stage], ended="")
    write_json(folder / STATE, begun)
    return begun


def rows(rigs: Rigs, job: Job, alone: bool, converter: str | None) -> Iterator[dict[str, object]]:
    """All rows of an envelope."""
    kind, size, seed = job
    with tempfile.TemporaryDirectory() as name:
        place = Path(name) / "proposed"
        place.mkdir()
        rig = replace(rigs.draw(kind, size, seed), converter=converter)
        course, choice = investigated(rig, place, Investigation(plan="sealed", baseline="coulomb", tolerance=0.0), propose, RUNS)
        yield row(job, "proposed", rig, course, choice)
        found = answer(course)
        if alone or not rig.hidden.truth or found is None or further(course) == 0:
            return
        for way, choose in (("repeat", repeated), ("random", at_random(seed))):
            folder = Path(name) / way
            begun = first_stage(course, place, folder)
            other = replace(rigs.draw(kind, size, seed), converter=converter)
            ended, choice = investigated(other, folder, begun, choose, len(begun.runs) + 2 * further(course))
            yield row(job, way, other, ended, choice)


def standard(job: Job) -> dict[str, object]:
    """The standard plan of seven runs on an envelope, as a line of `study.py`."""
    envelope = draw_envelope(*job)
    with tempfile.TemporaryDirectory() as name:
        recording, folder = Path(name) / "sealed.h5", Path(name) / "answer"
        write(recording, envelope.campaign)
        diagnose_file(recording, folder, "coulomb", limit=LIMIT, page=False)
        return study.scored(envelope, job[1], job[2], folder)


def groups(stage: InvestigationStage | None) -> str:
    """The indistinguishable causes of a stage, as in the table."""
    return " | ".join(_places(group) for group in stage.open) if stage else ""


def _places(pairs: object) -> str:
    return "+".join(f"{cause} at {place}" for cause, place in pairs)  # type: ignore[attr-defined]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=20.0, help="begin no envelope after this time")
    parser.add_argument("--first", type=int, default=2, help="first round; the study was made with the envelopes of round 1")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--alone", action="store_true", help="proposals alone, neither repeated nor random runs beside them")
    parser.add_argument("--standard", action="store_true", help="the standard plan on envelopes that the table holds")
    parser.add_argument("--rigs", choices=FAMILIES, default="bonders")
    parser.add_argument("--table", type=Path, default=None, help="another table than that of these rigs")
    parser.add_argument("--converter", choices=CONVERTERS, default=None, help="the filter of the instrument's converters")
    parser.add_argument("--kinds", nargs="*", default=None, help="only these kinds")
    args = parser.parse_args()
    rigs = FAMILIES[args.rigs]
    own = args.table or rigs.table
    table, columns = (PLANNED, study.COLUMNS) if args.standard else (own, COLUMNS)
    known, investigations = done(table), done(own)
    rounds = range(args.first, args.first + args.rounds)
    chosen = [job for job in jobs(rigs, rounds) if not args.standard or job in investigations]
    todo = [job for job in chosen if job not in known and (args.kinds is None or job[0] in args.kinds)]
    end = time.monotonic() + 60.0 * args.minutes
    for job in todo:
        if time.monotonic() > end:
            break
        begun = time.monotonic()
        print(*job, flush=True)
        for each in [standard(job)] if args.standard else rows(rigs, job, args.alone, args.converter):
            append(table, columns, each)
            print(f"{time.monotonic() - begun:5.0f} s:", ", ".join(str(each[name]) for name in columns), flush=True)


if __name__ == "__main__":
    main()
