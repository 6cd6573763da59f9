"""The pages of a joint fit: that of a measurement, with its parameters and their history, and that of the fits alone."""

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from math import hypot
from pathlib import Path

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.estimate_pairs import doubles
from isorig.analysis.diagnose.misfit import discrepancies
from isorig.analysis.fitting.uncertainty import CALIBRATION
from isorig.analysis.parameters.joint_fit import WEIGHED, Characterization
from isorig.analysis.spectra.quality import fault_sentences
from isorig.analysis.wording import capitalized, of_signal, with_std, words
from isorig.rig.files.parameter_table import ParameterFile
from isorig.rig.report.first import advice, first_screen
from isorig.rig.report.frequency import isolation_of, transfer_section
from isorig.rig.report.misfit import Named, Simulated, misfit_charts, scores_chart, simulated, time_charts
from isorig.rig.report.page import Report, Section, Table, build_report
from isorig.rig.report.sections import entries_table, number, provenance_section, runs_section, with_unit
from isorig.rig.wire_bonder.description import THESIS

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
#: Change in standard deviations that counts as significant.
CHANGED = 3.0


def measurement_page(campaign: Campaign, found: Characterization, history: Sequence[ParameterFile] = ()) -> str:
    """The report of a campaign as HTML, with the parameters of earlier campaigns."""
    model = found.fit.model
    models: dict[Named, Simulated] = {("simulation", "simulated"): simulated(model, found.trials)}
    wrong = discrepancies(campaign, model, found.trials, doubles(model, found.trials))
    compared, ratio = isolation_of(campaign, model)
    asked = advice(campaign, found)
    sections = [
        runs_section(campaign),
        transfer_section(campaign, model),
        Section(
            title="Parameters",
            text=[ANY_RIG if found.head_mass is None else PARAMETERS, _calibration(found), *_contradictions(campaign, found)],
            tables=[entries_table(found.table) if found.head_mass is None else _parameter_table(campaign, found)],
        ),
        *([_history(found, history)] if history else []),
        Section(title="Simulation compared with measurement", charts=time_charts(found.trials, models)),
        *([Section(title="Isolation ratio", text=ratio)] if ratio else []),
        Section(
            title="What the simulation gets wrong",
            text=[d.text for d in wrong[:6]] or ["No discrepancy exceeds the noise."],
            charts=[*misfit_charts(found.trials, models), scores_chart({("simulation", "simulated"): found.score}, found.trials)],
        ),
        *([Section(title="Further advice for the next measurement", text=asked[1:])] if asked[1:] else []),
        provenance_section(campaign),
    ]
    report = Report(
        title=f"Measurement {Path(campaign.source).name}",
        verdict="The simulation explains the measurement down to the noise."
        if found.adequate
        else "The simulation does not explain the whole measurement.",
        summary=[*(doubt.text for doubt in found.doubts), *fault_sentences(found.faults)], sections=sections,
        first=first_screen(campaign, found, compared, wrong, asked, models),
    )  # fmt: skip
    return build_report(report)


def _calibration(found: Characterization) -> str:
    if found.calibrated:
        return "Uncertainties include those of the sensors' calibration and of the weighed masses, as given in the recording."
    return (
        f"The recording gives no uncertainty of its sensors' calibration ({CALIBRATION} in the plan's rig table), so the "
        "uncertainties include the noise only: an error of a sensitivity changes masses and friction by about the same share."
    )


def _contradictions(campaign: Campaign, found: Characterization) -> list[str]:
    # A sentence for every given value that differs from the fitted one.
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


def _parameter_table(campaign: Campaign, found: Characterization) -> Table:
    # The parameters compared with the given values and those of the thesis.
    notes = Counter(entry.note for entry in found.table.values() if entry.note and entry.value is not None)
    # Notes that apply to several values are printed once, below the table's name.
    common = next((note for note, count in notes.most_common(1) if count > 1 and note != WEIGHED), "")
    rows = [
        (
            words(name), with_unit(e.value, e.unit, e.uncertainty), with_unit(campaign.known.get(name), e.unit),
            with_unit(THESIS.get(name), e.unit), e.method,
            "*" if common and e.note == common else e.note,
        )
        for name, e in (({"head_mass": found.head_mass} if found.head_mass else {}) | found.table).items()
    ]  # fmt: skip
    value = "value ± std" if found.calibrated else "value ± std (noise alone)"
    return Table(
        columns=("parameter", value, "known", "thesis", "method", "note"),
        rows=rows,
        caption=f"* {capitalized(common)}." if common else "",
    )


def _history(found: Characterization, history: Sequence[ParameterFile]) -> Section:
    # A column for each earlier campaign, oldest first, and the significant changes since the last one.
    past = sorted(history, key=lambda item: item.measured or datetime.min.replace(tzinfo=UTC))
    last = past[-1]
    rows, sentences = [], []
    for name, entry in found.table.items():
        change = _change(entry.value, entry.std, last.values.get(name))
        if change is not None and abs(change) > CHANGED:
            sentences.append(f"{words(name).capitalize()} has changed by {change:+.1f} standard deviations since {_label(last)}.")
        earlier = (_shown(item.values.get(name)) for item in past)
        now = _shown(None if entry.value is None else (entry.value, entry.std or 0.0))
        rows.append((words(name), entry.unit, *earlier, now, "–" if change is None else f"{change:+.1f}"))
    table = Table(
        columns=("parameter", "unit", *(_label(item) for item in past), "now", "change, deviations"), rows=rows,
        caption="Value ± standard uncertainty, none where a value was given; the change is since the latest earlier campaign.",
    )  # fmt: skip
    quiet = f"No parameter has changed by more than {CHANGED:g} standard deviations since {_label(last)}."
    return Section(title="Parameters compared with earlier campaigns", text=sentences or [quiet], tables=[table])


def _label(item: ParameterFile) -> str:
    return item.campaign if item.measured is None else f"{item.campaign}, {item.measured:%Y-%m-%d}"


def _shown(pair: tuple[float, float] | None) -> str:
    if pair is None:
        return "–"
    return number(pair[0], 6) if pair[1] == 0.0 else with_std(*pair)


def _change(value: float | None, std: float | None, before: tuple[float, float] | None) -> float | None:
    spread = hypot(std or 0.0, before[1]) if before is not None else 0.0
    return None if value is None or before is None or spread == 0.0 else (value - before[0]) / spread


def fits_page(
    campaign: Campaign, found: Characterization, parameters: Section | None = None, further: Sequence[Section] = (),
    remarks: Sequence[str] = (),
) -> str:  # fmt: skip
    """The page of a joint fit as HTML: the parameters, by default the table alone, further sections, and every run compared with
    the fitted model; the remarks follow the faults of the records."""
    models: dict[Named, Simulated] = {("joint fit", "simulated"): simulated(found.fit.model, found.trials)}
    charts = [*time_charts(found.trials, models), *misfit_charts(found.trials, models)]
    report = Report(
        title=f"Parameters of {Path(campaign.source).name}",
        verdict=f"The held-out error of the joint fit is {of_signal(found.error)}, that of noise alone {found.noise_alone}.",
        summary=[*fault_sentences(found.faults), *remarks],
        sections=[
            parameters or Section(title="Parameters", tables=[entries_table(found.table)]),
            *further,
            Section(title="Joint fit over the runs", charts=charts),
            provenance_section(campaign),
        ],
    )
    return build_report(report)
