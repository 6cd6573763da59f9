"""The cause of a change in recorded campaigns."""

from __future__ import annotations

import numpy as np
import pytest
from made_up import PARAMETERS, SCATTER
from recorded import TAKES, drawn_rig, today, worn

from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.solve import base_parameters
from isorig.analysis.trends.difference import ProblemWithPriors, explanations
from isorig.rig.wire_bonder.description import FRICTION
from isorig.rig.wire_bonder.session import virtual_campaign


def test_worn_friction_is_the_cause_although_everything_scatters() -> None:
    """Fits that start from the earlier values end far from the campaign, and others would then explain more."""
    draw = np.random.default_rng([1, 0])
    before = drawn_rig(draw)
    after = worn(1.28).change(today(before, draw))
    known = [path for path in PARAMETERS if path in before.free or path == FRICTION]
    scatter = dict(zip(PARAMETERS, SCATTER.tolist(), strict=True))
    own = {path: after.get(path) for path in known}
    first, *others = explanations(
        virtual_campaign(after, TAKES[:1], seed=1), before, scatter, today=own, changed={FRICTION: 0.02}
    )
    assert (first.cause, first.location) == ("friction_force", "isolation")
    assert not any(other.alike for other in others)
    assert abs(first.new / after.get(FRICTION) - 1.0) < 0.01


def test_residuals_of_a_campaign_end_with_those_of_the_earlier_fit() -> None:
    """No value may come between: it would be one that nothing has written."""
    rig = drawn_rig(np.random.default_rng([1, 0]))
    one, *_ = base_parameters(rig)
    problem = ProblemWithPriors(
        prepare(virtual_campaign(rig, TAKES, seed=1), rig), [(one, one.encode(rig.get(one.path)) - 0.5, 0.25)]
    )
    residuals = problem.residuals([rig, rig])
    assert residuals.shape == (2, problem.size)
    assert residuals.shape[1] == sum(problem.sizes) == problem.measured + 1
    np.testing.assert_allclose(residuals[:, -1], 2.0)


@pytest.mark.parametrize(("std", "more"), [(0.125, 4.0 * 3.0), (0.25, 0.0), (0.5, 0.0)])
def test_more_campaigns_count_if_they_show_a_change_better_than_one(std: float, more: float) -> None:
    rig = drawn_rig(np.random.default_rng([1, 0]))
    one, other, *_ = base_parameters(rig)
    known = [(free, free.encode(rig.get(free.path)) - 0.5, 0.25) for free in (one, other)]
    problem = ProblemWithPriors(prepare(virtual_campaign(rig, TAKES, seed=1), rig), known)
    assert problem.unaccounted(rig, {one.path: std}) == pytest.approx(more)
