"""The page of an investigation: the question that each run answered, and the present knowledge."""

from __future__ import annotations

from isorig.rig.next.page import prediction_chart
from isorig.rig.next.sentences import named
from isorig.rig.next.stages import Investigation, InvestigationStage, diagnosis_folder
from isorig.rig.report.page import Report, Section, Table, build_report


def investigation_page(investigation: Investigation) -> str:
    """The page as HTML."""
    known = [stage for stage in investigation.stages if stage.answer]
    now = f"Stage {investigation.stages[-1].number} is in progress." if investigation.stages else "Nothing is measured yet."
    verdict = investigation.ended or now
    return build_report(
        Report(
            title="Investigation", verdict=verdict, summary=known[-1].answer if known else [],
            sections=[_overview(investigation), *(_section(stage) for stage in investigation.stages)],
        )
    )  # fmt: skip


def _overview(investigation: Investigation) -> Section:
    rows = [
        (
            f"{stage.number}", run.plan.id, run.description, f"{run.plan.seconds:g}", stage.asked[0],
            stage.answer[0] if stage.answer else stage.step, ", ".join(map(named, stage.named)),
        )
        for stage in investigation.stages
        for run in stage.runs
    ]  # fmt: skip
    columns = ("stage", "run", "drive", "s", "question", "answer", "named")
    text = [f"{investigation.seconds:g} s were measured in {len(investigation.runs)} runs."]
    if investigation.declined:
        text.append(f"Declined by the operator: {'; '.join(investigation.declined)}.")
    return Section(title="Stages", text=text, tables=[Table(columns=columns, rows=rows)] if rows else [])


def _section(stage: InvestigationStage) -> Section:
    text = [*stage.asked]
    for run in stage.runs:
        text += [f"Run {run.plan.id}: {run.description}.", *run.why]
    if stage.answer:
        text += ["After it:", *stage.answer]
        if stage.verdict:
            text.append(f"The diagnosis is in {diagnosis_folder(stage)}/report.html.")
    charts = [prediction_chart(picture, f"{run.plan.id}-{k + 1}") for run in stage.runs for k, picture in enumerate(run.pictures)]
    return Section(title=f"Stage {stage.number}", text=text, charts=charts)
