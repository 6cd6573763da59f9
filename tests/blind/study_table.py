"""A table of a study that grows line by line: a stopped study continues where it ends."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

#: Kind, size and seed of an envelope.
Job = tuple[str, float, int]


def append(table: Path, columns: Sequence[str], row: Mapping[str, object]) -> None:
    """Add a line; a new table begins with its columns."""
    fresh = not table.exists()
    table.parent.mkdir(parents=True, exist_ok=True)
    with table.open("a", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        if fresh:
            writer.writeheader()
        writer.writerow(row)


def done(table: Path) -> set[Job]:
    """Envelopes that a table holds."""
    if not table.exists():
        return set()
    with table.open() as file:
        return {(line["kind"], float(line["size"]), int(line["seed"])) for line in csv.DictReader(file)}
