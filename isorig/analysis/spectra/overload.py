"""Signs of an overloaded input in a record: samples at full scale, and flat tops at an extreme.

A limit cuts a motion off: the record arrives at it and leaves it as steeply as it moves elsewhere. At rest, at the plateau of a
command and at the top of a slow swing it does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from isorig.analysis.campaign import BoolArray, Channel, FloatArray, IntArray, once

#: Share of full scale that counts as overload.
FULL = 0.999
#: Number of consecutive equal samples at a record's extreme that indicates a limit.
ROW = 3
#: Minimum number of different values at a record's start for this test: a coarse converter repeats every value.
VALUES = 32
#: Samples over which the change of a record before and after a flat top counts, and which noise may interrupt it; its least share
#: of the rms change over as many. Chosen: the slope at 98 % of a sine's amplitude; rests and plateaus are approached more slowly.
NEAR, STEEP = 3, 0.3
#: Samples read at once: records may be longer than memory.
LONGEST = 1 << 20


def blocks(channel: Channel) -> Iterator[FloatArray]:
    """The channel's values, block by block, shape (up to `LONGEST`,)."""
    return (channel.read(start, start + LONGEST) for start in range(0, len(channel), LONGEST))


def cut_off(values: FloatArray, at: BoolArray) -> IntArray:
    """Lengths of the rows of samples `at` an extreme at which a motion is cut off, shape (rows,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(np.int8)))
    if not len(edges) or len(values) <= NEAR:
        return edges[:0]
    apart = np.flatnonzero(edges[2::2] - edges[1:-1:2] > NEAR)
    first, stop = edges[np.concatenate([[0], 2 * apart + 2])], edges[np.concatenate([2 * apart + 1, [-1]])]
    moved = np.abs(values[NEAR:] - values[:-NEAR])  # by the sample at which it starts
    inside = (first > NEAR) & (stop < len(moved))
    first, stop = first[inside], stop[inside]
    slower = np.minimum(moved[first - 1 - NEAR], moved[stop])
    lengths: IntArray = (stop - first)[slower > STEEP * np.sqrt(np.mean(moved**2))]
    return lengths


class Extent(NamedTuple):
    """The smallest and the largest value of a block, and its standard deviation."""

    low: float
    high: float
    std: float


@once
def extents(channel: Channel) -> tuple[Extent, ...]:
    """The extent of each of a channel's `blocks`."""
    return tuple(Extent(float(block.min()), float(block.max()), float(block.std())) for block in blocks(channel))


def extremes(channel: Channel) -> tuple[float, float]:
    """The smallest and the largest value of a channel."""
    return min(each.low for each in extents(channel)), max(each.high for each in extents(channel))


def plateaus(channel: Channel) -> int:
    """Number of times that a motion is cut off at the record's largest or smallest value; 0 for a coarse converter."""
    if len(np.unique(channel.read(0, 4096))) < VALUES:
        return 0
    ends, count = extremes(channel), 0
    for start, extent in zip(range(0, len(channel), LONGEST), extents(channel), strict=True):
        # Only blocks that reach an extreme are read again.
        if {extent.low, extent.high} & set(ends):
            block = channel.read(start, start + LONGEST)
            count += sum(int((cut_off(block, block == end) >= ROW).sum()) for end in ends)
    return count
