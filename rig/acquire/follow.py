"""A recording while it is being made: what is measured so far, again and again, and at the end the whole of it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from analysis.measured import Campaign
from rig.acquire.recorder import working_file
from rig.acquire.recover import campaign_of, working
from rig.errors import RecordingError
from rig.recording import open_recording


def follow(output: Path, *, every: float = 1.0, shortest: float = 0.0, patience: float = 30.0) -> Iterator[tuple[Campaign, bool]]:
    """The campaign that a session is writing, each time that it has grown, and whether it is the finished recording, the last.

    The writer is not held up by this and may be in another process. A campaign is to be read before the next is asked for.

    Parameters
    ----------
    output
        The recording that `rig acquire -o` was given.
    every
        Seconds between two looks.
    shortest
        Runs shorter than so many seconds are left out until the recording is finished.
    patience
        Seconds to wait without a new sample before giving up.

    Raises
    ------
    RecordingError
        Where nothing is being recorded there, or the writer has stopped without finishing.
    """
    partial = working_file(output)
    size, grown = 0, time.monotonic()
    while partial.exists():
        try:
            with working(partial) as (known, found):
                runs = [item.run for item in found if item.run is not None]
                if (now := sum(len(run) for run in runs)) > size:
                    size, grown = now, time.monotonic()
                    kept = [run for run in runs if run.duration >= shortest]
                    if kept:
                        yield campaign_of(known, kept, str(partial)), False
        except (OSError, RecordingError, RuntimeError, KeyError):
            # It is being laid out, was read between two writes, or has just become the recording.
            pass
        if time.monotonic() - grown > patience:
            raise RecordingError(f"{partial} has not grown for {patience:g} s; its writer is gone, so use rig recover")
        time.sleep(every)
    with open_recording(output) as campaign:
        yield campaign, True
