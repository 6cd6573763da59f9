"""Which forms the equations of motion refute, from given residuals; the limits stated here are those of the code."""

from types import SimpleNamespace
from typing import Any, cast

import pytest
from small_rigs import stage

from isorig.analysis.diagnose.forms_in_equations import comparable_forms, shows_two
from isorig.analysis.diagnose.search import Suspected
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Free

STOP, SPRING, DELAY = ("end_stop", "spring"), ("hardening_stiffness", "spring"), ("channel_delay", "x")


@pytest.mark.parametrize(("left", "kept"), [(60.4, True), (60.6, False)])
def test_a_form_must_remove_half_of_what_the_best_at_its_place_removes(left: float, kept: bool) -> None:
    # Of an excess of 100 the best one removes 81.
    found = comparable_forms({"a": 101.0}, {STOP: {"a": 20.0}, SPRING: {"a": left}})
    assert (SPRING in found) is kept
    assert STOP in found


@pytest.mark.parametrize(("best", "kept"), [(12.1, True), (11.9, False)])
def test_a_form_that_leaves_far_more_of_an_equation_that_another_one_repairs_is_refuted(best: float, kept: bool) -> None:
    # It leaves more than six times as much; where the best one leaves twelve times the noise, its values may be as bad.
    found = comparable_forms({"a": 1001.0}, {STOP: {"a": best}, SPRING: {"a": 100.0}})
    assert (SPRING in found) is kept


@pytest.mark.parametrize(("left", "kept"), [(7.7, True), (7.9, False)])
def test_a_repaired_equation_counts_from_its_floor(left: float, kept: bool) -> None:
    assert (SPRING in comparable_forms({"a": 101.0}, {STOP: {"a": 0.3}, SPRING: {"a": left}})) is kept


@pytest.mark.parametrize(("best", "kept"), [(51.1, True), (50.9, False)])
def test_where_no_form_removes_half_of_an_equation_all_are_tried(best: float, kept: bool) -> None:
    assert (SPRING in comparable_forms({"a": 101.0}, {STOP: {"a": best}, SPRING: {"a": 101.0}})) is kept


def test_a_form_at_another_place_stays_for_the_equation_that_it_repairs() -> None:
    before = {"a": 101.0, "b": 11.0}
    after = {STOP: {"a": 2.0, "b": 11.0}, DELAY: {"a": 101.0, "b": 1.0}, ("wrong_mass", "m"): {"a": 101.0, "b": 11.0}}
    assert comparable_forms(before, after) == {STOP, DELAY}
    assert comparable_forms(before, {}) == frozenset()


@pytest.mark.parametrize(
    ("spring", "delay", "two"),
    [
        ({"a": 2.0, "b": 50.0}, {"a": 50.0, "b": 2.0}, True),
        ({"a": 10.9, "b": 50.0}, {"a": 50.0, "b": 2.0}, True),
        ({"a": 11.1, "b": 50.0}, {"a": 50.0, "b": 2.0}, False),  # a fifth of the excess of one equation stays
        ({"a": 2.0, "b": 2.0}, {"a": 50.0, "b": 2.0}, False),  # one repairs both
    ],
)
def test_two_forms_are_shown_where_each_repairs_its_own_equations(
    spring: dict[str, float], delay: dict[str, float], two: bool
) -> None:
    assert shows_two({"a": 51.0, "b": 51.0}, {SPRING: spring, DELAY: delay}) is two
    # An equation that is not broken needs no repair.
    assert shows_two({"a": 51.0, "b": 51.0, "c": 3.9}, {SPRING: spring | {"c": 3.9}, DELAY: delay | {"c": 3.9}}) is two
    assert not shows_two({"a": 51.0, "b": 51.0, "c": 4.0}, {SPRING: spring | {"c": 4.0}, DELAY: delay | {"c": 4.0}})


def test_two_forms_at_one_place_are_no_two_causes() -> None:
    assert not shows_two({"a": 51.0, "b": 51.0}, {STOP: {"a": 2.0, "b": 50.0}, SPRING: {"a": 50.0, "b": 2.0}})


def test_forces_with_a_memory_refute_no_other_such_force() -> None:
    loop, play = ("hysteresis", "spring"), ("play_and_friction", "spring")
    assert comparable_forms({"a": 101.0}, {loop: {"a": 2.0}, play: {"a": 90.0}}) == {loop, play}
    assert comparable_forms({"a": 101.0}, {STOP: {"a": 2.0}, play: {"a": 90.0}}) == {STOP}


def test_each_variant_of_a_form_is_compared() -> None:
    """A stop at both ends and a stop at one end are one cause; only one of them repairs the equation of a stop at one end."""
    both, one = (
        Candidate(cause="end_stop", location="spring", family="stop", starts=(stage(),), free=free, reported=())
        for free in ((), (Free(path="links.spring.laws.0.stroke"),))
    )
    solved = []

    def solved_with(model: object, like: object) -> SimpleNamespace:
        solved.append(model)
        return SimpleNamespace(residuals={"a": 90.0 if model == "both" else 2.0})

    job = SimpleNamespace(equations=SimpleNamespace(hidden=()), current=SimpleNamespace(free=()), solved_with=solved_with)
    found = SimpleNamespace(
        broken=True, tentative=False, rare=False, left=lambda candidate, free: 1.0, score_of=lambda *key: 1.0,
        ranking=SimpleNamespace(residuals={"a": 101.0}), equations=None,
    )  # fmt: skip
    starts = [(both, (), "both"), (both, (), "both again"), (one, (), "one"), (one, (), "one again")]
    suspected = SimpleNamespace(job=job)
    assert Suspected._in_model(cast(Any, suspected), cast(Any, starts), cast(Any, found)) == {STOP: {"a": 2.0}}
    assert solved == ["both", "one"]
