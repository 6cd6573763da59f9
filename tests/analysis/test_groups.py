"""Groups of segments: the changes due to each follow from the average without it, and their scatter is that of repeats."""

from __future__ import annotations

import numpy as np
import pytest
from test_spectra import RATE, pair, run_of

from isorig.analysis.spectra.segment_groups import MOST, USUAL, group_size
from isorig.analysis.spectra.welch import RunningSpectra, estimate, merged

LENGTH = 64


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
def test_changes_follow_from_the_average_without_the_group(estimator: str) -> None:
    x, y = pair(0, 10 * LENGTH)
    # Without overlap across the gap between runs, each run's segments are its own.
    runs = [run_of(x=x[k : k + LENGTH], y=y[k : k + LENGTH]) for k in range(0, len(x), LENGTH)]
    whole = estimate(runs, references=["x"], resolution=RATE / LENGTH)
    frf = whole.frf("y", "x", estimator)
    assert frf.group_changes is not None
    changes = frf.group_changes(frf.frequency[3:20])
    assert changes.shape == (10, 17)
    for k, values in enumerate(changes):
        rest = [run for i, run in enumerate(runs) if i != k]
        alone = estimate(rest, references=["x"], resolution=RATE / LENGTH)
        power = (9.0 * alone.density("x") / (10.0 * whole.density("x")))[3:20]
        moved = alone.frf("y", "x", estimator).value[3:20] - frf.value[3:20]
        np.testing.assert_allclose(values, moved * np.sqrt(power), rtol=2e-4, atol=2e-5)


def test_scatter_of_groups_is_that_of_repeats() -> None:
    values, scatter = [], []
    for seed in range(60):
        x, y = pair(seed, 200 * LENGTH)
        frf = estimate([run_of(x=x, y=y)], references=["x"], resolution=RATE / LENGTH).frf("y", "x")
        assert frf.group_changes is not None
        values.append(frf.value[2:-2])
        scatter.append((np.abs(frf.group_changes(frf.frequency[2:-2])) ** 2).sum(axis=0))
    spread = np.mean(np.abs(np.array(values) - np.mean(values, axis=0)) ** 2)
    assert spread / np.mean(scatter) == pytest.approx(1.0, abs=0.06)


def test_a_growing_record_keeps_few_groups_that_add_up() -> None:
    x, y = pair(1, 300 * LENGTH)
    runs = [run_of(x=x[:n], y=y[:n]) for n in range(20 * LENGTH, len(x) + 1, 20 * LENGTH)]
    running = RunningSpectra(runs[0], references=["x"], resolution=RATE / LENGTH)
    for run in runs:
        running.add(run)
        groups = running.spectra().groups
        assert groups is not None
        assert len(groups) <= MOST
        assert sum(part.segments for part in groups.parts) == running.segments
    whole = estimate(runs[-1:], references=["x"], resolution=RATE / LENGTH)
    added = sum(part.auto for part in groups.parts) * groups.scale / running.segments
    np.testing.assert_allclose(added, whole.auto, rtol=1e-5)
    both = merged([whole, whole])
    assert both.groups is not None
    assert whole.groups is not None
    assert len(both.groups) == 2 * len(whole.groups)


def test_groups_of_two_rates_go_together() -> None:
    x, y = pair(2, 40 * LENGTH)
    slow, fast = run_of(x=x, y=y), run_of(rate=2.0 * RATE, x=x, y=y)
    both = estimate([slow, fast], references=["x"], resolution=RATE / LENGTH)
    assert both.groups is not None
    added = sum(part.auto for part in both.groups.parts) * both.groups.scale / both.segments
    np.testing.assert_allclose(added, both.auto, rtol=1e-5)


def test_about_as_many_groups_for_any_length() -> None:
    assert [group_size(count, 8) for count in (10, 28, 60, 200, 2000)] == [1, 1, 2, 8, 72]
    assert all(0.6 * USUAL < count / group_size(count, 8) <= 1.5 * USUAL for count in range(USUAL, 5000))
