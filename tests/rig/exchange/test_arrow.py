"""Parquet, Feather and Arrow files: every value by the name of its column, and the time of an index."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.feather
import pyarrow.parquet
import pytest

from isorig.rig.errors import RecordingError
from isorig.rig.exchange.reading import read_foreign
from isorig.rig.files.hdf_walk import EXPANSION

N = 120
X, Y = np.round(np.random.default_rng(10).normal(size=(2, N)), 4)
STEPS = pd.to_timedelta(np.arange(N), unit="ms")


@pytest.mark.parametrize("index", [pd.Index(np.arange(N) / 1000.0, name="time"), STEPS, pd.Timestamp("2024-02-01") + STEPS, None])
@pytest.mark.parametrize("ending", ["parquet", "feather", "arrow"])
def test_every_value(tmp_path: Path, ending: str, index: pd.Index | None) -> None:
    frame = pd.DataFrame({"force [kN]": X, "acc.1": Y, "state": ["ok"] * N}, index=index)
    frame.loc[frame.index[7], "force [kN]"] = np.nan
    path = tmp_path / f"m.{ending}"
    table = pyarrow.Table.from_pandas(frame)
    (pyarrow.parquet.write_table if ending == "parquet" else pyarrow.feather.write_feather)(table, path)
    found = read_foreign(path)
    force = found.columns["force"]
    np.testing.assert_array_equal(np.delete(force.values, 7), np.delete(X, 7))
    assert (force.unit, force.lost.tolist() if force.lost is not None else []) == ("kN", [7])
    np.testing.assert_array_equal(found.columns["acc_1"].values, Y)
    clocks = [column.values for name, column in found.columns.items() if name not in ("force", "acc_1")]
    assert len(clocks) == (index is not None)
    for clock in clocks:
        np.testing.assert_allclose(clock, np.arange(N) / 1000.0, atol=1e-9)
    assert "'state' has values of type" in " ".join(found.remarks)


def test_damaged_and_inflated_files(tmp_path: Path) -> None:
    pyarrow.parquet.write_table(pyarrow.table({"a": X}), tmp_path / "a.parquet")
    (tmp_path / "a.parquet").write_bytes((tmp_path / "a.parquet").read_bytes()[:-60])
    pyarrow.parquet.write_table(pyarrow.table({"a": np.zeros(40_000_000)}), tmp_path / "b.parquet")
    for name, said in (("a", "cannot be read as a Parquet file"), ("b", f"at most {EXPANSION} times the stored size is read")):
        with pytest.raises(RecordingError, match=said):
            read_foreign(tmp_path / f"{name}.parquet")
