"""Results as HTML, which notebooks show instead of their text."""

from collections.abc import Sequence
from html import escape

from isorig.analysis.campaign import Campaign, Run
from isorig.analysis.isolation.ratio import IsolationRatio
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.parameters.joint_fit import Characterization
from isorig.analysis.simulate.free_run import Response
from isorig.analysis.spectra.modal_analysis import ModalModel
from isorig.analysis.spectra.welch import Frf
from isorig.analysis.views import shows
from isorig.analysis.wording import displayed_unit, of_signal, sized, words
from isorig.rig.report.sketch import picture


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A small table with a caption, as HTML; all texts are escaped."""
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<div><b>{escape(title)}</b><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"


@shows(Campaign, "html")
def of_campaign(campaign: Campaign) -> str:
    """The runs."""
    rows = [
        (run.id, run.set_up, run.excitation, f"{run.duration:g} s", f"{run.sample_rate:g} Hz", ", ".join(run.channels))
        for run in campaign.runs
    ]
    columns = ("run", "set-up", "excitation", "duration", "sample rate", "channels")
    return table(campaign.source or "campaign", columns, rows)


@shows(Run, "html")
def of_run(run: Run) -> str:
    """The channels."""
    rows = []
    for name, channel in run.channels.items():
        values = channel.read()
        size, unit = sized(float(values.std()), channel.unit), displayed_unit(channel.unit)
        rows.append((name, words(channel.quantity), unit, size, channel.about.get("sensor", "")))
    title = f"run {run.id}: {run.set_up}, {run.duration:g} s at {run.sample_rate:g} Hz"
    return table(title, ("channel", "quantity", "unit", "rms", "sensor"), rows)


@shows(Response, "html")
def of_response(response: Response) -> str:
    """The channels."""
    rows = [(name, sized(float(v.std()), response.units.get(name, ""))) for name, v in response.channels.items()]
    return table(repr(response), ("channel", "rms"), rows)


@shows(Frf, "html")
@shows(IsolationRatio, "html")
def in_words(found: Frf | IsolationRatio) -> str:
    """What it is."""
    return f"<p>{escape(repr(found))}</p>"


@shows(Characterization, "html")
def of_parameters(found: Characterization) -> str:
    """The table, each value in a unit of its size."""
    rows = [
        (name, "–" if e.value is None else sized(e.value, e.unit, e.std), e.method, e.note) for name, e in found.table.items()
    ]
    title = f"held-out error {of_signal(found.error)}, noise alone {found.noise_alone}"
    return table(title, ("parameter", "value", "method", "note"), rows)


@shows(ModalModel, "html")
def of_modes(found: ModalModel) -> str:
    """The modes with their shapes."""
    rows = [
        (
            sized(mode.frequency, "Hz", mode.frequency_std), sized(mode.damping, "1", mode.damping_std),
            ", ".join(f"{name} {part:+.2f}" for name, part in zip(found.responses, mode.shape.real, strict=True)),
        )
        for mode in found.modes
    ]  # fmt: skip
    return table("modes", ("frequency", "damping ratio", "shape"), rows)


shows(RigModel, "html")(picture)
