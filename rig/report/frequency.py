"""Sections over frequency: transfer functions with coherence, and the isolation ratio, measured and simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from analysis.errors import DataError
from analysis.measured import Campaign
from analysis.model import RigModel
from rig.compared import Compared, compared_isolation, told
from rig.prediction import predicted
from rig.report.charts import SERIES, Chart, Panel, Role, Trace, spread_over
from rig.report.page import Section
from rig.transfer import Transfer, transfer_functions


def frequency_sections(campaign: Campaign, model: RigModel) -> list[Section]:
    """Transfer functions and the isolation ratio, measured and as a model simulates the same runs; or why there are none."""
    sections = []
    try:
        sections.append(frf_section(campaign, predicted(model, campaign, as_recorded=True), model.drive.channel))
    except DataError as error:
        sections.append(Section(title="Transfer functions", text=[f"None: {error}."]))
    if "locked" not in model.configurations:
        return sections
    try:
        return [*sections, isolation_section(compared_isolation(campaign, model))]
    except DataError as error:
        return [*sections, Section(title="Isolation ratio", text=[f"None: {error}."])]


def frf_section(campaign: Campaign, simulated: Campaign, reference: str) -> Section:
    """Transfer functions of every response, each configuration and gain in its colour, simulated ones dotted."""
    measured, other = (transfer_functions(each, reference=reference) for each in (campaign, simulated))
    names = dict.fromkeys(item.frf.response for item in measured)
    first = measured[0].frf
    text = [
        f"H1 from {first.reference} at {first.resolution:g} Hz, averaged over the runs of each configuration and gain, where the "
        "drive has power. Bands show one standard deviation. A coherence below 1 means noise, friction or another nonlinearity."
    ]
    charts = [
        _frf_chart([m for m in measured if m.frf.response == name], [m for m in other if m.frf.response == name])
        for name in names
    ]
    return Section(title="Transfer functions", text=text, charts=charts)


def _frf_chart(measured: Sequence[Transfer], simulated: Sequence[Transfer]) -> Chart:
    colours: dict[str, Role] = {item.label: SERIES[k % len(SERIES)] for k, item in enumerate(measured)}
    traces = []
    for item in measured:
        frf, role = item.within_band(), colours[item.label]
        kept = spread_over(frf.frequency)
        f, size = frf.frequency[kept], np.abs(frf.value[kept])
        traces.append(Trace(name=item.label, x=f, y=size, spread=frf.magnitude_std[kept], role=role))
        traces.append(Trace(name=item.label, x=f, y=frf.coherence[kept], role=role, panel=1))
    for item in simulated:
        frf = item.within_band()
        kept = spread_over(frf.frequency)
        f, size = frf.frequency[kept], np.abs(frf.value[kept])
        traces.append(Trace(name="simulated", x=f, y=size, role=colours.get(item.label, "simulated"), style="dot"))
    about = measured[0].frf
    return Chart(
        name=f"frf-{about.response}", caption=f"{about.response} over {about.reference}.",
        panels=[
            Panel(label=f"|{about.response} / {about.reference}|", log=True, height=2.0),
            Panel(label="coherence", ends=(0.0, 1.0)),
        ],
        traces=traces, link="frequency",
    )  # fmt: skip


def isolation_section(found: Compared) -> Section:
    """The isolation ratio with its sentences."""
    roles: Mapping[str, Role] = {"measured": "measured", "simulated": "simulated"}
    traces = []
    for name, ratio in found.ratios.items():
        kept = spread_over(ratio.frequency)
        traces.append(
            Trace(name=name, x=ratio.frequency[kept], y=ratio.ratio[kept], spread=ratio.std[kept], role=roles[name])
        )  # fmt: skip
    ratio = found.measured
    stuck = np.isin(ratio.gain, [gain for gain, share in found.stuck.items() if share > 0.5])
    if stuck.any():
        ends = ratio.frequency[stuck][[0, -1]]
        traces.append(Trace(name="motor mostly stuck", x=ends, y=np.ones(2), role="noise", style="dash"))
    chart = Chart(
        name="isolation-ratio", caption="Acceleration of the heatblock per acceleration of the head, unlocked over locked.",
        panels=[Panel(label="unlocked / locked", log=True)], traces=traces, link="frequency",
    )  # fmt: skip
    return Section(title="Isolation ratio", text=told(found), charts=[chart])
