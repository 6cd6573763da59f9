"""Diagnosis of one recording of a fleet, in any process or on any machine."""

import errno
import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path

import msgspec

from isorig.analysis.diagnose.kinds import FORMS
from isorig.rig.acquire.locks import HeldError, locked
from isorig.rig.choices import Baseline
from isorig.rig.diagnose.many import answered, diagnose_file, program_version
from isorig.rig.errors import REFUSALS, OutputError, PlanError, RigError
from isorig.rig.files.findings import NamedCause, Value, read_findings
from isorig.rig.fleet.catalogue import FAILED, LIMIT, REFUSED, Catalogue, StoredAnswer, StoredParameter

#: Errors for missing disk space or quota.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class DiagnosisJob(msgspec.Struct, frozen=True, kw_only=True):
    """A recording to be diagnosed, the catalogue for its answer, and the known part of it: rig, recording, version and baseline.

    `limit` is a time limit in seconds; with `again`, it is diagnosed although there are findings.
    """

    catalogue: str
    answer: StoredAnswer
    limit: float | None = None
    pages: bool = False
    again: bool = False


def answer_job(job: DiagnosisJob) -> StoredAnswer | None:
    """Diagnose a recording, store the answer, and return it; None if another process is working on it. Raises RigError if the
    update cannot continue: answers cannot be stored, or this worker runs another version of the program."""
    if program_version() != job.answer.version:
        raise RigError(
            f"a worker runs version {program_version()} of this program, not {job.answer.version}; "
            "install the same on all workers"
        )
    catalogue = Catalogue(Path(job.catalogue))
    folder = catalogue.diagnosis(job.answer.key)
    with alone_in(folder) as free:
        if not free:
            return None
        answer = _answered(job, folder)
        catalogue.put(answer)
        return answer


def _answered(job: DiagnosisJob, folder: Path) -> StoredAnswer:
    blank, path = job.answer, Path(job.answer.path)
    origin = {"baseline": blank.baseline, "recording": path.name, "sha256": blank.content, "version": blank.version}
    try:
        if job.again or not answered(folder, origin, limit=job.limit):
            baseline: Baseline = "linear" if blank.baseline == "linear" else "coulomb"
            diagnose_file(path, folder, baseline, limit=job.limit, page=job.pages)
    except OutputError:
        raise
    except REFUSALS as refusal:
        return msgspec.structs.replace(blank, verdict=REFUSED, reason=str(refusal))
    except OSError as error:
        if error.errno in FULL:
            raise OutputError(f"{job.catalogue}: {error.strerror}; make room and update again") from None
        return msgspec.structs.replace(blank, verdict=FAILED, reason=f"{path}: {error}; update again")
    except Exception as error:  # one recording that crashes the program must not stop a thousand others
        text = f"{path}: the program failed ({type(error).__name__}: {error}); report it, and update again with --again"
        return msgspec.structs.replace(blank, verdict=FAILED, reason=text)
    try:
        if not answered(folder, origin, limit=job.limit):
            raise RigError(f"{path} was changed while it was diagnosed; update again")
        return from_findings(folder, blank)
    except RigError as error:
        return msgspec.structs.replace(blank, verdict=FAILED, reason=str(error))


def from_findings(folder: Path, blank: StoredAnswer) -> StoredAnswer:
    """The answer from findings.json and baseline.json of a folder. Raises RigError if they are not the output of a diagnosis."""
    try:
        found = read_findings(folder)
        began = msgspec.json.decode((folder / "baseline.json").read_bytes()).get("origin")
        started = None if began is None else datetime.fromisoformat(began)
    except (PlanError, OSError, msgspec.DecodeError, TypeError, ValueError, AttributeError) as error:
        raise RigError(
            f"{folder} does not contain the output of a diagnosis ({error}); remove it and update again with --again"
        ) from None
    names = [f"{step.cause} at {step.location}" for step in found.steps]
    alike = {f"{x.cause} at {x.location}" for group in found.indistinguishable for x in group}
    alike |= {name for step in found.steps for name in _same(step)}
    # A cause biases the values of a model without it: with a cause they are those of the model that has it, as far as the
    # baseline has them, too.
    own = found.baseline.parameters
    if found.steps:
        own = {name: found.extended.parameters[name] for name in own if name in found.extended.parameters}
    # Without an uncertainty they were not fitted: the time ended before.
    rows = [_parameter(name, row) for name, row in own.items() if row.std is not None or not found.cut_short]
    rows += [
        _parameter(f"{step.cause}.{step.location}.{name}", row) for step in found.steps for name, row in step.parameters.items()
    ]
    reason = ""
    if found.cut_short and found.time_limit_s is not None:
        rows.append(StoredParameter(name=LIMIT, value=found.time_limit_s, std=math.nan, unit="s"))
        reason = f"the time limit of {found.time_limit_s:g} s ended the search for causes before all were tried"
    return msgspec.structs.replace(
        blank, verdict=found.verdict, cause=" + ".join(names), alike=" + ".join(sorted(alike)), reason=reason,
        started=started, parameters=tuple(row for row in rows if row is not None),
    )  # fmt: skip


def _same(step: NamedCause) -> list[str]:
    # One campaign may identify the kind at a place, the next one its form: these are not different causes.
    forms = (step.kind,) if step.level == "form" else FORMS.get(step.kind, ())
    return [f"{word} at {step.location}" for word in forms]


def _parameter(name: str, row: Value) -> StoredParameter | None:
    if row.value is None:
        return None
    return StoredParameter(name=name, value=row.value, std=math.nan if row.std is None else row.std, unit=row.unit)


@contextmanager
def alone_in(folder: Path) -> Iterator[bool]:
    """Whether no other process works in a folder; none can during the block.

    The lock belongs to the system and ends with its process. On a file system without locks, two processes may do the same work
    twice, which costs time only.
    """
    with ExitStack() as stack:
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            stack.enter_context(locked(folder.with_name(f".{folder.name}.lock")))
            free = True
        except HeldError:
            free = False
        except NotImplementedError:  # a file system without locks
            free = True
        except OSError as error:
            raise OutputError(
                f"{folder} cannot be created ({error.strerror}); make room, or give another catalogue with -c"
            ) from None
        yield free
