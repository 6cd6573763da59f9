"""Diagnoses new recordings of a fleet as they arrive."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path

from isorig.rig.fleet.catalogue import Catalogue
from isorig.rig.fleet.change_causes import search_causes
from isorig.rig.fleet.recordings import Recording, recordings_under
from isorig.rig.fleet.sentences import answer_words
from isorig.rig.fleet.update import update, work_of
from isorig.rig.model.baseline import Baseline

#: Seconds between readings of the folders.
EVERY = 10.0


class NewRecordings:
    """Recordings that are complete: a file that is still being copied grows from one reading to the next."""

    def __init__(self) -> None:
        self._before: dict[Path, tuple[str, int, int]] = {}
        self._handed: dict[Path, tuple[str, int, int]] = {}

    def settled(self, folders: Mapping[Path, str | None]) -> list[Recording]:
        """Recordings unchanged since the last reading, and not returned in this state before."""
        now = {recording.path: recording for recording in recordings_under(folders)}
        rested = [r for path, r in now.items() if self._before.get(path) == r.stamp and self._handed.get(path) != r.stamp]
        self._before = {path: r.stamp for path, r in now.items()}
        self._handed.update({r.path: r.stamp for r in rested})
        return rested


def watch(
    catalogue: Catalogue, folders: Mapping[Path, str | None], baseline: Baseline, *, limit: float | None = None,
    scheduler: str | None = None, every: float = EVERY, seconds: float | None = None, tell: Callable[[str], None] = print,
) -> None:  # fmt: skip
    """Diagnose new recordings as they arrive, and report each answer and each change of a rig in a line.

    `folders` have the rig of each; they are read every `every` seconds, for `seconds` or without limit if None.
    """
    arrivals = NewRecordings()
    end = None if seconds is None else time.monotonic() + seconds
    while True:
        fresh = arrivals.settled(folders)
        if fresh:
            work = work_of(catalogue, baseline, limit=limit, only=fresh)
            for note in work.notes:
                tell(note)
            if work.jobs:
                update(catalogue, work.jobs, scheduler=scheduler, tell=lambda answer: tell(answer_words(answer)))
                for line in search_causes(catalogue, baseline, scheduler=scheduler):
                    tell(line)
        if end is not None and time.monotonic() + every > end:
            return
        time.sleep(every)
