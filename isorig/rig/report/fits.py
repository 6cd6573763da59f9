"""The page of a joint fit: the parameters, and every run compared with the fitted model."""

from __future__ import annotations

from pathlib import Path

from isorig.analysis.campaign import Campaign
from isorig.analysis.parameters.joint_fit import Characterization
from isorig.analysis.spectra.quality import fault_sentences
from isorig.analysis.wording import of_signal
from isorig.rig.report.charts import Role
from isorig.rig.report.misfit import misfit_charts, simulated, time_charts
from isorig.rig.report.page import Report, Section, build_report
from isorig.rig.report.sections import entries_table, provenance_section

JOINT: tuple[str, Role] = ("joint fit", "simulated")


def fits_page(campaign: Campaign, found: Characterization) -> str:
    """The page as HTML."""
    models = {JOINT: simulated(found.fit.model, found.trials)}
    charts = [*time_charts(found.trials, models), *misfit_charts(found.trials, models)]
    report = Report(
        title=f"Parameters of {Path(campaign.source).name}",
        verdict=f"The held-out error of the joint fit is {of_signal(found.error)}, that of noise alone {found.noise_alone}.",
        summary=fault_sentences(found.faults),
        sections=[
            Section(title="Parameters", tables=[entries_table(found.table)]),
            Section(title="Joint fit over the runs", charts=charts),
            provenance_section(campaign),
        ],
    )
    return build_report(report)
