"""Sections over frequency: transfer functions with coherence, and the isolation ratio, measured and simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from isorig.analysis.campaign import Campaign
from isorig.analysis.errors import DataError, SimulationError
from isorig.analysis.isolation.ratio import MOSTLY_STUCK
from isorig.analysis.wording import unit_ratio
from isorig.rig.acquire.run_check import incoherences
from isorig.rig.frf.transfer import Transfer, transfer_functions
from isorig.rig.report.charts import PHASE_ENDS, SERIES, Chart, ChartTrace, Panel, Role, Style, spread_over, unjoined
from isorig.rig.report.page import Report, Section, build_report

if TYPE_CHECKING:
    from isorig.analysis.model.rig_model import RigModel
    from isorig.analysis.spectra.welch import Frf
    from isorig.rig.wire_bonder.isolation import ComparedRatios

#: Styles of the lines of several recordings.
DASHES: tuple[Style, ...] = ("solid", "dash", "dot")
#: Why a section shows the measured functions alone: a rig that no spring holds may drift to where no record reached.
UNBOUNDED = "The model's motion grows without bound in a free simulation over whole runs, so nothing simulated is shown here."


def frequency_sections(campaign: Campaign, model: RigModel) -> list[Section]:
    """Transfer functions and the isolation ratio, measured and simulated for the same runs; or the reason why there are none."""
    found, text = isolation_of(campaign, model)
    charts = [isolation_chart(found)] if found is not None else []
    ratio = [Section(title="Isolation ratio", text=text, charts=charts)] if text else []
    return [transfer_section(campaign, model), *ratio]


def transfer_section(campaign: Campaign, model: RigModel) -> Section:
    """Transfer functions from every drive to every response, and dotted those simulated for the same runs; or why there are none.

    A colour for each configuration and gain; the curves of the first configuration of the rig are solid, others dashed.
    """
    from isorig.rig.model.prediction import predicted

    drives = model.drive_channels
    other: Sequence[Transfer] = ()
    try:
        measured = transfer_functions(campaign, reference=drives)
        with suppress(SimulationError):
            other = transfer_functions(predicted(model, campaign, as_recorded=True), reference=drives, found=())
    except DataError as error:
        return Section(title="Transfer functions", text=[f"Not available: {error}."])
    references = " and ".join(dict.fromkeys(item.reference for item in measured))
    text = [
        f"H1 from {references}, resolution {measured[0].resolution:g} Hz, averaged over the runs of each configuration and gain, "
        "within the band of the drive. Bands show one standard deviation. A coherence below 1 indicates noise, friction or "
        "another nonlinearity.",
        *(reason.text for reason in incoherences(campaign, drives)),
        *((UNBOUNDED,) if not other else ()),
    ]
    usual = next(iter(model.configurations))
    charts = [
        frf_chart(
            [(m.label, m) for m in measured if (m.response, m.reference) == name],
            [m for m in other if (m.response, m.reference) == name],
            styles={m.label: "dash" for m in measured if m.configuration != usual},
        )
        for name in dict.fromkeys((item.response, item.reference) for item in measured)
    ]
    return Section(title="Transfer functions", text=text, charts=charts)


def isolation_of(campaign: Campaign, model: RigModel) -> tuple[ComparedRatios | None, list[str]]:
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
    except SimulationError:
        return None, [UNBOUNDED]
    return found, isolation_sentences(found)


def frf_page(found: Sequence[tuple[str, Transfer]], name: str, remarks: Sequence[str]) -> str:
    """The page of `rig frf`: the transfer functions of one or more recordings by label, overlaid."""
    first = found[0][1]
    # Recordings differ by the style of their lines, set-ups by colour.
    sources = list(dict.fromkeys(label.removesuffix(item.label) for label, item in found))
    styles = {label: DASHES[sources.index(label.removesuffix(item.label)) % len(DASHES)] for label, item in found}
    pairs: dict[str, list[tuple[str, Transfer]]] = {}
    for label, item in found:
        pairs.setdefault(f"{item.response} over {item.reference}", []).append((label, item))
    how = (
        f"{first.estimator}, resolution {first.resolution:.4g} Hz, within the band of the drive; bands show one standard "
        "deviation."
    )
    sections = [Section(title=pair, charts=[frf_chart(same, styles=styles)]) for pair, same in pairs.items()]
    return build_report(Report(title="Transfer functions", verdict=name, summary=[how, *remarks], sections=sections))


def frf_chart(
    measured: Sequence[tuple[str, Transfer]], simulated: Sequence[Transfer] = (), *, styles: Mapping[str, Style]
) -> Chart:
    """Magnitude, phase and coherence of transfer functions of one response and reference by label, a colour for each set-up.

    `styles` are those of lines that are not solid, by label: they are on top, because curves coincide if a contact sticks that a
    lock blocks. Simulated curves are dotted, in the colour of the set-up that they simulate.
    """
    setups = list(dict.fromkeys(item.label for _, item in measured))
    colours: dict[str, Role] = {setup: SERIES[k % len(SERIES)] for k, setup in enumerate(setups)}
    traces = []
    for label, item in sorted(measured, key=lambda pair: styles.get(pair[0], "solid") != "solid"):
        traces += frf_traces(item.within_band(), label, colours[item.label], styles.get(label, "solid"))
    for item in simulated:
        frf = item.within_band()
        frf, role = frf.bins(spread_over(frf.frequency)), colours.get(item.label, "simulated")
        traces.append(ChartTrace(name="simulated", x=frf.frequency, y=np.abs(frf.value), role=role, style="dot"))
    about = measured[0][1]
    return Chart(
        name=f"frf-{about.response}-over-{about.reference}", caption=f"{about.response} over {about.reference}.",
        panels=frf_panels(about), traces=traces, link="frequency", peaks=True,
    )  # fmt: skip


def frf_panels(about: Frf) -> list[Panel]:
    """Panels of magnitude, phase and coherence of transfer functions with the channels and units of one."""
    return [
        Panel(label=f"|{about.response} / {about.reference}|\n{unit_ratio(*about.units)}", log=True, height=2.0),
        Panel(label="phase, °", ends=PHASE_ENDS, step=90.0),
        Panel(label="coherence", ends=(0.0, 1.02)),
    ]


def frf_traces(frf: Frf, name: str, role: Role = "measured", style: Style = "solid") -> list[ChartTrace]:
    """Magnitude, phase and coherence of a transfer function for these panels."""
    seen = frf.bins(spread_over(frf.frequency))
    f, phase = seen.frequency, unjoined(np.degrees(np.angle(seen.value)))
    return [
        ChartTrace(name=name, x=f, y=np.abs(seen.value), spread=seen.magnitude_std, role=role, style=style),
        ChartTrace(name=name, x=f, y=phase, role=role, panel=1, style=style),
        ChartTrace(name=name, x=f, y=seen.coherence, role=role, panel=2, style=style),
    ]


def isolation_chart(found: ComparedRatios) -> Chart:
    """The isolation ratio, measured and simulated, with the frequency bins at which the motor mostly sticks."""
    shown: Mapping[str, tuple[Role, Style]] = {"measured": ("measured", "solid"), "simulated": ("simulated", "dash")}
    traces = []
    for name, ratio in found.ratios.items():
        kept, (role, style) = spread_over(ratio.frequency), shown[name]
        x, y, spread = (values[kept] for values in (ratio.frequency, ratio.ratio, ratio.std))
        traces.append(ChartTrace(name=name, x=x, y=y, spread=spread, role=role, style=style))
    ratio = found.measured
    stuck = np.isin(ratio.gain, [gain for gain, share in found.stuck.items() if share > MOSTLY_STUCK])
    if stuck.any():
        ends = ratio.frequency[stuck][[0, -1]]
        traces.append(ChartTrace(name="motor mostly stuck", x=ends, y=np.ones(2), role="noise", style="dot"))
    return Chart(
        name="isolation-ratio",
        caption="Acceleration of the heatblock divided by acceleration of the head, unlocked divided by locked: 1 means no "
        "isolation, 0.1 that a tenth is transmitted.",
        panels=[Panel(label="ratio, unlocked / locked", log=True)], traces=traces, link="frequency",
    )  # fmt: skip
