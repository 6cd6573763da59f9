"""The cause of a change in recorded campaigns."""

from __future__ import annotations

import numpy as np
from made_up import PARAMETERS, SCATTER
from recorded import TAKES, drawn_rig, today, worn

from isorig.analysis.trends.difference import explanations
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
    first, *others = explanations(virtual_campaign(after, TAKES, seed=1), before, scatter, today=own, suspected=[FRICTION])
    assert (first.cause, first.location) == ("friction_force", "isolation")
    assert not any(other.alike for other in others)
    assert abs(first.new / after.get(FRICTION) - 1.0) < 0.01
