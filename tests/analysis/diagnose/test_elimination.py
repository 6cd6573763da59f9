"""Which candidates a rung eliminates: fits with given misfits, no simulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
import pytest
from small_rigs import stage

from isorig.analysis.fitting import ladder
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.ladder import DECISIVE, PROMISING, Race, Rung, race
from isorig.analysis.fitting.solve import Fit, Free, Problem
from isorig.analysis.model.rig_model import RigModel

CAUSES = ("wrong_mass", "hardening_stiffness")


def fitted(model: RigModel, cost: float) -> Fit:
    return Fit(model=model, free=(), covariance=np.zeros((0, 0)), cost=cost, evaluations=1)


def raced(monkeypatch: pytest.MonkeyPatch, *rungs: tuple[float, float, float]) -> Race:
    """An elimination with these misfits on each rung: of the refitted current model, then of two candidates."""
    bare = stage()
    starts = {cause: bare.replace({"bodies.table.mass": 5.0 + k}) for k, cause in enumerate(CAUSES)}

    def tried(start: RigModel, free: Sequence[Free], rung: Rung) -> Fit:
        costs = rungs[rung.steps]
        place = 0 if start == bare else 1 + list(starts.values()).index(start)
        return fitted(start, costs[place])

    monkeypatch.setattr(ladder, "tried", tried)
    candidates = [
        (Candidate(cause=cause, location="table", family=cause, starts=(start,), free=(), reported=()), (), start)
        for cause, start in starts.items()
    ]
    steps = [Rung(problem=cast("Problem", None), steps=k, seconds=float(k)) for k in range(len(rungs))]
    return race(candidates, steps, fitted(bare, 1.0), lambda text: None)


def test_a_rung_without_a_decisive_candidate_keeps_those_that_show_later(monkeypatch: pytest.MonkeyPatch) -> None:
    share = 1.0 - DECISIVE
    found = raced(monkeypatch, (10.0, 10.0 * share * 1.01, 10.0), (100.0, 95.0, 3.0))
    assert found.ranked[0][0].cause == "hardening_stiffness"
    assert [at for at, _ in found.telling] == [1]


def test_a_decisive_rung_eliminates_what_removes_little(monkeypatch: pytest.MonkeyPatch) -> None:
    share = 1.0 - DECISIVE
    found = raced(monkeypatch, (10.0, 10.0 * share * 0.99, 10.0 * (1.0 - PROMISING) * 1.01), (100.0, 50.0, 3.0))
    assert [candidate.cause for candidate, _ in found.ranked] == ["wrong_mass"]
    assert [at for at, _ in found.telling] == [0, 1]


def test_a_candidate_that_fits_worse_than_none_is_eliminated_on_any_rung(monkeypatch: pytest.MonkeyPatch) -> None:
    found = raced(monkeypatch, (10.0, 10.0 * (1.0 + PROMISING) * 1.01, 9.5), (100.0, 1.0, 20.0))
    assert [candidate.cause for candidate, _ in found.ranked] == ["hardening_stiffness"]
