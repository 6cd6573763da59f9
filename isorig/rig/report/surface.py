"""Charts of the force in a link: over its deflection, and the remaining force over its velocity."""

from __future__ import annotations

from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose.estimate_pairs import Doubles
from isorig.analysis.diagnose.evidence import surfaces
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.wording import with_article
from isorig.rig.report.charts import Chart, ChartTrace, Panel


def surface_charts(model: RigModel, compared: Doubles) -> list[Chart]:
    """Two charts for every observable link: measured points and simulated ones."""
    charts = []
    for seen in surfaces(model, compared):
        spring = model.link(seen.link).stiffness * seen.displacement
        where = f"{seen.run}: the force in {with_article(seen.link)}"
        charts += [
            _chart(f"force-{seen.link}", f"{where}.", "deflection, mm", 1e3 * seen.displacement, seen.force, seen.simulated),
            _chart(
                f"friction-{seen.link}", f"{where}, without the baseline's spring.", "relative velocity, m/s", seen.velocity,
                seen.force - spring, seen.simulated - spring,
            ),
        ]  # fmt: skip
    return charts


def _chart(name: str, caption: str, label: str, x: FloatArray, measured: FloatArray, simulated: FloatArray) -> Chart:
    return Chart(
        name=name, caption=caption, panels=[Panel(label="force, N")], x_label=label, x_log=False,
        traces=[
            ChartTrace(name="baseline", x=x, y=simulated, role="simulated", style="markers"),
            ChartTrace(name="measured", x=x, y=measured, role="measured", style="markers"),
        ],
    )  # fmt: skip
