"""The catalogue of a fleet: Parquet files that pandas and SQL read, and the only thing that keeps state.

::

    fleet/
      folders/     one small file for each folder that was added
      answers/     one small file for each answer, and compacted ones (all-*.parquet); long format, a row a parameter
      changes/     one small file for each change whose cause was looked for
      diagnoses/   findings.json and the models of each answer

An answer belongs to the content of a recording, the version of the program and the baseline; these name its file, so writing it
twice does no harm. Every file is written whole under a temporary name and then put in place.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from isorig.rig.errors import OutputError, RigError
from isorig.rig.files.output import replaced

if TYPE_CHECKING:
    import pandas as pd

#: Columns of an answer; the last five say what is needed to tell a recording again without reading it.
SCHEMA = pa.schema(
    [
        ("rig", pa.string()), ("campaign", pa.string()), ("started", pa.timestamp("us", "UTC")), ("parameter", pa.string()),
        ("value", pa.float64()), ("std", pa.float64()), ("verdict", pa.string()), ("cause", pa.string()),
        ("version", pa.string()), ("content", pa.string()), ("unit", pa.string()), ("baseline", pa.string()),
        ("alike", pa.string()), ("reason", pa.string()), ("path", pa.string()), ("size", pa.int64()),
        ("modified", pa.int64()),
    ]
)  # fmt: skip
FOLDERS = pa.schema([("folder", pa.string()), ("rig", pa.string())])
CHANGES = pa.schema(
    [
        ("rig", pa.string()), ("before", pa.string()), ("after", pa.string()), ("version", pa.string()),
        ("baseline", pa.string()), ("rank", pa.int64()), ("cause", pa.string()), ("location", pa.string()),
        ("parameter", pa.string()), ("old", pa.float64()), ("new", pa.float64()), ("std", pa.float64()),
        ("unit", pa.string()), ("share", pa.float64()), ("alike", pa.bool_()),
    ]
)  # fmt: skip
#: Small files from which on an update makes one file of them.
COMPACT = 200
#: Verdicts of recordings that gave no parameters: refused for what is in them, stopped by the time limit, failed for another
#: reason, and replaced by another recording at the same place.
REFUSED, LATE, FAILED, SUPERSEDED = "refused", "timed out", "failed", "superseded"
WITHOUT = (REFUSED, LATE, FAILED, SUPERSEDED)
#: Name of the row that keeps the time limit of a diagnosis that it stopped or cut short, s.
LIMIT = "time_limit"

R = TypeVar("R")


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """A value that a diagnosis gave: its path in the model, or cause, place and name; NaN where there is no deviation."""

    name: str
    value: float
    std: float
    unit: str = ""


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """What a diagnosis said of a recording.

    Parameters
    ----------
    rig, campaign
        Names of the folder and of the file without its ending.
    started
        When the first run began, where the recording says so.
    verdict
        Of the diagnosis, or one of `WITHOUT`.
    cause, alike
        Named causes as "cause at place", joined by " + "; all that the data cannot tell from them likewise, among them the kind
        of a form and the forms of a kind.
    reason
        Why there is no answer, or only a partial one, in a sentence.
    content, version, baseline
        SHA-256 of the recording, version of the program, name of the baseline: together the key.
    path, size, modified
        Where the recording was seen, its bytes, and its time of modification in ns.
    parameters
        What was fitted.
    """

    rig: str
    campaign: str
    content: str
    version: str
    baseline: str
    path: str
    size: int
    modified: int
    verdict: str
    started: datetime | None = None
    cause: str = ""
    alike: str = ""
    reason: str = ""
    parameters: tuple[Parameter, ...] = ()

    @property
    def key(self) -> str:
        """Name of the answer's file without its ending."""
        return key_of(self.content, self.version, self.baseline)


def key_of(content: str, version: str, baseline: str) -> str:
    """Name of an answer."""
    return f"{content[:32]}-{version}-{baseline}"


class Catalogue:
    """The files of a fleet in a folder.

    Parameters
    ----------
    folder
        Where they are; made when something is put there.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def existing(self) -> Catalogue:
        """The same catalogue.

        Raises
        ------
        RigError
            Where there is none.
        """
        if not (self.folder / "folders").is_dir():
            raise RigError(f"{self.folder} is no fleet's catalogue; make one with rig fleet add FOLDER, or name another with -c")
        return self

    # Folders

    def add_folder(self, folder: Path, rig: str | None) -> None:
        """Remember a folder of recordings, all of one rig where it is named."""
        name = hashlib.sha256(str(folder).encode()).hexdigest()[:16]
        _write(self.folder / "folders" / f"{name}.parquet", pa.table({"folder": [str(folder)], "rig": [rig]}, schema=FOLDERS))

    def folders(self) -> dict[Path, str | None]:
        """The folders that were added, and the rig that each stands for."""
        rows = [row for path in (self.folder / "folders").glob("*.parquet") for row in _load(path, FOLDERS).to_pylist()]
        return {Path(row["folder"]): row["rig"] for row in sorted(rows, key=lambda row: str(row["folder"]))}

    # Answers

    def diagnosis(self, key: str) -> Path:
        """The folder of an answer's findings.json and models."""
        return self.folder / "diagnoses" / key[:2] / key

    def put(self, answer: Answer) -> None:
        """Store an answer in the place of an earlier one of its key.

        Raises
        ------
        OutputError
            Where it could not be written; nothing else is touched then.
        """
        _write(self.folder / "answers" / answer.key[:2] / f"{answer.key}.parquet", _rows(answer))

    def answers(self) -> pd.DataFrame:
        """All answers, a row a parameter, in the order of rig and time; those without parameters have one row."""
        frame: pd.DataFrame = self.table().to_pandas()
        return frame

    def table(self) -> pa.Table:
        """The same as an Arrow table."""
        return retried(self._read_answers)

    def _read_answers(self) -> pa.Table:
        return _latest(self._small_answers(), self._whole_answers())

    def _small_answers(self) -> list[Path]:
        return sorted((self.folder / "answers").glob("??/*.parquet"))

    def _whole_answers(self) -> list[Path]:
        # The latest last.
        return sorted((self.folder / "answers").glob("all-*.parquet"), key=lambda path: (path.stat().st_mtime_ns, path.name))

    def compact(self, fewest: int = COMPACT) -> None:
        """Make one file of all answers, where there are at least so many small ones.

        Broken off at any point it leaves every answer in at least one file; two at once do no harm.
        """
        if len(self._small_answers()) < fewest:
            return

        def once() -> None:
            small, whole = self._small_answers(), self._whole_answers()
            stamps = [path.stat().st_mtime_ns for path in small]
            stream = pa.BufferOutputStream()
            _save(stream, _latest(small, whole))
            content = stream.getvalue()
            target = self.folder / "answers" / f"all-{hashlib.sha256(content).hexdigest()[:16]}.parquet"
            _put_in_place(target, lambda temporary: temporary.write_bytes(content))
            # What is older goes first: broken off here, a small file still comes before what was compacted.
            for path in whole:
                if path != target:
                    path.unlink(missing_ok=True)
            for path, stamp in zip(small, stamps, strict=True):
                # One that was written anew in the meantime stays.
                if path.exists() and path.stat().st_mtime_ns == stamp:
                    path.unlink(missing_ok=True)

        retried(once)

    # Changes

    def put_change(self, name: str, rows: Sequence[dict[str, object]]) -> None:
        """Store which causes explain a change, best first."""
        _write(self.folder / "changes" / f"{name}.parquet", pa.Table.from_pylist(list(rows), schema=CHANGES))

    def explained(self) -> set[str]:
        """Names of the changes whose cause was looked for."""
        return {path.stem for path in (self.folder / "changes").glob("*.parquet")}

    def change(self, name: str) -> list[dict[str, Any]]:
        """What explains a change, best first; empty where nothing does.

        Raises
        ------
        RigError
            Where it was not looked for.
        """
        return self.changes([name])[name]

    def changes(self, names: Iterable[str] | None = None) -> dict[str, list[dict[str, Any]]]:
        """What explains each change that was looked into, by its name, best first; empty where nothing does."""
        rows: dict[str, list[dict[str, Any]]] = {}
        for name in sorted(self.explained()) if names is None else names:
            found = _load(self.folder / "changes" / f"{name}.parquet", CHANGES).to_pylist()
            rows[name] = [row for row in found if row["cause"]]
        return rows


def retried(function: Callable[[], R]) -> R:
    """The function's result; called again where a file was compacted away under its hands."""
    for _ in range(20):
        try:
            return function()
        except FileNotFoundError:
            continue
    return function()


def _rows(answer: Answer) -> pa.Table:
    found = sorted(answer.parameters, key=lambda p: p.name) or [Parameter(name="", value=float("nan"), std=float("nan"))]
    common = {name: value for name, value in msgspec.structs.asdict(answer).items() if name != "parameters"}
    if answer.started is not None:
        common["started"] = answer.started.astimezone(UTC)
    return pa.Table.from_pylist(
        [{**common, "parameter": p.name, "value": p.value, "std": p.std, "unit": p.unit} for p in found], schema=SCHEMA
    )


def _latest(small: Iterable[Path], whole: Iterable[Path]) -> pa.Table:
    # A small file is newer than what was compacted; of compacted files that a break left side by side either will do.
    tables = [_load(path, SCHEMA) for path in whole]
    merged = tables[0] if tables else SCHEMA.empty_table()
    for table in (*tables[1:], *_batches(small)):
        known, fresh = (
            pc.binary_join_element_wise(*(t[k] for k in ("content", "version", "baseline")), "|") for t in (merged, table)
        )
        merged = pa.concat_tables([merged.filter(pc.invert(pc.is_in(known, value_set=pc.unique(fresh)))), table])
    return merged.sort_by(
        [(k, "ascending") for k in ("rig", "started", "campaign", "content", "version", "baseline", "parameter")]
    )


def _batches(small: Iterable[Path]) -> Iterator[pa.Table]:
    tables = [_load(path, SCHEMA) for path in small]
    if tables:
        yield pa.concat_tables(tables)


def _load(path: Path, schema: pa.Schema) -> pa.Table:
    try:
        return pq.ParquetFile(path).read().cast(schema)
    except FileNotFoundError:
        raise
    except (OSError, pa.ArrowInvalid, ValueError) as error:
        told = (str(error).splitlines() or [""])[0]
        raise RigError(f"{path} is damaged ({told}); remove it and run rig fleet update, which makes it again") from None


def _save(place: Any, table: pa.Table) -> None:
    pq.write_table(table, place, compression="zstd")


def _write(path: Path, table: pa.Table) -> None:
    _put_in_place(path, lambda temporary: _save(temporary, table))


def _put_in_place(path: Path, write: Callable[[Path], object]) -> None:
    try:
        with replaced(path) as temporary:
            write(temporary)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path} could not be written ({error.strerror or error}); make room and start again") from None
