"""A recording while it is being made: what is measured so far, again and again, and at the end the whole of it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from analysis.measured import Campaign
from rig.acquire.recorder import working_file
from rig.acquire.recover import campaign_of, read_working
from rig.errors import RecordingError
from rig.recording import read


def follow(output: Path, *, every: float = 1.0, patience: float = 30.0) -> Iterator[Campaign]:
    """The campaign that a session is writing, each time that it has grown; the last is the finished recording.

    The writer is not held up by this and may be on another process.

    Parameters
    ----------
    output
        The recording that `rig acquire -o` was given.
    every
        Seconds between two looks.
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
        found = _so_far(partial)
        if found is not None and (now := sum(len(run) for run in found.runs)) > size:
            size, grown = now, time.monotonic()
            yield found
        elif time.monotonic() - grown > patience:
            raise RecordingError(f"{partial} has not grown for {patience:g} s; its writer is gone, so use rig recover")
        time.sleep(every)
    yield read(output)


def _so_far(partial: Path) -> Campaign | None:
    try:
        known, found = read_working(partial)
        return campaign_of(known, [item.run for item in found if item.run is not None], str(partial))
    except (RecordingError, OSError, RuntimeError, KeyError):
        # It is being laid out, read between two writes, or has just become the recording.
        return None
