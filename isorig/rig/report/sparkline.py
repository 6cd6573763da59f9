"""A small line chart of a series, the size of a word."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from isorig.analysis.campaign import FloatArray
from isorig.rig.report.page import Sparkline

WIDTH, HEIGHT, EDGE = 64.0, 20.0, 2.0
#: Number of latest values shown; more cannot be resolved at this width.
MOST = 60


def sparkline(values: FloatArray, description: str, marked: Sequence[int] = ()) -> Sparkline:
    """The latest values, shape (n,), as a line; those at the indices `marked` get a dot.

    `description` describes the content in words.
    """
    start = max(len(values) - MOST, 0)
    y = values[start:]
    x = np.linspace(EDGE, WIDTH - EDGE, len(y)) if len(y) > 1 else np.full(len(y), WIDTH / 2.0)
    low, high = float(y.min()), float(y.max())
    span = high - low
    placed = HEIGHT - EDGE - (HEIGHT - 2 * EDGE) * ((y - low) / span if span > 0.0 else np.full(len(y), 0.5))
    points = [(round(float(a), 1), round(float(b), 1)) for a, b in zip(x, placed, strict=True)]
    return Sparkline(
        points=" ".join(f"{a:g},{b:g}" for a, b in points),
        marks=[points[k - start] for k in marked if k >= start],
        description=description,
    )
