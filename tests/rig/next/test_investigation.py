"""An investigation stage by stage: how it ends, and that it goes on where it was whatever breaks it off."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec
import pytest
from open_questions import end_stop, fitted, rivals, two_springs, written
from some_findings import findings

from isorig.analysis.model.limits import Limits
from isorig.analysis.proposals.menu import CandidateRun
from isorig.rig.acquire.plan import ChannelPlan, InstrumentPlan, Plan, RunPlan
from isorig.rig.acquire.plan_check import read_plan
from isorig.rig.cli import main
from isorig.rig.diagnose.many import CampaignOutcome
from isorig.rig.errors import PlanError
from isorig.rig.files.rivals import OpenSet, Rivals
from isorig.rig.next import investigation as investigation_module
from isorig.rig.next import proposal as proposal_module
from isorig.rig.next.investigation import (
    PAGE,
    SESSION,
    STATE,
    MeasuredRuns,
    Terms,
    investigate,
    nothing_known,
    read_investigation,
)
from isorig.rig.next.proposal import Proposal, Proposed, propose, situation
from isorig.rig.next.sentences import summary
from isorig.rig.next.stages import Investigation
from isorig.rig.wire_bonder.description import wire_bonder

NAMES = ("head", "motor", "table", "heatblock")
PLAN = Plan(
    instrument=InstrumentPlan(kind="framed", port="virtual", sample_rate=1024.0),
    channels={name: ChannelPlan(input=k, sensitivity=0.2) for k, name in enumerate(NAMES)},
    rig={"head_mass": 6.5, "motor_mass": 16.4, "heatblock_mass": 6.0, "table_mass": 250.0},
    limits=Limits(gains=(0.0, 70.0), band=(0.5, 30.0), stroke={"isolation": 0.008}),
)
FIRST = RunPlan(id="u35", configuration="unlocked", gain=35.0, seconds=20.0, band=(0.5, 20.0))
PROPOSED = CandidateRun(configuration="unlocked", excitation="random", gain=70.0, seconds=15.0, band=(0.5, 10.0), seed=4)


class KilledError(Exception):
    """What breaks an investigation off."""


@dataclass
class Lab:
    """Measuring, diagnosing and proposing, made up: what was asked, and where it breaks."""

    answers: list[Rivals]
    proposals: list[Proposal]
    breaks: str = ""
    declines: str = ""
    cut_short: bool = False
    stops: bool = False
    measured: list[str] = field(default_factory=list)
    diagnosed: list[str] = field(default_factory=list)

    def measure(self, plan: Plan, recording: Path) -> MeasuredRuns:
        held = json.loads(recording.read_text()) if recording.exists() else []
        for run in plan.runs:
            if run.id in held or run.id == self.declines:
                continue
            self._break(f"measure {run.id}")
            if self.stops:
                return MeasuredRuns(names=held, stopped=True)
            held.append(run.id)
            self.measured.append(run.id)
            recording.write_text(json.dumps(held))
        return MeasuredRuns(names=held)

    def diagnose(self, recording: Path, folder: Path, *rest: object, **options: object) -> CampaignOutcome:
        self._break(f"diagnose {folder.name}")
        self.diagnosed.append(folder.name)
        number = int(folder.name.removeprefix("diagnosis-"))
        written(folder, self.answers[min(number, len(self.answers)) - 1])
        (folder / "findings.json").write_bytes(msgspec.json.encode(findings()))
        return CampaignOutcome(campaign="lab", cut_short=self.cut_short)

    def propose(self, now: object, **options: object) -> Proposal:
        self._break(f"propose {len(self.diagnosed)}")
        return self.proposals.pop(0) if self.proposals else Proposal(kind="untested")

    def _break(self, where: str) -> None:
        if where == self.breaks:
            self.breaks = ""
            raise KilledError(where)


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Lab]:
    def made(answers: list[Rivals], proposals: list[Proposal], **options: object) -> Lab:
        found = Lab(answers=answers, proposals=proposals, **options)
        monkeypatch.setattr(investigation_module, "diagnose_file", found.diagnose)
        return found

    return made


def go(lab: Lab, folder: Path, plan: Plan, *, runs: int = 12, seconds: float = 300.0) -> Investigation:
    terms = Terms(most_runs=runs, seconds=seconds, limits=PLAN.limits, work=5.0, measure=lab.measure, choose=lab.propose)
    begun = read_investigation(folder) or Investigation(plan="plan.toml", baseline="coulomb", tolerance=0.0)
    return investigate(plan, folder, begun, terms)


def proposal() -> Proposal:
    return Proposal(kind="rivals", runs=(Proposed(run=PROPOSED, remarks=("It parts them.",)),))


OPEN = rivals(two_springs(), named=[("hardening_stiffness", "isolation")])
STANDS = rivals(named=[("end_stop", "isolation")], explains=end_stop())
WITH_FIRST = msgspec.structs.replace(PLAN, runs=(FIRST,))
STEPS = ("measure u35", "diagnose diagnosis-1", "propose 1", "measure next-1", "diagnose diagnosis-2")


def test_until_one_cause_stands(lab: Callable[..., Lab], tmp_path: Path) -> None:
    course = go(lab([OPEN, STANDS], [proposal()]), tmp_path, WITH_FIRST)
    assert course.ended == "Identified cause: end stop at isolation."
    assert [[run.plan.id for run in stage.runs] for stage in course.stages] == [["u35"], ["next-1"]]
    assert course.seconds == 35.0
    assert course.stages[0].open == [[("hardening_stiffness", "isolation"), ("end_stop", "isolation")]]
    page = (tmp_path / PAGE).read_text()
    for text in ("Identified cause", "It parts them.", "What do the planned runs show?", "35 s were measured in 2 runs"):
        assert text in page
    assert [run.id for run in read_plan(tmp_path / SESSION).runs] == ["u35", "next-1"]


@pytest.mark.parametrize("where", STEPS)
def test_an_interrupted_investigation_continues_at_the_same_step(where: str, lab: Callable[..., Lab], tmp_path: Path) -> None:
    made = lab([OPEN, STANDS], [proposal()], breaks=where)
    with pytest.raises(KilledError):
        go(made, tmp_path, WITH_FIRST)
    course = go(made, tmp_path, WITH_FIRST)
    assert course.ended == "Identified cause: end stop at isolation."
    assert made.measured == ["u35", "next-1"]
    assert made.diagnosed == ["diagnosis-1", "diagnosis-2"]
    assert go(made, tmp_path, WITH_FIRST) == course


def test_the_operator_stops_and_goes_on(lab: Callable[..., Lab], tmp_path: Path) -> None:
    made = lab([STANDS], [], stops=True)
    course = go(made, tmp_path, WITH_FIRST)
    assert (course.ended, course.stages[0].step, course.seconds) == ("", "proposed", 0.0)
    made.stops = False
    assert go(made, tmp_path, WITH_FIRST).ended.startswith("Identified cause")


def test_a_run_that_is_not_wanted_is_not_proposed_again(lab: Callable[..., Lab], tmp_path: Path) -> None:
    made = lab([OPEN], [proposal()], declines="next-1")
    course = go(made, tmp_path, WITH_FIRST)
    assert len(course.declined) == 1
    assert len(course.stages) == 1
    now = situation([OPEN], PLAN.limits, {})
    refused = next(run for run in now.candidates() if run.excitation == "moves")
    told = investigation_module.run_words(refused)
    assert all(investigation_module.run_words(run) != told for run in replace(now, declined=frozenset([told])).candidates())


@pytest.mark.parametrize(
    ("answer", "options", "ended"),
    [
        (OPEN, {"runs": 1}, "The limit of 1 runs is reached."),
        (OPEN, {"seconds": 22.0}, "The limit of 22 s of measuring is reached."),
        (rivals(verdict="adequate"), {}, "No further allowed run is likely to reveal a cause of the catalogue."),
    ],
)
def test_ends(answer: Rivals, options: dict[str, float], ended: str, lab: Callable[..., Lab], tmp_path: Path) -> None:
    assert go(lab([answer], []), tmp_path, WITH_FIRST, **options).ended == ended


def test_an_undecided_remainder_is_left_after_two_runs_without_news(lab: Callable[..., Lab], tmp_path: Path) -> None:
    undecided = msgspec.structs.replace(two_springs(), why="undecided")
    answer = rivals(undecided, verdict="unexplained")
    again = [replace(proposal(), kind="undecided") for _ in range(5)]
    course = go(lab([answer], again), tmp_path, WITH_FIRST)
    assert course.ended == "The remaining error has no cause in the catalogue: further runs brought nothing new."
    assert len(course.stages) == 3


def test_an_error_without_a_candidate_cause_is_repeated_and_then_excited_otherwise() -> None:
    """First the drive that misfits most again, then the strongest broad run not measured yet, within limits and budget."""
    found = rivals(verdict="unexplained", worst="u35")
    first = propose(situation([found], PLAN.limits, {"u35": FIRST}), work=1.0)
    assert first.kind == "reproducible"
    assert [item.run.repeat_of for item in first.runs if not item.run.rests] == ["u35"]
    again = msgspec.structs.replace(found.runs[0], id="next-1", repeat_of="u35", start_time=100.0)
    now = situation([msgspec.structs.replace(found, runs=[*found.runs, again])], PLAN.limits, {"u35": FIRST})
    second = propose(now, work=1.0)
    (item,) = (item for item in second.runs if not item.run.rests)
    assert (second.kind, item.run.excitation, item.run.configuration) == ("undecided", "random", "unlocked")
    assert "Does another excitation reveal its cause?" in summary(second, found)[0]
    assert item.peaks is not None
    assert not item.peaks.beyond(PLAN.limits)
    assert propose(now, work=1.0, budget=5.0).kind == "untested"
    locked = msgspec.structs.replace(found.runs[0], id="l35", configuration="locked")
    elsewhere = msgspec.structs.replace(found, runs=[*found.runs, locked, again], worst="l35")
    third = propose(situation([elsewhere], PLAN.limits, {"u35": FIRST}), work=1.0)
    assert [item.run.configuration for item in third.runs if not item.run.rests] == ["locked"]


@pytest.mark.parametrize("gains", [True, False])
def test_a_sine_is_proposed_for_unknown_causes_only_if_nothing_broader_shows_one(
    gains: bool, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    compared: list[set[str]] = []

    def comparing(now: object, kind: str, question: object, runs: list[CandidateRun], *rest: object) -> Proposal:
        compared.append({run.excitation for run in runs})
        return proposal() if gains else Proposal(kind="untested")

    monkeypatch.setattr(proposal_module, "_compared", comparing)
    propose(situation([rivals(verdict="adequate")], PLAN.limits), work=1.0)
    assert "sine" not in compared[0]
    assert [("sine" in each) for each in compared[1:]] == ([] if gains else [True])


def test_causes_of_the_same_equations_end_it(lab: Callable[..., Lab], tmp_path: Path) -> None:
    same = OpenSet(why="indistinguishable", models=[fitted(wire_bonder(), "wrong_mass")], twins=[("sensor_gain", "head")])
    course = go(lab([rivals(same, named=[("wrong_mass", "head")])], []), tmp_path, WITH_FIRST)
    assert course.ended.startswith("Wrong mass at head. Sensor gain at head and wrong mass at")
    assert len(course.stages) == 1


@pytest.mark.parametrize("cut_short", [False, True])
def test_a_diagnosis_that_was_cut_short_says_so(cut_short: bool, lab: Callable[..., Lab], tmp_path: Path) -> None:
    course = go(lab([STANDS], [], cut_short=cut_short), tmp_path, WITH_FIRST)
    assert (investigation_module.CUT_SHORT in course.stages[0].answer) == cut_short


def test_nothing_known_is_the_rig_as_it_is_described() -> None:
    found = nothing_known(PLAN, PLAN.limits, "coulomb")
    now = situation([found], PLAN.limits)
    assert now.start_time == 0.0
    assert now.configuration == "unlocked"
    assert {run.excitation for run in now.candidates()} <= {"random"}
    with pytest.raises(PlanError, match=r"needs limits\.gains and limits\.band"):
        nothing_known(PLAN, Limits(), "coulomb")


def test_a_diagnosis_that_rules_out_counts(tmp_path: Path) -> None:
    earlier = rivals(ruled_out=[("end_stop", "isolation")])
    now = situation([earlier, OPEN], PLAN.limits)
    assert [(model.cause) for one in now.rivals.open for model in one.models] == ["hardening_stiffness"]
    other = rivals(explains=fitted(msgspec.structs.replace(wire_bonder(), name="another")))
    with pytest.raises(PlanError, match="different rigs"):
        situation([other, OPEN], PLAN.limits)


def test_a_damaged_state_is_refused(tmp_path: Path) -> None:
    (tmp_path / STATE).write_text("{}")
    with pytest.raises(PlanError, match="is damaged"):
        read_investigation(tmp_path)


def test_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A plan of one short run through a real port: measured, diagnosed, and ended by its budget; the same call adds nothing."""
    from isorig.rig.next.plan_file import with_runs, write_plan

    short = msgspec.structs.replace(FIRST, seconds=8.0, gain=70.0, seed=3)
    plan = write_plan(tmp_path / "plan.toml", with_runs(PLAN, [short]), {})
    call = ["investigate", str(plan), "--port", "virtual", "--yes", "--runs", "1", "-o", str(tmp_path / "out")]
    assert main(call) == 0
    said = capsys.readouterr().out
    assert "8 s measured in 1 runs" in said
    stage = json.loads((tmp_path / "out" / STATE).read_text())["stages"][0]
    assert stage["step"] == "diagnosed"
    assert (tmp_path / "out" / "diagnosis-1" / "report.html").exists()
    before = (tmp_path / "out" / "recording.h5").stat().st_mtime_ns
    assert main(call) == 0
    assert (tmp_path / "out" / "recording.h5").stat().st_mtime_ns == before
    assert main([*call, "--tolerance", "0.1"]) == 2
    assert "has an investigation of plan.toml" in capsys.readouterr().err
