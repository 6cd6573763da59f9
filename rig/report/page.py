"""The page of every report: from typed sections to one HTML text that works offline, for example as a mail attachment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import msgspec

from isorig.rig.report.charts import Chart

HERE = Path(__file__).parent


@dataclass(frozen=True, kw_only=True)
class Link:
    """A cell that links to another page of the same report."""

    text: str
    page: str


@dataclass(frozen=True, kw_only=True)
class Sparkline:
    """A cell with a small line chart (`sparkline`): the points of its line, and of its markers."""

    points: str
    marks: Sequence[tuple[float, float]]
    description: str


Cell = str | Link | Sparkline


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of words, numbers, links and small charts with column names, and a caption."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading with sentences, tables and charts, in this order."""

    title: str
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    charts: Sequence[Chart] = ()


@dataclass(frozen=True, kw_only=True)
class Answer:
    """A question answered on the first screen: the answer in a few words, and explaining sentences."""

    question: str
    short: str
    text: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class First:
    """The part of a report that is visible without scrolling.

    Parameters
    ----------
    sketch
        The rig as SVG; always our own drawing, with escaped names.
    measured
        What was measured, and the table of channels.
    answers
        The questions of a decision maker.
    picture
        The main chart.
    """

    sketch: str
    measured: Section
    answers: Sequence[Answer]
    picture: Chart | None = None


@dataclass(frozen=True, kw_only=True)
class Page:
    """A page after the first one, in the same file: shown when a link to it is followed."""

    name: str
    title: str
    verdict: str
    sections: Sequence[Section]


@dataclass(frozen=True, kw_only=True)
class Report:
    """The first screen of a report, its sections, and its further pages."""

    title: str
    verdict: str
    summary: Sequence[str]
    sections: Sequence[Section]
    first: First | None = None
    pages: Sequence[Page] = ()


def build_report(report: Report) -> str:
    """The page as HTML. Text from files is escaped; nothing is loaded when it is opened."""
    first = [report.first.picture] if report.first is not None and report.first.picture is not None else []
    sections = [*report.sections, *(section for page in report.pages for section in page.sections)]
    charts = [*first, *(chart for section in sections for chart in section.charts)]
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE), autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.tests["link"] = lambda cell: isinstance(cell, Link)
    environment.tests["sparkline"] = lambda cell: isinstance(cell, Sparkline)
    return environment.get_template("page.html").render(
        report=report,
        data=_embedded([chart.to_tree() for chart in charts]),
        library=_text("vendor/plotly-basic.min.js") if charts else "",
        script=_text("page.js"),
        style=_text("page.css"),
    )


def _embedded(tree: Any) -> str:
    # Within a script element only "<" can end it.
    return msgspec.json.encode(tree).decode().replace("<", "\\u003c")


def _text(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")
