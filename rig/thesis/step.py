"""What a step of the thesis amounts to: rows of figures beside the thesis's, words, pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from matplotlib.figure import Figure

HEAD = ("| what | thesis | here | agreement, or the reason for the difference |", "|---|---|---|---|")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One figure: what it is, what the thesis gives, what comes out here, and why they differ or agree."""

    what: str
    thesis: str
    here: str
    remark: str


@dataclass(frozen=True, kw_only=True)
class Step:
    """A step: its place in the thesis and name, rows, further words, pictures by name."""

    title: str
    rows: Sequence[Row]
    text: Sequence[str] = ()
    pictures: Mapping[str, Figure] = field(default_factory=dict)


def markdown(steps: Sequence[Step], preface: Sequence[str]) -> str:
    """The page."""
    lines = ["# The thesis reproduced", "", *[line for text in preface for line in (text, "")]]
    for step in steps:
        lines += [
            f"## {step.title}",
            "",
            "| what | thesis | here | agreement, or the reason for the difference |",
            "|---|---|---|---|",
        ]
        lines += [f"| {row.what} | {row.thesis} | {row.here} | {row.remark} |" for row in step.rows]
        lines += ["", *[line for text in step.text for line in (text, "")]]
        lines += [line for name in step.pictures for line in (f"![{step.title}](pictures/thesis-{name}.png)", "")]
    return "\n".join(lines).rstrip() + "\n"
