"""Output of commands: tables that fit 80 columns, and a progress line."""

import io
import os
import select
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import TextIO


def discard_output() -> None:
    """Discard what is still buffered for standard output: if its reader has ended, Python would report an error at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def terminal_closed() -> bool:
    """Whether standard output or standard error was a terminal that no longer exists."""
    if not hasattr(select, "poll"):  # Windows
        return False
    watched = select.poll()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            watched.register(stream.fileno(), 0)
    return any(events & (select.POLLHUP | select.POLLERR) for _, events in watched.poll(0))


#: Seconds that a terminal may take to accept output.
PATIENCE = 2.0


class NonBlockingTerminal(io.TextIOBase):
    """A terminal's output that causes no delay: what a stopped (Ctrl-S) or closed terminal does not take is dropped."""

    def __init__(self, stream: TextIO) -> None:
        # Opened again: without waiting is a property that all processes with the same open terminal share.
        self._file = os.open(os.ttyname(stream.fileno()), os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        self._patience = PATIENCE

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Terminals are written in UTF-8."""
        return "utf-8"

    def fileno(self) -> int:
        """Descriptor of the terminal."""
        return self._file

    def isatty(self) -> bool:
        """Always True."""
        return True

    def writable(self) -> bool:
        """Always True."""
        return True

    def write(self, text: str) -> int:
        """Write as much as the terminal accepts within `PATIENCE`, after a first failure without waiting."""
        left = memoryview(text.encode("utf-8", "replace"))
        end = time.monotonic() + self._patience
        while left:
            try:
                left = left[os.write(self._file, left) :]
                self._patience = PATIENCE
            except BlockingIOError:
                wait = end - time.monotonic()
                if wait <= 0.0 or not select.select([], [self._file], [], wait)[1]:
                    self._patience = 0.0
                    break
            except OSError:
                # It was closed.
                break
        return len(text)


def never_wait_for_terminal() -> None:
    """From now on this program's output never waits for its terminal: also its last line lets it end."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        with suppress(OSError, ValueError, AttributeError):
            if stream.isatty() and not isinstance(stream, NonBlockingTerminal):
                setattr(sys, name, NonBlockingTerminal(stream))


def show_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; numeric columns are right-aligned.

    Numbers, the first column (names) and words are never broken: if necessary, lines are longer than the terminal.
    """
    from rich import box
    from rich.console import Console
    from rich.measure import Measurement
    from rich.table import Table

    from isorig.rig.files.output import displayable

    table = Table(title=displayable(title), title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for place, head in enumerate(columns):
        plain = all(_is_number(row[place]) for row in rows)
        whole = plain or place == 0
        # The library makes narrow columns shorter than their longest word, and measures that even of cells that it may not break.
        cells = [displayable(text) for text in (head, *(row[place] for row in rows))]
        least = max(len(part) for cell in cells for part in ([cell] if whole else cell.split() or [""]))
        table.add_column(displayable(head), justify="right" if plain else "left", no_wrap=whole, overflow="fold", min_width=least)
    for row in rows:
        table.add_row(*map(displayable, row))
    console = Console()
    # It measures a table without a part of the distance of its columns.
    least = Measurement.get(console, console.options.update(max_width=1 << 16), table).minimum + len(columns)
    Console(width=max(console.width, least)).print(table, markup=False)


def _is_number(text: str) -> bool:
    return not text or text == "–" or text[0] in "+-.0123456789"
