"""Diagnosis of many campaigns: in parallel, skipping those with an answer, with one summary."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from isorig.analysis.parallel import cores
from isorig.rig.choices import Baseline
from isorig.rig.errors import REFUSALS, PlanError, RigError
from isorig.rig.files.output import csv_text

if TYPE_CHECKING:
    from isorig.rig.files.findings import Findings

J = TypeVar("J")
R = TypeVar("R")


class CampaignOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """A line of the summary.

    `cut_short` states that the time limit ended the search for causes; `refusal` is the reason why a recording could not be used,
    otherwise empty; `doubts` lists implausible units or given values, to be checked first; `answer` is the answer in a sentence.
    """

    campaign: str
    verdict: str = ""
    causes: str = ""
    locations: str = ""
    holdout_baseline: float | None = None
    holdout_extended: float | None = None
    noise_floor: float | None = None
    cut_short: bool = False
    refusal: str = ""
    doubts: str = ""
    answer: str = ""


def diagnose_file(
    file: Path, folder: Path, baseline: Baseline, tell: Callable[[str], None] = lambda text: None, *, tolerance: float = 0.0,
    limit: float | None = None, page: bool = True,
) -> CampaignOutcome:  # fmt: skip
    """Diagnose one recording into a folder; `tell` is called with a line for each stage, and `page` is whether to write a page.

    The `tolerance` is the error, as a share of the signal, that counts as adequate, and `limit` the seconds of processor time for
    all of it: the search for causes ends so early that uncertainties and page are done by then, and the answer, what was found so
    far, states this. Raises RigError or AnalysisError if the recording cannot be used; nothing is written then.
    """
    from isorig.analysis.deadline import Deadline
    from isorig.analysis.diagnose.diagnosis import diagnose
    from isorig.rig.diagnose.answer import write_answer
    from isorig.rig.files.recording import read
    from isorig.rig.model.baseline import baseline_model

    with Deadline(limit):
        tell("reading")
        campaign = read(file)
        found = diagnose(campaign, baseline_model(campaign, baseline), tolerance=tolerance, progress=tell)
    tell("writing the answer")
    origin = {"baseline": baseline, **fingerprint(file)}
    return _outcome(write_answer(folder, found, campaign, origin, limit=limit, page=page))


def diagnose_files(
    jobs: Sequence[tuple[Path, Path]], baseline: Baseline, *, scheduler: str | None = None, again: bool = False,
    tolerance: float = 0.0, limit: float | None = None,
) -> Iterator[CampaignOutcome]:  # fmt: skip
    """Diagnose recordings into a folder each, yielding outcomes as they arrive; those with an answer come first.

    With `again`, those are diagnosed, too. For the scheduler see `shared_out`, for tolerance and limit `diagnose_file`.
    """
    from isorig.rig.files.findings import read_findings

    left = []
    for file, folder in jobs:
        origin = {"baseline": baseline, **fingerprint(file)} if file.is_file() and not again else None
        if origin is not None and answered(folder, origin, tolerance=tolerance, limit=limit):
            yield _outcome(read_findings(folder))
        else:
            left.append((file.resolve(), folder.resolve()))
    answer = partial(_answer, baseline=baseline, tolerance=tolerance, limit=limit)
    for (file, _), outcome in shared_out(answer, left, scheduler):
        yield outcome if isinstance(outcome, CampaignOutcome) else _refused(file, str(outcome))


def time_limit(seconds: float | None) -> float | None:
    """The same seconds; None for infinity. Raises RigError if they are not a valid time limit."""
    if seconds is not None and not seconds > 0.0:
        raise RigError(f"--seconds is {seconds:g}; give a positive time, or inf for no limit")
    return None if seconds is not None and math.isinf(seconds) else seconds


def tolerated(share: float) -> float:
    """The same share of the signal. Raises RigError if it is not a valid tolerance."""
    if not 0.0 <= share < math.inf:
        raise RigError(f"--tolerance is {share:g}; give a share of the signal that is not negative, e.g. 0.05 for 5 %")
    return share


def _answer(job: tuple[Path, Path], **how: Any) -> CampaignOutcome:
    try:
        return diagnose_file(*job, **how)
    except (*REFUSALS, OSError) as refusal:
        return _refused(job[0], str(refusal))


def _refused(file: Path, why: str) -> CampaignOutcome:
    return CampaignOutcome(campaign=file.stem, verdict="refused", refusal=why)


def shared_out(function: Callable[[J], R], jobs: Iterable[J], scheduler: str | None = None) -> Iterator[tuple[J, R | Exception]]:
    """Do jobs in parallel, yielding each with its result as it arrives, or with the exception that ended it.

    Few jobs wait at a time, so that no longer taking results stops the rest. They are done by threads of this process, or by the
    workers of a Dask scheduler (`isorig.rig.diagnose.cluster.on_cluster`), for which function and jobs must be picklable. Raises
    RigError if the cluster cannot be used.
    """
    if scheduler is None:
        return _in_threads(function, iter(jobs))
    from isorig.rig.diagnose.cluster import on_cluster

    return on_cluster(function, jobs, scheduler)


def _in_threads(function: Callable[[J], R], waiting: Iterator[J]) -> Iterator[tuple[J, R | Exception]]:
    # An interrupted command does not wait for these threads, as it would for those of concurrent.futures.
    todo: SimpleQueue[J | None] = SimpleQueue()
    done: SimpleQueue[tuple[J, R | Exception]] = SimpleQueue()

    def work() -> None:
        while (job := todo.get()) is not None:
            try:
                done.put((job, function(job)))
            except Exception as failure:
                done.put((job, failure))

    first = list(islice(waiting, cores()))
    for job in first:
        todo.put(job)
        Thread(target=work, daemon=True).start()
    left = len(first)
    try:
        while left:
            yield done.get()
            following = next(waiting, None)
            left -= following is None
            if following is not None:
                todo.put(following)
    finally:
        for _ in first:
            todo.put(None)


def fingerprint(file: Path) -> dict[str, str]:
    """Origin of a result: the recording's name and hash, and the version of this program. Raises RigError if the file cannot be
    read."""
    try:
        with file.open("rb") as stream:
            digest = hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise RigError(f"{file} cannot be read ({error.strerror}); give the path of a recording") from None
    return {"recording": file.name, "sha256": digest, "version": program_version()}


def program_version() -> str:
    """The version of this program: an answer of another version may differ."""
    return version("isorig")


def answered(folder: Path, origin: dict[str, str], *, tolerance: float = 0.0, limit: float | None = None) -> bool:
    """Whether the folder has findings for that baseline, recording, version and tolerance that more time would not change."""
    from isorig.rig.files.findings import read_findings

    try:
        found = read_findings(folder)
    except PlanError:
        return False
    enough = not found.cut_short or (limit is not None and found.time_limit_s is not None and limit <= found.time_limit_s)
    return found.origin == origin and found.tolerance == tolerance and enough


def _outcome(found: Findings) -> CampaignOutcome:
    from isorig.rig.report.conclusion import conclude

    return CampaignOutcome(
        campaign=Path(found.origin["recording"]).stem, verdict=found.verdict,
        causes="+".join(step.cause for step in found.steps), locations="+".join(step.location for step in found.steps),
        holdout_baseline=found.holdout.baseline, holdout_extended=found.holdout.extended,
        noise_floor=found.holdout.noise_floor, cut_short=found.cut_short,
        doubts=" ".join(doubt.text for doubt in found.doubts), answer=conclude(found).answer,
    )  # fmt: skip


def summary(outcomes: Sequence[CampaignOutcome]) -> str:
    """The summary of many campaigns as CSV, in the order of their names."""
    ordered = sorted(outcomes, key=lambda o: o.campaign)
    return csv_text(CampaignOutcome.__struct_fields__, map(msgspec.structs.astuple, ordered))


def recordings_in(given: Sequence[Path]) -> list[Path]:
    """The given recordings; a folder stands for all of its .h5 files. Raises RigError if there is none, or two have the same
    name."""
    files = [f for place in given for f in (sorted(place.glob("*.h5")) if place.is_dir() else [place])]
    if not files:
        raise RigError("no recording was given; give a file, or a folder that contains .h5 files")
    names = [file.stem for file in files]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise RigError(f"two recordings are named {twice!r}; rename one, because each answer goes to a folder of that name")
    return files
