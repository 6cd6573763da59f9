"""Which candidates a rung eliminates: fits with given misfits, no simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from small_rigs import stage

from isorig.analysis.diagnose.pairs import FIRST_BEHIND, FIRSTS, LONGEST, firsts, searched
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.diagnose.step import PROMISING_LATER, contenders
from isorig.analysis.fitting import ladder
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.ladder import (
    BENT,
    DECISIVE,
    FAR,
    FAR_WORSE,
    PROMISING,
    TELLING,
    UNCHANGED,
    UNDECIDED,
    Race,
    Rung,
    race,
)
from isorig.analysis.fitting.solve import Fit, Free, Problem, positive
from isorig.analysis.model.rig_model import RigModel

CAUSES = ("wrong_mass", "hardening_stiffness")


def fitted(model: RigModel, cost: float) -> Fit:
    return Fit(model=model, free=(), covariance=np.zeros((0, 0)), cost=cost, evaluations=1)


def raced(monkeypatch: pytest.MonkeyPatch, *rungs: tuple[float, float, float], promising: float = PROMISING) -> Race:
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
    return race(candidates, steps, fitted(bare, 1.0), lambda text: None, promising)


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


@pytest.mark.parametrize(
    ("first", "second", "left_out"),
    [
        (5.0, 5.0 * UNCHANGED * 0.99, True),
        (5.0, 5.0 * UNCHANGED * 1.01, False),
        (BENT * 0.99, BENT, True),
        (BENT * 1.01, BENT, False),
        (TELLING * 0.99, 50.0, True),
        (TELLING * 1.01, 50.0, False),
    ],
)
def test_a_rung_is_left_out_where_the_model_nearly_agrees_and_does_not_drift_apart(
    first: float, second: float, left_out: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = raced(monkeypatch, (first, 0.1, 0.2), (second, 0.1, 0.2), (20.0, 0.1, 0.2))
    assert [at for at, _ in found.telling] == ([1, 2] if left_out else [0, 1, 2])


def test_the_rung_before_the_last_is_never_left_out_for_being_unchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    found = raced(monkeypatch, (5.0, 0.1, 0.2), (5.0, 0.1, 0.2), (5.0, 0.1, 0.2))
    assert [at for at, _ in found.telling] == [1, 2]


@pytest.mark.parametrize(("share", "kept"), [(PROMISING_LATER * 1.01, True), (PROMISING_LATER * 0.99, False)])
def test_a_candidate_for_a_further_step_must_remove_a_quarter(share: float, kept: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    found = raced(monkeypatch, (20.0, 20.0 * (1.0 - share), 40.0), promising=PROMISING_LATER)
    assert [candidate.cause for candidate, _ in found.ranked] == (["wrong_mass"] if kept else [])


def shape_costs(form: float, own: float, other: float, below: float = np.inf) -> list[tuple[str, str]]:
    """Places of the free shapes that are finished: one of the form's kind at its place, one of another kind."""
    spring = Candidate(cause="end_stop", location="rail", family="spring", starts=(), free=(), reported=())
    shapes = [
        (replace(spring, cause=cause), fitted(stage(), cost)) for cause, cost in (("spring_shape", own), ("damping_shape", other))
    ]
    run = Race(ranked=[(spring, fitted(stage(), form))], telling=())
    return [candidate.key for candidate, _ in contenders(sorted(shapes, key=lambda pair: pair[1].cost), run, below)]


def test_a_free_shape_is_finished_only_where_it_may_beat_the_form() -> None:
    form = 10.0
    own = form / POLICY.form_alike**2
    assert shape_costs(form, own * 0.99, 1e9) == [("spring_shape", "rail")]
    assert shape_costs(form, own * 1.01, 1e9) == []
    # Another kind is compared as long as it is not far worse than the best.
    assert shape_costs(form, 1e9, form * FAR_WORSE * 0.99) == [("damping_shape", "rail")]
    assert shape_costs(form, 1e9, form * FAR_WORSE * 1.01) == []
    assert shape_costs(form, 4.0, 4.0 * FAR_WORSE * 1.01) == [("spring_shape", "rail")]
    assert shape_costs(form, 4.0, 1e9, below=3.99) == []


@pytest.mark.parametrize(("ratio", "count"), [(FIRST_BEHIND * 0.99, 2), (FIRST_BEHIND * 1.01, 1)])
def test_a_cause_far_behind_the_best_gets_no_second_one(ratio: float, count: int) -> None:
    first = Candidate(cause="sensor_gain", location="x", family="sensor", starts=(), free=(), reported=())
    assert len(firsts([(first, fitted(stage(), 5.0)), (first, fitted(stage(), 5.0 * ratio))])) == count
    assert len(firsts([(first, fitted(stage(), 5.0))] * 9)) == FIRSTS


def test_pairs_are_searched_on_the_first_telling_rung_and_on_short_ones() -> None:
    rungs = [Rung(problem=cast("Problem", None), steps=1, seconds=s) for s in (1.0, LONGEST, LONGEST * 1.01, 4.0, 10.0)]
    first = Candidate(cause="sensor_gain", location="x", family="sensor", starts=(), free=(), reported=())
    misfit = [(first, fitted(stage(), TELLING * 1.01))]
    agrees = [(first, fitted(stage(), TELLING * 0.99))]

    def places(*telling: tuple[int, list[tuple[Candidate, Fit]]]) -> list[int]:
        return [at for at, _ in searched(Race(ranked=[], telling=telling), rungs)]

    assert places((0, misfit), (1, misfit), (2, misfit), (3, misfit)) == [0, 1]
    assert places((0, agrees), (3, misfit), (4, misfit)) == [3]
    assert places() == []


@pytest.mark.parametrize(("far", "returns"), [(FAR * 1.01, True), (FAR * 0.99, False)])
def test_a_parameter_far_from_its_given_value_is_fitted_again_from_there(
    far: float, returns: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = "links.rail.stiffness"
    given = stage()
    done = replace(
        fitted(given.replace({path: given.get(path) * float(np.exp(far))}), 5.0), free=(positive(path, given.get(path)),)
    )
    monkeypatch.setattr(ladder, "tried", lambda start, free, rung: replace(fitted(start, 1.0), free=done.free))
    found = ladder._returned(done, given, Rung(problem=cast("Problem", None), steps=1, seconds=1.0))
    assert (found.model.get(path) == given.get(path)) == returns
    # The first fit stays if it is the better one.
    monkeypatch.setattr(ladder, "tried", lambda start, free, rung: fitted(start, 6.0))
    assert ladder._returned(done, given, Rung(problem=cast("Problem", None), steps=1, seconds=1.0)) is done


@pytest.mark.parametrize(("seconds", "trusted"), [(UNDECIDED * 0.99, True), (UNDECIDED, False)])
def test_the_baseline_is_fitted_from_all_starting_points_until_a_second(
    seconds: float, trusted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    # On the first rung both starting points fit equally well, on the second only the last one fits.
    rungs = [Rung(problem=cast("Problem", None), steps=k, seconds=s) for k, s in enumerate((seconds, 5.0))]
    starts = (stage().replace({"bodies.table.mass": 7.0}), stage())
    monkeypatch.setattr(ladder, "ladder", lambda trials: rungs)
    costs = {
        (0, 7.0): 3.0,
        (0, stage().get("bodies.table.mass")): 3.0,
        (1, 7.0): 50.0,
        (1, stage().get("bodies.table.mass")): 1.0,
    }
    monkeypatch.setattr(
        ladder, "tried", lambda start, free, rung: fitted(start, costs[rung.steps, start.get("bodies.table.mass")])
    )
    monkeypatch.setattr(ladder, "finished", lambda done, trials: done)
    assert (ladder.baseline_fit(starts, ()).model == stage()) == trusted
