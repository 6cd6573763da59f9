"""The page of a diagnosis: sections of words, tables and pictures, put into one template."""

from __future__ import annotations

import base64
import hashlib
import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
from matplotlib.figure import Figure

from analysis.diagnose.diagnosis import Diagnosis
from analysis.measured import Campaign
from rig.figures import misfit_figure, scores_figure

WORDS = {
    "adequate": "Adequate: the baseline explains the data to the noise.",
    "explained": "Explained: the named cause accounts for what the baseline got wrong.",
    "partly explained": "Partly explained: a cause is certain, and a misfit beyond it remains.",
    "unexplained": "Unexplained: the baseline misfits, and no cause in the catalogue earns its name.",
}


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure as it goes into the page."""

    caption: str
    png: str

    @classmethod
    def of(cls, figure: Figure, caption: str) -> Picture:
        """Draw a matplotlib figure."""
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=110)
        return cls(caption=caption, png=base64.b64encode(buffer.getvalue()).decode())


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading with sentences, a table and pictures."""

    title: str
    text: Sequence[str] = ()
    columns: Sequence[str] = ()
    rows: Sequence[Sequence[str]] = ()
    pictures: Sequence[Picture] = ()


def build_page(title: str, verdict: str, summary: Sequence[str], sections: Sequence[Section]) -> str:
    """The page as HTML; whatever comes from a file is escaped."""
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string((Path(__file__).parent / "page.html").read_text(encoding="utf-8"))
    return template.render(title=title, verdict=verdict, summary=summary, sections=sections)


def diagnosis_page(diagnosis: Diagnosis, campaign: Campaign, content: dict[str, Any]) -> str:
    """The report of a diagnosis, readable top to bottom by someone who was not there."""
    holdout = content["holdout"]
    summary = [
        f"On data that took no part in any fit the baseline errs by {100 * holdout['baseline']:.2g} % of the signal, the "
        f"extended model by {100 * holdout['extended']:.2g} %; a perfect model would err by {100 * holdout['noise_floor']:.2g} %."
    ]
    summary += [
        f"Named: {s.cause.replace('_', ' ')} at {s.location}, "
        + ", ".join(f"{k.replace('_', ' ')} {v:.4g} ± {d:.1g} {u}" for k, (v, d, u) in s.parameters.items())
        + "."
        for s in diagnosis.steps
    ]
    sections = [
        _runs(campaign),
        _misfit(diagnosis),
        _parameters("Baseline", content["baseline"]["parameters"]),
    ]
    sections += [_named(step) for step in diagnosis.steps]
    sections += [_gain(diagnosis), _provenance(campaign)]
    return build_page(f"Diagnosis of {Path(campaign.source).name}", WORDS[diagnosis.verdict], summary, sections)


def _runs(campaign: Campaign) -> Section:
    rows = [
        (
            run.id,
            run.configuration,
            f"{run.gain:g}",
            run.excitation,
            f"{run.duration:.0f}",
            str(run.started or ""),
        )
        for run in campaign.runs
    ]
    known = ", ".join(f"{k.replace('_', ' ')} {v:g}" for k, v in campaign.known.items())
    return Section(
        title="Rig and runs", text=[f"Known beforehand: {known or 'nothing'}."],
        columns=("run", "configuration", "gain", "excitation", "seconds", "started"), rows=rows,
    )  # fmt: skip


def _misfit(diagnosis: Diagnosis) -> Section:
    told = [d.text for d in diagnosis.discrepancies[:6]] or ["Nothing stands above the noise."]
    figure = misfit_figure(diagnosis.baseline.model, diagnosis.extended.model, diagnosis.trials)
    caption = "Measured, baseline and extended model: amplitude spectra of each channel, and the error of both."
    return Section(title="What the simulation gets wrong", text=told, pictures=[Picture.of(figure, caption)])


def _parameters(title: str, table: dict[str, Any]) -> Section:
    rows = [(path, f"{row['value']:.6g}", f"{row['std']:.2g}", row["unit"]) for path, row in table.items()]
    return Section(title=f"{title} parameters", columns=("parameter", "value", "std", "unit"), rows=rows)


def _named(step: Any) -> Section:
    rows = [(name, f"{v:.6g}", f"{s:.2g}", u) for name, (v, s, u) in step.parameters.items()]
    told = [
        *step.evidence,
        f"It beats every rival in {100 * step.confidence:.0f} % of resampled held-out blocks.",
    ]
    told += [f"Rival {r.cause} at {r.location}: held-out error {r.holdout_error:.3g}." for r in step.rivals]
    told += [f"The data cannot tell it apart from {cause} at {place}." for cause, place in step.indistinguishable]
    return Section(
        title=f"Named: {step.cause.replace('_', ' ')} ({step.location})", text=told,
        columns=("parameter", "value", "std", "unit"), rows=rows,
    )  # fmt: skip


def _gain(diagnosis: Diagnosis) -> Section:
    figure = scores_figure(diagnosis.scores, diagnosis.trials)
    caption = "Held-out error of each run and channel, before and after."
    return Section(title="Gain on held-out data", pictures=[Picture.of(figure, caption)])


def _provenance(campaign: Campaign) -> Section:
    path = Path(campaign.source)
    digest = hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else "not on disk"
    rows = [("file", path.name), ("sha256", digest), ("isorig", version("isorig"))]
    rows += [(name, version(name)) for name in ("numpy", "scipy", "numba", "h5py")]
    rows.append(("command", " ".join(["rig", *sys.argv[1:]])))
    return Section(title="Where the numbers came from", columns=("what", "value"), rows=rows)
