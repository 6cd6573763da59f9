"""The equations of motion of a run while it is measured: computed in a process of its own, so that the session never waits.

The process, which the session starts (`isorig.rig.view.process`), reads what the session writes and prints an `EquationsReport`
as a line of JSON after each reading; it ends when its standard input is closed.
"""

import os
import signal
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import cast

import msgspec

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.causes.base import Kind
from isorig.analysis.diagnose.early_answer import CONFIRMED, Decision, EarlyAnswer, early_answer
from isorig.analysis.equations.system import HOLDS
from isorig.analysis.errors import AnalysisError
from isorig.rig.acquire.live import EquationsReport
from isorig.rig.errors import RigError
from isorig.rig.model.baseline import baseline_model
from isorig.rig.report.conclusion import KINDS
from isorig.rig.view.sources import beginning_of, watched

#: The session and its page have priority over this process. Chosen: at 10 a busy computer gave it a fiftieth of a core.
NICE = 5
#: Seconds between two readings, the shortest record that is read, and its growth until it is read again.
EVERY, SHORTEST, GROWTH = 0.5, 3.0, 1.1
#: Longest part of a run that is read, seconds: what a minute does not show, the diagnosis of all runs is for.
LONGEST = 60.0
#: Longest first record in seconds, and longest growth from one record to the next: where the computer is too busy to follow the
#: run, some records are left before `LONGEST`, each long enough to confirm the one before.
FIRST, MOST_GROWTH = 30.0, 1.05 * CONFIRMED


def main() -> None:
    """Follow the recording named in the command line until standard input is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the session handles Ctrl-C
    with suppress(AttributeError, OSError):
        os.nice(NICE)

    def end() -> None:
        sys.stdin.buffer.read()
        os._exit(0)

    threading.Thread(target=end, name="standard input", daemon=True).start()
    for message in equations_reports(reading.campaign for reading in watched(Path(sys.argv[1]), lambda: False, every=EVERY)):
        sys.stdout.buffer.write(msgspec.json.encode(message) + b"\n")
        sys.stdout.buffer.flush()


def equations_reports(campaigns: Iterable[Campaign]) -> Iterator[EquationsReport]:
    """A message for the last run of each campaign, once that has grown by `GROWTH`."""
    begun: datetime | None = None
    run_id, before, decision = "", 0.0, Decision()
    for campaign in campaigns:
        run = campaign.runs[-1]
        if (run.id, run.started) != (run_id, begun):
            run_id, begun, before, decision = run.id, run.started, 0.0, Decision()
        seconds = min(run.duration, max(FIRST, MOST_GROWTH * before))
        if not max(SHORTEST, GROWTH * before) <= seconds <= LONGEST:
            continue
        run = beginning_of(run, round(seconds * run.sample_rate))
        before = run.duration
        with suppress(RigError, AnalysisError):
            # Until all channels have samples, or for a rig that the plan does not describe, the equations tell nothing.
            alone = replace(campaign, runs=(run,))
            answer = early_answer(alone, baseline_model(alone))
            if answer is None:
                continue
            known = decision.add(run.duration, answer)
            yield EquationsReport(
                run=run.id, seconds=run.duration, residuals=dict(answer.residuals), limit=HOLDS, known=known, text=_text(answer)
            )


def _text(answer: EarlyAnswer) -> str:
    if answer.kind:
        return f"{KINDS[cast('Kind', answer.kind)]} ({answer.place})"
    return "every equation of motion holds" if answer.hold else ""


if __name__ == "__main__":
    main()
