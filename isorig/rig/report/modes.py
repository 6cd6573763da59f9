"""The page of `rig modes`: the modes, their shapes in motion, the stabilization diagram, and measured against fitted curves."""

from collections.abc import Mapping, Sequence

import numpy as np

from isorig.analysis.spectra.modal_analysis import ModalModel, ModeShape
from isorig.analysis.spectra.operating import OperatingModes
from isorig.analysis.wording import capitalized, sized, unit_ratio
from isorig.rig.report.charts import SERIES, Chart, ChartTrace, Panel, Role
from isorig.rig.report.page import AnimatedShape, Report, Section, Table, build_report

#: Poles by what the order before them agrees with: their name in the legend, and their role.
POLES: Mapping[str, tuple[str, Role]] = {
    "stable": ("stable in frequency and damping", "first"), "frequency": ("stable in frequency", "second"),
    "new": ("new", "noise"),
}  # fmt: skip


def modes_page(found: ModalModel, name: str, units: Sequence[str], remarks: Sequence[str]) -> str:
    """The page as HTML; `units` are those of response and reference."""
    about = ["Collinearity is 1 if all points move in phase or antiphase. Shapes swing as measured, without bodies in between."]
    size = np.sqrt(np.mean(np.abs(found.measured) ** 2, axis=(0, 1)))
    over = ChartTrace(name="rms of all transfer functions", x=found.frequency, y=size)
    stabilization = [_stabilization(over, f"rms magnitude\n{unit_ratio(*units)}", found)] if found.poles else []
    column = "bins in its bandwidth", [f"{mode.bins:.1f}" for mode in found.modes]
    return _page(f"Modes of {name}", remarks, found, about, column, [*stabilization, *_curves(found, units)])


def operating_page(found: OperatingModes, name: str, unit: str, remarks: Sequence[str]) -> str:
    """The page of a machine in operation as HTML; `unit` is that of the responses."""
    about = [
        "The excitation is not measured: it is assumed to be broad-band noise. Shapes have no scale.",
        "The variation of the envelope is 1 for a mode that noise excites, and 0 for a harmonic of a rotating part.",
    ]
    label = f"density\n({unit})²/Hz"
    traces = [
        ChartTrace(name=name, x=found.frequency, y=power, role=SERIES[k % len(SERIES)])
        for k, (name, power) in enumerate(zip(found.responses, found.power, strict=True))
    ]
    over = ChartTrace(name="mean density", x=found.frequency, y=np.mean(found.power, axis=0))
    densities = _magnitudes("densities", "Power spectral densities of the responses.", label, traces)
    column = "variation of the envelope", [f"{mode.variation:.2f}" for mode in found.modes]
    return _page(f"Operating modes of {name}", remarks, found, about, column, [_stabilization(over, label, found), densities])


def _page(
    title: str, remarks: Sequence[str], found: ModalModel | OperatingModes, about: Sequence[str],
    column: tuple[str, Sequence[str]], charts: Sequence[Chart],
) -> str:  # fmt: skip
    # The last column of the table, its name and values, depends on how the modes were found.
    modes: Sequence[ModeShape] = found.modes
    rows = [
        (
            str(k + 1), sized(mode.frequency, "Hz", mode.frequency_std), sized(mode.damping, "1", mode.damping_std),
            f"{mode.collinearity:.3f}", value,
        )
        for k, (mode, value) in enumerate(zip(modes, column[1], strict=True))
    ]  # fmt: skip
    shapes = [
        AnimatedShape(
            amplitudes=dict(zip(found.responses, mode.shape.tolist(), strict=True)),
            caption=f"Mode {k + 1}: {sized(mode.frequency, 'Hz', digits=4)}, damping {sized(mode.damping, '1')}",
        )
        for k, mode in enumerate(modes)
    ]
    table = Table(columns=("mode", "natural frequency", "damping ratio", "collinearity", column[0]), rows=rows)
    sections = [
        Section(
            title="Modes", text=[*about, *(f"{capitalized(said)}." for said in found.warnings)], tables=[table], shapes=shapes
        ),
        Section(title="Poles and curves", charts=charts),
    ]
    number = f"{len(modes)} modes" if len(modes) > 1 else "One mode"
    verdict = f"{number} from {found.frequency[0]:.4g} to {found.frequency[-1]:.4g} Hz"
    return build_report(Report(title=title, verdict=verdict, summary=remarks, sections=sections))


def _stabilization(over: ChartTrace, label: str, found: ModalModel | OperatingModes) -> Chart:
    # Poles by order below a curve over frequency, with the identified modes as lines.
    traces = [over]
    for status, (name, role) in POLES.items():
        poles = [(pole.frequency, pole.order) for pole in found.poles if pole.status == status]
        if poles:
            frequency, order = (np.array(column, dtype=float) for column in zip(*poles, strict=True))
            traces.append(ChartTrace(name=name, x=frequency, y=order, role=role, style="markers", panel=1))
    traces += [
        ChartTrace(
            name="identified modes", x=np.full(2, mode.frequency), y=np.array([0.0, max(pole.order for pole in found.poles)]),
            role="extended", panel=1, style="dot",
        )
        for mode in found.modes
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
        caption = f"Transfer functions from {reference}, measured and fitted."
        charts.append(_magnitudes(f"modes-over-{reference}", caption, f"magnitude\n{unit_ratio(*units)}", traces))
    return charts


def _magnitudes(name: str, caption: str, label: str, traces: Sequence[ChartTrace]) -> Chart:
    return Chart(
        name=name, caption=caption, panels=[Panel(label=label, log=True)], traces=traces, x_log=False, link="modes", peaks=True,
        x_ends=(float(traces[0].x[0]), float(traces[0].x[-1])),
    )  # fmt: skip
