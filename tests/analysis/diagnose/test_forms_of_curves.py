"""Forms started from the curve of a free shape, by its formula."""

from __future__ import annotations

import msgspec
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
from isorig.analysis.diagnose.revise import Revision, SearchStage, stage_of
from isorig.analysis.diagnose.step import Curve, Entry, curve_of, found_step
from isorig.analysis.fitting.division import ends
from isorig.analysis.fitting.ladder import Starts, finished, ladder, tried
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.score import score
from isorig.analysis.fitting.solve import Fit, base_parameters
from isorig.analysis.model.rig_model import Contact

#: N/m and N/m^3; N s/m and N s^2/m^2.
STIFFNESS, CUBIC, DAMPING, QUADRATIC = 2600.0, 4e7, 11.0, 40.0
#: N and N s/m: friction by direction, or at rest and at a large velocity.
FORWARD, BACKWARD, VISCOSITY = 2.4, 1.5, 6.0
#: Velocity over which the friction falls, m/s.
FADES = 0.04
#: Points and reach of the curves, m or m/s.
POINTS, DEFLECTION, SPEED = 31, 5e-3, 0.2


def started(kind: Kind, over: str, x: FloatArray, force: FloatArray, known: set[tuple[str, str]]) -> Starts:
    rig = with_law(stage(), "rail", laws.Cubic(cubic_stiffness=CUBIC)) if kind == "spring_shape" else stage()
    campaign = played(rig, seed=4)
    evidence = observe(campaign, stage(), prepare(campaign, stage()), stage(), stage())
    shape = next(one for one in free_shapes(stage(), evidence) if kind_of(one.cause) == kind and one.location == "rail")
    free = shape.parameters(stage(), base_parameters(stage()))
    fit = Fit(model=shape.starts[0], free=free, covariance=np.eye(len(free)), cost=1.0, evaluations=1)
    curve = Curve(
        over=over, unit="m", value_unit="N", points=tuple((float(a), float(b), 0.0) for a, b in zip(x, force, strict=True)),
        reached=(float(x[0]), float(x[-1])),
    )  # fmt: skip
    current = Fit(
        model=stage(), free=base_parameters(stage()), covariance=np.eye(3), cost=1.0, evaluations=1
    )  # fmt: skip
    return starts_from_curve(shape, fit, curve, current, evidence, known)


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


def test_levels_of_friction_give_the_asymmetric_law_its_values() -> None:
    """The curve has levels of friction, larger than zero in both directions."""
    v = np.linspace(-SPEED, SPEED, POINTS)
    levels = np.where(v > 0.0, FORWARD + VISCOSITY * v, BACKWARD)
    starts = started("friction_shape", "speed", v, levels, set())
    model = next(model for candidate, _, model in starts if candidate.cause == "asymmetric_friction")
    path = "contacts.rail.law"
    # A constant force is fitted along, so a start shows the sum of both levels and not their difference.
    levels_at_rest = model.get(f"{path}.forward_force") + model.get(f"{path}.backward_force")
    assert levels_at_rest == pytest.approx(FORWARD + BACKWARD, rel=0.05)
    uneven = model.get(f"{path}.forward_viscosity") - model.get(f"{path}.backward_viscosity")
    assert uneven == pytest.approx(VISCOSITY, rel=0.1)  # the curve is a straight line between two points about zero


def test_levels_of_friction_that_fall_with_the_velocity_give_stribeck_friction_its_values() -> None:
    """The model has no friction: the sizes come from the dry friction that is closest to the curve."""
    v = np.linspace(-SPEED, SPEED, POINTS)
    levels = BACKWARD + (FORWARD - BACKWARD) * np.exp(-((v / FADES) ** 2))
    starts = started("friction_shape", "speed", v, levels, set())
    models = [model for candidate, _, model in starts if candidate.cause == "stribeck_friction"]
    values = [
        [model.get(f"contacts.rail.law.{name}") for name in ("friction_force", "static_force", "stribeck_velocity")]
        for model in models
    ]
    assert any(each == pytest.approx([BACKWARD, FORWARD, FADES], rel=0.1) for each in values)


@pytest.mark.parametrize(
    ("law", "named"),
    [
        (laws.Asymmetric(forward_force=FORWARD, backward_force=BACKWARD), "asymmetric_friction"),
        pytest.param(
            laws.FrictionCurve(over="speed", at=(0.0, 0.03, 0.08, 0.2), levels=(0.5, 3.0, 0.5, 3.0)),
            None,
            marks=pytest.mark.study,
        ),
    ],
)
def test_a_free_shape_that_is_named_gets_the_form_that_its_search_did_not_fit(law: laws.ContactLaw, named: str | None) -> None:
    """A curve found together with a cause that turned out to be superfluous; without a form that is as good it remains."""
    described = stage()
    truth = msgspec.structs.replace(described, contacts=(Contact(name="rail", a="table", b="ground", law=law),))
    campaign = played(truth, seed=4)
    trials = prepare(campaign, described)
    division = ends(trials)
    whole = ladder(division.fits)[-1]
    evidence = observe(campaign, described, trials, described, described)
    shape = next(one for one in free_shapes(described, evidence) if one.cause == "friction_shape" and one.location == "rail")
    baseline, curve = (
        finished(rough, division.fits)
        for model, free in [
            (described, base_parameters(described)),
            (shape.starts[0], shape.parameters(described, base_parameters(described))),
        ]
        if (rough := tried(model, free, whole)) is not None
    )
    first, second = (score(fit.model, division.judged) for fit in (baseline, curve))
    found = Entry(candidate=shape, fit=curve, score=second)
    step = found_step(found, [found], first, set(), 1.0, curve=curve_of(shape, curve, evidence))
    revision = Revision(
        division=division, floors=np.full(first.error.shape, 1e-3), enough=1.2, tolerance=0.0,
        evidence_of=lambda model: observe(campaign, model, trials, described, described), progress=lambda text: None,
    )  # fmt: skip
    stages = [SearchStage(fit=baseline, score=first, paired=True), stage_of(first, step)]
    last = revision.revised(stages)[-1].step
    assert last is not None
    assert last.form == named
    if isinstance(law, laws.Asymmetric):
        assert last.parameters["forward_force"][0] == pytest.approx(FORWARD, rel=0.02)
        assert last.parameters["backward_force"][0] == pytest.approx(BACKWARD, rel=0.02)
