"""The one page of every report: typed sections in, one HTML text out that works offline from a mail attachment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import msgspec

from rig.report.charts import Chart

HERE = Path(__file__).parent


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of words and numbers under their heads, and what they show."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading with sentences, tables and charts, in this order."""

    title: str
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    charts: Sequence[Chart] = ()


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a report says first, and its sections."""

    title: str
    verdict: str
    summary: Sequence[str]
    sections: Sequence[Section]


def build_report(report: Report) -> str:
    """The page as HTML. Whatever comes from a file is escaped; nothing is fetched when it is opened."""
    charts = [chart for section in report.sections for chart in section.charts]
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE), autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined
    )
    return environment.get_template("page.html").render(
        report=report,
        data=_embedded([chart.to_tree() for chart in charts]),
        library=_text("vendor/plotly-basic.min.js") if charts else "",
        script=_text("page.js"),
        style=_text("page.css"),
    )


def _embedded(tree: Any) -> str:
    # Inside a script element only "<" can end it.
    return msgspec.json.encode(tree).decode().replace("<", "\\u003c")


def _text(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")
