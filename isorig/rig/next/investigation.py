"""An investigation: measure, diagnose, propose, and repeat until one cause is identified; saved on disk after each stage."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from isorig.analysis.fitting.solve import base_parameters
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.proposals.policy import POLICY as PROPOSALS
from isorig.analysis.proposals.precision import named_parameters, std_of_parameter, unit_of_parameter
from isorig.analysis.wording import capitalized, sized, words
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.recorder import working_file
from isorig.rig.acquire.rig_operator import Decision, Operator
from isorig.rig.acquire.session import acquire
from isorig.rig.acquire.store import whole_runs
from isorig.rig.choices import Baseline
from isorig.rig.diagnose.many import diagnose_file
from isorig.rig.errors import PlanError
from isorig.rig.files.findings import Findings, read_findings
from isorig.rig.files.inputs import content_of
from isorig.rig.files.output import write_json, write_text
from isorig.rig.files.rivals import Rivals, fitted_model, read_rivals
from isorig.rig.next.page import investigation_page, picture_of
from isorig.rig.next.plan_file import run_names, with_runs, write_plan
from isorig.rig.next.policy import POLICY
from isorig.rig.next.proposal import UNNAMED, Proposal, propose, single_driven, situation
from isorig.rig.next.runs import planned, run_words
from isorig.rig.next.sentences import inseparable, listed, reasons, summary, twins, unfitted
from isorig.rig.next.stages import Investigation, InvestigationRun, InvestigationStage, diagnosis_folder
from isorig.rig.report.conclusion import ruled_out_in_words
from isorig.rig.report.sections import CUT_SHORT
from isorig.rig.virtual.levels import HEAD_PER_GAIN

STATE, RECORDING, SESSION, PAGE = "investigation.json", "recording.h5", "session.toml", "report.html"


@dataclass(frozen=True, kw_only=True)
class MeasuredRuns:
    """The runs in the recording, and whether the operator ended the session."""

    names: Sequence[str]
    stopped: bool = False


#: Measures the runs of a plan that are not in the recording yet.
Measure = Callable[[Plan, Path], MeasuredRuns]
#: Selects the next runs, like `propose`.
Choose = Callable[..., Proposal]


@dataclass(frozen=True, kw_only=True)
class Terms:
    """Limits of an investigation, and its callbacks.

    It measures at most `most_runs` runs and `seconds` in total. A proposal takes at most `work` seconds, the search for causes in
    a diagnosis at most `limit`. `tell` is called with lines for the operator.
    """

    most_runs: int
    seconds: float
    limits: Limits
    work: float
    measure: Measure
    choose: Choose = propose
    limit: float | None = None
    tell: Callable[[str], None] = lambda text: None


def measure_with(
    wire: str, operator: Operator, consent: Callable[[str], Decision] | None = None, *, force: bool = False
) -> Measure:
    """A function that measures a plan's runs with the instrument at a port.

    `consent` is asked before each run by its name, if given; with `force` a run starts even if the pre-run check fails.
    """

    def measure(plan: Plan, recording: Path) -> MeasuredRuns:
        stopped = False

        def decide(name: str) -> Decision:
            nonlocal stopped
            decision = "take" if consent is None else consent(name)
            stopped = stopped or decision == "end"
            return decision

        left = {name for run in plan.runs for name in run.ids()} - whole_runs(recording, plan)
        broken_off = working_file(recording).exists()
        if left or broken_off:
            resume = broken_off or recording.exists()
            # The proposals keep to the strokes by a model fitted to the runs so far, which knows more than the description.
            chosen = msgspec.structs.replace(plan, limits=msgspec.structs.replace(plan.limits, stroke={}))
            acquire(chosen, wire, recording, replace(operator, decide=decide), resume=resume, force=force)
        return MeasuredRuns(names=sorted(whole_runs(recording, plan)), stopped=stopped)

    return measure


def investigate(plan: Plan, folder: Path, begun: Investigation, terms: Terms) -> Investigation:
    """Continue an investigation until one cause is identified, no allowed run is informative, or its limits are reached.

    Every step is saved in the folder before the next one starts, so an interrupted investigation can be continued. The runs of
    the plan are the first stage. Raises RigError, AnalysisError or DriverError if measuring or diagnosing fails; the results
    until then are kept.
    """
    investigation, stopped = begun, False
    while not (investigation.ended or stopped):
        step = investigation.stages[-1].step if investigation.stages else "diagnosed"
        if step == "diagnosed":
            investigation = _next_stage(plan, folder, investigation, terms)
        elif step == "proposed":
            investigation, stopped = _measure(plan, folder, investigation, terms)
        else:
            investigation = _diagnose(folder, investigation, terms)
        write_json(folder / STATE, investigation)
        write_text(folder / PAGE, investigation_page(investigation))
    return investigation


def read_investigation(folder: Path) -> Investigation | None:
    """The state of an investigation in a folder; None if there is none. Raises PlanError if it is damaged."""
    path = folder / STATE
    if not path.exists():
        return None
    try:
        return msgspec.json.decode(content_of(path), type=Investigation)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        raise PlanError(f"{path} is damaged; start again in another folder, the recording in this one is not changed") from None


def _next_stage(plan: Plan, folder: Path, investigation: Investigation, terms: Terms) -> Investigation:
    # The next question and its runs, or the reason why there is none.
    number = len(investigation.stages) + 1
    if not investigation.stages and plan.runs:
        alone = len(plan.described().configurations) == 1
        why = ["It is part of the plan."]
        runs = [InvestigationRun(plan=run, description=run_words(run, alone), why=why) for run in plan.runs]
        stage = InvestigationStage(number=number, kind="plan", asked=["What do the planned runs show?"], runs=runs)
        return _with_stage(folder, plan, investigation, stage, terms)
    if over := _reason_to_end(investigation, terms):
        return msgspec.structs.replace(investigation, ended=over)
    if investigation.diagnosed:
        rivals = read_rivals(folder / diagnosis_folder(investigation.diagnosed[-1]))
    else:
        rivals = nothing_known(plan, terms.limits, investigation.baseline)
    if rivals.named and rivals.open and all(one.why == "indistinguishable" and len(one.models) < 2 for one in rivals.open):
        ended = " ".join([f"{capitalized(listed(rivals.named))}.", *twins(rivals), *unfitted(rivals)])
        return msgspec.structs.replace(investigation, ended=ended)
    plans = {run.id: run for run in investigation.runs}
    now = situation([rivals], terms.limits, plans, frozenset(investigation.declined))
    proposal = terms.choose(now, budget=terms.seconds - investigation.seconds, work=terms.work, most=1)
    if not proposal.runs:
        return msgspec.structs.replace(investigation, ended=_nothing_left(investigation, proposal, now.rivals))
    names = run_names(len(proposal.runs), [run.id for run in investigation.runs])
    runs = [
        InvestigationRun(
            plan=planned(item.run, name), description=now.run_words(item.run), why=reasons(item, proposal, now),
            pictures=[picture_of(pair) for pair in item.choice.predicted_pairs] if item.choice is not None else [],
            promised=item.choice.probability if item.choice is not None else None,
        )
        for name, item in zip(names, proposal.runs, strict=True)
    ]  # fmt: skip
    stage = InvestigationStage(number=number, kind=proposal.kind, asked=summary(proposal, now.rivals), runs=runs)
    return _with_stage(folder, plan, investigation, stage, terms)


def _with_stage(folder: Path, plan: Plan, investigation: Investigation, stage: InvestigationStage, terms: Terms) -> Investigation:
    investigation = msgspec.structs.replace(investigation, stages=[*investigation.stages, stage])
    why = {run.plan.id: run.why for each in investigation.stages for run in each.runs}
    write_plan(folder / SESSION, with_runs(plan, investigation.runs), why)
    terms.tell(f"Stage {stage.number}: {' '.join(stage.asked)}")
    for run in stage.runs:
        terms.tell("\n  ".join([f"{run.plan.id}: {run.description}", *run.why]))
    return investigation


def _measure(plan: Plan, folder: Path, investigation: Investigation, terms: Terms) -> tuple[Investigation, bool]:
    stage = investigation.stages[-1]
    found = terms.measure(with_runs(plan, investigation.runs), folder / RECORDING)
    taken = [run for run in stage.runs if set(run.plan.ids()) & set(found.names)]
    if found.stopped:
        return investigation, True
    declined = [*investigation.declined, *(run.description for run in stage.runs if run not in taken)]
    if not taken:
        ended = "None of the planned runs was measured." if stage.kind == "plan" else ""
        return msgspec.structs.replace(investigation, stages=investigation.stages[:-1], declined=declined, ended=ended), False
    stage = msgspec.structs.replace(stage, runs=taken, step="measured")
    return msgspec.structs.replace(investigation.with_last(stage), declined=declined), False


def _diagnose(folder: Path, investigation: Investigation, terms: Terms) -> Investigation:
    stage = investigation.stages[-1]
    if all(run.plan.excitation == "free" for each in investigation.stages for run in each.runs):
        # A run at rest alone cannot be diagnosed.
        answer = ["The sensors' noise is known now."]
        stage = msgspec.structs.replace(stage, step="diagnosed", answer=answer)
        return investigation.with_last(stage)
    place = folder / diagnosis_folder(stage)
    outcome = diagnose_file(
        folder / RECORDING, place, investigation.baseline, tolerance=investigation.tolerance, limit=terms.limit
    )
    found = read_rivals(place)
    answer = [*diagnosis_sentences(found, read_findings(place)), *([CUT_SHORT] if outcome.cut_short else [])]
    stage = msgspec.structs.replace(
        stage, step="diagnosed", verdict=found.verdict, named=found.named, answer=answer,
        open=[[model.key for model in one.models] + one.twins for one in found.open],
    )  # fmt: skip
    terms.tell("\n  ".join([f"After stage {stage.number}:", *answer]))
    return investigation.with_last(stage)


def nothing_known(plan: Plan, limits: Limits, baseline: Baseline) -> Rivals:
    """The knowledge before the first run: the rig as described, with starting values. Raises PlanError if no limits determine the
    first run."""
    if limits.gains is None or limits.band is None:
        raise PlanError("a plan without runs needs limits.gains and limits.band; give the allowed gains and the allowed band")
    model = described_rig(plan, baseline)
    free = base_parameters(model)
    spread = np.array([POLICY.first_guess * model.get(f.path) if f.log else 100.0 * f.step for f in free])
    quiet = POLICY.noise_guess * HEAD_PER_GAIN * limits.gains[1]
    return Rivals(
        campaign="the first run", verdict="", baseline=baseline, sample_rate=plan.instrument.sample_rate,
        noise={name: quiet if quantity == model.drive.quantity else 0.0 for name, quantity in model.quantities.items()},
        known=plan.rig, runs=[], explains=fitted_model("", "", model, free, np.diag(spread**2)), open=[], named=[], ruled_out=[],
    )  # fmt: skip


def described_rig(plan: Plan, baseline: Baseline) -> RigModel:
    """The rig described by a plan, with starting values."""
    return single_driven(plan.nominal(friction=baseline == "coulomb"))


def _reason_to_end(investigation: Investigation, terms: Terms) -> str:
    """The reason to end an investigation before the next run is selected; empty if it continues."""
    known = investigation.diagnosed
    if known and known[-1].named and not known[-1].open and known[-1].verdict in ("explained", "partly explained"):
        return f"{'Identified cause' if len(known[-1].named) == 1 else 'Identified causes'}: {listed(known[-1].named)}."
    undecided = [stage for stage in known if stage.kind in ("undecided", "reproducible")]
    last = {(s.verdict, tuple(s.named)) for s in known[-POLICY.unchanged - 1 :]}
    if len(undecided) >= POLICY.unchanged and len(last) == 1:
        return "The remaining error has no cause in the catalogue: further runs brought nothing new."
    if len(investigation.runs) >= terms.most_runs:
        return f"The limit of {terms.most_runs} runs is reached."
    if investigation.seconds + PROPOSALS.shortest_run > terms.seconds:
        return f"The limit of {terms.seconds:g} s of measuring is reached."
    return ""


def _nothing_left(investigation: Investigation, proposal: Proposal, rivals: Rivals) -> str:
    pairs = inseparable(proposal) + twins(rivals)
    if pairs:
        return " ".join(pairs)
    if investigation.diagnosed and investigation.diagnosed[-1].verdict in UNNAMED:
        return "The model misfits, no cause of the catalogue explains it, and no remaining allowed run is likely to."
    if proposal.kind == "untested":
        return "No further allowed run is likely to reveal a cause of the catalogue."
    return "No allowed run is informative."


def diagnosis_sentences(rivals: Rivals, findings: Findings) -> list[str]:
    """The result of a diagnosis, in sentences."""
    verdict = {
        "adequate": "The model explains all runs down to the noise: no cause is needed so far.",
        "explained": "The named causes explain the runs.", "partly explained": "Part of the error is explained.",
        "unexplained": "The model misfits, and no cause is certain enough to be named.",
    }  # fmt: skip
    sentences = [verdict[rivals.verdict]]
    if rivals.named:
        sentences.append(f"Named: {listed(rivals.named)}.")
    for one in rivals.open:
        why = "The data cannot distinguish" if one.why == "indistinguishable" else "Closest, but not certain"
        sentences.append(f"{why}: {listed([model.key for model in one.models] + one.twins)}.")
    if rivals.ruled_out:
        most = POLICY.listed_ruled_out
        others = " and others" if len(rivals.ruled_out) > most else ""
        sentences.append(f"{ruled_out_in_words(findings)}: {listed(rivals.ruled_out[:most])}{others}.")
    return [*sentences, _parameters(rivals)]


def _parameters(rivals: Rivals) -> str:
    variant = rivals.explains.variant()
    shown = []
    for name, value_of in named_parameters(variant.model).items():
        std = std_of_parameter(variant, value_of)
        if std > 0.0:
            shown.append(f"{words(name)} {sized(value_of(variant.model), unit_of_parameter(name, variant.model), std)}")
    return f"Parameters: {', '.join(shown)}."
