"""The page of every report: from typed sections to one HTML text that works offline, for example as a mail attachment."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import jinja2
import msgspec
import numpy as np
from markupsafe import Markup, escape

from isorig.analysis.campaign import FloatArray
from isorig.rig.report.charts import Chart, encoded

HERE = Path(__file__).parent
#: Size of a sparkline in pixels and its margin; number of latest values that it shows: more cannot be resolved at this width.
WIDTH, HEIGHT, EDGE, MOST = 64.0, 20.0, 2.0, 60
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
    """A cell with a small line chart of the latest of some values, shape (n,); those at the indices `marked` get a dot.

    `description` describes the content in words.
    """

    values: FloatArray
    description: str
    marked: Sequence[int] = ()

    @property
    def places(self) -> list[tuple[float, float]]:
        """Coordinates of its points in pixels."""
        y = self.values[-MOST:]
        n, span = len(y), float(np.ptp(y))
        across = np.linspace(EDGE, WIDTH - EDGE, n) if n > 1 else np.full(1, 0.5 * WIDTH)
        share = (y - y.min()) / span if span > 0.0 else np.full(n, 0.5)
        down = HEIGHT - EDGE - (HEIGHT - 2.0 * EDGE) * share
        return [(round(a, 1), round(b, 1)) for a, b in zip(across.tolist(), down.tolist(), strict=True)]

    @property
    def dots(self) -> list[tuple[float, float]]:
        """Coordinates of its dots in pixels."""
        places, hidden = self.places, max(len(self.values) - MOST, 0)
        return [places[k - hidden] for k in self.marked if k >= hidden]


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
    """The part of a report that is visible without scrolling: the rig as SVG, what was measured or follows, answers, main charts.

    The sketch is always our own drawing, with escaped names.
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
        # Within a script element only "<" can end it.
        data=msgspec.json.encode(charts, enc_hook=encoded).decode().replace("<", "\\u003c"),
        library=_text("vendor/plotly-basic.min.js") if charts else "",
        script=_text("page.js"),
        style=_text("page.css"),
    )


def _text(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")
