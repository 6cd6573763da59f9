"""The pages of a proposal, each run with its reason and the predictions of the remaining causes, and of an investigation."""

from collections.abc import Sequence

import numpy as np

from isorig.analysis.campaign import SI_UNIT
from isorig.analysis.model.parameter_units import unit_of
from isorig.analysis.proposals.choice import Choice, PredictedPair
from isorig.analysis.proposals.policy import POLICY as PROPOSALS
from isorig.analysis.wording import capitalized, displayed_unit, sized, with_article, words
from isorig.rig.next.policy import POLICY
from isorig.rig.next.proposal import Proposal, Situation
from isorig.rig.next.sentences import cause, named, reasons, summary
from isorig.rig.next.stages import Investigation, InvestigationStage, Picture, diagnosis_folder
from isorig.rig.report.charts import Chart, ChartTrace, Panel
from isorig.rig.report.page import Report, Section, Table, build_report
from isorig.rig.report.sections import number


def proposal_page(proposal: Proposal, now: Situation, names: Sequence[str]) -> str:
    """The page of a proposal as HTML; `names` are those of the proposed runs."""
    return build_report(
        Report(
            title=f"The next run after {now.rivals.campaign}",
            verdict=f"{len(proposal.runs)} proposed" if proposal.runs else "No run is proposed",
            summary=summary(proposal, now.rivals), sections=proposal_sections(proposal, now, names),
        )
    )  # fmt: skip


def proposal_sections(proposal: Proposal, now: Situation, names: Sequence[str]) -> list[Section]:
    """A section for each proposed run, and one for the limits."""
    sections = []
    for name, item in zip(names, proposal.runs, strict=True):
        predicted_pairs = () if item.choice is None else item.choice.predicted_pairs
        charts = [prediction_chart(picture_of(pair), f"{name}-{k + 1}") for k, pair in enumerate(predicted_pairs)]
        tables = [] if item.choice is None else [_distances(item.choice)]
        text = [f"{capitalized(now.run_words(item.run))}.", *reasons(item, proposal, now)]
        sections.append(Section(title=f"Run {name}", text=text, tables=tables, charts=charts))
    return [*sections, _limits(proposal, now)]


def _distances(choice: Choice) -> Table:
    apart = sorted(choice.apart, key=lambda apart: -apart.distance)
    rivals = list(dict.fromkeys(cause(each.rival) for each in apart))
    # One rival of all is named once, in the caption.
    fitted = f": {rivals[0]}" if len(rivals) == 1 else ""
    rows = [
        (
            cause(each.truth), *(() if fitted else (cause(each.rival),)), number(min(each.distance, POLICY.largest_distance), 3),
            number(each.probability, 2),
        ) for each in apart
    ]  # fmt: skip
    return Table(
        columns=("true cause", *(() if fitted else ("fitted cause",)), "standard errors", "probability"), rows=rows,
        caption=f"Error of the refitted model{fitted} in this run, in standard errors of one frequency bin of the worst channel, "
        "and the probability that this distinguishes the two: 0 up to "
        f"{PROPOSALS.indistinguishable:g}, 1 from {PROPOSALS.distinguishable:g} on.",
    )  # fmt: skip


def picture_of(pair: PredictedPair) -> Picture:
    """The displayed part of a prediction."""
    apart = np.abs(pair.of_truth - pair.of_rival)
    width = min(round(POLICY.shown_seconds * pair.sample_rate), len(apart))
    middle = int(np.argmax(np.convolve(apart**2, np.ones(max(width // 4, 1)), mode="same")))
    first = max(min(middle - width // 2, len(apart) - width), 0)
    part = slice(first, first + width)
    return Picture(
        truth=cause(pair.truth), rival=cause(pair.rival), channel=pair.channel, sample_rate=pair.sample_rate, first=first,
        of_truth=pair.of_truth[part].tolist(), of_rival=pair.of_rival[part].tolist(), allowed=pair.allowed,
        distance=min(pair.distance, POLICY.largest_distance), unit=SI_UNIT[pair.truth.model.quantities[pair.channel]],
    )  # fmt: skip


def prediction_chart(shown: Picture, name: str) -> Chart:
    """The predictions of two causes for a run, and their difference compared with the allowed error."""
    truth, rival, unit = np.array(shown.of_truth), np.array(shown.of_rival), displayed_unit(shown.unit)
    t = (shown.first + np.arange(len(truth))) / shown.sample_rate
    return Chart(
        name=name, x_label="time, s", x_log=False,
        caption=f"Signal of {with_article(shown.channel)} for {shown.truth}, and prediction by {shown.rival} after a "
        f"refit to all runs; below, their difference compared with the allowed error (noise and accuracy of the simulation): "
        f"{shown.distance:.2g} standard errors over the whole run.",
        panels=[Panel(label=f"{shown.channel}, {unit}"), Panel(label=f"difference, {unit}", height=0.6)],
        traces=[
            ChartTrace(name=shown.truth, x=t, y=truth, role="first"),
            ChartTrace(name=f"{shown.rival}, refitted", x=t, y=rival, role="second", style="dash"),
            ChartTrace(name="difference", x=t, y=truth - rival, role="third", panel=1),
            ChartTrace(name="allowed", x=t, y=np.zeros(len(t)), spread=np.full(len(t), shown.allowed), role="noise", panel=1),
        ],
    )  # fmt: skip


def _limits(proposal: Proposal, now: Situation) -> Section:
    limits, model = now.limits, now.rivals.explains.model
    rows = [
        (f"stroke of {with_article(name)}", sized(value, unit_of(f"links.{name}.laws.0.stroke", model)))
        for name, value in limits.stroke.items()
    ]
    rows += [(f"record of {name}", sized(value, SI_UNIT[model.quantities[name]])) for name, value in limits.channels.items()]
    units = {"drive": SI_UNIT[model.drive.quantity], "force": "N m" if model.drive.quantity == "torque" else "N"}
    for key, of in {**units, "seconds": "s", "lock_price": "s"}.items():
        value = getattr(limits, key)
        if value is not None:
            rows.append((words(key), sized(value, of, digits=4)))
    for key, of in (("gains", ""), ("band", " Hz")):
        pair = getattr(limits, key)
        if pair is not None:
            rows.append((key, f"{pair[0]:.4g} to {pair[1]:.4g}{of}"))
    refused = [] if proposal.chosen is None else [(now.run_words(run), why) for run, why in proposal.chosen.refused.items()]
    tables = [Table(columns=("limit", "value"), rows=rows)]
    if refused:
        tables.append(Table(columns=("candidate", "refused because"), rows=refused))
    return Section(
        title="Limits",
        text=["A stroke or drive without a given limit is limited to what the runs so far reached."],
        tables=tables,
    )


def investigation_page(investigation: Investigation) -> str:
    """The page of an investigation as HTML: the question that each run answered, and the present knowledge."""
    known = [stage for stage in investigation.stages if stage.answer]
    now = f"Stage {investigation.stages[-1].number} is in progress." if investigation.stages else "Nothing is measured yet."
    verdict = investigation.ended or now
    return build_report(
        Report(
            title="Investigation", verdict=verdict, summary=known[-1].answer if known else [],
            sections=[_stages(investigation), *(_section(stage) for stage in investigation.stages)],
        )
    )  # fmt: skip


def _stages(investigation: Investigation) -> Section:
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
