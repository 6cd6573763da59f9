"""Figures of held-out errors against sums and resamplings written out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_rigs import chain, played

from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose.policy import POLICY, Stage, step_counts, verdict, wins
from isorig.analysis.fitting.excess import excess, log_excess, pooled, ratio, share_removed
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residuals import QUIET
from isorig.analysis.fitting.score import (
    BLOCKS,
    RUNS,
    Score,
    confidence,
    improvement,
    margin_in_errors,
    share_interval,
    signal_powers,
    surely_removes,
    units,
    worst,
)

ERROR = np.array([[0.1, 0.2, 0.9], [0.05, 0.4, 3.0], [0.5, 0.5, 0.5]])
FLOORS = np.array([[0.1, 0.01, 0.3], [0.06, 0.02, 0.1], [0.5, 0.4, 0.25]])


def scored(error: FloatArray, power: FloatArray | None = None, blocks: FloatArray | None = None) -> Score:
    ones = np.ones((*error.shape, BLOCKS))
    return Score(error=error, blocks=ones if blocks is None else blocks, power=ones if power is None else power)


def test_the_excess_is_the_mean_of_squares_beyond_the_floors() -> None:
    by_hand = [0.0, 0.04 - 0.0001, 0.81 - 0.09, 0.0, 0.16 - 0.0004, 4.0 - 0.01, 0.0, 0.25 - 0.16, 0.25 - 0.0625]
    assert excess(ERROR, FLOORS) == pytest.approx(sum(by_hand) / 9)
    assert share_removed(ERROR, FLOORS, FLOORS) == 1.0


def test_pooled_errors_count_each_channel_with_its_floor_at_least() -> None:
    rows = [(0.01 + 0.04 + 0.81) / 3, (0.0036 + 0.16 + 4.0) / 3, 0.25]
    np.testing.assert_allclose(pooled(ERROR, FLOORS), rows)
    assert ratio(ERROR, FLOORS, FLOORS) == pytest.approx(np.sqrt(sum(rows) / 3 / (FLOORS**2).mean()))


def test_the_logarithm_of_errors_over_floors_is_averaged() -> None:
    by_hand = [0.0, np.log(20.0), np.log(3.0), 0.0, np.log(20.0), np.log(30.0), 0.0, np.log(1.25), np.log(2.0)]
    assert log_excess(ERROR, FLOORS) == pytest.approx(sum(by_hand) / 9)


def test_the_worst_is_the_largest_error_over_its_floor() -> None:
    assert worst(scored(ERROR), FLOORS) == pytest.approx(30.0)


def test_units_are_runs_from_five_on_and_blocks_of_time_before() -> None:
    assert (RUNS, BLOCKS) == (5, 8)
    power = np.random.default_rng(2).uniform(0.0, 6.0, (5, 3, 8))
    limited = np.where(power > 4.0, 4.0, power)
    np.testing.assert_allclose(units(scored(np.ones((5, 3)), power)), limited.sum(axis=2).sum(axis=1) / 24)
    np.testing.assert_allclose(units(scored(np.ones((4, 3)), power[:4])), limited[:4].sum(axis=0).sum(axis=0) / 12)


def test_the_least_of_the_wins_counts() -> None:
    best = np.full(6, 1.0)
    assert wins(best, [np.full(6, 1.1), np.full(6, 0.9)]) == 0.0


def test_confidence_is_the_share_of_draws_in_which_the_best_beats_every_rival() -> None:
    generator = np.random.default_rng(8)
    best = np.exp(generator.normal(size=(2, 3, BLOCKS)))
    rivals = [best * np.exp(mean + 0.8 * generator.normal(size=BLOCKS)) for mean in (0.1, 0.2)]
    margins = [np.log(rival / best).sum(axis=0).sum(axis=0) for rival in rivals]
    picks = np.random.default_rng(0).integers(0, BLOCKS, (20000, BLOCKS))
    expected = np.mean([all(margin[pick].sum() > 0.0 for margin in margins) for pick in picks])
    assert 0.2 < expected < 0.8
    found = confidence(scored(ERROR, blocks=best), [scored(ERROR, blocks=rival) for rival in rivals])
    assert found == pytest.approx(expected, abs=0.08)


def test_a_margin_is_of_the_rival_behind_the_best() -> None:
    generator = np.random.default_rng(5)
    blocks = np.exp(generator.normal(size=(2, 3, BLOCKS)))
    rival = blocks * np.exp(0.2 + 0.1 * generator.normal(size=BLOCKS))
    difference = [np.mean([np.log(rival[r, c, b] / blocks[r, c, b]) for r in range(2) for c in range(3)]) for b in range(BLOCKS)]
    expected = np.mean(difference) / (np.std(difference, ddof=1) / np.sqrt(8.0))
    assert margin_in_errors(scored(ERROR, blocks=blocks), scored(ERROR, blocks=rival)) == pytest.approx(expected)


@pytest.mark.parametrize("runs", [5, 2])
def test_a_share_is_of_the_first_models_excess_with_the_interval_of_resampled_units(runs: int) -> None:
    # Two kinds of units, so that the resampled shares are those of a binomial draw.
    count = runs if runs >= RUNS else BLOCKS
    removed = np.where(np.arange(count) % 2 == 0, 0.2, 0.6)
    floors = np.zeros((runs, 1))
    if runs >= RUNS:
        first, after = np.ones((runs, 1)), np.sqrt(1.0 - removed)[:, None]
        models = [scored(error) for error in (first, first, after)]
    else:
        powers = (np.ones((runs, 1, BLOCKS)), np.broadcast_to(1.0 - removed, (runs, 1, BLOCKS)))
        models = [scored(np.ones((runs, 1)), power) for power in (powers[0], powers[0], powers[1])]
    value, low, high = share_interval(*models, floors)
    assert value == pytest.approx(removed.mean())
    generator = np.random.default_rng(0)
    shares = removed[generator.integers(0, count, (20000, count))].mean(axis=1)
    expected = np.quantile(shares, (0.025, 0.975))
    np.testing.assert_allclose((low, high), expected, atol=0.4 / count)
    assert low < value < high
    # Where the first model has no excess there is nothing to remove.
    assert share_interval(models[0], models[1], models[2], np.full_like(floors, 2.0))[0] == 0.0


@pytest.mark.parametrize(("differ", "sure"), [(1.01, True), (0.99, False)])
def test_blocks_in_which_the_models_hardly_differ_are_not_drawn(differ: float, sure: bool) -> None:
    """A rig that is released rests in most blocks: they tell nothing of a model that removes all before."""
    floors, shape = np.full((1, 1), 0.01), (1, 1, BLOCKS)
    before, after = np.full(shape, 1.5e-4), np.full(shape, 1.5e-4)
    before[0, 0, :2] += differ * 1e-4  # of the allowed square error
    one, other = (scored(np.sqrt(power.mean(axis=2)), power) for power in (before, after))
    assert surely_removes(one, other, floors) == sure


@pytest.mark.parametrize("runs", [5, 2])
def test_the_interval_of_a_share_is_from_the_25th_to_the_975th_permille_of_draws_of_all_units(runs: int) -> None:
    count = runs if runs >= RUNS else BLOCKS
    removed = np.linspace(0.8, 0.1, count)
    if runs >= RUNS:
        models = [scored(error) for error in (np.full((runs, 1), 2.0), np.ones((runs, 1)), np.sqrt(1.0 - removed)[:, None])]
    else:
        shape = (runs, 1, BLOCKS)
        powers = (np.full(shape, 4.0), np.ones(shape), np.broadcast_to(1.0 - removed, shape))
        models = [scored(np.ones((runs, 1)), power) for power in powers]
    value, low, high = share_interval(*models, np.zeros((runs, 1)), draws=4000)
    # The first model has four times the excess of the one before the step.
    assert value == pytest.approx(removed.mean() / 4.0)
    means = removed[np.random.default_rng(0).integers(0, count, (100_000, count))].mean(axis=1)
    np.testing.assert_allclose((low, high), np.quantile(means, (0.025, 0.975)) / 4.0, atol=0.003)


@pytest.mark.parametrize(("better", "sure"), [(1, False), (5, True)])
def test_a_step_is_sure_if_most_runs_err_less_with_it(better: int, sure: bool) -> None:
    """Of six runs one may decide whether a model is adequate."""
    before = np.full((6, 1), 0.2)
    after = np.where(np.arange(6) < better, 0.1, 0.205)[:, None]
    blocks = np.ones((6, 1, 8))
    first, then = (scored(error, power=error[:, :, None] ** 2 * blocks, blocks=blocks) for error in (before, after))
    assert surely_removes(first, then, np.full((6, 1), 0.05)) is sure


def test_improvement_is_the_share_of_the_figure_beyond_the_floor() -> None:
    before, after = scored(np.full((3, 2), 0.3)), scored(np.full((3, 2), 0.1))
    found = improvement(before, after, 0.05)
    assert found.removed == pytest.approx(0.8)
    # Blocks that are all alike leave nothing to chance.
    assert found.before == pytest.approx((0.3, 0.3))
    assert found.after == pytest.approx((0.1, 0.1))
    assert found.removed_interval == pytest.approx((0.8, 0.8))


def test_nothing_is_removed_where_nothing_is_beyond_the_floor() -> None:
    assert improvement(scored(np.full((3, 2), 0.04)), scored(np.full((3, 2), 0.03)), 0.05).removed == 0.0


def test_improvements_intervals_are_those_of_resampled_blocks() -> None:
    blocks = np.broadcast_to(np.where(np.arange(BLOCKS) < 4, 1.0, 3.0), (1, 1, BLOCKS))
    before, after = scored(np.array([[0.3]]), blocks=blocks), scored(np.array([[0.1]]))
    found = improvement(before, after, 0.0)
    picks = np.random.default_rng(0).integers(0, BLOCKS, (20000, BLOCKS))
    expected = 0.3 * np.sqrt(blocks[0, 0][picks].mean(axis=1) / 2.0)
    assert found.before == pytest.approx(np.quantile(expected, (0.025, 0.975)), abs=0.012)
    assert found.removed_interval == pytest.approx(np.quantile(1.0 - 0.1 / expected, (0.025, 0.975)), abs=0.03)


def stage(share: float, **more: object) -> Stage:
    floors = np.full((6, 3), 0.004)
    return Stage(error=np.sqrt(floors**2 + (1.0 - share) * (0.16 - floors**2)), **more)  # type: ignore[arg-type]


def test_two_steps_that_belong_together_count_where_both_explain_the_error() -> None:
    floors = np.full((6, 3), 0.004)
    for last, counts in ((1.0, True), (POLICY.explained + 0.01, True), (POLICY.explained - 0.01, False)):
        way = [stage(0.0), stage(0.05, place="a", paired=True), stage(last, place="b")]
        assert step_counts(way, 1, floors, 1.5) is counts
    # The second one may be missing.
    assert not step_counts([stage(0.0), stage(0.05, place="a", paired=True)], 1, floors, 1.5)
    assert not step_counts([stage(0.0), stage(0.05, place="a"), stage(1.0, place="b")], 1, floors, 1.5)


def test_the_baseline_counts_and_a_place_that_has_a_step_needs_more() -> None:
    floors = np.full((6, 3), 0.004)
    assert step_counts([stage(0.0)], 0, floors, 1.5)
    # The third step is at the first one's place, not at the second one's.
    way = [stage(0.0), stage(0.4, place="a"), stage(0.8, place="b"), stage(0.8 + 0.2 * 0.7, place="a")]
    assert not step_counts(way, 3, floors, 1.5)
    way[3] = stage(0.8 + 0.2 * 0.7, place="c")
    assert step_counts(way, 3, floors, 1.5)


def test_steps_are_certain_and_alone_unless_said() -> None:
    assert Stage(error=ERROR).certain
    assert not Stage(error=ERROR).refines
    assert not Stage(error=ERROR).paired


def test_a_first_step_that_does_not_count_leaves_the_campaign_unexplained() -> None:
    floors = np.full((6, 3), 0.004)
    assert verdict([stage(0.0), stage(0.1, place="a")], floors, 1.5) == ("unexplained", 0)
    # Also if the next one would explain nearly all.
    assert verdict([stage(0.0), stage(0.1, place="a"), stage(0.95, place="b")], floors, 1.5) == ("unexplained", 0)


def test_an_adequate_baseline_has_no_steps() -> None:
    floors = np.full((6, 3), 0.004)
    assert verdict([stage(1.0)], floors, 1.5) == ("adequate", 0)
    # Of three steps, those before the uncertain one are named.
    way = [stage(0.0), stage(0.6, place="a"), stage(0.75, place="b", refines=True, certain=False)]
    assert verdict(way, np.full((6, 3), 0.004), 1.5) == ("partly explained", 1)


def test_a_run_in_which_nothing_moves_is_compared_with_the_channel_s_largest_run() -> None:
    campaign = played(chain(), seed=5)
    moving, *_ = prepare(campaign, chain())
    still = replace(moving, measured=np.zeros_like(moving.measured))
    powers = signal_powers([moving, still])
    assert powers[1] == pytest.approx(QUIET**2 * powers[0])
    part = moving.measured[:, moving.fitted : moving.samples]
    assert powers[0] == pytest.approx((part**2).mean(axis=1))


@pytest.mark.parametrize(("elsewhere", "unknown"), [(0.045, False), (0.055, True)])
def test_a_draw_without_the_misfit_says_nothing_about_its_removal(elsewhere: float, unknown: bool) -> None:
    """The first block has all of the misfit; the others have this share of the whole excess, and the step leaves it."""
    floor, error, left = 0.01, 0.1, 0.02
    rest = floor + elsewhere * (error - floor)
    first = BLOCKS * error**2 - (BLOCKS - 1) * rest**2
    before = scored(np.full((1, 1), error), blocks=np.array([[[first, *([rest**2] * (BLOCKS - 1))]]]))
    after = scored(np.full((1, 1), left))
    low, high = improvement(before, after, floor).removed_interval
    assert high > 0.85
    # With the others' excess a draw without the first block shows a model that became worse.
    assert (low < 0.0) == unknown
