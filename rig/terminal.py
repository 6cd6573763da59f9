"""Output of commands: tables that fit 80 columns, and a progress line."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence


def discard_output() -> None:
    """Discard what is still buffered for standard output: if its reader has ended, Python would report an error at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def show_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; numeric columns are right-aligned.

    Numbers and the first column (names) are never truncated: if necessary, lines are longer than the terminal.
    """
    from rich import box
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for place, head in enumerate(columns):
        plain = all(_is_number(row[place]) for row in rows)
        table.add_column(head, justify="right" if plain else "left", no_wrap=plain or place == 0, overflow="fold")
    for row in rows:
        table.add_row(*row)
    console = Console()
    least = Measurement.get(console, console.options.update(max_width=1 << 16), table).minimum
    Console(width=max(console.width, least)).print(table, markup=False)


def _is_number(text: str) -> bool:
    return not text or text == "–" or text[0] in "+-.0123456789"
