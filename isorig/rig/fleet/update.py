"""Updates the catalogue: diagnoses recordings without an answer, at once or as they arrive; a failure stops no others."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pandas as pd

from isorig.rig.choices import Baseline
from isorig.rig.diagnose.many import program_version, shared_out
from isorig.rig.errors import RigError
from isorig.rig.files.output import reason
from isorig.rig.fleet.catalogue import FAILED, LIMIT, SUPERSEDED, Catalogue, StoredAnswer, StoredParameter, key_of
from isorig.rig.fleet.change_causes import search_causes
from isorig.rig.fleet.job import DiagnosisJob, answer_job
from isorig.rig.fleet.recordings import Recording, identified, recordings_under
from isorig.rig.fleet.sentences import answer_words

#: Seconds between checks of a recording that another process works on.
PATIENCE = 0.5
#: Seconds between two readings of watched folders.
EVERY = 10.0


@dataclass(frozen=True, kw_only=True)
class Work:
    """The work of an update: recordings without an answer, grouped by rig and sorted by name; the number of those with one.

    `notes` are sentences about folders and recordings that could not be used as they are.
    """

    jobs: tuple[DiagnosisJob, ...]
    known: int
    notes: tuple[str, ...]


def work_of(
    catalogue: Catalogue, baseline: Baseline, *, limit: float | None = None, pages: bool = False, again: bool = False,
    reread: bool = False, only: Sequence[Recording] | None = None,
) -> Work:  # fmt: skip
    """Compare the folders with the catalogue; the entries of moved or replaced recordings are corrected.

    With `again`, recordings whose diagnosis failed or took too long are tried again; with `reread`, every file is read, not only
    those with a new size or modification time. `only` restricts the work to these recordings.
    """
    folders = catalogue.folders()
    stored = _Stored(catalogue)
    sound = [a for a in stored.answers.values() if a.verdict != SUPERSEDED]
    known = {} if reread else {a.stamp: a.content for a in sound}
    found = identified(recordings_under(folders) if only is None else only, known)
    notes = [] if only is not None else [
        f"{folder} cannot be accessed; its recordings keep their answers" for folder in folders if not folder.is_dir()
    ]  # fmt: skip
    notes += [f"{r.path} cannot be read; make it a readable file, not a pipe or a device" for r in found if not r.content]
    found = [r for r in found if r.content]
    first, notices = _placed(found, sound)
    places = {r.path for r in found}
    for answer in sound:
        changed = _corrected(answer, first, places)
        if changed is not None:
            catalogue.put(msgspec.structs.replace(changed, parameters=stored.parameters(answer.key)))
            stored.answers[answer.key] = changed
    jobs = []
    for recording in first.values():
        blank = StoredAnswer(**msgspec.structs.asdict(recording), version=program_version(), baseline=baseline)
        old = stored.answers.get(blank.key)
        if old is None or _worth_trying(old, stored.limits.get(blank.key), limit, again):
            retry = old is not None and old.verdict != SUPERSEDED
            jobs.append(
                DiagnosisJob(catalogue=str(catalogue.folder.resolve()), answer=blank, limit=limit, pages=pages, again=retry)
            )
    return Work(jobs=tuple(jobs), known=len(first) - len(jobs), notes=(*notes, *notices))


def _worth_trying(old: StoredAnswer, given: float | None, limit: float | None, again: bool) -> bool:
    # `given` is the time limit that ended its diagnosis.
    if old.verdict == SUPERSEDED:
        return True
    if given is not None:
        return again or limit is None or limit > given
    return again and old.verdict == FAILED


class _Stored:
    # Content of the catalogue by the answers' keys: answers without parameters, time limits, and the parameters on request.

    def __init__(self, catalogue: Catalogue) -> None:
        self._frame = catalogue.answers()
        rows = self._frame[self._frame.parameter == LIMIT]
        self.limits = dict(zip(map(key_of, rows.content, rows.version, rows.baseline), rows.value, strict=True))
        columns = [name for name in StoredAnswer.__struct_fields__ if name != "parameters"]
        first = self._frame.drop_duplicates(["content", "version", "baseline"])
        self.answers: dict[str, StoredAnswer] = {}
        self._rows: dict[str, slice] = {}
        # Rows of an answer are adjacent.
        ends = pairwise([*first.index, len(self._frame)])
        for (start, end), row in zip(ends, first[columns].to_dict("records"), strict=True):
            given: Any = row
            answer = StoredAnswer(**given | {"started": None if pd.isna(row["started"]) else row["started"].to_pydatetime()})
            self.answers[answer.key] = answer
            self._rows[answer.key] = slice(start, end)

    def parameters(self, key: str) -> tuple[StoredParameter, ...]:
        rows = self._frame.iloc[self._rows[key]]
        values = zip(rows["parameter"], rows["value"], rows["std"], rows["unit"], strict=True)
        return tuple(StoredParameter(name=name, value=value, std=std, unit=unit) for name, value, std, unit in values if name)


def _placed(recordings: Sequence[Recording], stored: Sequence[StoredAnswer]) -> tuple[dict[str, Recording], list[str]]:
    # One path for each content: the earlier one if it still exists, otherwise the first.
    notes, first = [], {}
    at = {r.path: r.content for r in recordings}
    contents = set(at.values())
    kept = {
        a.content: a.path
        for a in stored
        if a.content in contents and (at[a.path] == a.content if a.path in at else Path(a.path).is_file())
    }
    for r in sorted(recordings, key=lambda r: (r.rig, r.path)):
        wanted = kept.setdefault(r.content, r.path)
        if wanted == r.path:
            first[r.content] = r
        else:
            notes.append(f"{r.path} is the same recording as {wanted}, which is used; remove one of them")
    return first, notes


def _corrected(answer: StoredAnswer, first: Mapping[str, Recording], places: Set[str]) -> StoredAnswer | None:
    # The answer with the present path of its recording; None if nothing has changed.
    here = first.get(answer.content)
    if here is not None:
        moved = msgspec.structs.replace(answer, **msgspec.structs.asdict(here))
        return None if moved == answer else moved
    if answer.path in places:
        return msgspec.structs.replace(answer, verdict=SUPERSEDED, reason=f"{answer.path} contains another recording now")
    return None


def update(
    catalogue: Catalogue, jobs: Sequence[DiagnosisJob], *, scheduler: str | None = None,
    tell: Callable[[StoredAnswer], None] = lambda answer: None,
) -> list[StoredAnswer]:  # fmt: skip
    """Do the work, store each answer when it is complete, merge the catalogue's files, and return the answers.

    `tell` is called with each answer. For the scheduler, whose workers see the same files, see `shared_out`. Raises RigError if
    answers cannot be stored, or the workers cannot be used: the remaining work is not started, and stored answers are kept.
    """
    answers = []
    for answer in _answers(catalogue, jobs, scheduler):
        answers.append(answer)
        tell(answer)
    catalogue.compact()
    return answers


def _answers(catalogue: Catalogue, jobs: Sequence[DiagnosisJob], scheduler: str | None) -> Iterator[StoredAnswer]:
    left = list(jobs)
    while left:
        busy = []
        for job, result in shared_out(answer_job, left, scheduler):
            if isinstance(result, RigError):
                raise result
            if isinstance(result, Exception):
                # Its workers died, or it could not be sent: reported, and tried again by an update with --again.
                why = f"{job.answer.path}: the diagnosis ended its worker ({reason(result)}); check the worker's memory"
                answer = msgspec.structs.replace(job.answer, verdict=FAILED, reason=why)
                catalogue.put(answer)
                yield answer
            elif result is None:
                busy.append(job)
            else:
                yield result
        # Those that another process was working on and has not answered: it may have died.
        stored = _Stored(catalogue).answers if busy else {}
        left = [job for job in busy if job.answer.key not in stored]
        if left:
            time.sleep(PATIENCE)


def watch(
    catalogue: Catalogue, folders: Mapping[Path, str | None], baseline: Baseline, *, limit: float | None = None,
    scheduler: str | None = None, every: float = EVERY, seconds: float | None = None, tell: Callable[[str], None] = print,
) -> None:  # fmt: skip
    """Diagnose new recordings as they arrive, and report each answer and each change of a rig in a line.

    `folders` have the rig of each; they are read every `every` seconds, for `seconds` or without limit if None. A recording that
    is still being copied grows: it is diagnosed once it is the same in two successive readings.
    """
    before: dict[str, Recording] = {}
    handed: dict[str, Recording] = {}
    end = None if seconds is None else time.monotonic() + seconds
    while True:
        now = {recording.path: recording for recording in recordings_under(folders)}
        fresh = [r for path, r in now.items() if before.get(path) == r != handed.get(path)]
        before, handed = now, handed | {r.path: r for r in fresh}
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
