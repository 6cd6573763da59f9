"""The page of a measurement: what was measured, the parameters, and how far the simulation seeded with them goes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.estimate_pairs import doubles
from isorig.analysis.diagnose.misfit import discrepancies
from isorig.analysis.model.built_in import THESIS
from isorig.analysis.parameters.joint_fit import CALIBRATION, WEIGHED, Characterization, Entry
from isorig.rig.files.parameter_table import ParameterFile
from isorig.rig.isolation_comparison import told
from isorig.rig.report.advice import advice
from isorig.rig.report.charts import Role
from isorig.rig.report.first import first_screen
from isorig.rig.report.frequency import isolation_of, transfer_section
from isorig.rig.report.history import history_sections
from isorig.rig.report.misfit import misfit_charts, scores_chart, simulated, time_charts
from isorig.rig.report.page import Report, Section, Table, build_report
from isorig.rig.report.sections import number, provenance_section, runs_section, words

MODEL: tuple[str, Role] = ("simulation", "simulated")


def measurement_page(campaign: Campaign, found: Characterization, history: Sequence[ParameterFile] = ()) -> str:
    """The report of a campaign as HTML, its parameters beside those found earlier."""
    model = found.fit.model
    models = {MODEL: simulated(model, found.trials)}
    wrong = discrepancies(campaign, model, found.trials, doubles(model, found.trials))
    compared, why = isolation_of(campaign, model)
    asked = advice(campaign, found)
    ratio = [Section(title="Isolation ratio", text=told(compared) if compared is not None else [why])]
    sections = [
        runs_section(campaign),
        transfer_section(campaign, model),
        Section(
            title="Parameters", text=[PARAMETERS, _calibration(found), *contradictions(campaign, found)],
            tables=[parameter_table(campaign, found)],
        ),
        *history_sections(found, history),
        Section(title="Simulated over measured", charts=time_charts(found.trials, models)),
        *(ratio if compared is not None or why else []),
        Section(
            title="What the simulation gets wrong",
            text=[d.text for d in wrong[:6]] or ["Nothing stands above the noise."],
            charts=[*misfit_charts(found.trials, models), scores_chart({MODEL: found.score}, found.trials)],
        ),
        *([Section(title="Further advice for the next measurement", text=asked[1:])] if asked[1:] else []),
        provenance_section(campaign),
    ]  # fmt: skip
    report = Report(
        title=f"Measurement {Path(campaign.source).name}", verdict=_verdict(found),
        summary=[*(doubt.text for doubt in found.doubts), *(fault.text for fault in found.faults)], sections=sections,
        first=first_screen(campaign, found, compared, wrong, asked),
    )  # fmt: skip
    return build_report(report)


PARAMETERS = (
    "All runs fitted at once with friction in the model; frequencies are the uncoupled √(k/m)/2π, damping is the ratio to "
    "critical. The thesis's column is its Table 4 and its force gauge, of another rig of this kind."
)
#: Known beforehand and found may differ by this share before a word is said.
CONTRADICTS = 0.05


def _calibration(found: Characterization) -> str:
    if found.calibrated:
        return "Deviations include what the recording tells of its sensors' calibration and its weighed masses."
    return (
        f"The recording does not tell how well its sensors are calibrated ({CALIBRATION} in the plan's rig table), so the "
        "deviations are "
        "those of the noise alone: a sensitivity that is 1 % off moves masses and friction by about as much."
    )


def contradictions(campaign: Campaign, found: Characterization) -> list[str]:
    """A sentence for every value that was known beforehand and is found to be another."""
    said = []
    for name, entry in found.table.items():
        known = campaign.known.get(name)
        if (
            known is None
            or entry.value is None
            or entry.method == "given"
            or abs(entry.value - known) <= CONTRADICTS * abs(known)
        ):
            continue
        why = (
            "the mode moves only part of what stands there, so its effective mass is less than what was weighed"
            if name == "table_mass" and entry.value < known
            else "what was known served as a first guess, and the runs say otherwise"
        )
        said.append(
            f"The {words(name)} was known as {known:.4g} {entry.unit} and is found to be {entry.value:.4g} {entry.unit}: {why}."
        )
    return said


def parameter_table(campaign: Campaign, found: Characterization) -> Table:
    """The parameters beside what was known beforehand and the thesis's."""
    notes = Counter(entry.note for entry in found.table.values() if entry.note and entry.value is not None)
    # What is said of several values is said once, below the table's name.
    common = next((note for note, count in notes.most_common(1) if count > 1 and note != WEIGHED), "")
    rows = [
        (
            words(name), number(e.value, _digits(e)), number(e.std, 2), e.unit, number(campaign.known.get(name), 4),
            number(THESIS.get(name), 4), e.method,
            "*" if common and e.note == common else e.note,
        )
        for name, e in {"head_mass": found.head_mass, **found.table}.items()
    ]  # fmt: skip
    spread = "std" if found.calibrated else "std (noise alone)"
    return Table(
        columns=("parameter", "value", spread, "unit", "known", "thesis", "method", "note"),
        rows=rows,
        caption=f"* {common[0].upper()}{common[1:]}." if common else "",
    )


def _digits(entry: Entry) -> int:
    # Two digits of the deviation are all that a value has to say.
    if not entry.value or not entry.std:
        return 6
    return int(np.clip(np.floor(np.log10(abs(entry.value))) - np.floor(np.log10(entry.std)) + 2, 2, 6))


def _verdict(found: Characterization) -> str:
    if found.adequate:
        return "The simulation with friction explains what was measured, to the noise."
    return "The simulation with friction does not explain all that was measured."
