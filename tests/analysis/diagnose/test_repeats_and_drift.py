"""Repeated runs of a rig that drifts differ: what the drift explains is no disturbance, and it hides no further cause."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

from small_rigs import Take, guessed, played, stage, with_law

import isorig as iso
from isorig.analysis import laws
from isorig.analysis.campaign import Campaign

TAKES = (Take(3.0, 1), Take(3.0, 1), Take(6.0, 3))
BEGUN = datetime(2024, 1, 1, tzinfo=UTC)
#: Seconds between the beginnings of two runs.
APART = 100.0


def session(rate: float, damping: float) -> Campaign:
    """A stage whose rail gets stiffer by `rate` per second of the session, with a damping that grows with the speed."""
    runs = []
    for k in range(len(TAKES)):
        warm = stage().replace({"links.rail.stiffness": stage().get("links.rail.stiffness") * (1.0 + rate * APART * k)})
        hidden = with_law(warm, "rail", laws.Drift(drift_rate=rate / (1.0 + rate * APART * k)))
        hidden = with_law(hidden, "rail", laws.QuadraticDamping(quadratic_damping=damping))
        run = played(hidden, seed=7, takes=TAKES).runs[k]
        runs.append(replace(run, started=BEGUN + timedelta(seconds=APART * k)))
    return Campaign(runs=tuple(runs), source="stage")


def test_a_damping_beside_a_drift_between_repeated_runs_is_found() -> None:
    found = iso.diagnose(session(1e-3, 12.0), guessed(stage(), 8))
    assert found.verdict == "explained"
    assert [(step.cause, step.location) for step in found.steps] == [("stiffness_drift", "rail"), ("quadratic_damping", "rail")]
    assert found.extended_error < 2.0 * found.floor
