"""The page of a measurement: what was measured, the parameters, and how far the simulation seeded with them goes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from analysis.characterize import Characterization
from analysis.diagnose.doubles import doubles
from analysis.diagnose.misfit import discrepancies
from analysis.measured import Campaign
from analysis.rigs import THESIS
from rig.characterized import ParameterFile
from rig.report.advice import advice
from rig.report.charts import Role
from rig.report.frequency import frequency_sections
from rig.report.history import history_sections
from rig.report.misfit import misfit_charts, scores_chart, simulated, time_charts
from rig.report.page import Report, Section, Table, build_report
from rig.report.sections import number, provenance_section, runs_section, words

MODEL: tuple[str, Role] = ("simulation", "simulated")


def measurement_page(campaign: Campaign, found: Characterization, history: Sequence[ParameterFile] = ()) -> str:
    """The report of a campaign as HTML, its parameters beside those found earlier."""
    model = found.fit.model
    models = {MODEL: simulated(model, found.trials)}
    wrong = discrepancies(campaign, model, found.trials, doubles(model, found.trials))
    frf, *isolation = frequency_sections(campaign, model)
    sections = [
        runs_section(campaign),
        frf,
        Section(title="Parameters", text=[PARAMETERS], tables=[parameter_table(found)]),
        *history_sections(found, history),
        Section(title="Simulated over measured", charts=time_charts(found.trials, models)),
        *isolation,
        Section(
            title="What the simulation gets wrong",
            text=[d.text for d in wrong[:6]] or ["Nothing stands above the noise."],
            charts=[*misfit_charts(found.trials, models), scores_chart({MODEL: found.score}, found.trials)],
        ),
        Section(title="Advice for the next measurement", text=advice(campaign, found)),
        provenance_section(campaign),
    ]
    report = Report(
        title=f"Measurement {Path(campaign.source).name}", verdict=_verdict(found), summary=_summary(found), sections=sections
    )
    return build_report(report)


PARAMETERS = (
    "All runs fitted at once with friction in the model; frequencies are the uncoupled √(k/m)/2π, damping is the ratio to "
    "critical. The thesis's column is its Table 4 and its force gauge, of another rig of this kind."
)


def parameter_table(found: Characterization) -> Table:
    """The parameters beside the thesis's."""
    rows = [
        (words(name), number(e.value, 6), number(e.std, 2), e.unit, number(THESIS.get(name), 4), e.method, e.note)
        for name, e in found.table.items()
    ]
    return Table(columns=("parameter", "value", "std", "unit", "thesis", "method", "note"), rows=rows)


def _verdict(found: Characterization) -> str:
    if found.adequate:
        return "The simulation with friction explains what was measured, to the noise."
    return "The simulation with friction does not explain all that was measured."


def _summary(found: Characterization) -> list[str]:
    told = [
        f"On data that took no part in the fit the simulation errs by {100 * found.error:.2g} % of the signal "
        f"(median over runs and channels); the sensors' noise alone would make {100 * found.floor:.2g} %."
    ]
    for body in ("table", "heatblock", "motor"):
        frequency, damping = found.table[f"{body}_frequency"], found.table[f"{body}_damping"]
        if frequency.value is not None and damping.value is not None:
            resonance = f"{frequency.value:.4g} ± {frequency.std:.1g} Hz"
            told.append(f"{body.capitalize()}: {resonance}, damping {damping.value:.3g} ± {damping.std:.1g}.")
    friction = found.table["friction_force"]
    if friction.value is not None:
        told.append(f"Friction between motor and table: {friction.value:.3g} ± {friction.std:.1g} N.")
    told += [fault.text for fault in found.faults]
    return told
