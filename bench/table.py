"""What every benchmark has in common: its options, and the rows that it adds to the table of `bench/run.py`."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class Row:
    """One figure of ours, beside a peer's where there is one.

    Parameters
    ----------
    what, unit
        What is measured.
    ours
        Our figure.
    peer, theirs
        The peer and its figure; empty and None where there is none.
    limit
        What our figure must keep, and whether it does.
    """

    what: str
    unit: str
    ours: float
    peer: str = ""
    theirs: float | None = None
    limit: str = ""

    @property
    def ratio(self) -> float | None:
        """The peer's figure over ours."""
        return None if self.theirs is None or self.ours == 0.0 else abs(self.theirs / self.ours)


def within(figure: float, limit: float, unit: str) -> str:
    """The words of an upper limit, and whether a figure keeps it."""
    return f"at most {limit:g} {unit}: {'kept' if figure <= limit else 'broken'}"


def options(description: str | None) -> argparse.ArgumentParser:
    """The options that every benchmark takes."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer repeats: figures are coarser")
    parser.add_argument("--rows", type=Path, help="where the rows of the common table are written, as JSON")
    return parser


def keep(rows: Sequence[Row], path: Path | None) -> None:
    """Write the rows for `bench/run.py`, where it asked for them."""
    if path is not None:
        path.write_text(json.dumps([asdict(row) for row in rows]), encoding="utf-8")
