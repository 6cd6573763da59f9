"""Charts as data, drawn by the page's script. A chart consists of panels, one above another, with a common x axis."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from isorig.analysis.campaign import FloatArray

#: What a trace represents; the page assigns each role a colour, dark and light.
Role = Literal["measured", "simulated", "extended", "noise", "first", "second", "third", "fourth", "fifth", "sixth"]
Style = Literal["solid", "dash", "dot", "markers", "dots", "points", "bars"]
SERIES: tuple[Role, ...] = ("first", "second", "third", "fourth", "fifth", "sixth")
#: Maximum number of points in a trace: more cannot be displayed.
MOST_POINTS = 1500
#: Degrees by which a phase may exceed ±180: close to 180, noise alone makes it wrap again and again.
BEYOND = 10.0
#: What a panel of phases shows, degrees.
PHASE_ENDS = (-180.0 - BEYOND, 180.0 + BEYOND)


@dataclass(frozen=True, kw_only=True)
class ChartTrace:
    """One line or one set of bars."""

    name: str  #: Name in the legend; traces with the same name share an entry.
    #: Values, shape (n,); `x` may be names for bars. NaN interrupts the line.
    x: FloatArray | Sequence[str]
    y: FloatArray
    spread: FloatArray | None = None  #: Half width of the error band, or of the error bars of single points, shape (n,).
    role: Role = "measured"  #: What it represents.
    panel: int = 0  #: Index of its panel, from the top.
    style: Style = "solid"  #: Its style; "points" are markers with error bars, "dots" many faint samples.


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A vertical axis with a label of one or more lines; limits (`ends`) and the distance of ticks (`step`) if they are fixed.

    `height` is its share of the height of the chart.
    """

    label: str
    log: bool = False
    ends: tuple[float, float] | None = None
    height: float = 1.0
    step: float | None = None


@dataclass(frozen=True, kw_only=True)
class Mark:
    """A shaded interval of the x axis in one panel."""

    begin: float
    end: float
    panel: int = 0


@dataclass(frozen=True, kw_only=True)
class Chart:
    """A figure of the page."""

    name: str  #: Name of the downloaded file.
    caption: str  #: Description of the content, in a sentence.
    #: The content.
    panels: Sequence[Panel]
    traces: Sequence[ChartTrace]
    #: The common x axis.
    x_label: str = "frequency, Hz"
    x_log: bool = True
    x_ends: tuple[float, float] | None = None
    x_date: bool = False  #: Whether the axis shows dates; x is in days since 1970.
    link: str | None = None  #: Charts with the same link zoom together.
    marks: Sequence[Mark] = ()  #: Shaded intervals.
    peaks: bool = False  #: Whether to state the largest value of every curve of the first panel, within the shown interval.

    @property
    def bars(self) -> int:
        """Number of bars from top to bottom; 0 if there are none. Every one gets its label."""
        shown = [trace for trace in self.traces if trace.style == "bars"]
        return len(shown[0].x) * max(1, len(shown)) if shown else 0


def unjoined(degrees: FloatArray) -> FloatArray:
    """A phase in degrees for drawing, shape (n,): a part up to `BEYOND` over ±180 continues its line; other wraps are NaN."""
    shown = degrees.copy()
    starts = np.flatnonzero(np.abs(np.diff(degrees)) > 180.0) + 1
    turned = 0.0
    for first, last in pairwise([*starts, len(degrees)]):
        turned -= 360.0 * np.sign(degrees[first] - degrees[first - 1])
        continued = degrees[first:last] + turned
        if np.abs(continued).max() <= 180.0 + BEYOND:
            shown[first:last] = continued
        else:
            shown[first - 1] = np.nan
            turned = 0.0
    return shown


def spread_over(frequency: FloatArray, most: int = MOST_POINTS) -> slice | np.ndarray:
    """Indices that select at most `most` of ascending positive frequencies, evenly on a logarithmic axis."""
    n = len(frequency)
    if n <= most:
        return slice(None)
    wanted = np.geomspace(max(float(frequency[0]), 1e-9), float(frequency[-1]), most)
    return np.unique(np.clip(np.searchsorted(frequency, wanted), 0, n - 1))


def encoded(value: Any) -> Any:
    """What JSON lacks: an array as float32 in base64, as plotly reads typed arrays; a number of numpy as Python's."""
    if np.ndim(value) == 0:
        return value.item()
    return {"dtype": "f4", "bdata": base64.b64encode(np.asarray(value, dtype="<f4").tobytes()).decode()}
