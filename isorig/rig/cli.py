"""The command line: every file under `isorig.rig.commands` is a command, loaded only when it is called."""

from __future__ import annotations

import atexit
import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from isorig.rig import commands
from isorig.rig.errors import REFUSALS
from isorig.rig.help import ABOUT, COMMANDS, HELP, INSTALL_COMPLETION, Pages, overview, purpose
from isorig.rig.process.interrupts import interrupted_between_imports
from isorig.rig.process.terminal import discard_output, terminal_closed

if TYPE_CHECKING:
    from cyclopts import App

#: Exit status of a process that a closed pipe or a closed terminal ended, as shells count signals: 128 and the number of SIGPIPE
#: or SIGHUP.
READER_GONE, TERMINAL_GONE = 141, 129


def _app(arguments: list[str]) -> App:
    from cyclopts import App

    # A command that is not called is not imported: the list has the first line of its file. A called one has its own help page,
    # and needs neither the other commands nor the installation of completion.
    app = App(
        name="rig",
        help=ABOUT,
        version=_version,
        # Markdown takes longer to import than everything else of a page.
        help_format="plaintext",
        help_formatter=Pages(),
        suppress_keyboard_interrupt=False,
    )
    called = [name for name in arguments[:1] if name in COMMANDS]
    if not called:
        app.register_install_completion_command(group="Shell", help=INSTALL_COMPLETION)
    for name in called or COMMANDS:
        file = COMMANDS[name]
        app.command(f"{commands.__name__}.{file}:{file}", name=name, help=None if called else purpose(name))
    return app


def _version() -> str:
    from importlib.metadata import version

    return version("isorig")


def main(arguments: list[str] | None = None) -> int:
    """Run a command, that of the command line without arguments; an error becomes one sentence on standard error and exit
    status 2."""
    if arguments is not None:
        return _status(arguments)
    ended: list[int] = []
    # What is registered first is called last, after all threads have ended.
    atexit.register(_end, ended)
    ended.append(_status(sys.argv[1:]))
    return ended[0]


def _end(ended: list[int]) -> None:
    # Only dismantling the interpreter is left: with the compiler, it takes a fifth of a short command's processor time.
    for status in ended:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(status)


def _status(arguments: list[str]) -> int:
    # Before numpy is imported: its matrices are small, and threads that wait for each other take twice the processor time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        with interrupted_between_imports():
            if all(each in HELP for each in arguments):
                print(overview())
            else:
                _app(arguments)(arguments)
            sys.stdout.flush()
    except REFUSALS as refusal:
        from isorig.rig.files.output import displayable

        _say(displayable(str(refusal)))
        return 2
    except BrokenPipeError:
        # The reader of a pipe, for example `head`, has read enough.
        discard_output()
        return READER_GONE
    except KeyboardInterrupt:
        _say("stopped by the operator")
        return 130
    except SystemExit as end:
        # cyclopts exits with 1 for a wrong call; here every unusable input exits with 2.
        return 2 if end.code == 1 else int(end.code or 0)
    except OSError:
        if not terminal_closed():
            raise
        discard_output()
        return TERMINAL_GONE
    return 0


def _say(sentence: str) -> None:
    # The terminal may have been closed.
    with suppress(OSError):
        print(f"rig: {sentence}", file=sys.stderr, flush=True)
