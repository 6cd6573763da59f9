"""Signs of a faulty input in a record: samples at full scale, flat tops at an extreme, rows of equal samples.

A limit cuts a motion off: the record arrives at it and leaves it as steeply as it moves elsewhere. At rest, at the plateau of a
command and at the top of a slow swing it does not.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from isorig.analysis.campaign import BoolArray, Channel, FloatArray, IntArray, once

#: Share of full scale that counts as overload.
FULL = 0.999
#: Number of consecutive equal samples at a record's extreme that indicates a limit.
ROW = 3
#: A record whose extreme value is this many times as frequent as the next one is at a limit there, even where noise leaves it at
#: once. At a peak of a sine that is rounded to steps, the highest step has at most 1 / (sqrt(2) - 1) = 2.4 times the samples of
#: the one below.
FREQUENT = 10
#: Values that differ by less than this share of a record's range are one value, computed with other rounding errors.
SAME = 1e-6
#: Minimum number of different values at a record's start for this test: a coarse converter repeats every value.
VALUES = 32
#: Samples over which the change of a record before and after a flat top counts, and which noise may interrupt it; its least share
#: of the rms change over as many. Chosen: the slope at 98 % of a sine's amplitude; rests and plateaus are approached more slowly.
NEAR, STEEP = 3, 0.3
#: Noise that is added after a limit scatters its samples: they are searched for within this share of the largest one. They are at
#: a limit if the distance from their median to their 90 % quantile is at most this share of the value; noise reaches this many
#: times as far. Chosen: of values spread evenly over that share, the distance is 0.008; of normal noise it is 1.28 standard
#: deviations.
WIDE, SCATTER, REACH = 0.02, 0.0025, 3.0
#: The same two in standard deviations of the sensor's noise, where that is larger, and the largest share of the value to search
#: within. Chosen: crests of a sine have a distance of 2.4, those at a limit one of 1.3 and what their flanks add.
WIDE_NOISE, SCATTER_NOISE, WIDEST = 10.0, 1.8, 0.2
#: Number of consecutive equal samples that no acceleration has, and the factor by which they must exceed the usual number (the
#: longest of a hundred rows) with a coarse converter.
STUCK, LONGER = 8, 8.0
#: Samples read at once: records may be longer than memory.
LONGEST = 1 << 20


def blocks(channel: Channel) -> Iterator[FloatArray]:
    """The channel's values, block by block, shape (up to `LONGEST`,)."""
    return (channel.read(start, start + LONGEST) for start in range(0, len(channel), LONGEST))


def noisy_limit(magnitudes: FloatArray, noise: float = 0.0) -> tuple[float, float] | None:
    """The limit at which most of the largest magnitudes are, and how far noise scatters them; None if they have no such limit.

    `magnitudes` has shape (n,), and `noise` is the standard deviation of the sensor's noise.
    """
    most = magnitudes.max(initial=0.0)
    noise = noise if WIDE_NOISE * noise <= WIDEST * most else 0.0
    top = magnitudes[magnitudes >= most - max(WIDE * most, WIDE_NOISE * noise)]
    if not len(top):
        return None
    limit, high = np.quantile(top, [0.5, 0.9])
    return (float(limit), REACH * float(high - limit)) if high - limit <= max(SCATTER * limit, SCATTER_NOISE * noise) else None


def cut_off(values: FloatArray, at: BoolArray, shortest: int = 1) -> IntArray:
    """Lengths of the rows of samples `at` an extreme at which a motion is cut off, those of `shortest` or more, shape (rows,)."""
    edges = np.flatnonzero(np.diff(at, prepend=False, append=False))
    if not len(edges) or len(values) <= NEAR:
        return edges[:0]
    apart = np.flatnonzero(edges[2::2] - edges[1:-1:2] > NEAR)
    first, stop = edges[np.concatenate([[0], 2 * apart + 2])], edges[np.concatenate([2 * apart + 1, [-1]])]
    inside = (first > NEAR) & (stop < len(values) - NEAR) & (stop - first >= shortest)
    first, stop = first[inside], stop[inside]
    if not len(first):
        return edges[:0]
    moved = np.abs(values[NEAR:] - values[:-NEAR])  # by the sample at which it starts
    slower = np.minimum(moved[first - 1 - NEAR], moved[stop])
    lengths: IntArray = (stop - first)[slower > STEEP * np.sqrt(np.mean(moved**2))]
    return lengths


class Row(NamedTuple):
    """Consecutive equal samples: the first one, their number and value."""

    first: int
    length: int
    value: float


class Extent(NamedTuple):
    """What the checks use of a block: extremes, mean, standard deviation and number of samples.

    `tops` are the numbers of times that a limit seems to cut the motion off at its smallest and largest value, `full` the number
    of samples at full scale, and `rows` the long rows of equal samples.
    """

    low: float
    high: float
    mean: float
    std: float
    length: int
    tops: tuple[int, int]
    full: int
    rows: tuple[Row, ...]


@once
def extents(channel: Channel) -> tuple[Extent, ...]:
    """The extent of each of a channel's `blocks`: all checks share this pass over the record."""
    return tuple(_extent(block, k * LONGEST, channel.full_scale) for k, block in enumerate(blocks(channel)))


def _extent(block: FloatArray, start: int, top: float | None) -> Extent:
    low, high, mean = float(block.min()), float(block.max()), block.mean(keepdims=True)
    reached = top is not None and max(-low, high) >= FULL * top
    return Extent(
        low=low, high=high, mean=float(mean[0]), std=float(block.std(mean=mean)), length=len(block),
        tops=(_tops(block, low), _tops(block, high)), full=int((np.abs(block) >= FULL * top).sum()) if top and reached else 0,
        rows=tuple(_rows(block, start)),
    )  # fmt: skip


def _tops(block: FloatArray, end: float) -> int:
    at = block == end
    count = np.count_nonzero(at)
    often = count >= FREQUENT and _frequent(block, end)
    return len(cut_off(block, at, 1 if often else ROW)) if count > 1 else 0


def _frequent(block: FloatArray, end: float) -> bool:
    # Whether the value at one end is `FREQUENT` times as frequent as the next one.
    below = np.abs(block - end)
    same = SAME * float(below.max())
    inner = float(below.min(where=below > same, initial=np.inf))
    return bool(np.count_nonzero(below <= same) >= FREQUENT * np.count_nonzero(np.abs(below - inner) <= same))


def _rows(block: FloatArray, start: int) -> Iterator[Row]:
    same = block[1:] == block[:-1]
    if np.count_nonzero(same) < STUCK - 1 or b"\1" * (STUCK - 1) not in same.tobytes():
        return
    edges = np.concatenate([[0], np.flatnonzero(~same) + 1, [len(block)]])
    rows = np.diff(edges)
    for k in np.flatnonzero(rows >= max(STUCK, LONGER * float(np.quantile(rows, 0.99)))):
        yield Row(first=start + int(edges[k]), length=int(rows[k]), value=float(block[edges[k]]))


def extremes(channel: Channel) -> tuple[float, float]:
    """The smallest and the largest value of a channel."""
    return min(each.low for each in extents(channel)), max(each.high for each in extents(channel))


def channel_std(channel: Channel) -> float:
    """Standard deviation of a channel, in its unit."""
    return combined((each.length, each.mean, each.std) for each in extents(channel))


def combined(parts: Iterable[tuple[int, float, float]]) -> float:
    """Standard deviation of values given in parts, by the number, mean and standard deviation of each part.

    Squares are about the mean of each part, which loses no digits (Chan, Golub and LeVeque 1983).
    """
    count, mean, std = np.array(list(parts)).T
    return float(np.sqrt(np.average(std**2 + (mean - np.average(mean, weights=count)) ** 2, weights=count)))


def plateaus(channel: Channel) -> int:
    """Number of times that a motion is cut off at the record's largest or smallest value; 0 for a coarse converter."""
    if len(np.unique(channel.read(0, 4096).astype(np.float32))) < VALUES:
        return 0
    low, high = extremes(channel)
    return sum((each.low == low) * each.tops[0] + (each.high == high) * each.tops[1] for each in extents(channel))
