"""Signs of an overloaded input in a record: samples at full scale, and consecutive equal samples at an extreme."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from isorig.analysis.campaign import Channel, FloatArray

#: Share of full scale that counts as overload.
FULL = 0.999
#: Number of consecutive equal samples at a record's extreme that indicates a limit.
ROW = 3
#: Minimum number of different values at a record's start for this test: a coarse converter repeats every value.
VALUES = 32
#: Samples read at once: records may be longer than memory.
LONGEST = 1 << 20


def blocks(channel: Channel) -> Iterator[FloatArray]:
    """The channel's values, block by block, shape (up to `LONGEST`,)."""
    return (channel.read(start, start + LONGEST) for start in range(0, len(channel), LONGEST))


def rows_of(values: FloatArray, value: float) -> int:
    """Number of times that values remain constant for `ROW` samples or longer."""
    at = np.concatenate([[False], values == value, [False]])
    edges = np.flatnonzero(np.diff(at.astype(np.int8)))
    return int((edges[1::2] - edges[::2] >= ROW).sum())


def extremes(channel: Channel) -> tuple[float, float]:
    """The smallest and the largest value of a channel."""
    ends = [(float(block.min()), float(block.max())) for block in blocks(channel)]
    return min(low for low, _ in ends), max(high for _, high in ends)


def plateaus(channel: Channel) -> int:
    """Number of times that the record remains at its largest or smallest value; 0 for a coarse converter."""
    if len(np.unique(channel.read(0, 4096))) < VALUES:
        return 0
    ends = extremes(channel)
    return sum(rows_of(block, end) for block in blocks(channel) for end in ends)
