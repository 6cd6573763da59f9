"""The command line: one App, each command in its own file under `rig.commands`, loaded only when it is called."""

from __future__ import annotations

import sys
from importlib.metadata import version

from cyclopts import App

from rig.errors import REFUSALS

app = App(
    name="rig",
    help="From an instrument's wire to a named cause: a toolkit for motor-isolation test rigs.",
    version=lambda: version("isorig"),
    suppress_keyboard_interrupt=False,
)
app.command("rig.commands.check:check", name="check")
app.command("rig.commands.frf:frf", name="frf")
app.command("rig.commands.characterize:characterize", name="characterize")
app.command("rig.commands.simulate:simulate", name="simulate")
app.command("rig.commands.isolation:isolation", name="isolation")
app.command("rig.commands.diagnose:diagnose", name="diagnose")
app.command("rig.commands.predict:predict", name="predict")
app.command("rig.commands.design:design", name="design")
app.command("rig.commands.acquire:acquire", name="acquire")
app.command("rig.commands.recover:recover", name="recover")
app.command("rig.commands.import_:import_", name="import")
app.command("rig.commands.export:export", name="export")
app.command("rig.commands.report:report", name="report")
app.command("rig.commands.demo:demo", name="demo")
app.command("rig.commands.virtual:app", name="virtual")


def main(arguments: list[str] | None = None) -> int:
    """Run a command; a refusal becomes one sentence on standard error and exit status 2."""
    try:
        app(arguments)
    except REFUSALS as refusal:
        print(f"rig: {refusal}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("rig: stopped by the operator", file=sys.stderr)
        return 130
    except SystemExit as end:
        # cyclopts ends with 1 where the words of a call are wrong; here every unusable input ends with 2.
        return 2 if end.code == 1 else int(end.code or 0)
    return 0
