"""The page of a measurement: what was measured, the parameters, and the accuracy of the fitted simulation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.estimate_pairs import doubles
from isorig.analysis.diagnose.misfit import discrepancies
from isorig.analysis.fitting.uncertainty import CALIBRATION
from isorig.analysis.parameters.joint_fit import WEIGHED, Characterization, Entry
from isorig.analysis.spectra.quality import fault_sentences
from isorig.rig.files.parameter_table import ParameterFile
from isorig.rig.report.advice import advice
from isorig.rig.report.charts import Role
from isorig.rig.report.first import first_screen
from isorig.rig.report.frequency import isolation_of, transfer_section
from isorig.rig.report.history import history_sections
from isorig.rig.report.misfit import misfit_charts, scores_chart, simulated, time_charts
from isorig.rig.report.page import Report, Section, Table, build_report
from isorig.rig.report.sections import entries_table, number, provenance_section, runs_section, words
from isorig.rig.wire_bonder.description import THESIS

MODEL: tuple[str, Role] = ("simulation", "simulated")


def measurement_page(campaign: Campaign, found: Characterization, history: Sequence[ParameterFile] = ()) -> str:
    """The report of a campaign as HTML, with the parameters of earlier campaigns."""
    model = found.fit.model
    models = {MODEL: simulated(model, found.trials)}
    wrong = discrepancies(campaign, model, found.trials, doubles(model, found.trials))
    compared, ratio = isolation_of(campaign, model)
    asked = advice(campaign, found)
    sections = [
        runs_section(campaign),
        transfer_section(campaign, model),
        Section(
            title="Parameters",
            text=[ANY_RIG if found.head_mass is None else PARAMETERS, _calibration(found), *contradictions(campaign, found)],
            tables=[entries_table(found.table) if found.head_mass is None else parameter_table(campaign, found)],
        ),
        *history_sections(found, history),
        Section(title="Simulation compared with measurement", charts=time_charts(found.trials, models)),
        *([Section(title="Isolation ratio", text=ratio)] if ratio else []),
        Section(
            title="What the simulation gets wrong",
            text=[d.text for d in wrong[:6]] or ["No discrepancy exceeds the noise."],
            charts=[*misfit_charts(found.trials, models), scores_chart({MODEL: found.score}, found.trials)],
        ),
        *([Section(title="Further advice for the next measurement", text=asked[1:])] if asked[1:] else []),
        provenance_section(campaign),
    ]
    report = Report(
        title=f"Measurement {Path(campaign.source).name}", verdict=_verdict(found),
        summary=[*(doubt.text for doubt in found.doubts), *fault_sentences(found.faults)], sections=sections,
        first=first_screen(campaign, found, compared, wrong, asked, models),
    )  # fmt: skip
    return build_report(report)


PARAMETERS = (
    "All runs fitted at once with friction in the model; frequencies are the uncoupled √(k/m)/2π, damping is the damping ratio. "
    "The thesis's column is its Table 4 and its force gauge, for another rig of this kind."
)
ANY_RIG = (
    "All runs fitted at once with the friction of the description in the model; given values were not fitted. The modes are "
    "those of the fitted springs and dampers, without friction."
)
#: Relative difference between given and fitted value that is reported.
CONTRADICTS = 0.05


def _calibration(found: Characterization) -> str:
    if found.calibrated:
        return "Uncertainties include those of the sensors' calibration and of the weighed masses, as given in the recording."
    return (
        f"The recording gives no uncertainty of its sensors' calibration ({CALIBRATION} in the plan's rig table), so the "
        "uncertainties include the noise only: an error of a sensitivity changes masses and friction by about the same share."
    )


def contradictions(campaign: Campaign, found: Characterization) -> list[str]:
    """A sentence for every given value that differs from the fitted one."""
    said = []
    for name, entry in found.table.items():
        known = campaign.known.get(name)
        if known is None or entry.value is None or entry.fixed or abs(entry.value - known) <= CONTRADICTS * abs(known):
            continue
        why = (
            "only part of the mass takes part in the mode, so the effective mass is smaller than the weighed one"
            if name == "table_mass" and entry.value < known
            else "the given value was a starting value only, and the runs contradict it"
        )
        said.append(
            f"The {words(name)} was given as {known:.4g} {entry.unit} and the fit gives {entry.value:.4g} {entry.unit}: {why}."
        )
    return said


def parameter_table(campaign: Campaign, found: Characterization) -> Table:
    """The parameters compared with the given values and those of the thesis."""
    notes = Counter(entry.note for entry in found.table.values() if entry.note and entry.value is not None)
    # Notes that apply to several values are printed once, below the table's name.
    common = next((note for note, count in notes.most_common(1) if count > 1 and note != WEIGHED), "")
    rows = [
        (
            words(name), number(e.value, _digits(e)), number(e.uncertainty, 2), e.unit, number(campaign.known.get(name), 4),
            number(THESIS.get(name), 4), e.method,
            "*" if common and e.note == common else e.note,
        )
        for name, e in (({"head_mass": found.head_mass} if found.head_mass else {}) | found.table).items()
    ]  # fmt: skip
    spread = "std" if found.calibrated else "std (noise alone)"
    return Table(
        columns=("parameter", "value", spread, "unit", "known", "thesis", "method", "note"),
        rows=rows,
        caption=f"* {common[0].upper()}{common[1:]}." if common else "",
    )


def _digits(entry: Entry) -> int:
    # Two digits of the uncertainty are significant.
    if not entry.value or not entry.std:
        return 6
    return int(np.clip(np.floor(np.log10(abs(entry.value))) - np.floor(np.log10(entry.std)) + 2, 2, 6))


def _verdict(found: Characterization) -> str:
    if found.adequate:
        return "The simulation explains the measurement down to the noise."
    return "The simulation does not explain the whole measurement."
