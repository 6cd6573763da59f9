"""Charts as data: what the page's script draws. A chart is a stack of panels over one axis."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from isorig.analysis.campaign import FloatArray

#: What a trace stands for; the page gives each its colour, dark and light.
Role = Literal["measured", "simulated", "extended", "noise", "first", "second", "third", "fourth", "fifth", "sixth"]
Style = Literal["solid", "dash", "dot", "markers", "points", "bars"]
SERIES: tuple[Role, ...] = ("first", "second", "third", "fourth", "fifth", "sixth")
#: Most points of a trace: more than this no screen shows.
MOST_POINTS = 1500


@dataclass(frozen=True, kw_only=True)
class Trace:
    """One line or one set of bars.

    Parameters
    ----------
    name
        What the legend says; traces of one name share an entry.
    x, y
        Values, shape (n,); `x` may be names for bars. NaN breaks the line.
    spread
        Half width of the error band, or of the bars where single points are drawn, shape (n,).
    role
        What it stands for.
    panel
        Which panel it is drawn in, from the top.
    style
        How it is drawn; "points" are markers with error bars.
    """

    name: str
    x: FloatArray | Sequence[str]
    y: FloatArray
    spread: FloatArray | None = None
    role: Role = "measured"
    panel: int = 0
    style: Style = "solid"


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A vertical axis.

    Parameters
    ----------
    label
        Its label, of one or more lines.
    log
        Whether it is logarithmic.
    ends
        Its ends, where they are fixed.
    height
        Its share of the chart's height.
    step
        Distance of its ticks, where it is fixed.
    """

    label: str
    log: bool = False
    ends: tuple[float, float] | None = None
    height: float = 1.0
    step: float | None = None


@dataclass(frozen=True, kw_only=True)
class Mark:
    """A stretch of the common axis that is shaded in one panel."""

    begin: float
    end: float
    panel: int = 0


@dataclass(frozen=True, kw_only=True)
class Chart:
    """A figure of the page.

    Parameters
    ----------
    name
        Name of the file when it is downloaded.
    caption
        What is to be seen, in a sentence.
    panels, traces
        What is drawn.
    x_label, x_log, x_ends
        The common axis.
    x_date
        Whether the axis shows dates; x is in days since 1970.
    link
        Charts of one link zoom together.
    marks
        What is shaded.
    """

    name: str
    caption: str
    panels: Sequence[Panel]
    traces: Sequence[Trace]
    x_label: str = "frequency, Hz"
    x_log: bool = True
    x_ends: tuple[float, float] | None = None
    x_date: bool = False
    link: str | None = None
    marks: Sequence[Mark] = ()

    @property
    def bars(self) -> int:
        """How many bars stand below one another; 0 where there are none. Every one gets its label."""
        shown = [trace for trace in self.traces if trace.style == "bars"]
        return len(shown[0].x) * max(1, len(shown)) if shown else 0

    def to_tree(self) -> dict[str, Any]:
        """The chart as plain values for the page's script, arrays as float32 in base64."""
        return {
            "name": self.name,
            "panels": [
                {"label": p.label, "log": p.log, "ends": _ends(p.ends, p.log), "height": p.height, "step": p.step}
                for p in self.panels
            ],
            "traces": [_trace(trace) for trace in self.traces],
            "x": {"label": self.x_label, "log": self.x_log, "ends": _ends(self.x_ends, self.x_log), "date": self.x_date},
            "link": self.link,
            "marks": [{"begin": m.begin, "end": m.end, "panel": m.panel} for m in self.marks],
        }


def spread_over(frequency: FloatArray, most: int = MOST_POINTS) -> slice | np.ndarray:
    """Indices that keep at most `most` of ascending positive frequencies, evenly on a logarithmic axis."""
    n = len(frequency)
    if n <= most:
        return slice(None)
    wanted = np.geomspace(max(float(frequency[0]), 1e-9), float(frequency[-1]), most)
    return np.unique(np.clip(np.searchsorted(frequency, wanted), 0, n - 1))


def _trace(trace: Trace) -> dict[str, Any]:
    named = isinstance(trace.x, Sequence)
    return {
        "name": trace.name,
        "x": list(trace.x) if isinstance(trace.x, Sequence) else packed(trace.x),
        "y": packed(trace.y),
        "spread": None if trace.spread is None else packed(trace.spread),
        "role": trace.role,
        "panel": trace.panel,
        "style": trace.style,
        "named": named,
    }


def packed(values: FloatArray) -> dict[str, str]:
    """float32 in base64, as plotly reads typed arrays."""
    return {"dtype": "f4", "bdata": base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()}


def _ends(ends: tuple[float, float] | None, log: bool) -> list[float] | None:
    if ends is None:
        return None
    return [float(v) for v in (np.log10(ends) if log else ends)]
