"""Help: the list of commands, and the pages of the commands.

The list is drawn here, as the library of the command line would draw it: importing that library takes most of the time that a
page of a command takes, and the list is what a new user waits for first.
"""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from pkgutil import get_data, iter_modules
from typing import TYPE_CHECKING, Any

from isorig.rig import commands

if TYPE_CHECKING:
    from cyclopts.help import HelpPanel
    from rich.console import Console, ConsoleOptions

#: By name of the command: the file, whose function of the same name is the command (with _ after a name that Python has, too).
COMMANDS = {module.name.rstrip("_"): module.name for module in iter_modules(commands.__path__)}
ABOUT = "A toolkit for vibration test rigs: measurement, simulation, and diagnosis of simulation errors."
#: Options that show help.
HELP = ("--help", "-h")
INSTALL_COMPLETION = "Install completion of commands and options."
#: Narrowest column of texts, in characters; a narrower terminal breaks the lines.
NARROWEST = 20
#: Sequences of terminals for names, headings and what follows.
NAME, HEADING, PLAIN = "\x1b[36m", "\x1b[1m", "\x1b[0m"
#: The lines of the boxes, for outputs that have no other characters than ASCII.
ASCII = str.maketrans("╭╮╰╯─│", "++++-|")


def purpose(name: str) -> str:
    """The first line of a command's file, without importing it: its line in the list of commands."""
    content = get_data(commands.__name__, f"{COMMANDS[name]}.py") or b""
    return content.decode().splitlines()[0].strip('"')


def overview() -> str:
    """The page of `rig --help`, as wide as the terminal."""
    width = shutil.get_terminal_size().columns
    listed = {name: purpose(name) for name in COMMANDS}
    listed |= {"--help (-h)": "Display this message and exit.", "--version": "Display application version."}
    parts = [_marked("Usage: rig COMMAND", HEADING), "", *textwrap.wrap(ABOUT, max(width, NARROWEST)), ""]
    parts += [*_box("Commands", listed, width), *_box("Shell", {"--install-completion": INSTALL_COMPLETION}, width)]
    page = "\n".join(parts)
    return page if (sys.stdout.encoding or "").lower().startswith("utf") else page.translate(ASCII)


def _box(title: str, rows: dict[str, str], width: int) -> list[str]:
    names = max(map(len, rows))
    texts = max(width - names - 6, NARROWEST)
    lines = [f"╭─ {title} ".ljust(names + texts + 5, "─") + "╮"]
    for name, text in rows.items():
        for place, part in enumerate(textwrap.wrap(text, texts)):
            lines.append(f"│ {_marked((name if place == 0 else '').ljust(names), NAME)}  {part.ljust(texts)} │")
    return [*lines, "╰".ljust(names + texts + 5, "─") + "╯"]


def _marked(text: str, how: str) -> str:
    # The older consoles of Windows print the sequences.
    plain = not sys.stdout.isatty() or sys.platform == "win32" or "NO_COLOR" in os.environ or os.environ.get("TERM") == "dumb"
    return text if plain else f"{how}{text}{PLAIN}"


class Pages:
    """Pages of the commands as the library of the command line draws them, with the lines of each paragraph joined."""

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Print a list of parameters or commands."""
        from cyclopts.help import DefaultFormatter

        for entry in panel.entries:
            _join_lines(entry.description)
        DefaultFormatter()(console, options, panel)

    def render_usage(self, console: Console, options: ConsoleOptions, usage: Any) -> None:
        """Print how a command is called."""
        from cyclopts.help import DefaultFormatter

        DefaultFormatter().render_usage(console, options, usage)

    def render_description(self, console: Console, options: ConsoleOptions, description: Any) -> None:
        """Print what a command does."""
        _join_lines(description)
        console.print(description)


def _join_lines(description: Any) -> None:
    # In place: the lines of each paragraph become one line, which the library breaks at the width of the terminal.
    from cyclopts.help import InlineText
    from rich.text import Text

    if isinstance(description, InlineText) and isinstance(text := description.primary_renderable, Text) and text.plain:
        paragraphs = text.plain.strip().split("\n\n")
        description.primary_renderable = Text("\n\n".join(" ".join(each.split()) for each in paragraphs))
