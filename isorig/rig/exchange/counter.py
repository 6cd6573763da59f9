"""Columns that count the samples: 0, 1, 2 ..., with rows missing, or starting again after their largest number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from isorig.analysis.campaign import IntArray
from isorig.rig.exchange.clock import BESIDE, BREAKS_MOST
from isorig.rig.exchange.table import Column

#: Fewest numbers after which a counter starts again: four bits. Shorter cycles are also those of commands in steps.
CYCLE_LEAST = 16
#: The largest whole number up to which a float has every one.
WHOLE_MOST = 2**53


@dataclass(frozen=True, kw_only=True)
class SampleCounter:
    """How a column counts.

    Parameters
    ----------
    first, last
        Its first and last number.
    largest
        The number after which it starts again; None if it does not.
    rows
        Number of rows.
    breaks
        Indices of the rows after which the next one does not have the next number, shape (n,).
    skipped
        Numbers that are skipped there, -1 for a repeated row, shape (n,).
    """

    first: int
    last: int
    largest: int | None
    rows: int
    breaks: IntArray
    skipped: IntArray

    @property
    def words(self) -> str:
        """What it counts, after the name of the column."""
        again = "" if self.largest is None else f", and again after {self.largest}"
        return f"counts the samples from {self.first} to {self.last}{again}"

    def faults(self, first: int = 0) -> str:
        """Where rows are missing or repeated, and what to do; empty if nowhere. Rows are counted from the `first` of the file."""
        if not len(self.breaks):
            return ""
        edges = np.concatenate([[0], self.breaks + 1, [self.rows]]) + first
        longest = int(np.argmax(np.diff(edges)))
        row, missing = first + int(self.breaks[0]) + 1, int(self.skipped[self.skipped > 0].sum())
        what = f"skips {self.skipped[0]} numbers" if self.skipped[0] > 0 else "does not rise"
        others = f" (so in {len(self.breaks)} places, {missing} numbers in all)" if len(self.breaks) > 1 else ""
        return (
            f"it {what} from row {row} to row {row + 1}{others}: rows are missing or repeated there; correct the file, or import "
            f"its parts as runs, the longest with samples = [{edges[longest]}, {edges[longest + 1]}]"
        )


def sample_counter(column: Column) -> SampleCounter | None:
    """How a column counts the samples; None if it does not: whole numbers that rise by one from almost every row to the next."""
    values = np.asarray(column.values)
    if values.dtype.kind not in "iuf" or len(values) < BESIDE or column.sensitivity != 1.0:
        return None
    if not (np.isfinite(values).all() and np.abs(values).max() < WHOLE_MOST and column.whole):
        return None
    numbers = values.astype(np.int64)
    steps = np.diff(numbers)
    largest = None
    if (steps < 0).any():
        largest = int(numbers.max())
        cycle = largest - int(numbers.min()) + 1
        if cycle < CYCLE_LEAST:
            return None
        steps = np.where(steps < 0, steps + cycle, steps)
    breaks = np.flatnonzero(steps != 1)
    if len(breaks) > BREAKS_MOST * len(steps):
        return None
    return SampleCounter(
        first=int(numbers[0]), last=int(numbers[-1]), largest=largest, rows=len(numbers), breaks=breaks, skipped=steps[breaks] - 1
    )
