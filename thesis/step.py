"""A section of the page: rows of figures compared with the thesis's, text, plots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure

from thesis.published_values import Stated, Verdict

HEADS = ("what", "thesis (tolerance)", "here", "verdict")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One figure: its name, the thesis's value, the value here, and the verdict or a remark."""

    what: str
    thesis: str
    here: str
    remark: str


@dataclass(frozen=True, kw_only=True)
class Step:
    """A step: its place in the thesis and name, rows, further words, pictures by name.

    `tables` are further tables: heads and rows of cells.
    """

    title: str
    rows: Sequence[Row] = ()
    text: Sequence[str] = ()
    pictures: Mapping[str, Figure] = field(default_factory=dict)
    tables: Sequence[tuple[Sequence[str], Sequence[Sequence[str]]]] = ()


def judged(what: str, stated: Stated, value: float, *, here: str = "", why: Mapping[Verdict, str] | None = None) -> Row:
    """A row with a computed verdict; `here` replaces the default format of the value, `why` explains a verdict."""
    reason = (why or {}).get(stated.verdict(value), "")
    text = stated.in_words(value)
    return Row(what=what, thesis=stated.shown, here=here or f"{value:.4g}", remark=f"{text}; {reason}" if reason else text)


def plain(what: str, here: str, *, thesis: str = "not given", remark: str = "") -> Row:
    """A row without a value of the thesis to compare with."""
    return Row(what=what, thesis=thesis, here=here, remark=remark)


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A table in Markdown."""
    return [_line(heads), _line(["---"] * len(heads)), *(_line(row) for row in rows)]


def _line(cells: Sequence[str]) -> str:
    # A bar inside a cell (a magnitude) would end it.
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def markdown(steps: Sequence[Step], preface: Sequence[str]) -> str:
    """The page."""
    lines = ["# The thesis reproduced", "", *[line for text in preface for line in (text, "")]]
    for step in steps:
        lines += [f"## {step.title}", ""]
        if step.rows:
            lines += [*table(HEADS, [(row.what, row.thesis, row.here, row.remark) for row in step.rows]), ""]
        for heads, rows in step.tables:
            lines += [*table(heads, rows), ""]
        lines += [line for text in step.text for line in (text, "")]
        lines += [line for name in step.pictures for line in (f"![{step.title}](pictures/thesis-{name}.png)", "")]
    return "\n".join(lines).rstrip() + "\n"
