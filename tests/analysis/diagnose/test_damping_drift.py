"""A damping that drifts: its decay against a closed form, its fit, its free shape, and what the equations find."""

from __future__ import annotations

import numpy as np
import pytest
from small_rigs import SESSION, Take, guessed, played, stage, with_law

import isorig as iso
from isorig.analysis import laws
from isorig.analysis.diagnose.causes.base import Evidence
from isorig.analysis.diagnose.causes.damping_drift import DampingDrift
from isorig.analysis.diagnose.free_shapes import free_shapes
from isorig.analysis.diagnose.suspects import suspects
from isorig.analysis.equations.system import equations_of
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.fitting.solve import Free, base_parameters, fit
from isorig.analysis.model.rig_model import Body, Configuration, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation, simulate

RATE, HZ, RATIO, DRIFT = 1000.0, 8.0, 0.005, 0.15


def test_a_pulled_mass_decays_with_the_integral_of_its_damping() -> None:
    """With c(t) = c0 (1 + r t) and little damping the amplitude is exp(-integral of c / 2 m), by averaging."""
    omega = 2.0 * np.pi * HZ
    law = laws.DampingDrift(drift_rate=DRIFT)
    model = RigModel(
        name="pulled", bodies=(Body(name="m", mass=2.0),),
        drive=Drive(channel="f", factor=1.0, pushes={"m": 1.0}, quantity="force"),
        links=(Link(name="spring", a="m", stiffness=2.0 * omega**2, damping=4.0 * RATIO * omega, laws=(law,)),),
        sensors=(Sensor(channel="x", body="m", quantity="displacement"),),
        configurations={"unlocked": Configuration(initial_position={"m": 0.01})},
    )  # fmt: skip
    t = np.arange(8000) / RATE
    x = simulate(model, Excitation.prepare(np.zeros(len(t)), RATE, oversample=4)).channels["x"]
    envelope = 0.01 * np.exp(-RATIO * omega * (t + 0.5 * DRIFT * t**2))
    peaks = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:])) + 1
    assert x[peaks] == pytest.approx(envelope[peaks], rel=0.02)


HIDDEN = with_law(stage(), "rail", laws.DampingDrift(drift_rate=0.15))


def test_the_equations_of_the_records_show_it() -> None:
    """The damping of a stage's rail almost triples within each run: neither its stiffness nor its friction does."""
    found = suspects(equations_of(played(HIDDEN, seed=2, takes=SESSION), guessed(stage(), 2)))
    assert found is not None
    first = found.chosen[0]
    assert (first.kind, first.place, first.what) == ("drift", "rail", "drift of damping")
    assert found.includes("damping_drift", "rail")


def test_a_fit_finds_the_hidden_rate_and_the_free_shape_its_course() -> None:
    model = stage()
    trials = prepare(played(HIDDEN, seed=1, takes=(Take(3.0, 1),)), model)
    problem, evidence = Problem(trials), Evidence(
        deflection={"rail": 1e-3}, speed={"rail": 0.05}, peak={}, sample_rate=400.0, end_time=12.0, flat_tops={}, mains={},
        misfit_frequencies=(), forces={}, push=20.0, configurations=frozenset({"unlocked"}), described=model, guess=model,
    )  # fmt: skip
    (candidate,) = DampingDrift().candidates(model, evidence)
    done = fit(candidate.starts[0], candidate.parameters(model), problem).model
    assert done.get(candidate.free[0].path) == pytest.approx(0.15, rel=0.05)
    (shape,) = (c for c in free_shapes(model, evidence) if c.cause == "drift" and c.shape and c.shape.value_unit == "N s/m")
    curve = fit(shape.starts[0], shape.parameters(model), problem).model
    whole = [curve.get("links.rail.damping") + curve.get(f"{shape.shape.path}.values.{k}") for k in (1, 3)]
    assert whole[1] / whole[0] == pytest.approx((1 + 0.15 * 9.0) / (1 + 0.15 * 3.0), rel=0.1)


@pytest.mark.parametrize("name", ["none", "cubic_stiffness", "quadratic_damping"])
@pytest.mark.parametrize("first", [laws.Drift(drift_rate=0.1), laws.DampingDrift(drift_rate=0.1)])
def test_free_shapes_beside_fitted_laws_have_all_their_parameters(first: laws.LinkLaw, name: str) -> None:
    """A free shape takes the place of a law of its kind, so that neither its parameters nor the places of others remain."""
    others = {
        "cubic_stiffness": laws.Cubic(cubic_stiffness=5.0),
        "quadratic_damping": laws.QuadraticDamping(quadratic_damping=1.0),
    }
    model = with_law(stage(), "rail", first)
    model = with_law(model, "rail", others[name]) if name in others else model
    free = tuple(
        Free(path=f"links.rail.laws.{k}.{field}", low=-10.0, high=10.0, log=False)
        for k, law in enumerate(model.link("rail").laws)
        for field in law.parameters
        if isinstance(getattr(law, field), float)
    )
    evidence = Evidence(
        deflection={"rail": 1e-3}, speed={"rail": 0.05}, peak={}, sample_rate=400.0, end_time=12.0, flat_tops={}, mains={},
        misfit_frequencies=(), forces={}, push=20.0, configurations=frozenset({"unlocked"}), described=model, guess=model,
    )  # fmt: skip
    shapes = free_shapes(model, evidence)
    assert {shape.cause for shape in shapes} >= {"drift", "spring_shape", "damping_shape"}
    for shape in shapes:
        for start in shape.starts:
            assert all(np.isfinite(start.get(item.path)) for item in shape.parameters(model, (*base_parameters(model), *free)))


def test_a_diagnosis_names_it() -> None:
    found = iso.diagnose(played(HIDDEN, seed=2, takes=SESSION), guessed(stage(), 2))
    assert found.verdict == "explained"
    assert [(step.cause, step.location) for step in found.steps] == [("damping_drift", "rail")]
