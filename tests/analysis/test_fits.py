"""Fits of causes: what they are kept from, where they start, and narrow valleys that they must run along."""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_rigs import played, stage

from isorig.analysis.campaign import FloatArray
from isorig.analysis.diagnose.causes.cogging import Cogging
from isorig.analysis.diagnose.causes.extra_mode import ExtraMode
from isorig.analysis.diagnose.observe import misfit_frequencies, observe
from isorig.analysis.fitting import trials
from isorig.analysis.fitting.division import beginnings, ends
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residuals import FINEST, Problem
from isorig.analysis.fitting.solve import FAINT, Free, base_parameters, damped_step, fit, jacobian_of, positive
from isorig.analysis.fitting.trials import expected
from isorig.analysis.model.rig_model import RigModel
from isorig.analysis.simulate import simulate
from isorig.rig.model.baseline import baseline_model
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

RIG = wire_bonder({**THESIS, "friction_force": 9.0})
TAKES = (
    VirtualRun(id="u7", configuration="unlocked", gain=7.0, seconds=20.0, start=0.0),
    VirtualRun(id="u70a", configuration="unlocked", gain=70.0, seconds=20.0, start=30.0),
    VirtualRun(id="u70b", configuration="unlocked", gain=70.0, seconds=20.0, start=60.0),
    VirtualRun(id="l70", configuration="locked", gain=70.0, seconds=20.0, start=90.0),
)
CAMPAIGN = virtual_campaign(RIG, TAKES, seed=3)
FRICTION = "contacts.isolation.law.friction_force"


def test_what_judges_is_kept_from_fits() -> None:
    trials = prepare(CAMPAIGN, RIG)
    by_ends = ends(trials)
    assert [t.run.id for t in by_ends.judged] == [t.run.id for t in by_ends.fits]
    assert all(t.fitted == round(0.6 * t.samples) for t in by_ends.fits)

    by_beginnings = beginnings(trials)
    assert [t.run.id for t in by_beginnings.judged] == ["u70b"]  # the second strongest; of locked runs there is but one
    assert [t.run.id for t in by_beginnings.fits] == ["u7", "u70a", "l70"]
    (judged,) = by_beginnings.judged
    assert judged.fitted == 0
    assert judged.samples == judged.onset + 5.0 * judged.sample_rate  # of the first five seconds
    # What is cut off the record changes nothing of what is left but its mean, except within the low-pass's length of its ends.
    whole = next(t for t in ends(trials).judged if t.run.id == "u70b")
    apart = (expected(RIG, judged) - expected(RIG, whole)[:, : judged.samples])[:, 50 : judged.samples - 50]
    np.testing.assert_allclose(apart - apart.mean(axis=1, keepdims=True), 0.0, rtol=0.0, atol=1e-10)


def test_one_run_of_a_configuration_judges_no_beginning() -> None:
    trials = prepare(virtual_campaign(RIG, [TAKES[1], TAKES[3]], seed=3), RIG)
    assert beginnings(trials).judged == ()


def test_an_attached_resonator_starts_near_the_model_without_it() -> None:
    """A light rider far from a body's resonance must hardly show, or no slope leads from there."""
    trials = prepare(CAMPAIGN, RIG)
    riders = ExtraMode().candidates(RIG, replace(observe(CAMPAIGN, RIG, trials, RIG, RIG), misfit_frequencies=(230.0,)))
    for rider in riders:
        light = next(s for s in rider.starts if s.bodies[-1].mass == 0.01 * RIG.body(rider.location).mass)
        for trial in (trials[1], trials[3]):
            here, there = (expected(model, trial) for model in (RIG, light))
            error = np.sqrt(np.mean((there - here) ** 2, axis=1) / np.mean(here**2, axis=1))
            assert error.max() < 0.12, (rider.location, trial.run.id, error)


def test_a_mode_is_found_despite_a_larger_misfit() -> None:
    """A motor's sensor that reads high is missed over octaves; the rider is a peak in another channel."""
    table = RIG.body("table").mass
    evidence = observe(CAMPAIGN, RIG, prepare(CAMPAIGN, RIG), RIG, RIG)
    rider = ExtraMode().candidates(RIG, replace(evidence, misfit_frequencies=(34.0,)))[0]
    assert rider.location == "table"
    hidden = next(s for s in rider.starts if s.bodies[-1].mass == 0.04 * table)
    low = RIG.replace({"sensors.motor.chain.gain": 0.4})
    found = misfit_frequencies(low, prepare(virtual_campaign(hidden, TAKES, seed=4), RIG))
    omega = np.sqrt(hidden.link("table_added").stiffness / hidden.bodies[-1].mass)
    assert min(abs(np.log2(2.0 * np.pi * f / omega)) for f in found) < 0.15


@pytest.mark.parametrize(("parts", "reached"), [(FINEST, 20.0), (FINEST + 1, 15.0)])
def test_a_fit_passes_no_model_whose_simulation_takes_too_many_parts_a_step(
    parts: int, reached: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The time of a simulation is proportional to the parts of its steps; here a damping above 15 N s/m takes so many."""
    path = "links.rail.damping"
    problem = Problem(prepare(played(stage().replace({path: 20.0}), seed=3), stage()))
    monkeypatch.setattr(Problem, "parts_of_step", lambda self, model: parts if model.get(path) > 15.0 else 1)
    found = fit(stage(), (Free(path=path, low=1.0, high=1e3),), problem, iterations=30).values[path]
    assert found == pytest.approx(20.0, rel=0.01) if reached == 20.0 else 12.0 < found <= 15.0


def test_a_start_whose_simulation_takes_many_parts_a_step_may_keep_them() -> None:
    problem, stiff = Problem(prepare(played(stage(), seed=3), stage())), stage().replace({"links.rail.damping": 3e6})
    assert problem.most_parts(stage()) == FINEST < problem.parts_of_step(stiff) == problem.most_parts(stiff)


def test_threads_share_the_stored_motions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Models are simulated in several threads at once, and each may drop what another one is about to read."""
    trial = prepare(CAMPAIGN, RIG)[0]
    still = simulate(RIG, trial.excitation, samples=8)
    monkeypatch.setattr(trials, "simulate", lambda *_, **__: still)
    models = [RIG.replace({"bodies.table.mass": 80.0 + 0.01 * k}) for k in range(400)]
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(8) as pool:
            assert all(pool.map(lambda model: len(trial.motion_of(model, 8)["table"]) == 8, 5 * models))
    finally:
        sys.setswitchinterval(before)
    assert len(trial._cache.motions) == trials.CACHED


def test_a_motion_is_simulated_once_for_all_sensors_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model that differs in a sensor's gain only moves alike."""
    trial, simulated = prepare(CAMPAIGN, RIG)[0], []
    monkeypatch.setattr(trials, "simulate", lambda *a, **k: simulated.append(a) or simulate(*a, **k))
    for gain in (1.0, 0.9, 1.1):
        expected(RIG.replace({"sensors.table.chain.gain": gain}), trial)
    assert len(simulated) == 1


def test_derivatives_hold_along_a_narrow_valley() -> None:
    """The heatblock's mass, its spring and the table's mass make up for each other; what is left must be right."""
    model = baseline_model(CAMPAIGN)
    path, weighed = "bodies.heatblock.mass", RIG.body("heatblock").mass
    problem = Problem(prepare(CAMPAIGN, model))
    free = (*base_parameters(model), positive(path, weighed))
    along = {
        path: 1.0, "links.heatblock.stiffness": 1.0, "links.heatblock.damping": 1.0,
        "bodies.table.mass": -weighed / RIG.body("table").mass,
    }  # fmt: skip
    valley = np.array([along.get(f.path, 0.0) for f in free])
    here = np.array([f.encode(RIG.get(f.path)) for f in free])

    def at(coordinates: FloatArray) -> RigModel:
        return RIG.replace({f.path: f.decode(c) for f, c in zip(free, coordinates, strict=True)})

    step = 3e-3
    ahead, behind, middle = problem.residuals([at(here + step * valley), at(here - step * valley), at(here)])
    central = (ahead - behind) / (2.0 * step)
    jacobian = jacobian_of(problem, at, here, free, middle)
    assert np.linalg.norm(central) < np.linalg.norm(jacobian, axis=0).max() / 3000.0
    assert np.linalg.norm(jacobian @ valley - central) < 0.1 * np.linalg.norm(central)


@pytest.mark.filterwarnings("error")
def test_a_simulation_that_diverges_by_a_step_has_no_slope() -> None:
    class Diverging:
        def about(self, _: RigModel) -> object:
            return self

        def residuals(self, models: list[RigModel]) -> FloatArray:
            return np.array([[1e200, np.inf, np.nan, 2e-5 * 1e99, 1e-5]] * len(models))

    here = np.zeros(5)
    jacobian = jacobian_of(Diverging(), lambda theta: RIG, np.zeros(1), base_parameters(RIG)[:1], here)  # type: ignore[arg-type]
    np.testing.assert_allclose(jacobian[:, 0], [0.0, 0.0, 0.0, 2e99, 1.0])
    assert np.isfinite(jacobian.T @ jacobian).all()


@pytest.mark.parametrize(("low", "high", "start"), [(1.0, 12.0, 12.0), (6.0, 20.0, 6.0)])
def test_a_fit_leaves_a_bound_at_which_it_starts(low: float, high: float, start: float) -> None:
    problem = Problem(prepare(CAMPAIGN, RIG)[1:2])
    done = fit(RIG.replace({FRICTION: start}), [Free(path=FRICTION, low=low, high=high)], problem)
    assert done.values[FRICTION] == pytest.approx(9.0, rel=0.01)


@pytest.mark.parametrize(("low", "high"), [(1.0, 8.0), (10.0, 20.0)])
def test_a_fit_stays_at_the_bound_next_to_its_minimum(low: float, high: float) -> None:
    problem = Problem(prepare(CAMPAIGN, RIG)[1:2])
    table = next(path for path in RIG.free if path.endswith("damping"))
    start = RIG.replace({FRICTION: min(max(9.0, low), high)})
    done = fit(start, [Free(path=FRICTION, low=low, high=high), positive(table, RIG.get(table))], problem)
    assert done.values[FRICTION] == pytest.approx(start.get(FRICTION))


@pytest.mark.parametrize("square", [0.0, 1e-320, FAINT])
def test_a_parameter_with_only_rounding_effects_stays(square: float) -> None:
    step = damped_step(np.diag([4.0, square]), np.array([2.0, 1e-160]), 0.0)
    assert step.tolist() == [-0.5, 0.0]
    assert damped_step(np.diag([4.0, 1.01 * FAINT]), np.array([2.0, FAINT]), 0.0)[1] < -0.9


@pytest.mark.parametrize(("coordinate", "value"), [(-43.98, 14.0 * np.pi - 43.98), (3.0, 3.0), (3.3, 3.3 - 2.0 * np.pi)])
def test_an_angle_is_within_half_a_turn(coordinate: float, value: float) -> None:
    angle = Free(path="links.l.laws.0.phase", low=-np.inf, log=False, turn=2.0 * np.pi)
    assert angle.decode(coordinate) == pytest.approx(value, abs=1e-4)
    assert Free(path="x", low=-np.inf, log=False).decode(coordinate) == coordinate


def test_the_phase_of_a_force_that_repeats_with_the_position_is_an_angle() -> None:
    link = SimpleNamespace(stiffness=1e3, deflection=1e-3, resistance=0.0)
    *_, phase = Cogging().free(link)  # type: ignore[arg-type]
    assert (phase.path, phase.turn) == ("phase", 2.0 * np.pi)
