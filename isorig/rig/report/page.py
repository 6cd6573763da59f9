"""The page of every report: from typed sections to one HTML text that works offline, for example as a mail attachment."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import msgspec
from markupsafe import Markup, escape

from isorig.rig.report.charts import Chart

HERE = Path(__file__).parent
#: Paths of parameters; dates, and values with their uncertainty.
_PATH = re.compile(r"[A-Za-z]\w*(?:\.\w+)+")
_WHOLE = re.compile(r"\d{4}-\d{2}-\d{2}|[-+]?\d[\w.+-]* ± \d[\w.+-]*(?: %)?")


@dataclass(frozen=True, kw_only=True)
class PageLink:
    """A cell that links to another page of the same report."""

    text: str
    page: str


@dataclass(frozen=True, kw_only=True)
class Sparkline:
    """A cell with a small line chart (`sparkline`): the points of its line, and of its markers."""

    points: str
    marks: Sequence[tuple[float, float]]
    description: str


Cell = str | PageLink | Sparkline


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of words, numbers, links and small charts with column names, and a caption."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""


@dataclass(frozen=True, kw_only=True)
class AnimatedShape:
    """A mode shape, which the page animates: complex amplitudes by place, the largest near 1, and a caption."""

    amplitudes: Mapping[str, complex]
    caption: str

    @property
    def points(self) -> list[tuple[str, float, complex]]:
        """Name, horizontal place in pixels, and amplitude of each point."""
        n = len(self.amplitudes)
        return [(name, 300.0 * (k + 0.5) / n, value) for k, (name, value) in enumerate(self.amplitudes.items())]


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading with sentences, tables, shapes and charts, in this order."""

    title: str
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    shapes: Sequence[AnimatedShape] = ()
    charts: Sequence[Chart] = ()


@dataclass(frozen=True, kw_only=True)
class AnsweredQuestion:
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
        The section beside the sketch: what was measured, or what follows from the verdict.
    answers
        The questions of a decision maker.
    pictures
        The main charts.
    """

    sketch: str
    measured: Section
    answers: Sequence[AnsweredQuestion] = ()
    pictures: Sequence[Chart] = ()


@dataclass(frozen=True, kw_only=True)
class Page:
    """A page after the first one, in the same file: shown when a link to it is followed."""

    name: str
    title: str
    verdict: str
    sections: Sequence[Section]


@dataclass(frozen=True, kw_only=True)
class Report:
    """The first screen of a report, its sections, and its further pages; with a first screen, sections fold behind headings."""

    title: str
    verdict: str
    summary: Sequence[str]
    sections: Sequence[Section]
    first: First | None = None
    pages: Sequence[Page] = ()


def wrapping(text: str) -> Markup:
    """A cell's text as HTML that wraps in narrow columns: within paths, but not within dates or values with their uncertainty."""
    if _PATH.fullmatch(text):
        return Markup(".<wbr>").join(text.split("."))
    return Markup(_WHOLE.sub(r'<span class="whole">\g<0></span>', str(escape(text))))


def build_report(report: Report) -> str:
    """The page as HTML. Text from files is escaped; nothing is loaded when it is opened."""
    first = [] if report.first is None else [*report.first.pictures]
    sections = [*report.sections, *(section for page in report.pages for section in page.sections)]
    charts = [*first, *(chart for section in sections for chart in section.charts)]
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE), autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters["wrapping"] = wrapping
    environment.tests["link"] = lambda cell: isinstance(cell, PageLink)
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
