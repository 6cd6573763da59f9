"""The catalogue of a fleet: Parquet files for pandas and SQL (DuckDB), and the only state of a fleet.

::

    fleet/
      folders/     one small file for each folder that was added
      answers/     one small file for each answer, and merged ones (all-*.parquet); long format, a row for each parameter
      changes/     one small file for each change whose cause was searched for
      diagnoses/   findings.json and the models of each answer

An answer is identified by the content of a recording, the version of the program and the baseline; these give the name of its
file, so writing it twice is harmless. Every file is first written under a temporary name and then renamed.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from isorig.rig.errors import OutputError, RigError, TimeLimitError
from isorig.rig.files.output import csv_text, replaced
from isorig.rig.fleet.recordings import Recording

if TYPE_CHECKING:
    import pandas as pd

#: Columns of an answer; the last five identify a recording without reading it.
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
#: Number of small files above which an update merges them.
COMPACT = 200
#: Verdicts of recordings without parameters: rejected for their content, stopped by the time limit, failed for another reason,
#: and replaced by another recording at the same path.
REFUSED, FAILED, SUPERSEDED = "refused", "failed", "superseded"
WITHOUT = (REFUSED, FAILED, SUPERSEDED)
#: Name of the row with the time limit of a diagnosis that was stopped or cut short by it, s.
LIMIT = "time_limit"
#: Limits of a query: seconds, rows of its result, and its memory. A fleet's catalogue has about 30 rows for each recording.
SECONDS, ROWS, MEMORY = 60.0, 1_000_000, "2GB"

R = TypeVar("R")


class StoredParameter(msgspec.Struct, frozen=True, kw_only=True):
    """A value from a diagnosis: its path in the model, or cause, place and name; NaN for a missing standard uncertainty."""

    name: str
    value: float
    std: float
    unit: str = ""


class StoredAnswer(Recording, frozen=True, kw_only=True):
    """The result of diagnosing a recording, which `content`, `version` and `baseline` identify."""

    #: Version of the program, name of the baseline.
    version: str
    baseline: str
    verdict: str = ""  #: Verdict of the diagnosis, or one of `WITHOUT`.
    started: datetime | None = None  #: Start of the first run, if the recording gives it.
    #: Named causes as "cause at place", joined by " + "; all causes indistinguishable from them, including the kind of a form and
    #: the forms of a kind.
    cause: str = ""
    alike: str = ""
    reason: str = ""  #: Why there is no answer, or a partial one only, in a sentence.
    parameters: tuple[StoredParameter, ...] = ()  #: The fitted parameters.

    @property
    def key(self) -> str:
        """Name of the answer's file without its extension."""
        return key_of(self.content, self.version, self.baseline)


def key_of(content: str, version: str, baseline: str) -> str:
    """Name of an answer."""
    return f"{content[:32]}-{version}-{baseline}"


class Catalogue:
    """The files of a fleet in a folder, which is created when something is stored in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def existing(self) -> Catalogue:
        """The catalogue itself; raises RigError if it does not exist."""
        if not (self.folder / "folders").is_dir():
            raise RigError(f"{self.folder} is not a fleet's catalogue; create it with rig fleet add FOLDER, or give another -c")
        return self

    # Folders

    def add_folder(self, folder: Path, rig: str | None) -> None:
        """Add a folder of recordings, all of one rig if it is named."""
        name = hashlib.sha256(str(folder).encode()).hexdigest()[:16]
        rows = pa.table({"folder": [str(folder)], "rig": [rig]}, schema=FOLDERS)
        _write(self.folder / "folders" / f"{name}.parquet", _encoded(rows))

    def folders(self) -> dict[Path, str | None]:
        """The folders that were added, and the rig of each."""
        rows = [row for path in (self.folder / "folders").glob("*.parquet") for row in _load(path, FOLDERS).to_pylist()]
        return {Path(row["folder"]): row["rig"] for row in sorted(rows, key=lambda row: str(row["folder"]))}

    # Answers

    def diagnosis(self, key: str) -> Path:
        """The folder of an answer's findings.json and models."""
        return self.folder / "diagnoses" / key[:2] / key

    def put(self, answer: StoredAnswer) -> None:
        """Store an answer, replacing an earlier one with the same key. Raises OutputError if it cannot be written; nothing else
        is changed."""
        _write(self.folder / "answers" / answer.key[:2] / f"{answer.key}.parquet", _encoded(_rows(answer)))

    def answers(self) -> pd.DataFrame:
        """All answers, a row for each parameter, sorted by rig and time; those without parameters have one row."""
        frame: pd.DataFrame = self.table().to_pandas()
        return frame

    def table(self) -> pa.Table:
        """The same as an Arrow table."""
        return retried(lambda: _latest(self._small_answers(), self._whole_answers()))

    def _small_answers(self) -> list[Path]:
        return sorted((self.folder / "answers").glob("??/*.parquet"))

    def _whole_answers(self) -> list[Path]:
        # The latest last.
        return sorted((self.folder / "answers").glob("all-*.parquet"), key=lambda path: (path.stat().st_mtime_ns, path.name))

    def compact(self, fewest: int = COMPACT) -> None:
        """Merge all answers into one file, if there are at least this many small ones.

        If interrupted at any point, every answer is in at least one file; two processes at once do no harm.
        """
        if len(self._small_answers()) < fewest:
            return

        def once() -> None:
            small, whole = self._small_answers(), self._whole_answers()
            stamps = [path.stat().st_mtime_ns for path in small]
            content = _encoded(_latest(small, whole))
            target = self.folder / "answers" / f"all-{hashlib.sha256(content).hexdigest()[:16]}.parquet"
            _write(target, content)
            # Older files are removed first: if this is interrupted, a small file still takes precedence over merged ones.
            for path in whole:
                if path != target:
                    path.unlink(missing_ok=True)
            for path, stamp in zip(small, stamps, strict=True):
                # A small file that was rewritten in the meantime stays.
                if path.exists() and path.stat().st_mtime_ns == stamp:
                    path.unlink(missing_ok=True)

        retried(once)

    # Changes

    def put_change(self, name: str, rows: Sequence[dict[str, object]]) -> None:
        """Store the causes that explain a change, best first."""
        _write(self.folder / "changes" / f"{name}.parquet", _encoded(pa.Table.from_pylist(list(rows), schema=CHANGES)))

    def explained(self) -> set[str]:
        """Names of the changes whose cause was searched for."""
        return {path.stem for path in (self.folder / "changes").glob("*.parquet")}

    def change(self, name: str) -> list[dict[str, Any]]:
        """The explanations of a change, best first; empty if there is none. Raises RigError if it was not searched for."""
        rows: list[dict[str, Any]] = _load(self.folder / "changes" / f"{name}.parquet", CHANGES).to_pylist()
        return [row for row in rows if row["cause"]]

    def changes(self) -> dict[str, list[dict[str, Any]]]:
        """The explanations of each change that was analysed, by its name."""
        return {name: self.change(name) for name in sorted(self.explained())}


def retried(function: Callable[[], R]) -> R:
    """The function's result; the function is called again if a file was merged away while it was read."""
    for _ in range(20):
        try:
            return function()
        except FileNotFoundError:
            continue
    return function()


def _rows(answer: StoredAnswer) -> pa.Table:
    found = sorted(answer.parameters, key=lambda p: p.name) or [StoredParameter(name="", value=float("nan"), std=float("nan"))]
    common = {name: value for name, value in msgspec.structs.asdict(answer).items() if name != "parameters"}
    if answer.started is not None:
        common["started"] = answer.started.astimezone(UTC)
    return pa.Table.from_pylist(
        [{**common, "parameter": p.name, "value": p.value, "std": p.std, "unit": p.unit} for p in found], schema=SCHEMA
    )


def _latest(small: Iterable[Path], whole: Iterable[Path]) -> pa.Table:
    # A small file is newer than merged ones; of two merged files left by an interruption either will do.
    tables = [_load(path, SCHEMA) for path in whole]
    merged = tables[0] if tables else SCHEMA.empty_table()
    fresh = [_load(path, SCHEMA) for path in small]
    for table in (*tables[1:], *([pa.concat_tables(fresh)] if fresh else [])):
        known, newer = (
            pc.binary_join_element_wise(*(t[k] for k in ("content", "version", "baseline")), "|") for t in (merged, table)
        )
        merged = pa.concat_tables([merged.filter(pc.invert(pc.is_in(known, value_set=pc.unique(newer)))), table])
    return merged.sort_by(
        [(k, "ascending") for k in ("rig", "started", "campaign", "content", "version", "baseline", "parameter")]
    )


def _load(path: Path, schema: pa.Schema) -> pa.Table:
    try:
        return pq.ParquetFile(path).read().cast(schema)
    except FileNotFoundError:
        raise
    except (OSError, pa.ArrowInvalid, ValueError) as error:
        reason = (str(error).splitlines() or [""])[0]
        raise RigError(f"{path} is damaged ({reason}); remove it and run rig fleet update, which creates it again") from None


def _encoded(table: pa.Table) -> pa.Buffer:
    stream = pa.BufferOutputStream()
    pq.write_table(table, stream, compression="zstd")
    return stream.getvalue()


def _write(path: Path, content: pa.Buffer) -> None:
    try:
        with replaced(path) as temporary:
            temporary.write_bytes(content)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path} could not be written ({error.strerror or error}); make room and start again") from None


def query_answers(catalogue: Catalogue, query: str) -> str:
    """The rows of a query as CSV; the table `answers` is the catalogue.

    The query can access this table only: no file, no network. Raises RigError if DuckDB is not installed, the query is empty or
    wrong, or its result is too long; TimeLimitError if the query takes longer than `SECONDS`.
    """
    try:
        import duckdb
    except ImportError:
        raise RigError("SQL needs DuckDB, which is not installed; install it with pip install 'isorig[sql]'") from None
    with duckdb.connect(config={"threads": 1, "memory_limit": MEMORY}) as connection:
        answers = catalogue.table()
        place = answers.schema.get_field_index("started")
        # Without its time zone, which is UTC: DuckDB would need another package to return it.
        connection.register("answers", answers.set_column(place, "started", answers.column(place).cast(pa.timestamp("us"))))
        connection.execute("set enable_external_access = false; set lock_configuration = true")
        late = threading.Timer(SECONDS, connection.interrupt)
        late.daemon = True
        late.start()
        try:
            if not connection.extract_statements(query):
                raise RigError("the query is empty; for example: select distinct rig from answers")
            found = connection.execute(query)
            names, rows = [column[0] for column in found.description or ()], found.fetchmany(ROWS + 1)
        except duckdb.InterruptException:
            raise TimeLimitError(
                f"the query took longer than {SECONDS:g} s; select fewer rows, or aggregate them in the query"
            ) from None
        except duckdb.Error as error:
            reason = (str(error).splitlines() or ["it failed"])[0]
            raise RigError(f"the query is wrong ({reason}); the table is answers, see docs/fleet.md for its columns") from None
        finally:
            late.cancel()
    if len(rows) > ROWS:
        raise RigError(f"the query has more than {ROWS} rows; add a limit, or aggregate them in the query")
    return csv_text(names, rows)
