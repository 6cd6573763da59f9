"""The page of `rig modes`: the modes, their shapes in motion, the stabilization diagram, and measured against fitted curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.analysis.spectra.modal import ModalModel, ModeShape
from isorig.analysis.spectra.operating import OperatingModes
from isorig.analysis.spectra.poles import Pole
from isorig.analysis.wording import sized
from isorig.rig.report.charts import SERIES, Chart, ChartTrace, Panel, Role
from isorig.rig.report.page import AnimatedShape, Report, Section, Table, build_report
from isorig.rig.report.sections import per

#: Poles by what the order before them agrees with: their name in the legend, and their role.
POLES: Mapping[str, tuple[str, Role]] = {
    "stable": ("stable in frequency and damping", "first"), "frequency": ("stable in frequency", "second"),
    "new": ("new", "noise"),
}  # fmt: skip


def modes_page(found: ModalModel, name: str, units: Sequence[str], remarks: Sequence[str]) -> str:
    """The page as HTML; `units` are those of response and reference."""
    text = [
        "Collinearity is 1 if all points move in phase or antiphase. Shapes swing as measured, without bodies in between.",
        *found.warnings,
    ]
    size = np.sqrt(np.mean(np.abs(found.measured) ** 2, axis=(0, 1)))
    over = ChartTrace(name="rms of all transfer functions", x=found.frequency, y=size)
    lines = [mode.frequency for mode in found.modes]
    stabilization = [_stabilization(over, f"rms magnitude\n{per(*units)}", found.poles, lines)] if found.poles else []
    charts = [*stabilization, *_curves(found, units)]
    sections = [
        _listed(found, text, "bins in its bandwidth", [f"{mode.lines:.1f}" for mode in found.modes]),
        Section(title="Poles and curves", charts=charts),
    ]
    verdict = _counted(len(found.modes), found.frequency)
    return build_report(Report(title=f"Modes of {name}", verdict=verdict, summary=remarks, sections=sections))


def operating_page(found: OperatingModes, name: str, unit: str, remarks: Sequence[str]) -> str:
    """The page of a machine in operation as HTML; `unit` is that of the responses."""
    text = [
        "The excitation is not measured: it is assumed to be broad-band noise. Shapes have no scale.",
        "The variation of the envelope is 1 for a mode that noise excites, and 0 for a harmonic of a rotating part.",
        *found.warnings,
    ]
    traces = [
        ChartTrace(name=name, x=found.frequency, y=power, role=SERIES[k % len(SERIES)])
        for k, (name, power) in enumerate(zip(found.responses, found.power, strict=True))
    ]
    densities = Chart(
        name="densities", caption="Power spectral densities of the responses.",
        panels=[Panel(label=f"density\n({unit})²/Hz", log=True)], traces=traces, x_log=False, link="modes", peaks=True,
        x_ends=(float(found.frequency[0]), float(found.frequency[-1])),
    )  # fmt: skip
    over = ChartTrace(name="mean density", x=found.frequency, y=np.mean(found.power, axis=0))
    lines = [mode.frequency for mode in found.modes]
    sections = [
        _listed(found, text, "variation of the envelope", [f"{mode.variation:.2f}" for mode in found.modes]),
        Section(title="Poles and curves", charts=[_stabilization(over, f"density\n({unit})²/Hz", found.poles, lines), densities]),
    ]
    verdict = _counted(len(found.modes), found.frequency)
    return build_report(Report(title=f"Operating modes of {name}", verdict=verdict, summary=remarks, sections=sections))


def _listed(found: ModalModel | OperatingModes, text: Sequence[str], what: str, values: Sequence[str]) -> Section:
    # The table of the modes, whose last column has a name and values of its own, and their shapes.
    modes: Sequence[ModeShape] = found.modes
    rows = [
        (
            str(k + 1), sized(mode.frequency, "Hz", mode.frequency_std), sized(mode.damping, "1", mode.damping_std),
            f"{mode.collinearity:.3f}", value,
        )
        for k, (mode, value) in enumerate(zip(modes, values, strict=True))
    ]  # fmt: skip
    shapes = [
        AnimatedShape(
            amplitudes=dict(zip(found.responses, mode.shape.tolist(), strict=True)),
            caption=f"Mode {k + 1}: {sized(mode.frequency, 'Hz', digits=4)}, damping {sized(mode.damping, '1')}",
        )
        for k, mode in enumerate(modes)
    ]
    columns = ("mode", "natural frequency", "damping ratio", "collinearity", what)
    return Section(title="Modes", text=text, tables=[Table(columns=columns, rows=rows)], shapes=shapes)


def _counted(modes: int, frequency: FloatArray) -> str:
    number = f"{modes} modes" if modes > 1 else "One mode"
    return f"{number} from {frequency[0]:.4g} to {frequency[-1]:.4g} Hz"


def _stabilization(over: ChartTrace, label: str, found: Sequence[Pole], lines: Sequence[float]) -> Chart:
    # Poles by order below a curve over frequency, with the identified modes as lines.
    traces = [over]
    for status, (name, role) in POLES.items():
        poles = [(pole.frequency, pole.order) for pole in found if pole.status == status]
        if poles:
            frequency, order = (np.array(column, dtype=float) for column in zip(*poles, strict=True))
            traces.append(ChartTrace(name=name, x=frequency, y=order, role=role, style="markers", panel=1))
    traces += [
        ChartTrace(
            name="identified modes", x=np.full(2, line), y=np.array([0.0, max(pole.order for pole in found)]),
            role="extended", panel=1, style="dot",
        )
        for line in lines
    ]  # fmt: skip
    return Chart(
        name="stabilization",
        caption="Stabilization diagram: poles of models of growing order. A mode's pole stays where it is.",
        panels=[Panel(label=label, log=True), Panel(label="order", height=1.4)],
        traces=traces, x_log=False, x_ends=(float(over.x[0]), float(over.x[-1])), link="modes",
    )  # fmt: skip


def _curves(found: ModalModel, units: Sequence[str]) -> list[Chart]:
    charts = []
    for j, reference in enumerate(found.references):
        traces = []
        for i, response in enumerate(found.responses):
            role = SERIES[i % len(SERIES)]
            traces += [
                ChartTrace(name=response, x=found.frequency, y=np.abs(found.measured[i, j]), role=role),
                ChartTrace(name=f"{response}, fitted", x=found.frequency, y=np.abs(found.fitted[i, j]), role=role, style="dash"),
            ]
        charts.append(
            Chart(
                name=f"modes-over-{reference}", caption=f"Transfer functions from {reference}, measured and fitted.",
                panels=[Panel(label=f"magnitude\n{per(*units)}", log=True)], traces=traces, x_log=False, link="modes", peaks=True,
                x_ends=(float(found.frequency[0]), float(found.frequency[-1])),
            )
        )  # fmt: skip
    return charts
