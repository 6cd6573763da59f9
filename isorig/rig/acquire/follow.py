"""Reads a recording while it is being written: repeatedly what is measured so far, and at the end all of it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from isorig.analysis.campaign import Campaign
from isorig.rig.acquire.recorder import working_file
from isorig.rig.acquire.recover import WorkingFileReader, campaign_of
from isorig.rig.errors import RecordingError
from isorig.rig.files.recording import open_recording


def follow(output: Path, *, every: float = 1.0, shortest: float = 0.0, patience: float = 30.0) -> Iterator[tuple[Campaign, bool]]:
    """The campaign that a session is writing, each time it has grown, and whether it is the finished recording (the last one).

    The writer is not delayed and may be another process. Read each campaign before requesting the next. `every` are the seconds
    between two readings; runs shorter than the seconds `shortest` are omitted until the recording is finished. Raises
    RecordingError if no session is writing there, or the writer has stopped without finishing: no new sample came for `patience`
    seconds.
    """
    partial = working_file(output)
    file: WorkingFileReader | None = None
    size, grown = 0, time.monotonic()
    try:
        while partial.exists():
            # It may be about to be created, or has just become the recording.
            with suppress(RecordingError):
                file = _opened(file, partial)
                runs = [item.run for item in file.runs() if item.run is not None]
                if (now := sum(len(run) for run in runs)) > size:
                    size, grown = now, time.monotonic()
                    kept = [run for run in runs if run.duration >= shortest]
                    if kept:
                        yield campaign_of(file.known, kept, str(partial)), False
            if time.monotonic() - grown > patience:
                raise RecordingError(f"{partial} has not grown for {patience:g} s; its writer has ended, so use rig recover")
            time.sleep(every)
    finally:
        if file is not None:
            file.close()
    with open_recording(output) as campaign:
        yield campaign, True


def _opened(file: WorkingFileReader | None, partial: Path) -> WorkingFileReader:
    # Blocks are read only once.
    if file is None or file.replaced:
        if file is not None:
            file.close()
        return WorkingFileReader(partial)
    file.refresh()
    return file
