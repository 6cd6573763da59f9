"""Fleets whose campaigns are drawn, not measured: parameters with the covariance of real fits and scatter between campaigns."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from isorig.rig.wire_bonder.description import FREE, FRICTION, THESIS, wire_bonder

FIRST = datetime(2026, 1, 5, 9, 0, tzinfo=UTC)
SPRING = "links.isolation.stiffness"
PARAMETERS = (*FREE, FRICTION)
#: Relative deviation from campaign to campaign, and of a fit, of each of PARAMETERS.
SCATTER = np.array([0.002, 0.005, 0.05, 0.003, 0.06, 0.01, 0.04, 0.03])
FITTED = np.array([0.0001, 0.0001, 0.0003, 0.0001, 0.0006, 0.0001, 0.0001, 0.0001])
#: Correlation of the errors of a fit to a ten-second session of the virtual rig (a table's mass with its spring and damper, ...).
CORRELATION = np.eye(len(PARAMETERS))
CORRELATION[0, 1] = CORRELATION[1, 0] = 0.9
CORRELATION[0, 2] = CORRELATION[2, 0] = 0.3
CORRELATION[6, 7] = CORRELATION[7, 6] = -0.8


@dataclass(frozen=True, kw_only=True)
class Shift:
    """A change of a rig from some campaign on: parameters by so many of their deviations, at once or per campaign; a cause."""

    rig: int
    first: int
    by: Mapping[str, float]
    drift: bool = False
    cause: str = ""
    seen: float = 0.97


def drawn_fleet(
    seed: int, *, rigs: int = 50, campaigns: int = 20, shifts: Sequence[Shift] = (), every: float = 7.0, false_cause: float = 0.0
) -> pd.DataFrame:
    """The catalogue's answers of a fleet that is measured every so many days."""
    g = np.random.default_rng(seed)
    model = wire_bonder({**THESIS, "friction_force": 10.0})
    middle = np.log([model.get(path) for path in PARAMETERS])
    n = len(PARAMETERS)
    levels = middle + 0.05 * g.normal(size=(rigs, 1, n))
    values = levels + SCATTER * g.normal(size=(rigs, campaigns, n))
    values += FITTED * (g.normal(size=(rigs, campaigns, n)) @ np.linalg.cholesky(CORRELATION).T)
    causes = np.full((rigs, campaigns), "", dtype=object)
    causes[g.random((rigs, campaigns)) < false_cause] = "extra_mode at table"
    for shift in shifts:
        since = np.arange(campaigns) - shift.first + 1
        shape = np.maximum(since, 0) if shift.drift else (since > 0).astype(float)
        for path, by in shift.by.items():
            k = PARAMETERS.index(path)
            values[shift.rig, :, k] += by * np.hypot(SCATTER[k], FITTED[k]) * shape
        if shift.cause:
            causes[shift.rig, (since > 0) & (g.random(campaigns) < shift.seen)] = shift.cause
    return frame_of(np.exp(values), np.exp(values) * FITTED, causes, every=every)


def frame_of(
    values: Any, stds: Any, causes: Any, *, every: float = 7.0, version: str = "1", baseline: str = "coulomb"
) -> pd.DataFrame:
    """Answers from values and deviations, shape (rigs, campaigns, parameters), and causes, shape (rigs, campaigns)."""
    rigs, campaigns, n = values.shape
    rig, campaign, parameter = (
        k.ravel() for k in np.meshgrid(np.arange(rigs), np.arange(campaigns), np.arange(n), indexing="ij")
    )
    names = np.array([f"rig-{k:03d}" for k in range(rigs)])
    started = pd.to_datetime([FIRST + timedelta(days=every * k) for k in range(campaigns)])
    contents = np.array([[hashlib.sha256(f"{r} {c}".encode()).hexdigest() for c in range(campaigns)] for r in range(rigs)])
    cause = causes[rig, campaign]
    return pd.DataFrame(
        {
            "rig": names[rig], "campaign": np.array([f"week-{k:03d}" for k in range(campaigns)])[campaign],
            "started": started[campaign], "parameter": np.array(PARAMETERS)[parameter],
            "value": values.ravel(), "std": stds.ravel(), "verdict": np.where(cause == "", "adequate", "explained"),
            "cause": cause, "version": version, "content": contents[rig, campaign], "unit": "1", "baseline": baseline,
            "alike": "", "reason": "", "path": names[rig], "size": 1, "modified": 1,
        }
    )  # fmt: skip


def write_catalogue(folder: Path, frame: pd.DataFrame) -> None:
    """The answers as a compacted file of a catalogue."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from isorig.rig.fleet.catalogue import SCHEMA

    (folder / "answers").mkdir(parents=True)
    (folder / "folders").mkdir()
    table = pa.Table.from_pandas(frame[SCHEMA.names], schema=SCHEMA, preserve_index=False)
    pq.write_table(table, folder / "answers" / "all-0.parquet", compression="zstd")
