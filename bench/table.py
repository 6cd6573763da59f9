"""Options of every benchmark, and the rows that it adds to the table of `bench/run.py`."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class Row:
    """A result of isorig, and that of another package or method if there is one.

    Parameters
    ----------
    what, unit
        The measured quantity and its unit.
    ours
        The value of isorig.
    peer, theirs
        The other package or method and its value; empty and None if there is none.
    limit
        The limit of our value, and whether it is met.
    """

    what: str
    unit: str
    ours: float
    peer: str = ""
    theirs: float | None = None
    limit: str = ""

    @property
    def ratio(self) -> float | None:
        """The other value over ours."""
        return None if self.theirs is None or self.ours == 0.0 else abs(self.theirs / self.ours)


def within(figure: float, limit: float, unit: str) -> str:
    """An upper limit, and whether a value meets it, as text."""
    return f"at most {limit:g} {unit}: {'met' if figure <= limit else 'not met'}"


def options(description: str | None) -> argparse.ArgumentParser:
    """The options of every benchmark."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer repetitions, less precise results")
    parser.add_argument("--rows", type=Path, help="file for the rows of the common table, as JSON")
    return parser


def keep(rows: Sequence[Row], path: Path | None) -> None:
    """Write the rows for `bench/run.py`, if it requested them."""
    if path is not None:
        path.write_text(json.dumps([asdict(row) for row in rows]), encoding="utf-8")
