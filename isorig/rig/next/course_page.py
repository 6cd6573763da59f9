"""The page of an investigation: the question that each run answered, and the present knowledge."""

from __future__ import annotations

from collections.abc import Sequence

from isorig.rig.next.page import foreseen_chart
from isorig.rig.next.stages import Course, Stage, diagnosis_folder
from isorig.rig.report.page import Report, Section, Table, build_report
from isorig.rig.report.sections import words


def course_page(course: Course) -> str:
    """The page as HTML."""
    known = [stage for stage in course.stages if stage.answer]
    verdict = course.ended or (
        f"Stage {course.stages[-1].number} is in progress." if course.stages else "Nothing is measured yet."
    )
    return build_report(
        Report(
            title="Investigation", verdict=verdict, summary=known[-1].answer if known else [],
            sections=[_overview(course), *(_section(stage) for stage in course.stages)],
        )
    )  # fmt: skip


def _overview(course: Course) -> Section:
    rows = [
        (
            f"{stage.number}", run.plan.id, run.description, f"{run.plan.seconds:g}", stage.asked[0],
            stage.answer[0] if stage.answer else stage.step, _names(stage.named),
        )
        for stage in course.stages
        for run in stage.runs
    ]  # fmt: skip
    columns = ("stage", "run", "drive", "s", "question", "answer", "named")
    text = [f"{course.seconds:g} s were measured in {len(course.runs)} runs."]
    if course.declined:
        text.append(f"Declined by the operator: {'; '.join(course.declined)}.")
    return Section(title="Course", text=text, tables=[Table(columns=columns, rows=rows)] if rows else [])


def _section(stage: Stage) -> Section:
    text = [*stage.asked]
    for run in stage.runs:
        text += [f"Run {run.plan.id}: {run.description}.", *run.why]
    if stage.answer:
        text += ["After it:", *stage.answer]
        if stage.verdict:
            text.append(f"The diagnosis is in {diagnosis_folder(stage)}/report.html.")
    charts = [foreseen_chart(picture, f"{run.plan.id}-{k + 1}") for run in stage.runs for k, picture in enumerate(run.pictures)]
    return Section(title=f"Stage {stage.number}", text=text, charts=charts)


def _names(keys: Sequence[tuple[str, str]]) -> str:
    return ", ".join(f"{words(cause)} at {place}" for cause, place in keys)
