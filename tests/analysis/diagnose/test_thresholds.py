"""The thresholds at their stated values, rule by rule and without simulation: a change of a value fails here."""

from __future__ import annotations

from dataclasses import dataclass, fields
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from small_rigs import stage, with_law

from isorig.analysis import laws
from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose.causes.backlash import is_play
from isorig.analysis.diagnose.causes.base import CALIBRATION, beyond_calibration
from isorig.analysis.diagnose.causes.end_stop import _inside_its_stops
from isorig.analysis.diagnose.causes.sensor_gain import SensorGain
from isorig.analysis.diagnose.causes.wrong_mass import WrongMass
from isorig.analysis.diagnose.diagnosis import is_certain
from isorig.analysis.diagnose.policy import (
    POLICY,
    Policy,
    Stage,
    adequacy_threshold,
    explains_better,
    explains_own_channel,
    may_be_noise,
    more_draws,
    rivals_alike,
    step_counts,
    verdict,
)
from isorig.analysis.diagnose.step import Entry, simplest
from isorig.analysis.fitting.excess import SIMULATION_LIMIT, excess, is_adequate, log_excess
from isorig.analysis.fitting.score import BLOCKS, Score, adequate, confidence, margin_in_errors
from isorig.rig.wire_bonder.description import wire_bonder

FLOORS = np.full((6, 3), 0.004)
#: Every threshold as docs/diagnosing.md and the study have it.
STATED = {
    "enough": 1.5, "explained": 0.8, "visible": 0.2, "typical": 0.7, "contributes": 0.5, "main": 0.3, "certain": 0.95,
    "matters": 1.05, "worth": 0.15, "rest": 0.1, "later": 0.03, "of_rest": 0.5, "of_rest_here": 0.8, "form_share": 0.9,
    "form_errors": 4.0, "settled": 0.01,
    "form_alike": 1.1, "form_close": 1.5, "form_apart": 2.0, "zero": 2.0, "distinguishable": 1.5, "doubtful": 4.0,
    "calibrations": 5, "scatter": 1.25, "beyond_calibration": 1.2, "guides": 0.1, "refitted": 0.1,
}  # fmt: skip


def errors(value: float) -> FloatArray:
    return np.full((6, 3), value)


def left(share: float) -> FloatArray:
    """Errors when a share of the excess of errors of 0.4 is removed."""
    return np.sqrt(FLOORS**2 + (1.0 - share) * (errors(0.4) ** 2 - FLOORS**2))


def way(*shares: float, certain: bool = True) -> list[Stage]:
    steps = [Stage(error=left(share), place=f"p{k}", certain=certain) for k, share in enumerate(shares)]
    return [Stage(error=errors(0.4)), *steps]


def test_the_floor_counts_four_permille_of_the_signal_and_an_error_at_most_200_per_cent() -> None:
    assert SIMULATION_LIMIT == 0.004
    assert excess(errors(3.0), np.zeros((6, 3))) == pytest.approx(4.0)
    assert excess(errors(1.9), np.zeros((6, 3))) == pytest.approx(1.9**2)


def test_adequate_is_up_to_one_and_a_half_floors() -> None:
    assert is_adequate(1.49 * FLOORS, FLOORS, POLICY.enough)
    assert not is_adequate(1.51 * FLOORS, FLOORS, POLICY.enough)
    # The parameter table has the same threshold.
    assert adequate(scored(1.49 * FLOORS), FLOORS)
    assert not adequate(scored(1.51 * FLOORS), FLOORS)


@pytest.mark.parametrize(
    ("share", "word"), [(0.81, "explained"), (0.79, "partly explained"), (0.51, "partly explained"), (0.49, "unexplained")]
)
def test_words_begin_at_eight_and_five_tenths_of_the_excess(share: float, word: str) -> None:
    assert verdict(way(share), FLOORS, 1.5)[0] == word


@pytest.mark.parametrize(("remains", "word"), [(0.199, "explained"), (0.201, "partly explained")])
def test_a_visible_misfit_is_not_explained_whatever_was_removed(remains: float, word: str) -> None:
    lost = [Stage(error=errors(1.9)), Stage(error=np.hypot(errors(remains), FLOORS), place="p", certain=False)]
    assert verdict(lost, FLOORS, 1.5) == (word, 1)
    assert verdict(lost, errors(0.25), 1.5) == ("explained", 1)


@pytest.mark.parametrize(("share", "counts"), [(0.16, True), (0.14, False)])
def test_a_step_is_worth_it_from_fifteen_per_cent(share: float, counts: bool) -> None:
    assert step_counts(way(share), 1, FLOORS, 1.5) is counts


@pytest.mark.parametrize(("decrease", "shown", "counts"), [(0.151, True, True), (0.149, True, False), (0.3, False, False)])
def test_a_first_step_that_the_equations_show_counts_from_a_seventh_of_the_errors(
    decrease: float, shown: bool, counts: bool
) -> None:  # fmt: skip
    # The largest errors, which are most of the excess, remain: all other runs improve.
    before, after = errors(0.02), errors(0.02 * np.exp(-1.2 * decrease))
    before[0] = after[0] = 0.4
    stages = [Stage(error=before), Stage(error=after, place="p0", shown=shown)]
    assert step_counts(stages, 1, FLOORS, 1.5) is counts


@pytest.mark.parametrize(("removed", "counts"), [(0.51, True), (0.49, False)])
def test_a_further_step_removes_half_of_the_rest(removed: float, counts: bool) -> None:
    assert step_counts(way(0.6, 0.6 + 0.4 * removed), 2, FLOORS, 1.5) is counts


@pytest.mark.parametrize(("first", "removed", "counts"), [(0.98, 0.81, True), (0.98, 0.79, False)])
def test_a_small_further_step_elsewhere_explains_what_remained(first: float, removed: float, counts: bool) -> None:
    """It removes less than `later` of the whole, but at least `settled`."""
    assert step_counts(way(first, first + (1.0 - first) * removed), 2, FLOORS, 1.5) is counts


@pytest.mark.parametrize(("removed", "counts"), [(0.0101, True), (0.0099, False)])
def test_a_further_step_removes_more_than_a_form_leaves(removed: float, counts: bool) -> None:
    first = 1.0 - removed / 0.85
    assert step_counts(way(first, first + removed), 2, FLOORS, 1.5) is counts


@pytest.mark.parametrize(("first", "place", "counts"), [(0.989, "p0", True), (0.991, "p0", False), (0.991, "p1", True)])
def test_what_a_form_leaves_at_its_own_place_is_no_further_cause(first: float, place: str, counts: bool) -> None:
    stages = way(first, 1.0)
    stages[2] = Stage(error=FLOORS, place=place)
    assert step_counts(stages, 2, FLOORS, 1.5) is counts
    # A contact has one friction law: a more general one there replaces the first.
    stages[2] = Stage(error=FLOORS, place=place, refines=True)
    assert step_counts(stages, 2, FLOORS, 1.5)


@pytest.mark.parametrize(
    ("kind", "shown", "error", "counts"),
    [
        ("damping_shape", True, 1.49, True), ("damping_shape", True, 1.51, False), ("damping_shape", False, 1.49, False),
        ("drift", True, 1.49, False),
    ],
)  # fmt: skip
def test_what_remains_is_another_kind_if_the_equations_show_it_and_it_leaves_nothing(
    kind: str, shown: bool, error: float, counts: bool
) -> None:  # fmt: skip
    stages = way(0.991, 1.0)
    stages[1] = Stage(error=stages[1].error, place="p0", kind="drift")
    stages[2] = Stage(error=error * FLOORS, place="p0", kind=kind, shown=shown)
    assert step_counts(stages, 2, FLOORS, 1.5) is counts


@pytest.mark.parametrize(
    ("first", "further", "counts"),
    [
        ("friction_shape", "spring_shape", True), ("spring_shape", "damping_shape", True), ("spring_shape", "memory", False),
        ("friction_shape", "damping_shape", False), ("spring_shape", "spring_shape", False),
    ],
)  # fmt: skip
def test_a_force_over_deflection_is_no_form_of_one_over_velocity(first: str, further: str, counts: bool) -> None:
    stages = way(0.991, 1.0)
    stages[1] = Stage(error=stages[1].error, place="p0", kind=first)
    stages[2] = Stage(error=FLOORS, place="p0", kind=further)
    assert step_counts(stages, 2, FLOORS, 1.5) is counts


@pytest.mark.parametrize(("both", "counts"), [(0.801, True), (0.799, False)])
def test_the_first_of_two_that_only_together_explain_counts_from_eight_tenths(both: float, counts: bool) -> None:
    # Alone it removes less than is worth a step.
    first, second = way(0.1, both)[1:]
    stages = [Stage(error=errors(0.4)), Stage(error=first.error, place="p0", paired=True), second]
    assert step_counts(stages, 1, FLOORS, 1.5) is counts


def scored(error: FloatArray, blocks: FloatArray | None = None) -> Score:
    given = np.ones((*error.shape, BLOCKS)) if blocks is None else blocks
    return Score(error=error, blocks=given, power=given)


def test_confidence_is_the_share_of_resampled_blocks_that_win() -> None:
    best = np.ones((2, 2, BLOCKS))
    assert confidence(scored(errors(0.1), best), [scored(errors(0.2), 4.0 * best)]) == 1.0
    assert confidence(scored(errors(0.1), best), [scored(errors(0.1), 0.9 * best)]) == 0.0
    assert confidence(scored(errors(0.1), best), []) == 1.0
    # A rival that is much better in one block of eight and worse in the others loses where a draw of eight has it at most once.
    uneven = best * np.where(np.arange(BLOCKS) == 0, np.exp(-6.5), np.exp(1.0))
    at_most_once = (7 / 8) ** 8 + 8 * (1 / 8) * (7 / 8) ** 7
    assert confidence(scored(errors(0.1), best), [scored(errors(0.1), uneven)]) == pytest.approx(at_most_once, abs=0.05)
    # Every rival counts, not the average one.
    both = confidence(scored(errors(0.1), best), [scored(errors(0.2), 4.0 * best), scored(errors(0.1), uneven)])
    assert both == confidence(scored(errors(0.1), best), [scored(errors(0.1), uneven)])


def test_margin_is_the_mean_difference_in_its_standard_errors() -> None:
    generator = np.random.default_rng(4)
    difference = 0.3 + 0.1 * generator.normal(size=BLOCKS)
    best, rival = np.ones((1, 1, BLOCKS)), np.exp(difference)[None, None]
    expected = difference.mean() / (difference.std(ddof=1) / np.sqrt(BLOCKS))
    assert margin_in_errors(scored(errors(0.1), best), scored(errors(0.1), rival)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("factor", "behind", "alike"),
    [(1.04, 9.0, True), (1.06, 9.0, False), (1.06, 1.9, True), (1.06, 2.1, False)],
)
def test_rivals_are_alike_within_five_per_cent_or_two_standard_errors(factor: float, behind: float, alike: bool) -> None:
    assert rivals_alike(errors(0.1), factor * errors(0.1), FLOORS, behind) is alike


def test_a_rival_whose_largest_error_is_plainly_too_large_is_another_answer() -> None:
    best = 1.2 * FLOORS
    for multiple, alike in ((1.49, True), (1.51, False)):
        rival = best.copy()
        rival[3, 1] = multiple * 1.5 * FLOORS[3, 1]
        assert rivals_alike(best, rival, FLOORS, behind=0.5) is alike
    # Only an adequate form can be told from others by that.
    assert rivals_alike(1.6 * FLOORS, rival, FLOORS, behind=0.5)


@dataclass(frozen=True)
class Kind:
    rank: int
    free: tuple[int, ...]


def test_the_simplest_of_equals_is_kept() -> None:
    entries = [SimpleNamespace(candidate=Kind(rank, (0,) * free)) for rank, free in ((3, 1), (1, 2), (1, 3), (2, 1))]
    assert simplest(cast("list[Any]", entries)) is cast("Entry", entries[1])


def test_a_sensors_fault_must_explain_its_own_channel() -> None:
    before = np.tile([0.1, 0.2, 0.4], (6, 1))
    whole = log_excess(before[:, [1]], FLOORS[:, [1]])
    for fall, explains in ((0.16, True), (0.14, False)):
        after = before.copy()
        after[:, 1] *= np.exp(-fall * whole)
        assert explains_own_channel(before, after, FLOORS, [1]) is explains
    # A fault that only frees another channel is not the cause; a cause that is no sensor's has no channel of its own.
    freed = before * [1.0, 1.0, 0.1]
    assert not explains_own_channel(before, freed, FLOORS, [1])
    assert explains_own_channel(before, freed, FLOORS, [])


def test_only_an_error_near_the_floor_is_calibrated() -> None:
    assert [may_be_noise(worst) for worst in (1.49, 1.51, 5.99, 6.01)] == [False, True, True, False]
    assert adequacy_threshold(None) == 1.5
    assert adequacy_threshold(1.2) == 1.5
    assert adequacy_threshold(2.0) == pytest.approx(2.4)


@pytest.mark.parametrize(
    ("worst", "draws", "another"),
    [
        (2.0, [], True),
        (2.0, [1.0], True),
        (2.0, [1.67], False),  # the threshold by this draw is 1.2 times 1.67
        (2.0, [1.66], True),
        (2.0, [1.0, 1.7], False),  # the largest draw counts, also where they differ
        (2.0, [1.0, 1.24], False),
        (2.0, [1.0, 1.26], True),
        (2.0, [0.5, 1.0, 1.0, 0.5], True),
        (2.0, [0.5, 1.0, 1.0, 0.5, 1.0], False),
    ],
)
def test_draws_that_differ_ask_for_more(worst: float, draws: list[float], another: bool) -> None:
    assert more_draws(worst, draws) is another


@pytest.mark.parametrize(
    ("other", "present", "tolerance", "better"),
    [
        (0.0059, 0.0061, 0.0, True),  # 1.5 floors of 0.004: the other is adequate, the present one is not
        (0.0058, 0.0059, 0.0, False),  # both are
        (0.0059, 0.4, 0.5, False),  # both are within the tolerance
        (0.3, 0.4, 0.35, True),  # only the other is
        (0.0061, 0.4, 0.0, True),  # a hundredth of the error
        (0.1 * np.exp(-0.11), 0.1, 0.0, True),
        (0.1 * np.exp(-0.09), 0.1, 0.0, False),
        (0.4, 0.1, 0.0, False),
    ],
)
def test_another_cause_is_clearly_better(other: float, present: float, tolerance: float, better: bool) -> None:
    assert explains_better(errors(other), errors(present), FLOORS, POLICY.enough, tolerance) is better


def test_without_a_tolerance_an_error_above_the_threshold_is_not_adequate() -> None:
    assert explains_better(errors(0.1), errors(0.4), FLOORS, POLICY.enough)


@pytest.mark.parametrize(
    ("confidence_", "indistinguishable", "certain"),
    [
        (0.96, (), True),
        (0.94, (), False),
        # Another form of the same kind at the same place leaves place and kind certain; another place does not.
        (0.96, (("stribeck_friction", "isolation"),), True),
        (0.96, (("coulomb_friction", "table"),), False),
        (0.96, (("backlash", "isolation"),), False),
    ],
)
def test_a_step_is_certain_from_95_per_cent_of_the_draws(
    confidence_: float, indistinguishable: tuple[tuple[str, str], ...], certain: bool
) -> None:
    step: Any = SimpleNamespace(
        confidence=confidence_, indistinguishable=indistinguishable, kind="friction_shape", location="isolation"
    )
    assert is_certain(step) is certain


def test_every_threshold_has_its_stated_value() -> None:
    assert {field.name: getattr(POLICY, field.name) for field in fields(Policy)} == STATED


@pytest.mark.parametrize(
    ("inside", "beyond", "described", "play"),
    [
        (249.0, 1000.0, 1000.0, True),  # a quarter of the spring remains inside
        (251.0, 1000.0, 1000.0, False),
        (200.0, 1000.0, 449.0, True),  # the described spring is nearer to the one beyond, by ratio
        (200.0, 1000.0, 445.0, False),
        (0.0, 1000.0, 1.0, True),
    ],
)
def test_the_described_spring_decides_between_play_and_stops(inside: float, beyond: float, described: float, play: bool) -> None:
    assert is_play(inside, beyond, described) is play


@pytest.mark.parametrize(("factor", "named"), [(1.0095, False), (0.9905, False), (1.0105, True), (0.9895, True)])
def test_a_mass_or_gain_within_calibrations_is_no_fault(factor: float, named: bool) -> None:
    model = wire_bonder()
    assert beyond_calibration("bodies.heatblock.mass", 6.0)(model.replace({"bodies.heatblock.mass": factor * 6.0})) == named
    assert CALIBRATION == 0.01
    for cause in (WrongMass(), SensorGain()):
        for candidate in cause.candidates(model, cast(Any, SimpleNamespace(is_silent=lambda channel: False, described=model))):
            path = candidate.free[0].path
            assert candidate.plausible(model.replace({path: factor * model.get(path)})) == named


@pytest.mark.parametrize(("share", "plausible"), [(1.01, True), (0.99, False)])
def test_there_is_no_stop_within_a_play(share: float, plausible: bool) -> None:
    clearance = 1e-3
    played = with_law(stage(), "rail", laws.Backlash(clearance=clearance, residual=0.0))
    stop = laws.EndStop(stroke=share * clearance, contact_stiffness=100.0, contact_damping=1.0)
    assert _inside_its_stops("rail", "links.rail.laws.1", 2500.0, with_law(played, "rail", stop)) is plausible
