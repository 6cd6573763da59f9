"""The command line: a table of commands, each in its own file under `isorig.rig.commands`, loaded only when it is called."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from isorig.rig.errors import REFUSALS
from isorig.rig.process.interrupts import interrupted_between_imports
from isorig.rig.process.terminal import discard_output, terminal_closed

if TYPE_CHECKING:
    from cyclopts import App

#: Location and one-line description of each command.
COMMANDS = {
    "describe": ("isorig.rig.commands.describe:describe", "Draws and checks a rig's description, or writes one."),
    "check": ("isorig.rig.commands.check:check", "Lists the runs of recordings and rejects damaged files."),
    "frf": ("isorig.rig.commands.frf:frf", "Transfer functions with coherence and error bars."),
    "modes": ("isorig.rig.commands.modes:modes", "Modes with shapes from many transfer functions at once."),
    "characterize": ("isorig.rig.commands.characterize:characterize", "Masses, natural frequencies, damping ratios, friction."),
    "simulate": ("isorig.rig.commands.simulate:simulate", "A rig's responses to a recorded or synthetic drive."),
    "isolation": ("isorig.rig.commands.isolation:isolation", "The isolation ratio, measured and simulated."),
    "diagnose": ("isorig.rig.commands.diagnose:diagnose", "What the simulation gets wrong, and the identified cause."),
    "next": ("isorig.rig.commands.next:next_", "Proposes the next run, to distinguish the remaining causes."),
    "investigate": ("isorig.rig.commands.investigate:investigate", "Measures and diagnoses until one cause is identified."),
    "predict": ("isorig.rig.commands.predict:predict", "The sensor signals that a model predicts."),
    "design": ("isorig.rig.commands.design:design", "How soft the isolation may be for given moves."),
    "instruments": ("isorig.rig.commands.instruments:instruments", "Lists what is connected, and proposes a plan for it."),
    "sensors": ("isorig.rig.commands.sensors:sensors", "Compares a plan's sensors with their calibration sheets."),
    "acquire": ("isorig.rig.commands.acquire:acquire", "Measures the runs of a plan with an instrument."),
    "view": ("isorig.rig.commands.view:view", "Shows a session or a recording in the browser."),
    "recover": ("isorig.rig.commands.recover:recover", "Restores the data of a killed session."),
    "import": ("isorig.rig.commands.import_:import_", "Converts files of other formats to a recording."),
    "export": ("isorig.rig.commands.export:export", "Writes a recording in other formats."),
    "report": ("isorig.rig.commands.report:report", "One page about a measurement."),
    "demo": ("isorig.rig.commands.demo:demo", "The whole chain, without hardware."),
    "fleet": ("isorig.rig.commands.fleet:app", "Many rigs over many campaigns: what changed, when, and why."),
    "virtual": ("isorig.rig.commands.virtual:app", "A virtual rig, as a recording or as a simulated instrument."),
}


#: Exit status of a process that a closed pipe or a closed terminal ended, as shells count signals: 128 and the number of SIGPIPE
#: or SIGHUP.
READER_GONE, TERMINAL_GONE = 141, 129


def _app(arguments: list[str]) -> App:
    from importlib.metadata import version

    from cyclopts import App

    # A command that is not called is not imported: the list uses its line from here. A called one has its own help page.
    app = App(
        name="rig",
        help="A toolkit for vibration test rigs: measurement, simulation, and diagnosis of simulation errors.",
        version=lambda: version("isorig"),
        suppress_keyboard_interrupt=False,
    )
    app.register_install_completion_command(group="Shell", help="Install completion of commands and options.")
    for name, (target, line) in COMMANDS.items():
        app.command(target, name=name, help=None if name in arguments else line)
    return app


def main(arguments: list[str] | None = None) -> int:
    """Run a command; an error becomes one sentence on standard error and exit status 2."""
    arguments = sys.argv[1:] if arguments is None else arguments
    # Before numpy is imported: its matrices are small, and threads that wait for each other take twice the processor time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        with interrupted_between_imports():
            _app(arguments)(arguments)
            sys.stdout.flush()
    except REFUSALS as refusal:
        from isorig.rig.files.output import displayable

        _say(displayable(str(refusal)))
        return 2
    except BrokenPipeError:
        # The reader of a pipe, such as `head`, has read enough.
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
