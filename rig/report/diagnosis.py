"""The page of a diagnosis, readable top to bottom by someone who was not there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from analysis.diagnose.diagnosis import Diagnosis
from analysis.diagnose.step import Step
from analysis.measured import Campaign
from rig.report.charts import Role
from rig.report.frequency import frequency_sections
from rig.report.misfit import misfit_charts, scores_chart, simulated, time_charts
from rig.report.page import Report, Section, Table, build_report
from rig.report.sections import number, parameters_table, provenance_section, runs_section, words
from rig.report.surface import surface_charts

VERDICTS = {
    "adequate": "Adequate: the baseline explains the data to the noise.",
    "explained": "Explained: the named cause accounts for what the baseline got wrong.",
    "partly explained": "Partly explained: a cause is certain, and a misfit beyond it remains.",
    "unexplained": "Unexplained: the baseline misfits, and no cause in the catalogue earns its name.",
}
EVIDENCE = (
    "Every figure is taken from the record and from the fitted baseline's simulation under the same drive; what estimation does "
    "to it cancels, and only the difference counts."
)
BASELINE: tuple[str, Role] = ("baseline", "simulated")
EXTENDED: tuple[str, Role] = ("extended model", "extended")


def diagnosis_page(diagnosis: Diagnosis, campaign: Campaign, content: dict[str, Any]) -> str:
    """The report of a diagnosis as HTML.

    Parameters
    ----------
    diagnosis
        What was found.
    campaign
        What was measured.
    content
        The same as in findings.json.
    """
    models = {BASELINE: simulated(diagnosis.baseline.model, diagnosis.trials)}
    scores = {BASELINE: diagnosis.scores[0]}
    if diagnosis.steps:
        models[EXTENDED] = simulated(diagnosis.extended.model, diagnosis.trials)
        scores[EXTENDED] = diagnosis.scores[1]
    wrong = [d.text for d in diagnosis.discrepancies[:6]] or ["Nothing stands above the noise."]
    frf, *isolation = frequency_sections(campaign, diagnosis.extended.model)
    sections = [
        runs_section(campaign),
        frf,
        Section(
            title="Parameters of the baseline",
            tables=[
                parameters_table(content["baseline"]["parameters"], "Fitted to all runs at once; std is one standard deviation.")
            ],
        ),
        Section(title="Simulated over measured", charts=time_charts(diagnosis.trials, models)),
        *isolation,
        Section(title="What the simulation gets wrong", text=wrong, charts=misfit_charts(diagnosis.trials, models)),
        Section(
            title="What the records say before a cause is fitted",
            text=[EVIDENCE, *(sign.text for sign in diagnosis.signs)],
            charts=surface_charts(diagnosis.baseline.model, diagnosis.beside),
        ),
        *(_named(step) for step in diagnosis.steps),
        Section(
            title="Gain on held-out data",
            text=[_gained(diagnosis), content["holdout"]["how"]],
            charts=[scores_chart(scores, diagnosis.division.judged)],
        ),
        Section(title="Advice for the next measurement", text=advice(diagnosis)),
        provenance_section(campaign),
    ]
    report = Report(
        title=f"Diagnosis of {Path(campaign.source).name}",
        verdict=VERDICTS[diagnosis.verdict],
        summary=_summary(diagnosis),
        sections=sections,
    )
    return build_report(report)


def _gained(diagnosis: Diagnosis) -> str:
    before, after = (f"{100 * low:.3g} to {100 * high:.3g} %" for low, high in (diagnosis.gain.before, diagnosis.gain.after))
    if not diagnosis.steps:
        return f"The baseline's error lies between {before} of the signal (95 % interval of resampled blocks)."
    low, high = diagnosis.gain.removed_interval
    return (
        f"The baseline's error lies between {before} of the signal, the extended model's between {after}: "
        f"{100 * diagnosis.gain.removed:.3g} % of what stood above the floor is gone ({100 * low:.3g} to {100 * high:.3g} %; "
        "95 % intervals of resampled blocks)."
    )


def _summary(diagnosis: Diagnosis) -> list[str]:
    errors = (diagnosis.baseline_error, diagnosis.extended_error, diagnosis.floor)
    before, after, floor = (f"{100 * error:.2g} %" for error in errors)
    gained = f", the extended model by {after}" if diagnosis.steps else ""
    told = [
        f"On data that took no part in any fit the baseline errs by {before} of the signal{gained}; "
        f"a perfect model would err by {floor}, the sensors' noise."
    ]
    for step in diagnosis.steps:
        values = ", ".join(f"{words(k)} {v:.4g} ± {d:.1g} {u}" for k, (v, d, u) in step.parameters.items())
        told.append(f"Named: {words(step.cause)} at {step.location}" + (f", {values}." if values else "."))
    return told


def _named(step: Step) -> Section:
    told = [*step.evidence, f"It beats every rival in {100 * step.confidence:.0f} % of resampled held-out blocks."]
    told += [f"The data cannot tell it apart from {words(cause)} at {place}." for cause, place in step.indistinguishable]
    values = [(words(name), number(v, 6), number(s, 2), u) for name, (v, s, u) in step.parameters.items()]
    tables = [Table(columns=("parameter", "value", "std", "unit"), rows=values)] if values else []
    rivals = [(words(r.cause), r.location, number(r.holdout_error, 3)) for r in step.rivals]
    if rivals:
        told.append(f"Its own held-out error is {step.after:.3g}; the rivals were fitted in full to the same data.")
        tables.append(Table(columns=("rival", "location", "held-out error"), rows=rivals, caption="Rivals, best first."))
    return Section(title=f"Named: {words(step.cause)} ({step.location})", text=told, tables=tables)


def advice(diagnosis: Diagnosis) -> list[str]:
    """What would settle what this campaign leaves open."""
    told = []
    for step in diagnosis.steps:
        for cause, place in step.indistinguishable:
            told.append(
                f"To tell {words(step.cause)} at {step.location} from {words(cause)} at {place}, measure again at another "
                "gain, or with one more accelerometer at that place."
            )
    worst = max(diagnosis.discrepancies, key=lambda d: d.size, default=None)
    if diagnosis.verdict in ("unexplained", "partly explained") and worst is not None:
        told.append(
            f"What remains is largest at the {worst.channel}, {worst.configuration} at gain {worst.gain:g}, between "
            f"{worst.band_hz[0]:g} and {worst.band_hz[1]:g} Hz: drive that band alone, at two gains, for longer."
        )
    if not any(trial.run.use == "holdout" for trial in diagnosis.trials):
        told.append('Record one run more and mark it use = "holdout": a model judged on a run of its own is judged harder.')
    return told
