"""Forms started from the curve of a free shape, by its formula."""

from __future__ import annotations

import numpy as np
import pytest
from small_rigs import played, stage, with_law

from isorig.analysis import laws
from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose.causes.base import Kind
from isorig.analysis.diagnose.forms_of_curves import starts_from_curve
from isorig.analysis.diagnose.free_shapes import free_shapes
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.diagnose.step import Curve, Entry
from isorig.analysis.fitting.ladder import Starts
from isorig.analysis.fitting.score import BLOCKS, Score
from isorig.analysis.fitting.solve import Fit, base_parameters
from isorig.analysis.fitting.trials import prepare

#: N/m and N/m^3; N s/m and N s^2/m^2.
STIFFNESS, CUBIC, DAMPING, QUADRATIC = 2600.0, 4e7, 11.0, 40.0
#: Points and reach of the curves, m or m/s.
POINTS, DEFLECTION, SPEED = 31, 5e-3, 0.2


def started(kind: Kind, over: str, x: FloatArray, force: FloatArray, known: set[tuple[str, str]]) -> Starts:
    rig = with_law(stage(), "rail", laws.Cubic(cubic_stiffness=CUBIC)) if kind == "spring_shape" else stage()
    campaign = played(rig, seed=4)
    evidence = observe(campaign, stage(), prepare(campaign, stage()), stage(), stage())
    shape = next(one for one in free_shapes(stage(), evidence) if kind_of(one.cause) == kind and one.location == "rail")
    free = shape.parameters(stage(), base_parameters(stage()))
    fit = Fit(model=shape.starts[0], free=free, covariance=np.eye(len(free)), cost=1.0, evaluations=1)
    none = np.zeros((1, 1))
    score = Score(none, np.zeros((1, 1, BLOCKS)), np.zeros((1, 1, BLOCKS)))
    curve = Curve(
        over=over, unit="m", value_unit="N", points=tuple((float(a), float(b), 0.0) for a, b in zip(x, force, strict=True)),
        reached=(float(x[0]), float(x[-1])),
    )  # fmt: skip
    current = Fit(
        model=stage(), free=base_parameters(stage()), covariance=np.eye(3), cost=1.0, evaluations=1
    )  # fmt: skip
    return starts_from_curve(Entry(candidate=shape, fit=fit, score=score), curve, current, evidence, known)


def test_a_cubic_curve_gives_the_hardening_spring_its_values() -> None:
    x = np.linspace(-DEFLECTION, DEFLECTION, POINTS)
    starts = started("spring_shape", "deflection", x, STIFFNESS * x + CUBIC * x**3, set())
    assert {"hardening_stiffness", "end_stop", "asymmetric_stiffness"} <= {candidate.cause for candidate, _, _ in starts}
    model = next(model for candidate, _, model in starts if candidate.cause == "hardening_stiffness")
    assert model.get("links.rail.laws.0.cubic_stiffness") == pytest.approx(CUBIC, rel=0.02)
    assert model.get("links.rail.stiffness") == pytest.approx(STIFFNESS, rel=0.02)


def test_a_quadratic_curve_over_speed_gives_quadratic_damping_its_values() -> None:
    v = np.linspace(-SPEED, SPEED, POINTS)
    starts = started("damping_shape", "speed", v, DAMPING * v + QUADRATIC * v * np.abs(v), set())
    model = next(model for candidate, _, model in starts if candidate.cause == "quadratic_damping")
    assert model.get("links.rail.laws.0.quadratic_damping") == pytest.approx(QUADRATIC, rel=0.02)


def test_forms_that_were_fitted_and_curves_over_time_give_none() -> None:
    x = np.linspace(-DEFLECTION, DEFLECTION, POINTS)
    starts = started("spring_shape", "deflection", x, STIFFNESS * x + CUBIC * x**3, {("hardening_stiffness", "rail")})
    assert "hardening_stiffness" not in {candidate.cause for candidate, _, _ in starts}
    assert started("spring_shape", "time", x, STIFFNESS * x, set()) == []
