"""What commands print: tables that fit 80 columns, and a line that tells what is going on."""

from __future__ import annotations

from collections.abc import Sequence


def show_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; columns whose cells are all numbers or dashes stand to the right."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for place, head in enumerate(columns):
        plain = all(_is_number(row[place]) for row in rows)
        table.add_column(head, justify="right" if plain else "left", no_wrap=plain)
    for row in rows:
        table.add_row(*row)
    Console().print(table, markup=False)


def _is_number(text: str) -> bool:
    return not text or text == "–" or text[0] in "+-.0123456789"
