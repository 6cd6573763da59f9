"""Updates the catalogue: diagnoses every recording without an answer; a failure does not stop the others."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from isorig.rig.diagnose.many import program_version, shared_out
from isorig.rig.errors import RigError
from isorig.rig.fleet.catalogue import FAILED, LIMIT, SUPERSEDED, WITHOUT, Catalogue, StoredAnswer, StoredParameter, key_of
from isorig.rig.fleet.job import DiagnosisJob, JobResult, answer_job
from isorig.rig.fleet.recordings import Recording, identified, recordings_under
from isorig.rig.model.baseline import Baseline

#: Seconds between checks of a recording that another process works on.
PATIENCE = 0.5


@dataclass(frozen=True, kw_only=True)
class Work:
    """The work of an update.

    Parameters
    ----------
    jobs
        Recordings without an answer, grouped by rig and sorted by name.
    known
        Number of recordings with an answer.
    notes
        Sentences about folders and recordings that could not be used as they are.
    """

    jobs: tuple[DiagnosisJob, ...]
    known: int
    notes: tuple[str, ...]


@dataclass
class Updated:
    """Result of an update: answers by verdict, and sentences about recordings without an answer."""

    done: int = 0
    without: list[StoredAnswer] = field(default_factory=list)


def work_of(
    catalogue: Catalogue,
    baseline: Baseline,
    *,
    limit: float | None = None,
    pages: bool = False,
    again: bool = False,
    reread: bool = False,
    only: Sequence[Recording] | None = None,
) -> Work:
    """Compare the folders with the catalogue; the entries of moved or replaced recordings are corrected.

    Parameters
    ----------
    catalogue
        Has the folders that were added.
    baseline
        Name of the baseline.
    limit, pages
        As for `DiagnosisJob`.
    again
        Whether recordings whose diagnosis failed or took too long are tried again.
    reread
        Whether every file is read, not only those with a new size or modification time.
    only
        Restrict to these recordings.
    """
    folders = catalogue.folders()
    stored = _Stored(catalogue)
    sound = [a for a in stored.answers.values() if a.verdict != SUPERSEDED]
    known = {} if reread else {(a.path, a.size, a.modified): a.content for a in sound}
    found = identified(recordings_under(folders) if only is None else only, known)
    notes = [] if only is not None else [
        f"{folder} cannot be accessed; its recordings keep their answers" for folder in folders if not folder.is_dir()
    ]  # fmt: skip
    notes += [f"{r.path} cannot be read; make it a readable file, not a pipe or a device" for r in found if not r.content]
    first, notices = _placed([r for r in found if r.content], sound)
    places = {str(r.path) for r in found if r.content}
    for answer in sound:
        changed = _corrected(answer, first, places)
        if changed is not None:
            catalogue.put(msgspec.structs.replace(changed, parameters=stored.whole(answer).parameters))
            stored.answers[answer.key] = changed
    jobs = []
    for blank in (_blank(r, baseline) for r in first.values()):
        old = stored.answers.get(blank.key)
        if old is None or _worth_trying(old, limit, again):
            retry = old is not None and old.verdict != SUPERSEDED
            jobs.append(
                DiagnosisJob(catalogue=str(catalogue.folder.resolve()), answer=blank, limit=limit, pages=pages, again=retry)
            )
    return Work(jobs=tuple(jobs), known=len(first) - len(jobs), notes=(*notes, *notices))


def _blank(recording: Recording, baseline: Baseline) -> StoredAnswer:
    return StoredAnswer(
        rig=recording.rig, campaign=recording.campaign, content=recording.content, version=program_version(), baseline=baseline,
        path=str(recording.path), size=recording.size, modified=recording.modified, verdict="",
    )  # fmt: skip


def _worth_trying(old: StoredAnswer, limit: float | None, again: bool) -> bool:
    if old.verdict == SUPERSEDED:
        return True
    given = next((p.value for p in old.parameters if p.name == LIMIT), None)
    if given is not None:
        return again or limit is None or limit > given
    return again and old.verdict == FAILED


class _Stored:
    # Content of the catalogue: every answer without its parameters except for a time limit, and the parameters on request.

    def __init__(self, catalogue: Catalogue) -> None:
        self._frame = catalogue.answers()
        rows = self._frame[self._frame.parameter == LIMIT]
        limits = dict(zip(map(key_of, rows.content, rows.version, rows.baseline), rows.value, strict=True))
        columns = [name for name in StoredAnswer.__struct_fields__ if name != "parameters"]
        self.answers: dict[str, StoredAnswer] = {}
        first = self._frame.drop_duplicates(["content", "version", "baseline"])
        self._rows = {}
        for at, row in zip(first.index, first[columns].to_dict("records"), strict=True):
            kept: Any = {name: row[name] for name in columns}
            kept["started"] = None if row["started"] != row["started"] else row["started"].to_pydatetime()
            answer = StoredAnswer(**kept)
            if answer.key in limits:
                stopped = StoredParameter(name=LIMIT, value=limits[answer.key], std=math.nan, unit="s")
                answer = msgspec.structs.replace(answer, parameters=(stopped,))
            self.answers[answer.key] = answer
            self._rows[answer.key] = at

    def whole(self, answer: StoredAnswer) -> StoredAnswer:
        # Rows of an answer are adjacent.
        start = self._rows[answer.key]
        rows = []
        for row in self._frame.iloc[start : start + 1000].to_dict("records"):
            if key_of(row["content"], row["version"], row["baseline"]) != answer.key:
                break
            rows.append(row)
        found = (
            StoredParameter(name=r["parameter"], value=r["value"], std=r["std"], unit=r["unit"]) for r in rows if r["parameter"]
        )
        return msgspec.structs.replace(answer, parameters=tuple(found))


def _placed(recordings: Sequence[Recording], stored: Sequence[StoredAnswer]) -> tuple[dict[str, Recording], list[str]]:
    # One path for each content: the earlier one if it still exists, otherwise the first.
    notes, first = [], {}
    at = {str(r.path): r.content for r in recordings}
    contents = set(at.values())
    kept = {
        a.content: a.path
        for a in stored
        if a.content in contents and (at[a.path] == a.content if a.path in at else Path(a.path).is_file())
    }
    for r in sorted(recordings, key=lambda r: (r.rig, str(r.path))):
        wanted = kept.setdefault(r.content, str(r.path))
        if wanted == str(r.path):
            first[r.content] = r
        else:
            notes.append(f"{r.path} is the same recording as {wanted}, which is used; remove one of them")
    return first, notes


def _corrected(answer: StoredAnswer, first: Mapping[str, Recording], places: Set[str]) -> StoredAnswer | None:
    # The answer with the present path of its recording; None if nothing has changed.
    here = first.get(answer.content)
    if here is not None:
        moved = msgspec.structs.replace(
            answer, rig=here.rig, campaign=here.campaign, path=str(here.path), size=here.size, modified=here.modified
        )
        return None if moved == answer else moved
    if answer.path in places:
        return msgspec.structs.replace(answer, verdict=SUPERSEDED, reason=f"{answer.path} contains another recording now")
    return None


def update(
    catalogue: Catalogue,
    jobs: Sequence[DiagnosisJob],
    *,
    scheduler: str | None = None,
    tell: Callable[[StoredAnswer], None] = lambda answer: None,
) -> Updated:
    """Do the work, store each answer when it is complete, and merge the catalogue's files.

    Parameters
    ----------
    catalogue, jobs
        From `work_of`.
    scheduler
        Dask scheduler, as for `shared_out`, whose workers see the same files; threads of this process if None.
    tell
        Called with each answer.

    Raises
    ------
    RigError
        Answers cannot be stored, or the workers cannot be used: the remaining work is not started, and stored answers are kept.
    """
    updated = Updated()
    for answer in _answers(catalogue, jobs, scheduler):
        updated.done += 1
        if answer.verdict in WITHOUT:
            updated.without.append(answer)
        tell(answer)
    catalogue.compact()
    return updated


def _answers(catalogue: Catalogue, jobs: Sequence[DiagnosisJob], scheduler: str | None) -> Iterator[StoredAnswer]:
    left = deque(jobs)
    while left:
        busy = []
        for job, result in shared_out(answer_job, left, scheduler):
            if isinstance(result, JobResult):
                if result.stop:
                    raise RigError(result.stop)
                if result.answer is None:
                    busy.append(job)
                else:
                    yield result.answer
            else:
                # Its workers died, or it could not be sent: reported, and tried again by an update with --again.
                why = f"{job.answer.path}: the diagnosis ended its worker ({_last(result)}); check the worker's memory"
                answer = msgspec.structs.replace(job.answer, verdict=FAILED, reason=why)
                catalogue.put(answer)
                yield answer
        left = deque(_unanswered(catalogue, busy))
        if left:
            time.sleep(PATIENCE)


def _unanswered(catalogue: Catalogue, busy: Sequence[DiagnosisJob]) -> list[DiagnosisJob]:
    # Those that another process was working on and has not answered: it may have died.
    if not busy:
        return []
    stored = _Stored(catalogue).answers
    return [job for job in busy if job.answer.key not in stored]


def _last(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:200]
