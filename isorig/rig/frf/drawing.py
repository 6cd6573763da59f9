"""Figures of transfer functions, drawn by another process while this one computes the rest.

Importing the library of the figures and drawing take as long as everything else of `rig frf`. The process reads each
`FrfPicture` from its standard input and answers on its standard output, pickled; it ends when its standard input is closed.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from isorig.rig.errors import OutputError
from isorig.rig.process import piped

if TYPE_CHECKING:
    from isorig.analysis.spectra.periodic import PeriodicFrf
    from isorig.analysis.spectra.welch import Frf
    from isorig.rig.frf.figures import View


@dataclass(frozen=True, kw_only=True)
class FrfPicture:
    """A figure to draw in a file: transfer functions by label in a band (Hz), or their estimates period by period."""

    path: Path
    curves: Mapping[str, Frf] = field(default_factory=dict)
    band: tuple[float, float] = (0.0, inf)
    view: View = "bode"
    periods: Mapping[str, PeriodicFrf] = field(default_factory=dict)


class FigureProcess:
    """The other process, to which figures are sent."""

    def __init__(self) -> None:
        # Ctrl-C is for this process, which then ends the other one.
        self._process, self._input, self._output = piped("-m", "isorig.rig.frf.drawing", apart=True)
        # The pipe holds less than a figure, so another thread waits until the process reads.
        self._sender = ThreadPoolExecutor(1, "to the figures")
        self._sent: list[Future[None]] = []

    def draw(self, job: FrfPicture) -> None:
        """Send a figure."""
        self._sent.append(self._sender.submit(self._drawn, job))

    def wait(self) -> None:
        """Wait until all figures are drawn. Raises OutputError if a figure could not be written."""
        sent, self._sent = self._sent, []
        for each in sent:
            each.result()

    def end(self) -> None:
        """End the process, also if it is drawing."""
        self._process.kill()
        self._sender.shutdown(cancel_futures=True)
        with suppress(OSError):
            self._input.close()
        self._output.close()
        self._process.wait()

    def _drawn(self, job: FrfPicture) -> None:
        try:
            pickle.dump(job, self._input)
            self._input.flush()
            wrong = pickle.load(self._output)
        except (OSError, EOFError):
            raise OutputError(f"{job.path} was not drawn because its process ended; run the command again") from None
        if wrong is not None:
            raise wrong


@contextmanager
def drawn_elsewhere() -> Iterator[FigureProcess]:
    """Another process that draws figures during the block."""
    drawing = FigureProcess()
    try:
        yield drawing
    finally:
        drawing.end()


def main() -> None:
    """Draw until standard input is closed."""
    from isorig.rig.frf.figures import frf_view, periods_figure, save

    jobs, answers = sys.stdin.buffer, sys.stdout.buffer
    while True:
        try:
            job: FrfPicture = pickle.load(jobs)
        except EOFError:
            return
        wrong: Exception | None = None
        try:
            save(periods_figure(job.periods) if job.periods else frf_view(job.curves, job.band, job.view), job.path)
        except Exception as error:
            wrong = error
        pickle.dump(wrong, answers)
        answers.flush()


if __name__ == "__main__":
    main()
