"""The whole chain without hardware: measures a virtual rig through a real port, then uses the file only."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from isorig.drivers.errors import ConnectionLostError
from isorig.rig.process import python

#: The plan that comes with the program.
PLAN = Path(__file__).parents[1] / "acquire" / "demo.toml"
SECONDS = 600.0


@contextmanager
def virtual_instrument(seed: int, *options: str) -> Iterator[str]:
    """A simulated instrument in a separate process; yields the path of its port. `options` are passed to rig virtual instrument.
    Raises ConnectionLostError if the process does not start."""
    call = python("-m", "isorig", "virtual", "instrument", "--seed", str(seed), "--seconds", str(SECONDS), *options)
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            port = process.stdout.readline().strip()
            if not port:
                why = process.stderr.read().strip() if process.stderr else ""
                raise ConnectionLostError(f"the simulated instrument did not start ({why or 'no output'}); try again")
            yield port
        finally:
            process.terminate()


class Clock:
    """Prints each stage with the elapsed seconds."""

    def __init__(self) -> None:
        self._began = time.monotonic()

    def tell(self, text: str) -> None:
        """One line on standard error."""
        print(f"{self.seconds:5.1f} s  {text}", file=sys.stderr, flush=True)

    @property
    def seconds(self) -> float:
        """Elapsed seconds."""
        return time.monotonic() - self._began
