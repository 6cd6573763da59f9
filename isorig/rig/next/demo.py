"""An investigation without hardware: a virtual rig with a hidden effect, from the first run to the identified cause."""

import shutil
from pathlib import Path

from isorig.analysis.wording import words
from isorig.rig.acquire.plan import as_virtual
from isorig.rig.acquire.plan_check import read_plan
from isorig.rig.acquire.rig_operator import MeasuredRun, Operator
from isorig.rig.errors import OutputError
from isorig.rig.next.investigation import PAGE, STATE, Terms, described_rig, investigate, measure_with
from isorig.rig.next.plan_file import limits_of, with_runs
from isorig.rig.next.stages import Investigation
from isorig.rig.process.terminal import show_table
from isorig.rig.virtual.demo import PLAN, Clock, virtual_instrument
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.effects import hidden_in

#: The hidden effect, and its size.
HIDDEN, SIZE = "end_stop", 1.0
#: Runs and seconds of measuring for the demo, and seconds for each proposal, so that it takes about a minute.
RUNS, SECONDS, WORK = 6, 120.0, 6.0


def show(folder: Path, seed: int) -> None:
    """Investigate a virtual rig through a real port, and disclose the hidden effect at the end. Raises OutputError if the folder
    contains an investigation that is not a demo's."""
    clock = Clock()
    place = folder / "investigation"
    if place.exists() and not (place / STATE).exists():
        raise OutputError(f"{place} exists and is not an investigation; give another folder with -o")
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    plan = as_virtual(with_runs(read_plan(PLAN), ()))
    with virtual_instrument(seed, "--hide", HIDDEN, "--size", str(SIZE)) as port:
        clock.tell(f"a virtual rig with a hidden effect is connected to {port}; nothing is measured yet")

        def took(item: MeasuredRun) -> None:
            clock.tell(f"  {item.id}: {item.tally.stored} samples, {item.tally.lost} lost")

        operator = Operator(lock=lambda _: None, watch=lambda _: None, taken=took)
        terms = Terms(
            most_runs=RUNS, seconds=SECONDS, limits=limits_of(described_rig(plan, "coulomb"), plan, None), work=WORK,
            measure=measure_with(port, operator), tell=clock.tell,
        )  # fmt: skip
        investigation = investigate(plan, place, Investigation(plan=PLAN.name, baseline="coulomb", tolerance=0.0), terms)
    truth = hidden_in(wire_bonder(), HIDDEN, SIZE, seed).truth
    rows = [
        ("outcome", investigation.ended),
        ("hidden in the rig", ", ".join(f"{words(cause)} at {where}" for cause, where in truth)),
        ("runs, and seconds of measuring", f"{len(investigation.runs)}, {investigation.seconds:g}"),
        ("page of the investigation", str(place / PAGE)),
        ("seconds", f"{clock.seconds:.0f}"),
    ]
    show_table("Investigation", ("what", "result"), rows)
