"""Empty cells: shorter columns, columns with a lower sample rate, and lost samples."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from isorig.rig.exchange.clock import column_rate, is_time
from isorig.rig.exchange.table import Column

#: Share of a column's cells that may be lost samples; with more it is not a record.
LOST_MOST = 0.1


def completed(columns: Mapping[str, Column]) -> tuple[dict[str, Column], list[str]]:
    """Columns of equal length with an interpretation of their empty cells (NaN), and sentences about them.

    Empty cells at the end mean a shorter column; a value in every k-th cell only means a record with 1/k of the rate; a few empty
    cells are lost samples, listed in `Column.lost`.
    """
    rate = next((column_rate(name, column, "") for name, column in columns.items() if is_time(name, column)), None)
    found: dict[str, Column] = {}
    remarks = []
    for name, column in columns.items():
        there = np.flatnonzero(~np.isnan(column.values))
        n = len(column.values)
        if len(there) == n:
            found[name] = column
        elif len(there) < 2:
            if not re.fullmatch(r"|column\d+|Unnamed.*", name):
                remarks.append(f"column {name!r} is empty and is left out")
        elif len(there) == n - there[0] and there[0] > 0:
            # Late first value: the rows before it are lost samples of this column.
            found[name] = replace(column, lost=np.flatnonzero(np.isnan(column.values)))
            remarks.append(f"column {name!r} has no value in its first {there[0]} rows")
        elif len(steps := np.unique(np.diff(there))) == 1:
            every = int(steps[0])
            kept = column.values[there]
            own = None if rate is None else rate / every
            found[name] = replace(column, values=kept, sample_rate=column.sample_rate or own)
            remarks.append(
                f"column {name!r} has {len(kept)} values of {n}" + (f", one in every {every} rows" if every > 1 else "")
                + ": it is treated as a separate record"
            )  # fmt: skip
        else:
            values = column.values[: there[-1] + 1]
            lost = np.flatnonzero(np.isnan(values))
            if len(lost) > LOST_MOST * len(values):
                remarks.append(f"column {name!r} has no value in {len(lost)} of {len(values)} rows and is left out")
                continue
            short = len(values) < n
            found[name] = replace(column, values=values, lost=lost, sample_rate=column.sample_rate or (rate if short else None))
            remarks.append(f"column {name!r} has no value in {len(lost)} of {len(values)} rows: they are stored as gaps")
    return found, remarks
