"""Which candidates are eliminated: fits with given misfits, no simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from small_rigs import played, rubbing, stage

from isorig.analysis.deadline import Deadline, count_samples, out_of_time, time_left
from isorig.analysis.diagnose import search
from isorig.analysis.diagnose.causes import containing, proposed
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.diagnose.search import PROMISING_LATER, contenders
from isorig.analysis.diagnose.step import Entry
from isorig.analysis.equations.unknown_force import Places
from isorig.analysis.errors import OutOfTimeError
from isorig.analysis.fitting import ladder
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.ladder import (
    AGREES,
    BEHIND,
    CLOSE,
    DECISIVE,
    EACH,
    FAR,
    FAR_WORSE,
    LEAVES,
    PROMISING,
    STAYS,
    TELLING,
    UNDECIDED,
    Rung,
    followed,
    verified,
)
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.score import Score
from isorig.analysis.fitting.solve import Fit, Free, base_parameters, positive
from isorig.analysis.fitting.trials import SIGNAL_SHARE
from isorig.analysis.laws import Asymmetric, Dahl, Stribeck
from isorig.analysis.model.rig_model import RigModel

CAUSES = ("wrong_mass", "hardening_stiffness")


def fitted(model: RigModel, cost: float) -> Fit:
    return Fit(model=model, free=(), covariance=np.zeros((0, 0)), cost=cost, evaluations=1)


def eliminated(
    monkeypatch: pytest.MonkeyPatch, *rungs: tuple[float, float, float], promising: float = PROMISING
) -> list[str]:  # fmt: skip
    """The causes that remain with these misfits on each rung: of the refitted current model, then of two candidates."""
    bare = stage()
    starts = {cause: bare.replace({"bodies.table.mass": 5.0 + k}) for k, cause in enumerate(CAUSES)}
    seen = list(starts.values())

    def tried(start: RigModel, free: Sequence[Free], rung: Rung) -> Fit:
        return fitted(start, rungs[rung.steps][0 if start == bare else 1 + seen.index(start)])

    monkeypatch.setattr(ladder, "tried", tried)
    monkeypatch.setattr(ladder, "misfit", lambda model, problem: 1.0)
    candidates = [
        (Candidate(cause=cause, location="table", family=cause, starts=(start,), free=(), reported=()), (), start)
        for cause, start in starts.items()
    ]
    steps = [Rung(problem=cast("Problem", None), steps=k, seconds=float(k)) for k in range(len(rungs))]
    return [c.cause for c, _ in followed(candidates, steps, fitted(bare, 1.0), lambda text: None, promising)]


def test_a_length_without_a_decisive_candidate_keeps_those_that_show_later(monkeypatch: pytest.MonkeyPatch) -> None:
    share = 1.0 - DECISIVE
    assert eliminated(monkeypatch, (10.0, 10.0 * share * 1.01, 10.0), (100.0, 95.0, 3.0)) == ["hardening_stiffness"]


def test_a_decisive_length_eliminates_what_removes_little(monkeypatch: pytest.MonkeyPatch) -> None:
    share = 1.0 - DECISIVE
    little = 10.0 * (1.0 - PROMISING) * 1.01
    assert eliminated(monkeypatch, (10.0, 10.0 * share * 0.99, little), (100.0, 50.0, 3.0)) == ["wrong_mass"]


@pytest.mark.parametrize(
    ("bare", "cost", "kept"),
    [
        (TELLING * 0.99, LEAVES * TELLING * 1.01, False),
        (TELLING * 0.99, LEAVES * TELLING * 0.99, True),
        (TELLING * 1.01, LEAVES * TELLING * 1.01, True),
    ],
)
def test_a_fit_far_from_data_that_the_current_model_explains_is_lost(
    bare: float, cost: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = eliminated(monkeypatch, (bare, cost, 0.99 * bare), (10.0, 1.0, 8.0))
    assert found == (["wrong_mass"] if kept else []) + ["hardening_stiffness"]


@pytest.mark.parametrize(("ratio", "kept"), [(BEHIND * 0.99, 3), (BEHIND * 1.01, 2)])
def test_candidates_far_behind_the_best_are_eliminated_except_two(
    ratio: float, kept: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    models = [stage().replace({"bodies.table.mass": 5.0 + k}) for k in range(3)]
    costs = dict(zip((model.get("bodies.table.mass") for model in models), (1.0, ratio, ratio), strict=True))
    monkeypatch.setattr(
        ladder, "tried", lambda start, free, rung: fitted(start, costs.get(start.get("bodies.table.mass"), 100.0))
    )
    monkeypatch.setattr(ladder, "misfit", lambda model, problem: 1.0)
    starts = [
        (Candidate(cause=f"{k}", location="table", family="", starts=(model,), free=(), reported=()), (), model)
        for k, model in enumerate(models)
    ]
    rung = Rung(problem=cast("Problem", None), steps=0, seconds=1.0)
    assert len(followed(starts, [rung], fitted(stage(), 1.0), lambda text: None)) == kept


@pytest.mark.parametrize(("share", "kept"), [(PROMISING_LATER * 1.01, True), (PROMISING_LATER * 0.99, False)])
def test_a_candidate_for_a_further_step_must_remove_a_quarter(share: float, kept: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    found = eliminated(monkeypatch, (20.0, 20.0 * (1.0 - share), 40.0), promising=PROMISING_LATER)
    assert found == (["wrong_mass"] if kept else [])


@pytest.mark.parametrize(("cost", "fits"), [(AGREES * 0.99, 1), (AGREES * 1.01, 2)])
def test_a_candidate_that_agrees_is_fitted_from_one_starting_point(
    cost: float, fits: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[float] = []
    models = [stage().replace({"bodies.table.mass": 5.0 + k}) for k in range(3)]

    def tried(start: RigModel, free: Sequence[Free], rung: Rung) -> Fit:
        done.append(start.get("bodies.table.mass"))
        return fitted(start, cost)

    monkeypatch.setattr(ladder, "tried", tried)
    # The third one is the same starting point as the first.
    misfits = dict(zip((5.0, 6.0, 7.0), (10.0, 20.0, 10.0 * (1.0 + CLOSE)), strict=True))
    monkeypatch.setattr(ladder, "misfit", lambda model, problem: misfits[model.get("bodies.table.mass")])
    one = Candidate(cause="wrong_mass", location="table", family="", starts=tuple(models), free=(), reported=())
    verified([(one, (), model) for model in models], Rung(problem=cast("Problem", None), steps=0, seconds=1.0), lambda text: None)
    assert done == [5.0, 6.0][:fits]


def test_the_closest_starting_points_of_each_candidate_are_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    models = [stage().replace({"bodies.table.mass": 5.0 + k}) for k in range(EACH + 1)]
    done: list[float] = []

    def tried(start: RigModel, free: Sequence[Free], rung: Rung) -> Fit:
        done.append(start.get("bodies.table.mass"))
        return fitted(start, 2.0 * AGREES)

    monkeypatch.setattr(ladder, "tried", tried)
    monkeypatch.setattr(ladder, "misfit", lambda model, problem: 20.0 - model.get("bodies.table.mass"))
    both = [Candidate(cause=cause, location="table", family="", starts=tuple(models), free=(), reported=()) for cause in CAUSES]
    starts = [(one, (), model) for one in both for model in models]
    verified(starts, Rung(problem=cast("Problem", None), steps=0, seconds=1.0), lambda text: None, most=len(starts))
    assert sorted(done) == sorted(2 * [model.get("bodies.table.mass") for model in models[1:]])


@pytest.mark.parametrize(("of_start", "repeated"), [(0.99, True), (1.01, False)])
def test_a_fit_that_leaves_more_of_the_whole_runs_than_its_start_is_repeated_on_these(
    of_start: float, repeated: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    start, short, whole = stage(), cast("Problem", "short"), cast("Problem", "whole")
    led_away = start.replace({"bodies.table.mass": 9.0})
    left = {("whole", start.encoded): of_start, ("whole", led_away.encoded): 1.0}
    monkeypatch.setattr(ladder, "misfit", lambda model, problem: left.get((problem, model.encoded), 3.0))
    monkeypatch.setattr(ladder, "tried", lambda model, free, rung: fitted(led_away if rung.problem == "short" else start, 0.5))
    one = Candidate(cause="end_stop", location="rail", family="spring", starts=(), free=(), reported=())
    run = verified([(one, (), start)], Rung(problem=short, steps=0, seconds=1.0), lambda text: None, whole=whole)
    assert [done.model for _, done in run] == [start if repeated else led_away]


@pytest.mark.parametrize(("misfit_of_first_moments", "left", "added"), [(9.9, 1.0, 0), (10.1, 1.0, 2), (10.1, 0.5, 0)])
def test_where_a_missing_effect_bent_the_fit_a_candidate_starts_from_what_the_equations_solve_for(
    misfit_of_first_moments: float, left: float, added: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "misfit", lambda model, problem: misfit_of_first_moments)
    damping, stiffness = "links.rail.damping", "links.rail.stiffness"
    described = msgspec.structs.replace(stage(), free=(damping,))
    guess, bent = described.replace({damping: 7.0}), described.replace({damping: 70.0})
    candidate = Candidate(
        cause="wrong_stiffness", location="rail", family="stiffness", starts=(bent,), free=(Free(path=stiffness),), reported=()
    )
    job = SimpleNamespace(
        left=left, current=fitted(bent, 1.0), rungs=[SimpleNamespace(problem=None)], guess=guess,
        solved={stiffness: 1800.0, damping: 5.0},
    )  # fmt: skip
    starts = [(candidate, (*base_parameters(bent), *candidate.free), bent)]
    found = search.Job.with_values_before_fit(cast("search.Job", job), starts)[1:]
    values = [(model.get(damping), model.get(stiffness)) for _, _, model in found]
    assert values == [(7.0, stage().get(stiffness)), (7.0, 1800.0)][:added]


@pytest.mark.parametrize("sure", [True, False])
@pytest.mark.parametrize(("ratio", "tried_too"), [(LEAVES * 0.99, True), (LEAVES * 1.01, False)])
def test_starting_points_far_from_the_data_are_tried_for_a_sure_candidate_only(
    ratio: float, tried_too: bool, sure: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    costs = {"first": 1e6, "close": 1.0, "far": ratio}
    models = {name: stage().replace({"bodies.table.mass": 5.0 + k}) for k, name in enumerate(costs)}
    misfits = {model.get("bodies.table.mass"): costs[name] for name, model in models.items()}
    monkeypatch.setattr(ladder, "misfit", lambda model, problem: misfits[model.get("bodies.table.mass")])
    monkeypatch.setattr(ladder, "tried", lambda start, free, rung: fitted(start, misfits[start.get("bodies.table.mass")]))
    starts = [
        (Candidate(cause=name, location="table", family="", starts=(model,), free=(), reported=()), (), model)
        for name, model in models.items()
    ]
    run = verified(starts, Rung(problem=cast("Problem", None), steps=0, seconds=1.0), lambda text: None, sure=sure)
    tried = {"close", *(("far",) if tried_too else ()), *(("first",) if sure else ())}
    assert {candidate.cause for candidate, _ in run} == tried


def test_a_sure_candidate_is_fitted_however_many_start_closer_to_the_data(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two starting points of the first candidate are behind fifteen others: the closest of them takes the twelfth place."""
    models = [stage().replace({"bodies.table.mass": 5.0 + k}) for k in range(17)]
    monkeypatch.setattr(ladder, "misfit", lambda model, problem: model.get("bodies.table.mass"))
    monkeypatch.setattr(ladder, "tried", lambda start, free, rung: fitted(start, start.get("bodies.table.mass")))
    sure, *others = [
        Candidate(cause=f"{k}", location="table", family="", starts=(), free=(), reported=()) for k in range(len(models) - 1)
    ]
    starts = [(sure, (), models[-2]), (sure, (), models[-1])]
    starts += [(one, (), model) for one, model in zip(others, models, strict=False)]
    rung = Rung(problem=cast("Problem", None), steps=0, seconds=1.0)
    run = verified(starts, rung, lambda text: None, sure=True)
    assert [done.cost for _, done in run] == [5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 20.0]
    run = verified(starts, rung, lambda text: None)
    assert [done.cost for _, done in run] == [5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0]
    # Where its closest starting point is among the twelve, no further one takes a place.
    close = (sure, (), stage().replace({"bodies.table.mass": 4.0}))
    run = verified([close, *starts], rung, lambda text: None, sure=True)
    assert [done.cost for _, done in run] == [4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0]


@pytest.mark.parametrize(("bare", "followed_on"), [(1.99, 10), (2.01, 8)])
def test_data_with_which_the_current_model_agrees_eliminate_no_candidate(
    bare: float, followed_on: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[int] = []
    rungs = [Rung(problem=cast("Problem", None), steps=k, seconds=float(k)) for k in range(2)]
    monkeypatch.setattr(ladder, "misfit", lambda model, problem: 1.0)
    monkeypatch.setattr(ladder, "bare_cost", lambda current, rung: bare)
    monkeypatch.setattr(ladder, "tried", lambda start, free, rung: fitted(start, 0.5))
    model = stage()
    starts = [
        (Candidate(cause=f"{k}", location="table", family="", starts=(), free=(), reported=()), (), model) for k in range(10)
    ]
    found = ladder.verified

    def counted(starts: ladder.Starts, *given: Any, **named: Any) -> ladder.Running:
        seen.append(len(starts))
        return found(starts, *given, **named)

    monkeypatch.setattr(ladder, "verified", counted)
    followed(starts, rungs, fitted(model, 1.0), lambda text: None)
    assert seen == [10, followed_on]


def shape_costs(form: float, own: float, other: float, below: float = np.inf) -> list[tuple[str, str]]:
    """Places of the free shapes that are finished: one of the form's kind at its place, one of another kind."""
    spring = Candidate(cause="end_stop", location="rail", family="spring", starts=(), free=(), reported=())
    shapes = [
        (replace(spring, cause=cause), fitted(stage(), cost)) for cause, cost in (("spring_shape", own), ("damping_shape", other))
    ]
    forms = [(spring, fitted(stage(), form))]
    nearly = None
    if np.isfinite(below):
        forms[0] = (spring, fitted(stage(), below * POLICY.form_close**2))
        nearly = Entry(candidate=spring, fit=forms[0][1], score=cast("Score", None))
    return [candidate.key for candidate, _ in contenders(sorted(shapes, key=lambda pair: pair[1].cost), forms, nearly)]


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
    assert shape_costs(form, 4.0, 1e9, below=4.01) == [("spring_shape", "rail")]


@pytest.mark.parametrize(
    ("form", "place", "kept"),
    [
        (POLICY.form_close**2 * 1.01, "rail", True),
        (POLICY.form_close**2 * 0.99, "rail", False),
        (1.0, "belt", True),  # the form that removes most is elsewhere
    ],
)
def test_a_free_shape_must_predict_the_runs_better_than_a_form_that_removes_most(
    form: float, place: str, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "misfit", lambda model, problem: model.get("bodies.table.mass"))
    spring = Candidate(cause="end_stop", location="rail", family="spring", starts=(), free=(), reported=())
    shape = replace(spring, cause="spring_shape")
    costs = {spring.key: form, shape.key: 1.0}
    fits = {key: fitted(stage().replace({"bodies.table.mass": cost}), 1.0) for key, cost in costs.items()}
    job = cast("search.Job", SimpleNamespace(whole=None))
    found = search.Job.following(job, [(shape, fits[shape.key])], [(spring, fits[spring.key])], {("spring_shape", place)})
    assert [candidate for candidate, _ in found] == ([shape] if kept else [])


@pytest.mark.parametrize(("most", "shown", "further"), [(True, True, False), (True, False, True), (False, True, True)])
def test_a_free_shape_that_explains_most_where_the_equations_show_a_cause_ends_the_search(
    most: bool, shown: bool, further: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No form follows the records: whether other candidates are simulated."""
    asked: list[str] = []
    curve = Candidate(cause="spring_shape", location="rail", family="spring", starts=(), free=(), reported=())

    class Places:
        def __init__(self, name: str) -> None:
            self.name, self.leads, self.known = name, name == "equations", frozenset[tuple[str, str]]()

        @property
        def forms(self) -> list[tuple[Candidate, Fit]]:
            asked.append(self.name)
            return []

        def shapes(self, forms: Sequence[Entry]) -> list[tuple[Candidate, Fit]]:
            return [(curve, fitted(stage(), 1.0))] if self.leads else []

        def shown(self, cause: str, place: str) -> bool:
            return shown

        def suffices(self, forms: Sequence[Entry]) -> bool:
            return False

    job = SimpleNamespace(
        progress=lambda text: None, left=1.0, forms_only=False, steps=1, curved=None, explains=lambda entry: True,
        helps=lambda forms: False, removes_most=lambda entry: most, finished=list, floors=np.zeros((1, 1)), evidence=None,
        entries=lambda run: [Entry(candidate=candidate, fit=done, score=cast("Score", None)) for candidate, done in run],
    )  # fmt: skip
    monkeypatch.setattr(search, "best_fits", lambda entries, floors: list(entries))
    monkeypatch.setattr(search, "sources", lambda job: [Places("equations"), Places("screen")])
    monkeypatch.setattr(search, "_kind_and_form", lambda *given: None)
    search.next_step(cast("search.Job", job))
    assert ("screen" in asked) == further


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
    monkeypatch.setattr(ladder, "misfit", lambda start, problem: 1.0)
    monkeypatch.setattr(ladder, "finished", lambda done, trials: done)
    assert (ladder.baseline_fit(starts, ()).model == stage()) == trusted


def test_a_curve_of_one_source_is_not_lost_to_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two sources that lead, of which no form follows the records; the second one has no curve either."""
    curve = Candidate(cause="damping_shape", location="rail", family="damper", starts=(), free=(), reported=())

    def source(shapes: list[tuple[Candidate, Fit]]) -> SimpleNamespace:
        return SimpleNamespace(leads=True, forms=[], known=frozenset(), shapes=lambda forms: shapes, shown=lambda *_: False)

    job = SimpleNamespace(
        progress=lambda text: None, left=1.0, forms_only=False, steps=1, curved=None, helps=lambda forms: False,
        removes_most=lambda entry: True, finished=list, floors=np.zeros((1, 1)), evidence=None,
        entries=lambda run: [Entry(candidate=candidate, fit=done, score=cast("Score", None)) for candidate, done in run],
    )  # fmt: skip
    monkeypatch.setattr(search, "best_fits", lambda entries, floors: list(entries))
    monkeypatch.setattr(search, "sources", lambda job: [source([(curve, fitted(stage(), 1.0))]), source([])])
    given: list[Sequence[Entry]] = []
    monkeypatch.setattr(search, "_kind_and_form", lambda job, known, forms, shapes: given.append(shapes))
    search.next_step(cast("search.Job", job))
    assert [entry.candidate for entry in given[0]] == [curve]


@pytest.mark.parametrize(("spent", "limit"), [(1, 150_000_000), (100_000_000, 500_000_000)])
def test_pairs_take_a_multiple_of_the_samples_of_single_causes(spent: int, limit: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where these end, the single causes remain; the time that is left ends them, too."""
    times: list[float] = []

    def together(*given: object) -> None:
        times.append(time_left())
        count_samples(limit)
        assert not out_of_time()
        count_samples(1)
        assert out_of_time()
        raise OutOfTimeError("the limit is reached")

    monkeypatch.setattr(search, "_together", together)
    source = SimpleNamespace(pairs=list)
    with Deadline(7.0):
        found = search._both(cast("search.Job", SimpleNamespace(steps=2)), cast("search.Source", source), [], spent)
        assert not out_of_time()
    assert found is None
    assert times == [pytest.approx(7.0, abs=0.5)]


@pytest.mark.parametrize(("attached", "causes"), [(False, {"stribeck_friction", "asymmetric_friction"}), (True, set())])
def test_dry_friction_leads_to_the_laws_that_contain_it(attached: bool, causes: set[str]) -> None:
    """With its sizes. What is attached to the rig is not part of another law."""
    campaign = played(stage(), seed=3)
    evidence = observe(campaign, stage(), prepare(campaign, stage()), stage(), stage())
    simple = next(c for c in proposed(stage(), evidence) if c.key == ("coulomb_friction", "rail"))
    free, begun = (*base_parameters(stage()), *simple.free), rubbing(stage(), "rail", 3.0)
    if attached:
        simple = next(c for c in proposed(stage(), evidence) if c.cause == "extra_mode")
        free, begun = simple.parameters(stage(), base_parameters(stage())), simple.starts[0]
    starts = [(form, its, model) for form, its in containing(simple, begun, free, evidence) for model in form.starts]
    assert {candidate.cause for candidate, _, _ in starts} == causes
    for candidate, its, model in starts:
        assert {each.path for each in candidate.free} <= {each.path for each in its}
        law = model.contact("rail").law
        assert isinstance(law, Stribeck | Asymmetric)
        assert (law.friction_force if isinstance(law, Stribeck) else law.forward_force) == pytest.approx(3.0, rel=0.35)


@pytest.mark.parametrize(
    ("cost", "few", "follows", "lengths"),
    [
        (0.99 * (STAYS / SIGNAL_SHARE) ** 2, True, True, "whole"), (1.01 * (STAYS / SIGNAL_SHARE) ** 2, True, True, "growing"),
        (1.0, True, False, "growing"), (1.0, False, True, "growing"),
    ],
)  # fmt: skip
def test_where_nothing_drifts_apart_candidates_are_fitted_to_the_whole_at_once(
    cost: float, few: bool, follows: bool, lengths: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of few places, as long as the best fit follows the records."""
    candidate = Candidate(cause="end_stop", location="rail", family="spring", starts=(stage(),), free=(), reported=())
    item = SimpleNamespace(candidate=candidate, models=[stage()])
    monkeypatch.setattr(search.Screened, "_screened", [item])
    monkeypatch.setattr(search, "diverse", list)
    monkeypatch.setattr(search, "misfit", lambda model, problem: cost)
    monkeypatch.setattr(search, "verified", lambda starts, rung, progress: "whole")
    monkeypatch.setattr(search, "followed", lambda starts, *others: "growing")
    job = SimpleNamespace(
        progress=print, left=0.5, current=fitted(stage(), cost), rungs=[SimpleNamespace(problem=None)], promising=0.1,
        follows=lambda run: bool(run) and follows, with_values_before_fit=list,
    )  # fmt: skip
    places = cast("Places", object()) if few else None
    assert search.Screened(job=cast("search.Job", job), places=places).forms == lengths


def test_a_law_keeps_its_level_where_the_curve_that_replaced_it_led_to_zero() -> None:
    before, law = rubbing(stage(), "rail", 2.0), Dahl(friction_force=2.0, bristle_stiffness=1e4)
    path = "contacts.rail.law.friction_force"
    level = Free(path=path, low=0.0, high=10.0, log=False)
    contacts = tuple(msgspec.structs.replace(contact, law=law) for contact in before.contacts)
    dahl = msgspec.structs.replace(before, contacts=contacts)
    now = Fit(model=dahl, free=(level,), covariance=np.eye(1), cost=1.0, evaluations=1)
    for after, kept in ((1.5, 1.5), (0.0, 2.0)):
        step = replace(now, model=before.replace({path: after}))
        assert ladder.without_step(step, now).get(path) == kept
