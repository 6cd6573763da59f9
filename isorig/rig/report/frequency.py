"""Sections over frequency: transfer functions with coherence, and the isolation ratio, measured and simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.errors import DataError
from isorig.rig.acquire.run_check import incoherences
from isorig.rig.frf.transfer import Transfer, transfer_functions
from isorig.rig.report.charts import SERIES, Chart, ChartTrace, Panel, Role, Style, spread_over, unjoined
from isorig.rig.report.page import Report, Section, build_report
from isorig.rig.report.sections import per

if TYPE_CHECKING:
    from isorig.analysis.model.rig_model import RigModel
    from isorig.rig.wire_bonder.isolation import Compared

#: Styles of the lines of several recordings.
DASHES: tuple[Style, ...] = ("solid", "dash", "dot")


def frequency_sections(campaign: Campaign, model: RigModel) -> list[Section]:
    """Transfer functions and the isolation ratio, measured and simulated for the same runs; or the reason why there are none."""
    found, text = isolation_of(campaign, model)
    charts = [isolation_chart(found)] if found is not None else []
    ratio = [Section(title="Isolation ratio", text=text, charts=charts)] if text else []
    return [transfer_section(campaign, model), *ratio]


def transfer_section(campaign: Campaign, model: RigModel) -> Section:
    """Transfer functions, measured and simulated for the same runs; or the reason why there are none."""
    from isorig.rig.model.prediction import predicted

    try:
        drives = [drive.channel for drive in model.drives]
        return frf_section(campaign, predicted(model, campaign, as_recorded=True), drives, next(iter(model.configurations)))
    except DataError as error:
        return Section(title="Transfer functions", text=[f"Not available: {error}."])


def isolation_of(campaign: Campaign, model: RigModel) -> tuple[Compared | None, list[str]]:
    """The isolation ratio measured and simulated, with its sentences; or None and the reason, if the rig can be locked."""
    from isorig.analysis.parameters.joint_fit import is_wire_bonder
    from isorig.rig.model.prediction import Model
    from isorig.rig.wire_bonder.isolation import compared_isolation, isolation_sentences

    if "locked" not in model.configurations or not is_wire_bonder(model):
        return None, []
    try:
        found = compared_isolation(campaign, [Model(name="simulated", rig=model)])
    except DataError as error:
        return None, [f"None: {error}."]
    return found, isolation_sentences(found)


def frf_section(campaign: Campaign, simulated: Campaign, drives: Sequence[str], usual: str) -> Section:
    """Transfer functions from every drive to every response, a colour for each configuration and gain, simulated ones dotted.

    The curves of the configuration `usual` are solid, others dashed.
    """
    measured, other = transfer_functions(campaign, reference=drives), transfer_functions(simulated, reference=drives, found=())
    names = dict.fromkeys((item.frf.response, item.frf.reference) for item in measured)
    first = measured[0].frf
    references = " and ".join(dict.fromkeys(item.frf.reference for item in measured))
    text = [
        f"H1 from {references}, resolution {first.resolution:g} Hz, averaged over the runs of each configuration and gain, "
        "within the band of the drive. Bands show one standard deviation. A coherence below 1 indicates noise, friction or "
        "another nonlinearity.",
        *(reason.text for reason in incoherences(campaign, drives)),
    ]
    charts = [
        frf_chart(
            [(m.label, m) for m in measured if (m.response, m.reference) == name],
            [(m.label, m) for m in other if (m.response, m.reference) == name],
            styles={m.label: "dash" for m in measured if m.configuration != usual},
        )
        for name in names
    ]
    return Section(title="Transfer functions", text=text, charts=charts)


def frf_page(found: Sequence[tuple[str, Transfer]], name: str, remarks: Sequence[str]) -> str:
    """The page of `rig frf`: the transfer functions of one or more recordings by label, overlaid."""
    first = found[0][1]
    pairs = dict.fromkeys((item.response, item.reference) for _, item in found)
    # Recordings differ by the style of their lines, set-ups by colour.
    sources = list(dict.fromkeys(label.removesuffix(item.label) for label, item in found))
    styles = {label: DASHES[sources.index(label.removesuffix(item.label)) % len(DASHES)] for label, item in found}
    sections = []
    for response, reference in pairs:
        same = [(label, item) for label, item in found if (item.response, item.reference) == (response, reference)]
        sections.append(Section(title=f"{response} over {reference}", charts=[frf_chart(same, styles=styles)]))
    how = (
        f"{first.estimator}, resolution {first.resolution:.4g} Hz, within the band of the drive; bands show one standard "
        "deviation."
    )
    return build_report(Report(title="Transfer functions", verdict=name, summary=[how, *remarks], sections=sections))


def frf_chart(
    measured: Sequence[tuple[str, Transfer]], simulated: Sequence[tuple[str, Transfer]] = (), *, styles: Mapping[str, Style]
) -> Chart:
    """Magnitude, phase and coherence of transfer functions of one response and reference by label, a colour for each set-up.

    `styles` are those of lines that are not solid, by label: they are on top. Simulated curves are dotted, in the colour of the
    set-up that they simulate.
    """
    setups = list(dict.fromkeys(item.label for _, item in measured))
    colours: dict[str, Role] = {setup: SERIES[k % len(SERIES)] for k, setup in enumerate(setups)}
    traces = []
    for label, item in sorted(measured, key=lambda pair: styles.get(pair[0], "solid") != "solid"):
        frf, role = item.within_band(), colours[item.label]
        kept = spread_over(frf.frequency)
        f, size = frf.frequency[kept], np.abs(frf.value[kept])
        # Curves of other configurations are dashed and on top: they coincide if a contact sticks that a lock blocks.
        style = styles.get(label, "solid")
        turned = np.degrees(np.angle(frf.value[kept]))
        traces += [
            ChartTrace(name=label, x=f, y=size, spread=frf.magnitude_std[kept], role=role, style=style),
            ChartTrace(name=label, x=f, y=unjoined(turned), role=role, panel=1, style=style),
            ChartTrace(name=label, x=f, y=frf.coherence[kept], role=role, panel=2, style=style),
        ]
    for _, item in simulated:
        frf = item.within_band()
        kept = spread_over(frf.frequency)
        f, size = frf.frequency[kept], np.abs(frf.value[kept])
        traces.append(ChartTrace(name="simulated", x=f, y=size, role=colours.get(item.label, "simulated"), style="dot"))
    about = measured[0][1]
    ratio = per(*(name or "unknown unit" for name in about.units))
    return Chart(
        name=f"frf-{about.response}-over-{about.reference}", caption=f"{about.response} over {about.reference}.",
        panels=[
            Panel(label=f"|{about.response} / {about.reference}|\n{ratio}", log=True, height=2.0),
            Panel(label="phase, °", ends=(-185.0, 185.0), step=90.0),
            Panel(label="coherence", ends=(0.0, 1.02)),
        ],
        traces=traces, link="frequency", peaks=True,
    )  # fmt: skip


def isolation_chart(found: Compared) -> Chart:
    """The isolation ratio, measured and simulated, with the frequency bins at which the motor mostly sticks."""
    roles: Mapping[str, Role] = {"measured": "measured", "simulated": "simulated"}
    traces = []
    for name, ratio in found.ratios.items():
        kept = spread_over(ratio.frequency)
        traces.append(
            ChartTrace(
                name=name, x=ratio.frequency[kept], y=ratio.ratio[kept], spread=ratio.std[kept], role=roles[name],
                style="solid" if name == "measured" else "dash",
            )
        )  # fmt: skip
    ratio = found.measured
    stuck = np.isin(ratio.gain, [gain for gain, share in found.stuck.items() if share > 0.5])
    if stuck.any():
        ends = ratio.frequency[stuck][[0, -1]]
        traces.append(ChartTrace(name="motor mostly stuck", x=ends, y=np.ones(2), role="noise", style="dot"))
    return Chart(
        name="isolation-ratio",
        caption="Acceleration of the heatblock divided by acceleration of the head, unlocked divided by locked: 1 means no "
        "isolation, 0.1 that a tenth is transmitted.",
        panels=[Panel(label="ratio, unlocked / locked", log=True)], traces=traces, link="frequency",
    )  # fmt: skip
