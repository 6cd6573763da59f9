"""The verdict's rules at their boundaries, on errors made by hand: no simulation."""

from __future__ import annotations

import inspect
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose.policy import POLICY, Policy, Stage, form_stands, is_superfluous, step_counts, verdict, wins
from isorig.analysis.fitting.excess import MOST_ERROR, excess, is_adequate, ratio, share_removed

FLOORS = np.full((6, 3), 0.004)


def errors(value: float) -> FloatArray:
    return np.full((6, 3), value)


def after(share: float, before: float = 0.4) -> FloatArray:
    """Errors that are left when a share of the excess is removed."""
    return np.sqrt(FLOORS**2 + (1.0 - share) * (errors(before) ** 2 - FLOORS**2))


def stages(*shares: float, places: tuple[str, ...] = (), certain: tuple[bool, ...] = ()) -> list[Stage]:
    """The baseline and models that removed these shares so far."""
    steps = zip(shares, places or tuple(f"p{k}" for k in range(len(shares))), certain or (True,) * len(shares), strict=True)
    return [Stage(error=errors(0.4)), *(Stage(error=after(s), place=place, certain=sure) for s, place, sure in steps)]


def test_every_threshold_says_what_it_means() -> None:
    """In a comment on its line or above it; two thresholds share the one of the threshold before."""
    lines = [line.strip() for line in inspect.getsource(Policy).splitlines()]
    silent = {
        field.name
        for field in fields(Policy)
        for k, line in enumerate(lines)
        if line.startswith(f"{field.name}: ") and "#: " not in line and not lines[k - 1].startswith("#: ")
    }
    assert silent == {"of_rest_here", "scatter"}


@pytest.mark.parametrize(("factor", "verdict_"), [(0.99, "adequate"), (1.01, "unexplained")])
def test_adequacy_threshold(factor: float, verdict_: str) -> None:
    error = FLOORS.copy()
    error[2, 1] = factor * POLICY.enough * FLOORS[2, 1]
    assert verdict([Stage(error=error)], FLOORS, POLICY.enough)[0] == verdict_


def test_a_tolerance_makes_a_small_error_adequate() -> None:
    assert verdict([Stage(error=errors(0.049))], FLOORS, POLICY.enough, tolerance=0.05)[0] == "adequate"
    assert verdict([Stage(error=errors(0.051))], FLOORS, POLICY.enough, tolerance=0.05)[0] == "unexplained"


def test_share_removed_counts_squares_beyond_the_floor() -> None:
    assert share_removed(errors(0.4), after(0.37), FLOORS) == pytest.approx(0.37)
    assert share_removed(errors(0.4), FLOORS, FLOORS) == 1.0
    assert share_removed(errors(0.4), errors(0.4), FLOORS) == 0.0
    assert share_removed(FLOORS, FLOORS, FLOORS) == 0.0


def test_a_motion_that_is_lost_counts_no_more_than_twice_the_signal() -> None:
    assert excess(errors(1e6), FLOORS) == pytest.approx(MOST_ERROR**2, rel=1e-4)


@pytest.mark.parametrize(
    ("share", "said"),
    [
        (POLICY.explained + 0.01, "explained"),
        (POLICY.explained - 0.01, "partly explained"),
        (POLICY.contributes + 0.01, "partly explained"),
        (POLICY.contributes - 0.01, "unexplained"),
    ],
)
def test_the_word_follows_the_share(share: float, said: str) -> None:
    word, kept = verdict(stages(share), FLOORS, POLICY.enough)
    assert (word, kept) == (said, 0 if said == "unexplained" else 1)


@pytest.mark.parametrize(
    ("left", "floor", "said"), [(0.69, 0.01, "explained"), (0.71, 0.01, "partly explained"), (0.71, 0.05, "explained")]
)
def test_a_cause_that_hardly_reduces_the_median_error_explains_a_part(left: float, floor: float, said: str) -> None:
    """One channel of three had most of the error; the others may be at their floors before and after."""
    first, floors = np.array([[0.4, 0.05, 0.05]]), np.array([[0.01, floor, floor]])
    last = np.array([[0.02, left * 0.05, left * 0.05]])
    assert verdict([Stage(error=first), Stage(error=last)], floors, POLICY.enough)[0] == said


def test_an_uncertain_step_is_named_only_where_it_explains() -> None:
    assert verdict(stages(0.7, certain=(False,)), FLOORS, POLICY.enough) == ("unexplained", 0)
    assert verdict(stages(0.9, certain=(False,)), FLOORS, POLICY.enough) == ("explained", 1)


@pytest.mark.parametrize(("share", "said"), [(POLICY.worth + 0.01, "partly explained"), (POLICY.worth - 0.01, "unexplained")])
def test_a_step_that_the_equations_show_is_named_although_disturbances_are_most_of_the_error(share: float, said: str) -> None:
    way = stages(share, certain=(False,))
    assert verdict(way, FLOORS, POLICY.enough) == ("unexplained", 0)
    way[1] = replace(way[1], shown=True)
    assert verdict(way, FLOORS, POLICY.enough)[0] == said


@pytest.mark.parametrize(("more", "counts"), [(POLICY.worth + 0.01, True), (POLICY.worth - 0.01, False)])
def test_a_further_step_that_the_equations_show_needs_less(more: float, counts: bool) -> None:
    way = stages(0.99, 0.99 + 0.01 * more)
    assert not step_counts(way, 2, FLOORS, POLICY.enough)
    way[2] = replace(way[2], shown=True)
    assert step_counts(way, 2, FLOORS, POLICY.enough) is counts


@pytest.mark.parametrize(
    ("shares", "places", "kept"),
    [
        ((0.6, 0.6 + 0.4 * (POLICY.of_rest + 0.02)), ("a", "b"), 2),
        ((0.6, 0.6 + 0.4 * (POLICY.of_rest - 0.02)), ("a", "b"), 1),
        ((0.6, 0.6 + 0.4 * (POLICY.of_rest_here + 0.02)), ("a", "a"), 2),
        ((0.6, 0.6 + 0.4 * (POLICY.of_rest_here - 0.02)), ("a", "a"), 1),
        ((0.94, 0.94 + POLICY.later + 0.002), ("a", "b"), 2),
        ((0.94, 0.94 + POLICY.later - 0.002), ("a", "b"), 1),
    ],
)
def test_a_further_step_must_remove_more(shares: tuple[float, ...], places: tuple[str, ...], kept: int) -> None:
    assert verdict(stages(*shares, places=places), FLOORS, POLICY.enough)[1] == kept


@pytest.mark.parametrize(("more", "counts"), [(POLICY.worth + 0.01, True), (POLICY.worth - 0.01, False)])
def test_a_more_general_law_in_the_same_place_needs_less(more: float, counts: bool) -> None:
    way = stages(0.6, 0.6 + 0.4 * more, places=("a", "a"))
    way[2] = replace(way[2], refines=True)
    assert step_counts(way, 2, FLOORS, POLICY.enough) is counts


def test_a_further_step_that_reaches_the_floor_counts_however_small() -> None:
    way = stages(0.999, 1.0)
    assert not is_adequate(way[1].error, FLOORS, POLICY.enough)
    assert verdict(way, FLOORS, POLICY.enough) == ("explained", 2)


@pytest.mark.parametrize(("share", "counts"), [(POLICY.worth + 0.01, True), (POLICY.worth - 0.01, False)])
def test_a_first_step_must_be_worth_it(share: float, counts: bool) -> None:
    assert step_counts(stages(share), 1, FLOORS, POLICY.enough) is counts


def test_a_form_keeps_nine_tenths_of_the_gain() -> None:
    # The shape leaves much itself, so that the ratio of the errors does not decide.
    for share, stands in ((0.5 * POLICY.form_share + 0.01, True), (0.5 * POLICY.form_share - 0.01, False)):
        assert form_stands(errors(0.4), after(0.5), after(share), FLOORS) is stands
    assert ratio(after(0.5 * POLICY.form_share - 0.01), after(0.5), FLOORS) < POLICY.form_alike


def test_a_form_with_a_much_larger_error_than_the_shape_is_not_the_cause() -> None:
    generator = np.random.default_rng(3)
    shape = errors(0.02) * generator.uniform(0.8, 1.2, (6, 3))
    for factor, stands in ((POLICY.form_close - 0.1, True), (POLICY.form_close + 0.1, False)):
        noisy = factor * shape * generator.uniform(0.6, 1.4, (6, 1))
        noisy *= factor * np.sqrt(np.mean(shape**2)) / np.sqrt(np.mean(noisy**2))
        assert form_stands(errors(0.4), shape, noisy, FLOORS) is stands


def test_a_form_with_a_larger_error_in_every_run_is_not_the_cause() -> None:
    shape = errors(0.02)
    for factor, stands in ((POLICY.form_alike - 0.01, True), (POLICY.form_alike + 0.01, False)):
        assert form_stands(errors(0.4), shape, factor * shape, FLOORS) is stands


def test_the_scatter_between_runs_is_known_from_two_runs_on() -> None:
    shape, factor = errors(0.02), POLICY.form_alike + 0.01
    for runs, stands in ((1, True), (2, False)):
        before, floors = errors(0.4)[:runs], FLOORS[:runs]
        assert form_stands(before, shape[:runs], factor * shape[:runs], floors) is stands


def test_four_standard_errors_over_runs() -> None:
    shape = errors(0.02)
    more = np.array([0.0, 0.0, 0.002, 0.004, 0.006, 0.012])
    spread = np.std(more, ddof=1) / np.sqrt(6)
    for errors_over, stands in ((POLICY.form_errors - 0.2, True), (POLICY.form_errors + 0.2, False)):
        form = shape + (more - more.mean() + errors_over * spread)[:, None]
        assert ratio(form, shape, FLOORS) < POLICY.form_close
        assert form_stands(errors(0.4), shape, form, FLOORS) is stands


def test_rivals_within_a_few_per_cent_do_not_differ() -> None:
    assert ratio(errors(0.102), errors(0.1), FLOORS) < POLICY.matters < ratio(errors(0.11), errors(0.1), FLOORS)
    assert ratio(0.5 * FLOORS, FLOORS, FLOORS) == 1.0


@pytest.mark.parametrize(
    ("without", "present", "superfluous"),
    [
        (0.99 * POLICY.enough * 0.004, 0.004, True),
        (1.01 * POLICY.enough * 0.004, 0.004, False),
        (0.99 * POLICY.matters * 0.1, 0.1, True),
        (1.01 * POLICY.matters * 0.1, 0.1, False),
    ],
)
def test_a_cause_is_superfluous_where_the_later_ones_suffice_or_it_adds_too_little(
    without: float, present: float, superfluous: bool
) -> None:  # fmt: skip
    assert is_superfluous(errors(without), errors(present), FLOORS, POLICY.enough) == superfluous


def test_a_tolerance_makes_a_cause_superfluous() -> None:
    assert is_superfluous(errors(0.049), errors(0.01), FLOORS, POLICY.enough, tolerance=0.05)
    assert not is_superfluous(errors(0.051), errors(0.01), FLOORS, POLICY.enough, tolerance=0.05)


def test_certainty_is_the_share_of_resampled_runs_that_win() -> None:
    best = np.full(6, 1.0)
    assert wins(best, [np.full(6, 1.1)]) == 1.0
    assert wins(best, [np.full(6, 0.9)]) == 0.0
    assert wins(best, []) == 1.0
    # One run of six decides: it is missing from (5/6)^6 = 33 % of the draws, where the others are equal.
    one = best.copy()
    one[0], rival = 2.0, best.copy()
    assert wins(one, [rival]) == pytest.approx((5 / 6) ** 6, abs=0.05)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_more_removed_is_never_a_worse_verdict(one: float, other: float) -> None:
    order = ["unexplained", "partly explained", "explained"]
    less, more = sorted((one, other))
    words = [order.index(verdict(stages(share), FLOORS, POLICY.enough)[0]) for share in (less, more)]
    assert words[0] <= words[1]


def test_thresholds_are_the_policys() -> None:
    strict = replace(POLICY, explained=0.95, contributes=0.9)
    assert verdict(stages(0.85), FLOORS, POLICY.enough, policy=strict)[0] == "unexplained"
