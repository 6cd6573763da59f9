"""What a step reports of candidates that the data cannot exclude: entries made by hand, no fit."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from small_rigs import chain, guessed, played, stage

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose import diagnosis, revise, search
from isorig.analysis.diagnose import step as steps
from isorig.analysis.diagnose.causes.base import Kind
from isorig.analysis.diagnose.considered import all_considered
from isorig.analysis.diagnose.diagnosis import MOST_STEPS, _doubted, _of_sensors, _Search, _standing
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.diagnose.policy import POLICY
from isorig.analysis.diagnose.revise import Revision, SearchStage, merged, near_rivals, stage_of
from isorig.analysis.diagnose.search import Screened, Suspected, _extends, best_fits, sources
from isorig.analysis.diagnose.step import (
    Curve,
    Entry,
    Found,
    Step,
    _closest,
    _same_curve,
    best_form,
    best_kind,
    curve_of,
    determined,
    vanishes,
    without_form,
)
from isorig.analysis.diagnose.suspects import FEW_PERIODS, OTHER_MEMORY, Suspects
from isorig.analysis.equations.columns import PERIODIC
from isorig.analysis.equations.ranking import Explanation, score_of
from isorig.analysis.equations.system import equations_of
from isorig.analysis.fitting.candidate import Candidate, Reported, Shape
from isorig.analysis.fitting.division import ends
from isorig.analysis.fitting.excess import share_removed
from isorig.analysis.fitting.plausible import Doubt
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.score import BLOCKS, Score, score
from isorig.analysis.fitting.solve import Fit, Free, base_parameters
from isorig.analysis.laws import BoucWen, ContactLaw, Coulomb
from isorig.analysis.model.rig_model import Contact, RigModel

FLOORS = np.full((4, 2), 0.004)


def scored(error: float, shape: tuple[int, ...] = (4, 2)) -> Score:
    return Score(np.full(shape, error), np.full((*shape, BLOCKS), error**2), np.full((*shape, BLOCKS), error**2))


def entry(cause: str, channel: str, error: float, *, points: int = 0) -> Entry:
    """A gain of a sensor, or a free shape of its curve with so many points."""
    free = tuple(Free(path=f"sensors.{channel}.chain.gain", low=0.1, high=10.0) for _ in range(points or 1))
    shape = Shape(over="value", unit="m", value_unit="m", path="", tables=()) if points else None
    candidate = Candidate(
        cause=cause, location=channel, family="gain", starts=(stage(),), free=free, reported=(), shape=shape, rank=0
    )
    fit = Fit(model=stage(), free=free, covariance=np.eye(len(free)), cost=1.0, evaluations=1)
    return Entry(candidate=candidate, fit=fit, score=scored(error))


def reported(*, elsewhere: float, delay: float = 1.0) -> set[tuple[str, str]]:
    campaign, guess = played(stage(), seed=7), guessed(stage(), 7)
    trials = prepare(campaign, guess)
    forms = [entry("sensor_gain", "x", 0.0100), entry("sensor_gain", "a", elsewhere), entry("channel_delay", "x", delay)]
    shapes = [entry("sensor", "x", 0.0098, points=5), entry("sensor", "a", 0.0099, points=5)]
    found = best_kind(forms, shapes, scored(0.1), FLOORS, observe(campaign, guess, trials, guess, guess))
    assert found is not None
    assert found.step.form == "sensor_gain"
    return {(found.step.cause, found.step.location), *found.step.indistinguishable}


@pytest.mark.parametrize(("share", "closest"), [(POLICY.main + 0.01, "sensor_gain"), (POLICY.main - 0.01, None), (-0.2, None)])
def test_a_form_that_removes_little_of_the_error_is_not_the_closest_to_a_curve(share: float, closest: str | None) -> None:
    campaign, guess = played(stage(), seed=7), guessed(stage(), 7)
    trials = prepare(campaign, guess)
    form = entry("sensor_gain", "x", float(np.sqrt(0.004**2 + (1.0 - share) * (0.1**2 - 0.004**2))))
    shape = entry("sensor", "x", 0.005, points=5)
    found = best_kind([form], [shape], scored(0.1), FLOORS, observe(campaign, guess, trials, guess, guess))
    assert found is not None
    assert found.step.form is None
    assert (found.step.closest and found.step.closest[0]) == closest


@pytest.mark.parametrize(
    ("odd", "factor", "closest"),
    [(False, 0.99, "hardening_stiffness"), (False, 1.01, "asymmetric_stiffness"), (True, 1.01, "hardening_stiffness")],
)
def test_the_form_with_fewer_parameters_is_the_closest_unless_another_leaves_less(odd: bool, factor: float, closest: str) -> None:
    """An odd curve is close to no form that differs by direction."""
    now, least = scored(0.1), 0.02
    errors = {"hardening_stiffness": least * factor * POLICY.matters, "asymmetric_stiffness": least}
    forms = [entry(cause, "x", error) for cause, error in errors.items()]
    forms[1] = replace(forms[1], candidate=replace(forms[1].candidate, free=2 * forms[1].candidate.free))
    found = _closest(forms, now, FLOORS, odd=odd)
    assert found == (closest, pytest.approx(share_removed(now.error, scored(errors[closest]).error, FLOORS)))


@pytest.mark.parametrize(
    ("even", "odd"), [(0.0, True), (0.9 * POLICY.zero * np.sqrt(2.0), True), (1.1 * POLICY.zero * np.sqrt(2.0), False)]
)
def test_a_curve_is_odd_if_its_even_part_is_zero_within_its_uncertainty(even: float, odd: bool) -> None:
    positions = np.linspace(-1.0, 1.0, 9)
    points = [(float(x), float(50.0 * np.sinh(x) + 0.5 * even * (abs(x) == 0.75)), 0.0 if x == 0.0 else 1.0) for x in positions]
    curve = Curve(over="deflection", unit="m", value_unit="N", points=tuple(points), reached=(-1.0, 1.0))
    assert curve.is_odd == odd


def test_a_form_elsewhere_that_is_as_good_is_reported_by_its_name() -> None:
    assert reported(elsewhere=0.0101) == {("sensor_gain", "x"), ("sensor_gain", "a")}


@pytest.mark.parametrize(("behind", "told"), [(POLICY.matters - 0.01, True), (POLICY.form_close, False)])
def test_another_form_at_its_place_that_is_as_good_is_reported(behind: float, told: bool) -> None:
    """Of a late channel the data may not tell whether it is late or behind a low-pass."""
    assert (("channel_delay", "x") in reported(elsewhere=0.0300, delay=0.0100 * behind)) == told


def test_a_place_without_such_a_form_is_reported_by_its_free_shape() -> None:
    assert reported(elsewhere=0.0300) == {("sensor_gain", "x"), ("sensor", "a")}


@pytest.mark.parametrize(
    ("factor", "standing"), [(POLICY.form_close + 0.01, "not confirmed"), (POLICY.form_close - 0.01, "ruled out")]
)
def test_a_fit_that_left_more_than_the_model_without_it_rules_nothing_out(factor: float, standing: str) -> None:
    first, entries = scored(0.1), [entry("sensor_gain", "x", 0.1 * factor), entry("sensor_gain", "a", 0.097)]
    found = all_considered([(first, entries)], [], (), {}, first, FLOORS, stage(), (), None)
    assert next(c.standing for c in found if c.location == "x" and c.holdout_error is not None) == standing


@pytest.mark.parametrize(
    ("pointed", "x"), [(None, "ruled out"), (("sensor", "x"), "not confirmed"), (("memory", "x"), "ruled out")]
)
def test_a_cause_to_which_the_equations_point_is_not_ruled_out_by_its_fit(pointed: tuple[str, str] | None, x: str) -> None:
    first, entries = scored(0.1), [entry("sensor_gain", "x", 0.098), entry("sensor_gain", "a", 0.097)]
    found = all_considered([(first, entries)], [], (), {}, first, FLOORS, stage(), (), pointed)
    assert {c.location: c.standing for c in found if c.holdout_error is not None} == {"x": x, "a": "ruled out"}


@pytest.mark.parametrize(
    ("second", "standing"), [(0.09, "main contributor"), (0.03 * POLICY.form_close * 0.99, "one of several")]
)
def test_the_only_candidate_that_explains_most_is_the_main_contributor(second: float, standing: str) -> None:
    first, entries = scored(0.1), [entry("sensor_gain", "x", 0.03), entry("sensor_gain", "a", second)]
    found = all_considered([(first, entries)], [], (), {}, first, FLOORS, stage(), (), None)
    assert next(c.standing for c in found if c.location == "x") == standing


@pytest.mark.parametrize(("std", "first", "named"), [(1.01, 0.02, 1), (1.01, 0.031, 2), (0.99, 0.02, 2)])
def test_a_law_whose_values_are_not_determined_gives_way_to_a_simpler_one(std: float, first: float, named: int) -> None:
    """If that comes close to it (a factor of 1.5 in the error)."""
    plain, rich = entry("sensor_gain", "x", first), entry("sensor_gain", "x", 0.02)
    rich = replace(rich, candidate=replace(rich.candidate, free=(*rich.candidate.free, *rich.candidate.free)))
    rich = replace(rich, fit=replace(rich.fit, covariance=np.eye(1) * std**2))  # of the gain, which is 1
    plain = replace(plain, fit=replace(plain.fit, covariance=np.eye(1) * 0.1))
    assert len(determined(rich, [plain, rich], FLOORS).candidate.free) == named


@pytest.mark.parametrize(
    ("more", "extends"), [(0.1 / (1.01 * POLICY.form_alike), True), (0.1 / (0.99 * POLICY.form_alike), False)]
)
def test_a_more_general_law_must_leave_clearly_less(more: float, extends: bool) -> None:
    def law(channel: str, error: float) -> Entry:
        found = entry("sensor_gain", channel, error)
        return replace(found, fit=replace(found.fit, covariance=np.eye(1) * 0.1))

    assert _extends(law("x", more), [law("x", 0.1)], FLOORS) == extends
    assert _extends(law("x", 0.1), [law("a", 0.01)], FLOORS)


@pytest.mark.parametrize(("stds", "extends"), [((0.99, 5.0), True), ((1.01, 5.0), False), ((0.99, 0.1), True)])
def test_a_more_general_law_without_a_determined_value_imitates(stds: tuple[float, float], extends: bool) -> None:
    """Both gains are 1; an adequate model with it is no reason."""
    found = entry("sensor_gain", "x", 1e-9)
    both = tuple(Free(path=f"sensors.{channel}.chain.gain", low=0.1, high=10.0) for channel in ("x", "a"))
    law = replace(
        found, candidate=replace(found.candidate, free=both), fit=replace(found.fit, free=both, covariance=np.diag(stds) ** 2)
    )
    assert _extends(law, [entry("sensor_gain", "x", 0.1)], FLOORS) == extends


def test_no_candidate_has_a_share_of_a_baseline_that_became_adequate_during_the_search() -> None:
    searches = [(scored(0.1), [entry("sensor_gain", "x", 0.004)])]
    found, *_ = all_considered(searches, [], (), {}, scored(0.004), FLOORS, stage(), (), None)
    assert (found.share, found.standing) == (0.0, "ruled out")
    assert "without it" in found.why


def step_to(cause: str, kind: Kind, before: float, after: float, location: str = "rail") -> SearchStage:
    """A stage of a search with a step that reduces the error from `before` to `after`."""
    step = Step(
        cause=cause, location=location, kind=kind, form=cause, closest=None, parameters={}, confidence=1.0, rivals=(),
        indistinguishable=(), evidence=("It does.",), before=before, after=after, reported=(),
    )  # fmt: skip
    return SearchStage(fit=entry("sensor_gain", "x", after).fit, score=scored(after), step=step)


def test_a_cause_that_leaves_more_than_the_better_baseline_of_a_later_fit_removes_nothing() -> None:
    searches = [(scored(0.1), [entry("sensor_gain", "x", 0.0077)])]
    found, *_ = all_considered(searches, [], (), {}, scored(0.0073), FLOORS, stage(), (), None)
    assert found.standing == "ruled out"
    assert found.share is not None
    assert found.share < 0.0


def test_a_replaced_cause_that_left_more_does_not_reduce_the_share_of_the_one_in_its_place() -> None:
    last = step_to("hysteresis", "memory", 0.15, 0.009, "x").step
    assert last is not None
    searches = [(scored(0.15), [entry("coulomb_friction", "x", 0.25)]), (scored(0.25), [entry("hysteresis", "x", 0.009)])]
    found, *_ = all_considered(searches, [last], {("coulomb_friction", "x")}, {}, scored(0.15), FLOORS, stage(), (), None)
    assert (found.cause, found.standing) == ("hysteresis", "established")
    assert found.share == pytest.approx(1.0, abs=0.01)


def test_a_named_cause_has_the_share_of_the_one_that_it_replaced_too() -> None:
    last = step_to("hysteresis", "memory", 0.05, 0.009, "x").step
    assert last is not None
    searches = [(scored(0.15), [entry("coulomb_friction", "x", 0.05)]), (scored(0.05), [entry("hysteresis", "x", 0.009)])]
    found = all_considered(searches, [last], {("coulomb_friction", "x")}, {}, scored(0.15), FLOORS, stage(), (), None)
    shares = {one.cause: one.share for one in found if one.share is not None}
    assert shares == {"hysteresis": pytest.approx(1.0, abs=0.01), "coulomb_friction": pytest.approx(0.89, abs=0.01)}
    # One that is not named has its own share.
    searches[1][1].append(entry("relaxation", "x", 0.03))
    found = all_considered(searches, [last], {("coulomb_friction", "x")}, {}, scored(0.15), FLOORS, stage(), (), None)
    assert next(one.share for one in found if one.cause == "relaxation") == pytest.approx(0.07, abs=0.01)


@pytest.mark.parametrize("again", [False, True])
def test_an_exchanged_cause_is_ruled_out_unless_it_is_named_again(again: bool) -> None:
    first, entries = scored(0.1), [entry("sensor_gain", "x", 0.03), entry("sensor_gain", "a", 0.02)]
    named = [step_to("sensor_gain", "sensor", 0.1, 0.02, at).step for at in ("a", *("x" * again))]
    exchanged = {("sensor_gain", "x"): ("sensor_gain", "a")}
    found = all_considered([(first, entries)], [step for step in named if step], (), exchanged, first, FLOORS, stage(), (), None)
    one = next(one for one in found if one.location == "x" and one.share is not None)
    assert one.standing == ("established" if again else "ruled out")
    assert ("sensor_gain at a explains more together with the later causes" in one.why) is not again


def test_a_stage_whose_step_needs_the_next_one_says_so() -> None:
    found = best_form([entry("sensor_gain", "x", 0.01)], scored(0.1), FLOORS)
    assert not stage_of(scored(0.1), found).paired
    assert stage_of(scored(0.1), replace(found, then=found)).paired


@pytest.mark.parametrize(
    ("shape", "chosen", "place", "same"),
    [
        ("friction_shape", "coulomb_friction", "rail", True),
        ("friction_shape", "coulomb_friction", "elsewhere", False),
        ("friction_shape", "end_stop", "rail", False),
        ("spring_shape", "coulomb_friction", "rail", False),
    ],
)
def test_a_curve_over_the_velocity_between_the_same_ends_is_no_other_cause(
    shape: str, chosen: str, place: str, same: bool
) -> None:  # fmt: skip
    first, *_, last = (link.name for link in chain().links)
    at = {"rail": first, "elsewhere": last}
    curve, form = entry(shape, at["rail"], 0.01, points=4), entry(chosen, at[place], 0.01)
    form = replace(form, fit=replace(form.fit, model=chain()))
    assert _same_curve(curve, form) is same
    assert not _same_curve(replace(curve, candidate=replace(curve.candidate, shape=None)), form)


def test_the_points_of_a_curve_ascend_and_have_the_straight_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """Backward velocities are negative, zero is a point of the forward direction alone; a point that no fit changed is exact."""
    shape = Shape(over="speed", unit="m/s", value_unit="N", path="contacts.rail.law", tables=("forward", "backward"))
    tables = {"forward": [1.0, 2.0], "backward": [-1.0, -3.0]}
    monkeypatch.setattr(steps, "tabulated", lambda model, shape, evidence: ([0.0, 0.5], tables, 4.0, (-0.4, 0.4)))
    found = entry("friction_shape", "rail", 0.01, points=4)
    fit: object = SimpleNamespace(model=stage(), std={"contacts.rail.law.forward.1": 0.25})
    curve = curve_of(replace(found.candidate, shape=shape), fit, SimpleNamespace())  # type: ignore[arg-type]
    assert curve is not None
    assert curve.points == ((-0.5, -1.0, 0.0), (0.0, 1.0, 0.0), (0.5, 4.0, 0.25))
    assert curve.paths == tuple(f"contacts.rail.law.{name}" for name in ("backward.1", "forward.0", "forward.1"))
    assert curve_of(found.candidate, fit, SimpleNamespace()) is None  # type: ignore[arg-type]


def test_a_curve_has_the_values_of_the_model_to_which_it_is_moved() -> None:
    """A point whose value the other model has 100 larger."""
    curve = steps.Curve(
        over="speed", unit="m/s", value_unit="N", points=((0.5, 4.0, 0.25),), reached=(0.0, 1.0), paths=("links.rail.stiffness",)
    )
    stiffness = stage().get("links.rail.stiffness")
    found = curve.moved(stage(), stage().replace({"links.rail.stiffness": stiffness + 100.0}))
    assert found.points == ((0.5, 104.0, 0.25),)


def test_a_named_cause_keeps_its_share_when_a_later_search_fits_it_again() -> None:
    first, again = scored(0.1), scored(0.05)
    named = step_to("sensor_gain", "sensor", 0.1, 0.05, "x").step
    assert named is not None
    searches = [(first, [entry("sensor_gain", "x", 0.05)]), (again, [entry("sensor_gain", "x", 0.0499)])]
    found, *_ = all_considered(searches, [named], (), {}, first, FLOORS, stage(), (), None)
    assert found.share == pytest.approx(0.75, abs=0.01)
    assert found.standing == "main contributor"


def test_friction_that_generalizes_the_step_before_it_replaces_that_step() -> None:
    first = step_to("coulomb_friction", "friction_shape", 0.9, 0.4)
    baseline = replace(first, step=None)
    last = step_to("stribeck_friction", "friction_shape", 0.4, 0.4 / POLICY.form_close * 0.99)
    stages, gone = merged([baseline, first, last], FLOORS)
    assert gone == {("coulomb_friction", "rail")}
    (step,) = (stage.step for stage in stages if stage.step)
    assert (step.cause, step.before, step.after) == ("stribeck_friction", 0.9, 0.4 / POLICY.form_close * 0.99)
    assert "coulomb_friction" in step.evidence[-1]


@pytest.mark.parametrize(
    "last",
    [
        step_to("stribeck_friction", "friction_shape", 0.4, 0.01, "other rail"),
        step_to("hardening_stiffness", "spring_shape", 0.4, 0.01),
        step_to("stribeck_friction", "friction_shape", 0.4, 0.4 / POLICY.form_close * 1.01),
    ],
)
def test_steps_at_other_places_of_other_kinds_and_refinements_both_count(last: SearchStage) -> None:
    first = step_to("coulomb_friction", "friction_shape", 0.9, 0.4)
    stages, gone = merged([replace(first, step=None), first, last], FLOORS)
    assert (len(stages), gone) == (3, frozenset())


def rubbing(law: ContactLaw, *names: str, step: SearchStage) -> SearchStage:
    """A stage whose step is a law at the contact "rail" with these parameters."""
    model = msgspec.structs.replace(stage(), contacts=(Contact(name="rail", a="table", law=law),))
    free = tuple(Free(path=f"contacts.rail.law.{name}") for name in names)
    candidate = replace(entry("sensor_gain", "x", 0.1).candidate, free=free)
    return replace(step, candidate=candidate, fit=replace(step.fit, model=model))


def test_a_law_that_replaces_that_of_an_earlier_cause_takes_the_place_of_its_step() -> None:
    """However many steps are between them, and although the earlier cause alone leaves more than the model without it."""
    dry = rubbing(Coulomb(friction_force=59.0), "friction_force", step=step_to("coulomb_friction", "friction_shape", 0.15, 0.25))
    law = BoucWen(friction_force=59.0, initial_stiffness=7e3)
    last = rubbing(law, "friction_force", "initial_stiffness", step=step_to("hysteresis", "memory", 0.25, 0.009))
    baseline = replace(dry, step=None, candidate=None)
    stages, gone = merged([baseline, replace(dry, paired=True), last], FLOORS)
    assert gone == {("coulomb_friction", "rail")}
    assert [s.step and (s.step.cause, s.step.before, s.step.after) for s in stages] == [None, ("hysteresis", 0.15, 0.009)]
    assert stages[-1].step is not None
    assert "falls from 15 % to 0.90 %" in stages[-1].step.evidence[0]
    assert "coulomb_friction at rail" in stages[-1].step.evidence[-1]
    between = rubbing(Coulomb(friction_force=9.0), step=step_to("hardening_stiffness", "spring_shape", 0.25, 0.1))
    stages, gone = merged([baseline, dry, between, last], FLOORS)
    assert gone == {("coulomb_friction", "rail")}
    assert [s.step and s.step.cause for s in stages] == [None, "hysteresis", "hardening_stiffness"]
    assert [s.score.figure for s in stages] == [dry.score.figure, dry.score.figure, last.score.figure]
    assert stages[-1].fit is last.fit


def test_a_cause_that_the_last_model_lacks_is_not_named() -> None:
    dry = rubbing(Coulomb(friction_force=9.0), "friction_force", step=step_to("coulomb_friction", "friction_shape", 0.4, 0.2))
    last = replace(step_to("play_and_friction", "memory", 0.2, 0.01), candidate=entry("sensor_gain", "x", 0.1).candidate)
    stages, gone = merged([replace(dry, step=None, candidate=None), dry, last], FLOORS)
    assert gone == {("coulomb_friction", "rail")}
    assert [s.step and s.step.cause for s in stages] == [None, "play_and_friction"]


@pytest.mark.parametrize(("alone", "steps"), [(0.004, 1), (0.04, 2)])
def test_the_second_of_two_causes_is_left_out_if_the_first_suffices(
    alone: float, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    """A pair may only have led the first cause's fit out of a local minimum."""
    campaign, guess = played(stage(), seed=7), guessed(stage(), 7)
    trials = prepare(campaign, guess)
    wrong = stage().replace({"sensors.x.chain.gain": 1.3})
    free = base_parameters(guess)
    baseline = Fit(model=wrong, free=free, covariance=np.eye(len(free)), cost=1.0, evaluations=1)
    search = _Search(campaign, guess, guess, equations_of(campaign, guess), trials, lambda text: None, 0.0, MOST_STEPS)
    shape = score(wrong, ends(trials).judged).error.shape

    def found(cause: str, error: float, then: Found | None = None) -> Found:
        step = step_to(cause, "sensor", 0.3, error).step
        assert step is not None
        one = entry("sensor_gain", "x" if then else "a", error)
        one = replace(one, score=scored(error, shape), fit=replace(baseline, model=stage()))
        return Found(step=step, entry=one, entries=(one,), then=then)

    answers = iter([found("sensor_gain", alone, found("crosstalk", 0.004)), None, None, None])
    monkeypatch.setattr(diagnosis, "next_step", lambda *given, **options: next(answers))
    monkeypatch.setattr(diagnosis, "without", lambda *given: baseline)
    monkeypatch.setattr(diagnosis, "widened", lambda done: done)
    monkeypatch.setattr(revise, "widened", lambda done: done)
    assert len(search.causes(baseline, ends).stages) == 1 + steps


@pytest.mark.parametrize(
    ("alone", "plausible", "named"),
    [
        (0.004, True, ["backlash"]),  # the second one suffices
        (0.0204, True, ["backlash"]),  # the first one adds less than 5 %
        (0.03, True, ["wrong_mass", "backlash"]),
        (0.03, False, ["backlash"]),  # the first one is as given after all
    ],
)
def test_the_first_of_two_causes_is_left_out_if_the_last_fit_needs_it_no_more(
    alone: float, plausible: bool, named: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    mass = replace(entry("sensor_gain", "x", 0.2).candidate, cause="wrong_mass", plausible=lambda model: plausible)
    first = replace(step_to("wrong_mass", "known_value", 0.3, 0.2), candidate=mass, paired=True)
    last = step_to("backlash", "spring_shape", 0.2, 0.02)
    leaner = fitted_as(monkeypatch, last.fit, alone)
    _, *steps = revision().revised([replace(first, step=None, candidate=None, score=scored(0.3)), first, last])
    assert [stage.step.cause for stage in steps if stage.step] == named
    if len(named) == 1:
        assert steps[0].fit is leaner
        assert steps[0].step is not None
        assert (steps[0].step.before, steps[0].step.after) == (scored(0.3).figure, scored(alone).figure)


def revision() -> Revision:
    """A revision of stages of a short recording."""
    campaign, guess = played(stage(), seed=7), guessed(stage(), 7)
    trials = prepare(campaign, guess)
    return Revision(
        division=ends(trials), floors=FLOORS, enough=POLICY.enough, tolerance=0.0, progress=lambda text: None,
        evidence_of=lambda model: observe(campaign, model, trials, guess, guess),
    )  # fmt: skip


def fitted_as(monkeypatch: pytest.MonkeyPatch, fit: Fit, *errors: float) -> Fit:
    """The fit that every refit gives from now on, with these held-out errors one after the other, the last one for all more."""
    refit, left = replace(fit, cost=0.5), list(errors)
    monkeypatch.setattr(revise, "without_cause", lambda before, after, last: (last.model, last.free))
    monkeypatch.setattr(revise, "tried", lambda model, free, rung: refit)
    monkeypatch.setattr(revise, "finished", lambda rough, trials: refit)
    monkeypatch.setattr(revise, "widened", lambda done: done)
    monkeypatch.setattr(revise, "score", lambda model, judged: scored(left.pop(0) if len(left) > 1 else left[0]))
    return refit


@pytest.mark.parametrize(
    ("with_rival", "named"),
    [
        (0.1 * np.exp(-POLICY.refitted) * 0.99, "sensor_gain"),
        (0.1 * np.exp(-POLICY.refitted) * 1.01, "wrong_mass"),
    ],
)
def test_a_cause_is_exchanged_for_a_rival_that_explains_more_with_the_later_ones(
    with_rival: float, named: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:  # fmt: skip
    """While the relaxation was missing, the mass was closer than the gain."""
    rival = entry("sensor_gain", "x", 0.21)
    wrong = entry("wrong_mass", "table", 0.2).candidate
    first = replace(step_to("wrong_mass", "known_value", 0.3, 0.2), candidate=wrong, entries=(rival,))
    last = step_to("relaxation", "memory", 0.2, 0.1)
    baseline = replace(first, step=None, candidate=None, entries=(), score=scored(0.3))
    fitted_as(monkeypatch, last.fit, 0.2, with_rival)  # without any of the two, and with the rival
    put: list[Candidate] = []

    def with_cause(model: RigModel, free: object, candidate: Candidate, fit: object, evidence: object) -> list[Any]:
        put.append(candidate)
        return [(candidate, free, model)]

    monkeypatch.setattr(revise, "with_cause", with_cause)
    changed = revision()
    _, one, two = changed.revised([baseline, first, last])
    assert one.step is not None
    assert two.step is not None
    assert (one.step.cause, two.step.cause) == (named, "relaxation")
    if named == "sensor_gain":
        assert changed.exchanged == {("wrong_mass", "rail"): ("sensor_gain", "x")}
        assert (one.step.before, one.step.after, two.step.before) == pytest.approx((0.3, 0.21, 0.21))
        assert two.step.after == pytest.approx(with_rival)
    else:
        assert not changed.exchanged
    assert {candidate.key for candidate in put} == {("sensor_gain", "x")}
    assert capsys.readouterr().out == "", "what is said goes to progress"


@pytest.mark.parametrize(("share", "named"), [(0.99, "coulomb_friction"), (1.01, "play_and_friction")])
@pytest.mark.parametrize("paired", [True, False])
def test_a_simpler_law_at_its_place_takes_the_place_of_a_cause(
    share: float, named: str, paired: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While a gain was missing, play looked better than friction alone."""
    simple = entry("sensor_gain", "x", 0.21)
    simple = replace(simple, candidate=replace(simple.candidate, cause="coulomb_friction", location="rail"))
    general = replace(simple.candidate, cause="play_and_friction", rank=3)
    first = replace(step_to("play_and_friction", "memory", 0.3, 0.2), candidate=general, entries=(simple,), paired=paired)
    last = step_to("sensor_gain", "sensor", 0.2, 0.1)
    fitted_as(monkeypatch, last.fit, 0.2, 0.1 * POLICY.matters * share)  # without any of the two, and with the simpler one
    monkeypatch.setattr(revise, "with_cause", lambda model, free, candidate, fit, evidence: [(candidate, free, model)])
    stages = [replace(first, step=None, candidate=None, entries=(), score=scored(0.3)), first, last]
    _, one, _ = revision().revised(stages)
    assert one.step is not None
    assert (one.step.cause, one.paired) == (named, paired)


@pytest.mark.parametrize(("share", "kept"), [(0.99, False), (1.01, True)])
def test_a_law_before_another_one_of_the_same_link_is_left_out(share: float, kept: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without it the other law has another place in the link's list: its cause is put into the model before both."""
    first = replace(step_to("sensor_gain", "sensor", 0.3, 0.2), candidate=entry("sensor_gain", "x", 0.2).candidate)
    last = replace(step_to("relaxation", "memory", 0.2, 0.1), candidate=entry("relaxation", "rail", 0.1).candidate)
    fitted_as(monkeypatch, last.fit, 0.1 * POLICY.matters * share)
    moved = replace(entry("relaxation", "rail", 0.1).candidate, reported=(Reported(name="time", path="drive.factor", unit="s"),))
    monkeypatch.setattr(revise, "without_cause", lambda before, after, last: None)
    monkeypatch.setattr(revise, "with_cause", lambda model, free, candidate, fit, evidence: [(moved, free, model)])
    stages = [replace(first, step=None, candidate=None, score=scored(0.3)), first, last]
    found = revision().revised(stages)
    assert len(found) == (3 if kept else 2)
    if not kept:
        assert found[-1].candidate is moved
        assert found[-1].step is not None
        assert found[-1].step.reported == moved.reported
        assert (found[-1].step.before, found[-1].step.after) == pytest.approx((0.3, 0.1 * POLICY.matters * share))


@pytest.mark.parametrize(("error", "named"), [(0.101, "sensor_gain"), (0.2, None)])
def test_a_curve_of_a_pair_is_exchanged_for_a_form_that_comes_as_close(
    error: float, named: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    points = tuple((x, x, 0.1) for x in (-1.0, 0.0, 1.0))
    curve = Curve(over="value", unit="m", value_unit="m", points=points, reached=(-1.0, 1.0))
    shaped = step_to("sensor", "sensor", 0.3, 0.1)
    assert shaped.step is not None
    shaped = replace(
        shaped, step=replace(shaped.step, form=None, curve=curve), candidate=entry("sensor", "x", 0.1, points=3).candidate
    )
    baseline = replace(shaped, step=None, candidate=None, entries=(), score=scored(0.3), paired=True)
    form = entry("sensor_gain", "x", error)
    monkeypatch.setattr(revise, "starts_from_curve", lambda *_: [])
    monkeypatch.setattr(revise, "verified", lambda starts, rung, progress: [(form.candidate, form.fit)])
    monkeypatch.setattr(Revision, "_finished", lambda self, candidate, rough: form)
    monkeypatch.setattr(revise, "is_determined", lambda form: True)
    _, last = revision().revised([baseline, shaped])
    assert last.step is not None
    assert last.step.form == named


def test_an_adequate_model_keeps_its_causes(monkeypatch: pytest.MonkeyPatch) -> None:
    first = replace(step_to("wrong_mass", "known_value", 0.3, 0.2), entries=(entry("sensor_gain", "x", 0.2),))
    first = replace(first, candidate=entry("wrong_mass", "table", 0.2).candidate)
    last = step_to("relaxation", "memory", 0.2, 0.005)
    fitted_as(monkeypatch, last.fit, 0.2, 0.004)
    monkeypatch.setattr(revise, "with_cause", lambda model, free, candidate, fit, evidence: [(candidate, free, model)])
    stages = [replace(first, step=None, candidate=None, score=scored(0.3)), first, last]
    assert revision().revised(stages) == stages


def test_rivals_of_a_step_are_close_forms_of_another_kind_or_place() -> None:
    errors = {"x": 0.2 * POLICY.form_close * 0.99, "a": 0.2 * POLICY.form_close * 1.01}
    forms = tuple(entry("sensor_gain", place, error) for place, error in errors.items())
    shape, same = entry("sensor", "b", 0.2, points=5), entry("wrong_mass", "rail", 0.2)
    stage_ = replace(step_to("wrong_mass", "known_value", 0.3, 0.2), entries=(*forms, shape, same))
    assert [rival.candidate.location for rival in near_rivals(stage_, FLOORS)] == ["x"]


@pytest.mark.parametrize(
    ("cost", "scored_in_turn"),
    [(np.inf, (0, 0, 0, 0, 3, 0, 4)), (1e-300, (0, 0, 3, 3, 4, 4))],
    ids=["first seconds", "whole runs"],
)
def test_steps_before_a_better_fit_are_tested_again(
    monkeypatch: pytest.MonkeyPatch, cost: float, scored_in_turn: tuple[int, ...]
) -> None:
    """A baseline in a local minimum takes a first step; a second one leads to parameters that need neither.

    The first seconds of the runs show that the parameters are better there, or only the whole runs do.
    """
    campaign, guess = played(stage(), seed=7), guessed(stage(), 7)
    trials = prepare(campaign, guess)
    shape = score(guess, ends(trials).judged).error.shape
    free = base_parameters(guess)
    poor, first, second, better, best = (
        Fit(model=guess, free=free, covariance=np.eye(len(free)), cost=float(k), evaluations=1) for k in range(5)
    )
    errors = (0.4, 0.05, 0.01, 0.01, 0.004)  # by cost
    search = _Search(campaign, guess, guess, equations_of(campaign, guess), trials, lambda text: None, 0.0, MOST_STEPS)

    def found(cause: str, before: Fit, after: Fit) -> Found:
        step = step_to(cause, "sensor", errors[int(before.cost)], errors[int(after.cost)]).step
        assert step is not None
        one = replace(entry("sensor_gain", "x", 0.0), score=scored(errors[int(after.cost)], shape), fit=after)
        return Found(step=step, entry=one, entries=(one,), then=None)

    answers = iter([found("sensor_gain", poor, first), found("crosstalk", first, second)])
    refits = {(1.0, 0.0): poor, (2.0, 1.0): better, (3.0, 0.0): best}
    scores = iter(errors[k] for k in scored_in_turn)
    monkeypatch.setattr(diagnosis, "next_step", lambda *given, **options: next(answers))
    monkeypatch.setattr(diagnosis, "bare_cost", lambda current, rung: cost)  # in its local minimum: infinite
    monkeypatch.setattr(diagnosis, "without", lambda step, current, trials: refits[step.cost, current.cost])
    monkeypatch.setattr(diagnosis, "score", lambda model, judged: scored(next(scores), shape))
    monkeypatch.setattr(diagnosis, "explains_own_channel", lambda *given: True)
    monkeypatch.setattr(diagnosis, "with_chain_errors", lambda known, fits: None)
    monkeypatch.setattr(diagnosis, "widened", lambda done: done)
    monkeypatch.setattr(revise, "widened", lambda done: done)
    (only,) = search.causes(poor, ends).stages
    assert only.fit is best


def test_a_fit_that_a_better_one_replaced_does_not_raise_the_noise_floor(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model in a local minimum may be far more sensitive to noise on the drive."""
    campaign, guess = played(stage(), seed=7), guessed(stage(), 7)
    trials = prepare(campaign, guess)
    shape = score(guess, ends(trials).judged).error.shape
    free = base_parameters(guess)
    poor, better = (
        Fit(model=model, free=free, covariance=np.eye(len(free)), cost=1.0, evaluations=1)
        for model in (guess.replace({"links.rail.stiffness": 9e3}), stage())
    )
    search = _Search(campaign, guess, guess, equations_of(campaign, guess), trials, lambda text: None, 0.0, MOST_STEPS)
    step = step_to("sensor_gain", "sensor", 0.4, 0.3).step
    assert step is not None
    one = replace(entry("sensor_gain", "x", 0.3), score=scored(0.3, shape), fit=better)
    answers = iter([Found(step=step, entry=one, entries=(one,)), None])
    monkeypatch.setattr(diagnosis, "next_step", lambda *given, **options: next(answers))
    monkeypatch.setattr(diagnosis, "bare_cost", lambda current, rung: np.inf)
    monkeypatch.setattr(diagnosis, "without", lambda step, current, trials: better)
    monkeypatch.setattr(diagnosis, "score", lambda model, judged: scored(0.05 if model == better.model else 0.4, shape))
    monkeypatch.setattr(diagnosis, "widened", lambda done: done)
    monkeypatch.setattr(diagnosis, "depends_on_drive", lambda model, trials: True)
    monkeypatch.setattr(search, "floors", lambda models, judged: np.full(shape, 0.2 if poor.model in models else 0.001))
    assert np.all(search.causes(poor, ends).quiet == 0.001)


def test_only_faults_of_sensors_have_own_channels() -> None:
    """A free shape of a link reports no values, and must not be judged by every channel; that of a sensor by its own."""
    step = step_to("friction_shape", "friction_shape", 0.4, 0.2).step
    assert step is not None
    assert not step.reported
    assert _of_sensors(replace(step, location="x"), ["a", "x"]) == []
    assert _of_sensors(replace(step, kind="sensor", location="x"), ["a", "x"]) == [1]


@pytest.mark.parametrize(("value", "zero"), [(1.99e-3, True), (2.01e-3, False), (-1.99e-3, True), (-2.01e-3, False)])
def test_a_form_whose_values_are_zero_within_their_uncertainty_is_none(value: float, zero: bool) -> None:
    delayed = entry("channel_delay", "x", 0.01)
    free = (Free(path="sensors.x.chain.delay", low=-1.0, high=1.0, log=False),)
    model = stage().replace({"sensors.x.chain.delay": value})
    fit = Fit(model=model, free=free, covariance=np.array([[1e-3**2]]), cost=1.0, evaluations=1)
    assert vanishes(replace(delayed, candidate=replace(delayed.candidate, free=free), fit=fit)) is zero


def test_a_form_with_one_value_that_shows_an_effect_is_one() -> None:
    two = entry("channel_delay", "x", 0.01)
    free = tuple(Free(path=f"sensors.{name}.chain.delay", low=-1.0, high=1.0, log=False) for name in ("x", "a"))
    positive = tuple(Free(path=f"sensors.{name}.chain.gain") for name in ("x", "a"))
    model = stage().replace({free[0].path: 1e-3, free[1].path: 9e-3})
    for own, covariance in ((free, 1e-6 * np.eye(2)), (positive, np.diag([4.0, 0.01]))):
        fit = Fit(model=model, free=own, covariance=covariance, cost=1.0, evaluations=1)
        assert not vanishes(replace(two, candidate=replace(two.candidate, free=own), fit=fit))


@pytest.mark.parametrize(("std", "zero"), [(0.99, False), (1.01, True)])
def test_a_positive_value_below_its_uncertainty_shows_no_effect(std: float, zero: bool) -> None:
    gained = entry("sensor_gain", "x", 0.01)
    free = (Free(path="sensors.x.chain.gain"),)
    fit = Fit(
        model=stage().replace({"sensors.x.chain.gain": 1.0}), free=free, covariance=np.array([[std**2]]), cost=1.0, evaluations=1
    )
    assert vanishes(replace(gained, candidate=replace(gained.candidate, free=free), fit=fit)) is zero


@pytest.mark.parametrize(("std", "zero"), [(0.99, False), (1.01, True)])
def test_each_value_of_a_form_without_effect_is_zero_within_its_uncertainty(std: float, zero: bool) -> None:
    """A positive value that is, beside a signed one that the data determine or not."""
    signed = Free(path="sensors.x.chain.delay", low=-1.0, high=1.0, log=False)
    free = (Free(path="sensors.x.chain.gain"), signed)
    values = {"sensors.x.chain.gain": 1.0, "sensors.x.chain.delay": 1e-3}
    fit = Fit(
        model=stage().replace(values), free=free, covariance=np.diag([4.0, (std * 1e-3 / POLICY.zero) ** 2]), cost=1.0,
        evaluations=1,
    )  # fmt: skip
    both = entry("sensor_gain", "x", 0.01)
    assert vanishes(replace(both, candidate=replace(both.candidate, free=free), fit=fit)) is zero


@pytest.mark.parametrize(
    ("general", "simple", "told"),
    [("asymmetric_stiffness", "hardening_stiffness", False), ("stribeck_friction", "coulomb_friction", False),
     ("end_stop", "hardening_stiffness", True)],
)  # fmt: skip
def test_a_more_general_form_is_not_told_beside_the_one_it_contains(general: str, simple: str, told: bool) -> None:
    forms = [entry(simple, "x", 0.0100), entry(general, "x", 0.0099, points=3)]
    forms = [replace(one, candidate=replace(one.candidate, shape=None)) for one in forms]
    found = best_form(forms, scored(0.1), FLOORS)
    assert found.step.cause == simple
    assert found.step.indistinguishable == (((general, "x"),) if told else ())


@pytest.mark.parametrize(("worse", "kept"), [(1.04, False), (1.06, True)])
def test_a_last_fit_that_predicts_less_gives_the_uncertainty_only(
    worse: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    campaign, guess = played(stage(), seed=7), guessed(stage(), 7)
    free = base_parameters(guess)
    before, after = (
        Fit(model=model, free=free, covariance=k * np.eye(len(free)), cost=1.0, evaluations=1)
        for k, model in ((1.0, stage()), (2.0, stage().replace({"links.rail.stiffness": 2501.0})))
    )
    trials = prepare(campaign, guess)
    search = _Search(campaign, guess, guess, equations_of(campaign, guess), trials, lambda text: None, 0.0, MOST_STEPS)
    monkeypatch.setattr(diagnosis, "next_step", lambda *given, **options: None)
    found = search.causes(before, ends)
    error = found.stages[0].score.error.shape
    found = replace(found, stages=[replace(found.stages[0], score=scored(0.1, error))])
    monkeypatch.setattr(diagnosis, "assessed", lambda *given: SimpleNamespace(fit=after))
    monkeypatch.setattr(diagnosis, "score", lambda model, judged: scored(0.1 * worse, error))
    last = search.settled(found).stages[0]
    assert last.fit.model == (before if kept else after).model
    assert last.fit.covariance[0, 0] == 2.0
    assert last.score.figure == pytest.approx(0.1 if kept else 0.1 * worse)


@pytest.mark.parametrize(("std", "form"), [(0.99, "sensor_gain"), (1.01, None)])
def test_a_form_whose_refined_values_are_not_determined_is_the_closest_only(
    std: float, form: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign, guess = played(stage(), seed=7), guessed(stage(), 7)
    trials = prepare(campaign, guess)
    search = _Search(campaign, guess, guess, equations_of(campaign, guess), trials, lambda text: None, 0.0, MOST_STEPS)
    baseline = Fit(model=guess, free=base_parameters(guess), covariance=np.eye(3), cost=1.0, evaluations=1)
    monkeypatch.setattr(diagnosis, "next_step", lambda *given, **options: None)
    found = search.causes(baseline, ends)
    shape = found.stages[0].score.error.shape
    first = replace(found.stages[0], score=scored(0.3, shape))
    gained = entry("sensor_gain", "x", 0.1)
    last = replace(
        step_to("sensor_gain", "sensor", 0.3, 0.1), candidate=gained.candidate, fit=gained.fit, score=scored(0.1, shape)
    )
    refined = replace(gained.fit, covariance=np.array([[std**2]]))
    monkeypatch.setattr(diagnosis, "assessed", lambda *given: SimpleNamespace(fit=refined))
    monkeypatch.setattr(diagnosis, "score", lambda model, judged: scored(0.1, shape))
    step = search.settled(replace(found, stages=[first, last], kept=1)).stages[1].step
    assert step is not None
    assert (step.form, step.cause) == (form, form or "sensor")


@pytest.mark.parametrize(("remains", "kept"), [(0.69, False), (0.71, True)])
def test_equations_refute_a_doubt_about_the_unit_of_the_drive(
    monkeypatch: pytest.MonkeyPatch, remains: float, kept: bool
) -> None:  # fmt: skip
    """What the best explanation leaves, with the drive as described and with its factor corrected by the ratio of the doubt."""
    rig, campaign = stage(), Campaign(runs=())
    doubt = Doubt(parameter=f"drive.{rig.drive.channel}", kind="unit", ratio=4.0, text="")
    blamed = {rig.drive.factor: remains, 4.0 * rig.drive.factor: 1.0}
    monkeypatch.setattr(diagnosis, "equations_of", lambda campaign, model: model)
    monkeypatch.setattr(diagnosis, "solved_values", lambda equations, explanation: {})
    monkeypatch.setattr(
        diagnosis, "suspects",
        lambda model: SimpleNamespace(exact=True, chosen=[None], remains=blamed[model.drive.factor]),
    )  # fmt: skip
    assert bool(_standing([doubt], campaign, rig, rig)) is kept  # type: ignore[arg-type]


@pytest.mark.parametrize("clear", [None, ("spring_shape", "bearing")])
def test_equations_lead_the_search_for_a_further_cause_of_a_rig_judged_by_its_drive_if_they_are_clear(
    clear: tuple[str, str] | None,
) -> None:  # fmt: skip
    equations = SimpleNamespace(hidden=(), complete=True, residuals=dict)
    job = SimpleNamespace(
        equations=equations, curved=None, judged_by_drive=True, left=0.3, rubbing="", by_estimates=SimpleNamespace(clear=clear)
    )
    assert isinstance(next(sources(job)), Suspected) is (clear is not None)  # type: ignore[arg-type]


@pytest.mark.parametrize(("other", "told"), [("asymmetric_stiffness", False), ("end_stop", True)])
def test_of_a_pair_the_form_that_contains_one_is_not_told_either(
    other: str, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    gain = entry("sensor_gain", "x", 0.1)
    cubic, wider = (
        replace(gain, candidate=replace(gain.candidate, cause=cause, location="rail", rank=rank))
        for cause, rank in (("hardening_stiffness", 1), (other, 2))
    )
    monkeypatch.setattr(search, "finished", lambda rough, trials: rough)
    monkeypatch.setattr(search, "without", lambda last, alone, trials: alone)
    monkeypatch.setattr(search, "score", lambda model, fine: scored(0.004))
    monkeypatch.setattr(search, "curve_of", lambda *_: None)
    job = SimpleNamespace(
        finished=lambda entries: [], trials=(), fine=(), floors=FLOORS, now=scored(0.3), progress=lambda text: None,
        allowed=lambda model: FLOORS, explains=lambda entry: True, nearly=lambda entry: True, evidence=None,
    )  # fmt: skip
    pairs = [(gain.candidate, gain.fit, one.candidate, one.fit) for one in (cubic, wider)]
    found = search._together(job, pairs, [])  # type: ignore[arg-type]
    assert found is not None
    assert found.then is not None
    assert found.then.step.cause == "hardening_stiffness"
    assert found.then.step.indistinguishable == (((other, "rail"),) if told else ())


@pytest.mark.parametrize(("factor", "found"), [(0.99, True), (1.01, False)])
def test_a_run_whose_motion_is_lost_does_not_decide_about_a_pair(
    factor: float, found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pair leaves as much as the single cause in one run of four, and a tenth in the mean logarithm."""
    gain = entry("sensor_gain", "x", 0.1)
    lost = np.full((4, 2), factor * 0.1 * POLICY.rest ** (0.5 * 4.0 / 3.0))
    lost[3] = 0.1
    monkeypatch.setattr(search, "finished", lambda rough, trials: rough)
    monkeypatch.setattr(search, "without", lambda last, alone, trials: alone)
    monkeypatch.setattr(search, "score", lambda model, fine: replace(scored(0.1), error=lost))
    monkeypatch.setattr(search, "curve_of", lambda *_: None)
    job = SimpleNamespace(
        finished=lambda entries: [], trials=(), fine=(), floors=FLOORS, now=scored(0.3), progress=lambda text: None,
        allowed=lambda model: FLOORS, explains=lambda entry: True, nearly=lambda entry: False, evidence=None,
    )  # fmt: skip
    single = replace(gain, score=scored(0.1), fit=gain.fit)
    pair = (gain.candidate, gain.fit, gain.candidate, replace(gain.fit, cost=2.0))
    assert (search._together(job, [pair], [single]) is not None) is found  # type: ignore[arg-type]


@pytest.mark.parametrize(("place", "doubted"), [("rail", False), ("x", True)])
def test_the_spring_of_a_link_with_a_named_play_is_not_doubted(
    place: str, doubted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    doubt = Doubt(parameter="links.rail.stiffness", kind="decade", ratio=0.007, text="")
    monkeypatch.setattr(diagnosis, "doubts", lambda model, fits, campaign: (doubt,))
    stages = [step_to("play_and_friction", "memory", 0.3, 0.3), step_to("play_and_friction", "memory", 0.3, 0.01, place)]
    found = SimpleNamespace(stages=stages, kept=1, verdict="explained")
    assert bool(_doubted(found, stage(), Campaign(runs=()))) is doubted  # type: ignore[arg-type]


@pytest.mark.parametrize("left", [0.99, 1.0])
def test_where_complete_equations_hold_all_kinds_are_screened_for(left: float) -> None:
    """A decay shows a softening of 3 % in its phase; the noise of its equation is larger."""
    equations = SimpleNamespace(hidden=(), complete=True, residuals=lambda: {"table": 1.0})
    job = SimpleNamespace(equations=equations, curved=None, judged_by_drive=False, left=left, rubbing="", by_estimates=None)
    (source,) = sources(job)  # type: ignore[arg-type]
    assert isinstance(source, Screened)
    assert (source.kinds, source.strict) == (None, True)


def test_a_run_that_is_sensitive_to_noise_does_not_decide_between_two_fits_of_a_candidate() -> None:
    """After a few slips noise on the drive explains as much of one run's error as the better fit leaves there."""
    floors = np.array([[0.008], [0.042], [0.010]])
    right, wrong = (np.array(errors)[:, None] for errors in ([0.008, 0.047, 0.013], [0.012, 0.0425, 0.019]))
    fits = [replace(entry("sensor_gain", "x", 0.1), score=replace(scored(0.1, (3, 1)), error=each)) for each in (wrong, right)]
    (best,) = best_fits(fits, floors)
    assert best.score.error is right


def test_another_form_at_the_place_of_a_step_is_a_rival() -> None:
    first = replace(step_to("hysteresis", "memory", 0.3, 0.2), entries=(entry("play_and_friction", "rail", 0.2),))
    assert [rival.candidate.cause for rival in near_rivals(first, FLOORS)] == ["play_and_friction"]


@pytest.mark.parametrize(("removed", "shown"), [(0.99, False), (1.01, True)])
def test_a_second_memory_at_a_place_must_remove_enough_of_its_recorded_force(removed: float, shown: bool) -> None:
    """The equations call every memory next to another one a slip."""
    candidate = replace(entry("relaxation", "rail", 0.1).candidate, cause="relaxation")
    left = np.sqrt(1.0 - removed * OTHER_MEMORY)
    found = SimpleNamespace(
        _explanation_of=lambda one: SimpleNamespace(what="slip"), _begun=lambda one, free: SimpleNamespace(left=left),
        _bare=lambda explanation, current: 1.0,
    )  # fmt: skip
    current = SimpleNamespace(free=())
    assert Suspects._shows_memory(found, candidate, current) is shown  # type: ignore[arg-type]
    slip = replace(candidate, cause="hysteresis")
    assert Suspects._shows_memory(found, slip, current)  # type: ignore[arg-type]


@pytest.mark.parametrize(("periods", "suspected"), [(0.99 * FEW_PERIODS, True), (1.01 * FEW_PERIODS, False)])
def test_few_periods_of_a_force_may_be_another_curve(periods: float, suspected: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    force = SimpleNamespace(deflection=np.array([-0.5, 0.5]) * 1e-3)
    pitch = {"pitch": 1e-3 / periods}
    repeats = Explanation(kind="spring_shape", place="rail", what=PERIODIC, score=1.0, residuals={}, values=pitch)
    monkeypatch.setattr(Suspects, "_solved", lambda self, explanation: ({}, force))
    monkeypatch.setattr(Suspects, "_remembers", lambda self, location: False)
    found = Suspects(ranking=None, chosen=(repeats,), places={}, equations=None)  # type: ignore[arg-type]
    assert found.includes("cogging", "rail")
    assert found.includes("backlash", "rail") is suspected
    assert not found.includes("hysteresis", "rail")


def test_an_explanation_without_samples_to_check_it_has_no_score() -> None:
    assert score_of({"table": 5.0}, {"table": np.inf}) == -np.inf


def test_a_step_without_a_form_has_none_of_its_values() -> None:
    step = step_to("extra_mode", "added_motion", 0.3, 0.1).step
    assert step is not None
    found = without_form(replace(step, parameters={"mode_mass": (0.2, 9.5, "kg")}), 0.8)
    assert (found.cause, found.closest, found.parameters, found.reported) == ("added_motion", ("extra_mode", 0.8), {}, ())
