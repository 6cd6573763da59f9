"""The page of a diagnosis, for readers who were not present."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.budget import NATURES, Budget
from isorig.analysis.diagnose.diagnosis import Diagnosis
from isorig.analysis.diagnose.estimate_pairs import Doubles
from isorig.analysis.diagnose.evidence import surfaces
from isorig.analysis.diagnose.step import Curve, Step
from isorig.analysis.equations.system import Equations, equations_of
from isorig.analysis.fitting.score import Score
from isorig.analysis.model.rig_model import Link, RigModel
from isorig.analysis.wording import capitalized, in_per_cent, state, with_article, words
from isorig.rig.files.findings import Findings, HeldValue
from isorig.rig.report.charts import Chart, ChartTrace, Panel
from isorig.rig.report.conclusion import KINDS, Conclusion, conclude
from isorig.rig.report.frequency import frequency_sections
from isorig.rig.report.misfit import (
    BASELINE,
    EXTENDED,
    Named,
    Simulated,
    bars_chart,
    both_simulated,
    misfit_charts,
    residual_chart,
    scores_chart,
    second_chart,
    time_charts,
    worst_second,
)
from isorig.rig.report.page import First, Report, Section, Table, build_report
from isorig.rig.report.place import OVER, SHOWN, Over, equation_force, force_chart, joint_of, marks, place_force
from isorig.rig.report.sections import HOLD_OUT, parameters_table, provenance_section, runs_section, unbroken, with_unit
from isorig.rig.report.sketch import sketch

EVIDENCE = (
    "Every figure is computed in the same way from the record and from the simulation with the same drive, so that "
    "estimation errors cancel and only the difference counts."
)


def diagnosis_page(diagnosis: Diagnosis, campaign: Campaign, findings: Findings) -> str:
    """The report of a diagnosis as HTML."""
    models = both_simulated(diagnosis)
    scores = dict(zip(models, diagnosis.scores, strict=False))
    said = conclude(findings)
    wrong = [d.text for d in diagnosis.discrepancies[:6]] or ["No discrepancy exceeds the noise."]
    frf, *isolation = frequency_sections(campaign, diagnosis.extended.model)
    sections = [
        runs_section(campaign),
        frf,
        Section(
            title="Parameters of the baseline",
            tables=[parameters_table(findings.baseline.parameters)],
        ),
        Section(title="Simulation compared with measurement", charts=time_charts(diagnosis.trials, models)),
        *isolation,
        Section(title="What the simulation gets wrong", text=wrong, charts=misfit_charts(diagnosis.trials, models)),
        Section(
            title="Evidence from the records before a cause is fitted",
            text=[EVIDENCE, *(sign.text for sign in diagnosis.signs)],
            charts=_surface_charts(diagnosis.baseline.model, diagnosis.compared),
        ),
        *(
            _named(step, share, own.held)
            for step, share, own in zip(diagnosis.steps, diagnosis.shares, findings.steps, strict=True)
        ),
        _considered(diagnosis),
        _budget(diagnosis),
        Section(
            title="Improvement on held-out data",
            text=[_improvement(diagnosis), findings.holdout.how],
            charts=[scores_chart(scores, diagnosis.division.judged)],
        ),
        Section(title="Advice for the next measurement", text=advice(diagnosis)),
        provenance_section(campaign),
    ]
    report = Report(
        title=f"Diagnosis of {Path(campaign.source).name}",
        verdict=unbroken(f"{capitalized(said.answer)}."),
        summary=[said.check] if said.check else [],
        sections=sections,
        first=_first(diagnosis, campaign, said, findings.remarks, models, scores),
    )
    return build_report(report)


def _first(
    diagnosis: Diagnosis, campaign: Campaign, said: Conclusion, remarks: Sequence[str],
    models: Mapping[Named, Simulated], scores: Mapping[Named, Score],
) -> First:  # fmt: skip
    model = diagnosis.baseline.model
    of_extended = cache(partial(equations_of, campaign, diagnosis.extended.model))  # many pages do not need them
    force, errors = _force(diagnosis, models, of_extended), _errors_chart(diagnosis, scores)
    second = second_chart(worst_second(diagnosis.trials, diagnosis.division.judged, models))
    equations = residual_chart(diagnosis.residuals, of_extended().residuals() if diagnosis.steps else None)
    # Charts of half the page's width in pairs.
    pairs = force is not None and equations is not None
    pictures = [force, equations, second, errors] if pairs else [force or equations, errors, second]
    return First(
        sketch=sketch(_with_masses_of(diagnosis.extended.model, model), marks(model, diagnosis.steps)),
        measured=Section(title="What follows", text=[line for line in (said.ruled_out, said.next, *remarks) if line]),
        pictures=[chart for chart in pictures if chart is not None],
    )


def _with_masses_of(extended: RigModel, model: RigModel) -> RigModel:
    # A baseline that lacks a cause may have fitted another mass for it.
    masses = (f"bodies.{body.name}.mass" for body in model.bodies)
    return model.replace({path: extended.get(path) for path in masses})


def _force(diagnosis: Diagnosis, models: Mapping[Named, Simulated], equations: Callable[[], Equations]) -> Chart | None:
    # At the place of the first cause, or to which the equations point; otherwise in the link that the baseline gets most wrong.
    # Where other links hold the bodies beyond it, too, or their motion is not simulated, its equation of motion gives the force.
    baseline = diagnosis.baseline.model
    owners = {BASELINE: baseline, EXTENDED: diagnosis.extended.model}
    over: Over = "deflection"
    links: Sequence[Link] = baseline.links
    place = kind = ""
    if diagnosis.steps:
        step = diagnosis.steps[0]
        kind = step.kind
        link = joint_of(baseline, step)
        links = [link] if link is not None and step.kind in OVER else []
        place = step.location if step.kind in OVER else ""
        if step.curve is None or step.curve.over != "position":
            over = OVER.get(step.kind, over)
    elif diagnosis.pointed:
        kind, place = diagnosis.pointed
        links = [link for link in baseline.links if link.name == place]
        place = place if kind in OVER else ""
        over = OVER.get(kind, over)
    simulated_by = {name: (owners[name], responses) for name, responses in models.items()}
    found = [at for link in links if (at := place_force(link, diagnosis.trials, simulated_by)) is not None]
    if not found and place:
        found = [at for at in [equation_force(place, equations(), {name: owners[name] for name in models})] if at is not None]
    curves = SHOWN.get(kind, "mean") if over == "deflection" else "mean"
    return force_chart(max(found, key=lambda at: at.misfit), over, curves) if found else None


def _surface_charts(model: RigModel, compared: Doubles) -> list[Chart]:
    # Two for every observable link, measured points and simulated ones: the force, and that without the spring's.
    charts = []
    for seen in surfaces(model, compared):
        spring = model.link(seen.link).stiffness * seen.displacement
        for name, note, label, x, without in (
            ("force", "", "deflection, mm", 1e3 * seen.displacement, np.zeros(1)),
            ("friction", ", without the baseline's spring", "relative velocity, m/s", seen.velocity, spring),
        ):
            traces = [
                ChartTrace(name="baseline", x=x, y=seen.simulated - without, role="simulated", style="markers"),
                ChartTrace(name="measured", x=x, y=seen.force - without, role="measured", style="markers"),
            ]
            caption, panels = f"{seen.run}: the force in {with_article(seen.link)}{note}.", [Panel(label="force, N")]
            charts.append(
                Chart(name=f"{name}-{seen.link}", caption=caption, panels=panels, traces=traces, x_label=label, x_log=False)
            )
    return charts


def _errors_chart(diagnosis: Diagnosis, scores: Mapping[Named, Score]) -> Chart:
    channels = list(diagnosis.division.judged[0].channels)
    sets = {key: np.array([100.0 * each.figure, *(100.0 * np.median(each.error, axis=0))]) for key, each in scores.items()}
    sets["noise alone", "noise"] = np.array([100.0 * diagnosis.floor, *np.full(len(channels), np.nan)])
    return bars_chart(
        "errors", "Error on held-out data, rms of simulated minus measured divided by rms of measured: medians over the runs.",
        "error, % of the signal", ["all channels", *channels], sets,
    )  # fmt: skip


def _improvement(diagnosis: Diagnosis) -> str:
    before, after = (
        f"{100 * low:.3g} to {100 * high:.3g} %" for low, high in (diagnosis.improvement.before, diagnosis.improvement.after)
    )
    if not diagnosis.steps:
        return f"The error of the baseline is {before} of the signal (95 % interval from resampled blocks)."
    low, high = diagnosis.improvement.removed_interval
    return (
        f"The error of the baseline is {before} of the signal, that of the extended model {after}: "
        f"{100 * diagnosis.improvement.removed:.3g} % of the excess error above the noise floor is removed ({100 * low:.3g} to "
        f"{100 * high:.3g} %; 95 % intervals from resampled blocks)."
    )


def _named(step: Step, share: tuple[float, float, float], held: Mapping[str, HeldValue]) -> Section:
    removed, low, high = (100.0 * value for value in share)
    notes = [
        f"It removes {removed:.3g} % ({low:.3g} to {high:.3g} %) of the baseline's reproducible excess error.",
        *step.evidence,
        f"It is better than every rival in {100 * step.confidence:.0f} % of the resampled held-out data.",
    ]
    notes += [f"The data cannot distinguish it from {words(cause)} at {place}." for cause, place in step.indistinguishable]
    charts = []
    if step.curve is not None:
        notes.append(
            f"A free shape was fitted: the curve below, determined by the data over {step.curve.over}. No law of this kind at "
            "this place can fit better, and the extended model contains the curve."
        )
        charts.append(curve_chart(step.location, step.curve))
    if step.closest is not None:
        notes.append(
            f"The closest catalogued form is {words(step.closest[0])}; it removes {100 * step.closest[1]:.3g} % of the excess "
            f"error, the free shape {100 * share[0]:.3g} %, so it is not named."
        )
    values = [(words(name), with_unit(v, u, s)) for name, (v, s, u) in step.parameters.items()]
    values += [(words(name), f"{with_unit(row.value, row.unit)} (held)") for name, row in held.items()]
    tables = [Table(columns=("parameter", "value ± std"), rows=values)] if values else []
    # The form, or the kind if no form comes close to the free shape.
    what = words(step.cause) if step.form else f"{KINDS[step.kind]} of no catalogued form"
    return Section(title=f"Named: {what} ({step.location})", text=notes, tables=tables, charts=charts)


def curve_chart(place: str, curve: Curve) -> Chart:
    """A free shape with its standard uncertainties, at the points that the runs determine."""
    x, value, std = np.array(curve.points).T
    # A point whose uncertainty exceeds the whole curve's range is not determined, and its error bar would hide the others.
    known = std <= np.ptp(value)
    left_out = f" {np.count_nonzero(~known)} points that the runs do not determine are left out." if not known.all() else ""
    quantity = {"deflection": "force", "speed": "force", "position": "friction force", "time": "value"}.get(curve.over, "value")
    quantity = "damping" if curve.of_damping else quantity
    low, high = curve.reached
    return Chart(
        name=f"curve-{place}",
        caption=f"{place}: {quantity} over {curve.over}, with the standard uncertainty. The runs cover {low:.3g} to "
        f"{high:.3g} {curve.unit}; outside of this the curve is an extrapolation.{left_out}",
        panels=[Panel(label=f"{quantity}, {curve.value_unit}")],
        traces=[ChartTrace(name="free shape", x=x[known], y=value[known], spread=std[known], role="extended")],
        x_label=f"{curve.over}, {curve.unit}", x_log=False,
    )  # fmt: skip


def _considered(diagnosis: Diagnosis) -> Section:
    rows = [
        (
            words(item.cause), item.location, "" if item.holdout_error is None else in_per_cent(item.holdout_error),
            "" if item.share is None else f"{100 * max(item.share, 0.0):.3g} %", item.standing, item.why,
        )
        for item in diagnosis.considered
    ]  # fmt: skip
    columns = ("cause", "location", "held-out error", "share removed", "status", "reason")
    text = ["Every fitted cause, and those that are not identifiable from these runs."] if rows else ["No cause was needed."]
    return Section(title="All causes considered", text=text, tables=[Table(columns=columns, rows=rows)] if rows else [])


def _budget(diagnosis: Diagnosis) -> Section:
    def share(budget: Budget, nature: str) -> str:
        value, low, high = (100.0 * part for part in budget.shares[nature])
        if nature == "disturbance" and not budget.repeated:
            return "not measured"
        return f"{value:.3g} % ({low:.3g} to {high:.3g})"

    rows = [(nature, *(share(budget, nature) for budget in diagnosis.budgets)) for nature in NATURES]
    caption = "Shares of the held-out error power, with 95 % intervals over resampled runs."
    table = Table(columns=("nature", "baseline", "extended model"), rows=rows, caption=caption)
    return Section(title="Composition of the error", text=[diagnosis.budgets[0].how], tables=[table])


def advice(diagnosis: Diagnosis) -> list[str]:
    """Measurements that would answer what this campaign leaves open."""
    sentences = []
    for step in diagnosis.steps:
        for cause, place in step.indistinguishable:
            sentences.append(
                f"To distinguish {words(step.cause)} at {step.location} from {words(cause)} at {place}, measure again at another "
                "gain, or with an additional accelerometer at that place."
            )
    worst = max(diagnosis.discrepancies, key=lambda d: d.size, default=None)
    if diagnosis.verdict in ("unexplained", "partly explained") and worst is not None:
        sentences.append(
            f"The remaining error is largest at {with_article(worst.channel)}, "
            f"{state(worst.configuration, worst.gain, alone=len(diagnosis.baseline.model.configurations) == 1)}, between "
            f"{worst.band_hz[0]:g} and {worst.band_hz[1]:g} Hz: excite this band only, at two gains, for longer."
        )
    if not any(trial.run.use == "holdout" for trial in diagnosis.trials):
        sentences.append(HOLD_OUT)
    return sentences
