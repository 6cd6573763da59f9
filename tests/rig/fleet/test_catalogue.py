"""The catalogue's files: whole whatever breaks off, read by others, asked in SQL."""

from __future__ import annotations

import csv
import hashlib
import io
import subprocess
import sys
import threading
from datetime import UTC, datetime
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isorig.rig.cli import main
from isorig.rig.errors import RigError
from isorig.rig.fleet.catalogue import SCHEMA, Catalogue, StoredAnswer, StoredParameter, query_answers

#: The columns that other programs may count on, in this order.
PROMISED = ["rig", "campaign", "started", "parameter", "value", "std", "verdict", "cause", "version", "content"]


def answer(k: int, *, rig: str = "rig-a", version: str = "1.0", value: float = 1.0) -> StoredAnswer:
    return StoredAnswer(
        rig=rig, campaign=f"w{k}", started=datetime(2026, 1, 1 + k % 28, tzinfo=UTC), version=version,
        content=hashlib.sha256(bytes([k])).hexdigest(), baseline="coulomb", path=f"/{rig}/w{k}.h5", size=10, modified=k,
        verdict="adequate",
        parameters=(
            StoredParameter(name="b", value=value, std=0.1, unit="N"), StoredParameter(name="a", value=k, std=0.1, unit="kg"),
        ),
    )  # fmt: skip


def test_other_programs_read_it(tmp_path: Path) -> None:
    store = Catalogue(tmp_path)
    for k in range(3):
        store.put(answer(k))
    found = pd.read_parquet(tmp_path / "answers")
    assert list(found.columns)[: len(PROMISED)] == PROMISED == SCHEMA.names[: len(PROMISED)]
    assert len(found) == 6
    assert found.started.dt.tz is not None
    store.compact(fewest=1)
    again = pd.read_parquet(tmp_path / "answers")
    keys = ["content", "parameter"]
    pd.testing.assert_frame_equal(found.sort_values(keys).reset_index(drop=True), again.sort_values(keys).reset_index(drop=True))


@settings(max_examples=12, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 5), st.sampled_from(["1.0", "1.1"]), st.sampled_from(["compact", "put", "put"])), max_size=12
    )
)
def test_compacting_changes_nothing_that_is_read(
    tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[int, str, str]]
) -> None:
    store = Catalogue(tmp_path_factory.mktemp("store"))
    wanted = {}
    for turn, (k, version, what) in enumerate(steps):
        if what == "compact":
            store.compact(fewest=1)
        else:
            put = answer(k, version=version, value=float(turn))
            store.put(put)
            wanted[put.key] = float(turn)
    rows = store.answers()
    found = {f"{r.content[:32]}-{r.version}-{r.baseline}": r.value for r in rows.itertuples() if r.parameter == "b"}
    assert found == wanted
    assert len(rows) == 2 * len(wanted)


def test_same_answers_same_bytes(tmp_path: Path) -> None:
    stores = [Catalogue(tmp_path / name) for name in ("one", "other")]
    for store, order in zip(stores, (range(8), reversed(range(8))), strict=True):
        for k in order:
            store.put(answer(k))
    small = [{f.name: f.read_bytes() for f in s.folder.rglob("*.parquet")} for s in stores]
    assert small[0] == small[1]
    stores[0].compact(fewest=1)
    for k in range(4):
        stores[1].put(answer(k))
    stores[1].compact(fewest=1)
    whole = [{f.name: f.read_bytes() for f in s.folder.rglob("*.parquet")} for s in stores]
    assert len(whole[0]) == 1
    assert whole[0] == whole[1]


def test_read_while_it_is_compacted(tmp_path: Path) -> None:
    """Another process compacts and puts over and over; what is read is whole at any time."""
    for k in range(20):
        Catalogue(tmp_path).put(answer(k))
    code = (
        "import sys; sys.path.insert(0, sys.argv[2])\n"
        "from pathlib import Path\n"
        "from test_catalogue import Catalogue, answer\n"
        "store = Catalogue(Path(sys.argv[1]))\n"
        "print('begins', flush=True)\n"
        "for turn in range(25):\n"
        "    store.put(answer(turn % 20)); store.compact(fewest=1)\n"
    )
    call = [sys.executable, "-c", code, str(tmp_path), str(Path(__file__).parent)]
    with subprocess.Popen(call, stdout=subprocess.PIPE) as one, subprocess.Popen(call, stdout=subprocess.PIPE) as other:
        for each in (one, other):
            assert each.stdout is not None
            assert each.stdout.readline() == b"begins\n"
        while one.poll() is None or other.poll() is None:
            assert Catalogue(tmp_path).answers().content.nunique() == 20
    assert len(Catalogue(tmp_path).answers()) == 40


def test_a_compaction_that_is_killed_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Catalogue(tmp_path)
    for k in range(5):
        store.put(answer(k))
    store.compact(fewest=1)
    store.put(answer(3, value=9.0))
    store.put(answer(7))
    removed = []

    unlink = Path.unlink

    def failing(path: Path, missing_ok: bool = False) -> None:
        if len(removed) == 1:
            raise KeyboardInterrupt
        if path.suffix == ".parquet" and not path.name.startswith("."):
            removed.append(path)
        unlink(path, missing_ok)

    with monkeypatch.context() as broken:
        broken.setattr(Path, "unlink", failing)
        with pytest.raises(KeyboardInterrupt):
            store.compact(fewest=1)
    rows = store.answers()
    assert rows.content.nunique() == 6
    assert rows[(rows.campaign == "w3") & (rows.parameter == "b")].value.tolist() == [9.0]


def test_damaged_files_are_reported(tmp_path: Path) -> None:
    store = Catalogue(tmp_path)
    store.put(answer(0))
    file = next((tmp_path / "answers").rglob("*.parquet"))
    file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(RigError, match=r"is damaged .*; remove it and run rig fleet update"):
        store.answers()


def test_sql(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("duckdb", reason="DuckDB is not installed: pip install 'isorig[sql]'")
    store = Catalogue(tmp_path)
    store.add_folder(tmp_path, None)
    for k in range(3):
        store.put(answer(k, rig=f"rig-{k % 2}"))
    ask = "select rig, count(*) as n, max(started) as latest from answers where parameter = 'a' group by rig order by rig"
    assert main(["fleet", "sql", ask, "-c", str(tmp_path)]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [(row["rig"], row["n"]) for row in rows] == [("rig-0", "2"), ("rig-1", "1")]
    assert rows[0]["latest"] == "2026-01-03 00:00:00"
    for wrong in ("selec", "select * from read_csv('/etc/passwd')", "install httpfs", "set enable_external_access = true"):
        assert main(["fleet", "sql", wrong, "-c", str(tmp_path)]) == 2
        assert "rig: the query is wrong" in capsys.readouterr().err


@pytest.mark.parametrize("query", ["", ";", "  ;;  ", " -- nothing"])
def test_an_empty_query_is_refused(tmp_path: Path, query: str, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("duckdb", reason="DuckDB is not installed: pip install 'isorig[sql]'")
    Catalogue(tmp_path).add_folder(tmp_path, None)
    assert main(["fleet", "sql", query, "-c", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("rig: the query is empty; ")


@pytest.mark.parametrize(
    ("query", "says"),
    [
        ("with recursive t(n) as (select 1 union all select n + 1 from t) select max(n) from t", r"took longer than 0\.5 s"),
        ("select count(*) from range(1000000) a, range(1000000) b", r"took longer than 0\.5 s"),
        ("select * from range(100000000000)", "has more than 1000 rows"),
    ],
)
def test_an_endless_query_is_ended(tmp_path: Path, query: str, says: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("duckdb", reason="DuckDB is not installed: pip install 'isorig[sql]'")
    monkeypatch.setattr("isorig.rig.fleet.catalogue.SECONDS", 0.5)
    monkeypatch.setattr("isorig.rig.fleet.catalogue.ROWS", 1000)
    store = Catalogue(tmp_path)
    store.add_folder(tmp_path, None)
    with pytest.raises(RigError, match=says):
        query_answers(store, query)


def test_names_in_the_rows_of_a_query_are_no_formulas(tmp_path: Path) -> None:
    pytest.importorskip("duckdb", reason="DuckDB is not installed: pip install 'isorig[sql]'")
    store = Catalogue(tmp_path)
    store.put(answer(1, rig="=1+1"))
    rows = list(csv.reader(io.StringIO(query_answers(store, 'select distinct rig, -1.5 as n, rig as "@x" from answers'))))
    assert rows == [["rig", "n", "'@x"], ["'=1+1", "-1.5", "'=1+1"]]


def test_many_threads_put_at_once(tmp_path: Path) -> None:
    store = Catalogue(tmp_path)
    threads = [threading.Thread(target=lambda: [store.put(answer(k)) for k in range(10)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert store.answers().content.nunique() == 10
    assert not [f for f in tmp_path.rglob(".*") if f.is_file()]
