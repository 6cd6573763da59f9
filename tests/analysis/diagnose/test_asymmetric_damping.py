"""A damper with unlike directions is proposed at every damper, and never pushes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from isorig.analysis.diagnose.causes.asymmetric_damping import AsymmetricDamping
from isorig.analysis.diagnose.causes.base import WeakestSizes
from isorig.analysis.laws import AsymmetricDamping as Law
from isorig.analysis.laws.base import NO_LINK
from isorig.rig.wire_bonder.description import wire_bonder


class Swings:
    deflection: ClassVar = {"table": 1e-3, "heatblock": 1e-5, "isolation": 2e-3}
    speed: ClassVar = {"table": 0.1, "heatblock": 1e-3, "isolation": 0.2}


def test_its_force_is_that_of_two_dampers() -> None:
    v, nothing = np.array([-0.2, 0.0, 0.3]), np.zeros(3)
    force = 10.0 * v + Law(damping_difference=4.0).force(nothing, v, nothing, nothing[None], NO_LINK)
    np.testing.assert_allclose(force, [-0.2 * 6.0, 0.0, 0.3 * 14.0])


@pytest.mark.parametrize(("share", "damps"), [(-1.06, False), (-1.04, True), (1.04, True), (1.06, False)])
def test_one_that_pushes_is_no_damper(share: float, damps: bool) -> None:
    model = wire_bonder()
    (found,) = (c for c in AsymmetricDamping().candidates(model, Swings()) if c.location == "table")
    fitted = found.starts[0].replace({found.free[0].path: share * model.link("table").damping})
    assert found.plausible(fitted) == damps


def test_asymmetric_friction_has_a_viscosity_for_each_direction_where_dry_friction_acts() -> None:
    assert {c.location for c in AsymmetricDamping().candidates(wire_bonder(), Swings())} == {"table", "heatblock"}


def test_the_weakest_differs_by_three_tenths_of_the_damping() -> None:
    damping = wire_bonder().link("table").damping
    found = AsymmetricDamping().sized(wire_bonder(), Swings(), "table", 1.0, WeakestSizes())
    assert abs(found.parameters["damping_difference"]) == pytest.approx(0.3 * damping)
