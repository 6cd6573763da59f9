"""Distances between refitted rivals, limits, precision and the choice among candidates, against figures worked out otherwise."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy.optimize import least_squares
from small_rivals import DAMPER, DAMPING, FREQUENCY, MASS, RATE, STIFFNESS, one_mass, prospect, variant

from isorig.analysis import laws
from isorig.analysis.deadline import Deadline
from isorig.analysis.errors import ModelError
from isorig.analysis.fitting.excess import SIMULATION_LIMIT
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.linear import transfer
from isorig.analysis.model.rig_model import Body, Link
from isorig.analysis.proposals.choice import Comparison, Question, choose, distinguishing_probability
from isorig.analysis.proposals.hypotheses import hypotheses
from isorig.analysis.proposals.limits import LargestMotions, largest_of, peaks_of, reached_so_far, simulated_peaks
from isorig.analysis.proposals.menu import CandidateRun, candidate_runs, covers_all_modes, run_at_rest
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.proposals.precision import KnownPrecision, parameter_by_name, runs_for_uncertainty, std_of_parameter
from isorig.analysis.proposals.prediction import Predicted, Prospect, distance, drawn_models, refit, remaining_distance
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.excitation import sine, steps, sweep
from isorig.analysis.simulate.natural import natural_modes
from isorig.rig.wire_bonder.description import wire_bonder

NOISE = {"body": 1e-3, "force": 1e-3}


def quiet(text: str) -> None:
    """Nobody watches."""


def cubic(share: float = 0.3) -> laws.Cubic:
    return laws.Cubic(cubic_stiffness=share * STIFFNESS / 0.01**2)


def test_a_difference_that_a_parameter_absorbs_is_no_distance() -> None:
    """A rival that differs in its fitted stiffness alone lies far off unrefitted, and nowhere once it is refitted."""
    truth, rival = variant(one_mass()), variant(one_mass().replace({"links.spring.stiffness": 1.005 * STIFFNESS}), "other")
    seen = Predicted(prospect(20.0), NOISE, rival.model)
    records = seen.records([truth, rival])
    moments = seen.moments(records[0], records[1], seen.slopes(rival))
    assert np.sqrt(moments.square.max()) > 5.0
    assert distance(rival.free, [moments], [True]) < 0.05 * np.sqrt(moments.square.max())
    assert refit(rival.free, [moments])[0] == pytest.approx(-np.log(1.005), rel=0.05)


def test_distance_is_that_of_a_full_refit() -> None:
    """The linear step leaves what nonlinear least squares of another library leaves."""
    truth, rival = variant(one_mass(link_laws=(cubic(0.02),)), "hardening_stiffness"), variant(one_mass())
    run = prospect(20.0)
    seen = Predicted(run, NOISE, rival.model)
    records = seen.records([truth, rival])
    moments = seen.moments(records[0], records[1], seen.slopes(rival))
    found = distance(rival.free, [moments], [True])

    excitation = run.excitation()
    want = simulate(truth.model, excitation).channels["body"]

    def residual(theta: np.ndarray) -> np.ndarray:
        values = {f.path: v for f, v in zip(rival.free, np.exp(theta), strict=True)}
        return (simulate(rival.model.replace(values), excitation).channels["body"] - want) / seen.allowed[0]

    best = least_squares(residual, np.log([STIFFNESS, DAMPER]), diff_step=1e-4)
    assert found == pytest.approx(np.sqrt(np.mean(best.fun**2)), rel=0.05)


@pytest.mark.parametrize(("rms", "noise"), [(20.0, 0.02), (0.1, 0.02), (20.0, 0.0)])
def test_what_is_allowed_is_noise_and_the_simulations_limit(rms: float, noise: float) -> None:
    run = prospect(rms)
    seen = Predicted(run, {"body": noise} if noise else {}, one_mass())
    response = simulate(one_mass(), run.excitation()).channels["body"]
    assert seen.allowed[0] == pytest.approx(np.hypot(noise, SIMULATION_LIMIT * np.std(response)), rel=0.01)


def test_records_come_back_in_time() -> None:
    run = prospect(20.0)
    seen = Predicted(run, NOISE, one_mass())
    response = simulate(one_mass(), run.excitation()).channels["body"]
    assert seen.record(seen.records([variant(one_mass())])[0, 0], "body") == pytest.approx(response, abs=1e-9)


def test_existing_runs_constrain_the_rival() -> None:
    """With a run in hand that fixes the stiffness, a difference that a stiffness would absorb counts."""
    truth, rival = variant(one_mass(link_laws=(cubic(),)), "hardening_stiffness"), variant(one_mass())
    strong, weak = (Predicted(prospect(rms), NOISE, rival.model) for rms in (20.0, 0.5))
    moments = {}
    for name, seen in (("strong", strong), ("weak", weak)):
        records = seen.records([truth, rival])
        moments[name] = seen.moments(records[0], records[1], seen.slopes(rival))
    alone = distance(rival.free, [moments["strong"]], [True])
    held = distance(rival.free, [moments["weak"], moments["strong"]], [False, True])
    assert held > 1.001 * alone
    assert remaining_distance(moments["strong"], np.zeros(2)).max() >= held
    # Of several counted runs the one that distinguishes best counts.
    step = refit(rival.free, [moments["weak"], moments["strong"]])
    assert remaining_distance(moments["weak"], step).max() < held
    assert distance(rival.free, [moments["weak"], moments["strong"]], [True, True]) == held


def test_motion_without_bound_is_an_infinite_distance() -> None:
    rival = variant(one_mass())
    seen = Predicted(prospect(20.0), NOISE, rival.model)
    record = seen.records([rival])[0]
    moments = seen.moments(np.full_like(record, np.nan), record, seen.slopes(rival))
    assert (
        distance(rival.free, [moments], [True]) == np.inf
        or np.isinf(remaining_distance(moments, refit(rival.free, [moments]))).all()
    )


@pytest.mark.parametrize(("size", "chance"), [(0.0, 0.0), (1.0, 0.0), (np.sqrt(3.0), 0.5), (3.0, 1.0), (1e9, 1.0)])
def test_probability_that_a_run_distinguishes(size: float, chance: float) -> None:
    assert distinguishing_probability(size) == pytest.approx(chance)


def test_draws_follow_the_covariance() -> None:
    models = drawn_models(variant(one_mass(), std=0.05), 400, 1)
    assert models[0] == one_mass()
    spread = np.std(np.log([m.get("links.spring.stiffness") for m in models[1:]]))
    assert spread == pytest.approx(0.05, rel=0.15)
    wide = np.std(np.log([m.get("links.spring.damping") for m in drawn_models(variant(one_mass(), std=9.0), 400, 1)[1:]]))
    assert wide == pytest.approx(np.log(2.0), rel=0.15)


def test_peaks_of_a_sine_are_those_of_the_formula() -> None:
    """Steady amplitude of one mass under a sine at its own frequency: F / (c omega)."""
    n = round(30 * RATE)
    force = sine(samples=n, sample_rate=RATE, peak=2.0, frequency=FREQUENCY)
    peaks = simulated_peaks([one_mass()], Excitation.prepare(force, RATE, oversample=8), "unlocked", 0.0)
    omega = 2 * np.pi * FREQUENCY
    assert peaks.stroke["spring"] == pytest.approx(2.0 / (DAMPER * omega), rel=2e-3)
    assert peaks.speed["spring"] == pytest.approx(2.0 / DAMPER, rel=2e-3)
    assert peaks.channels["body"] == pytest.approx(2.0 * omega / DAMPER, rel=3e-3)
    assert (peaks.drive, peaks.force) == pytest.approx((2.0, 2.0), rel=1e-3)


def test_limits_at_their_boundary() -> None:
    force = sine(samples=512, sample_rate=RATE, peak=2.0, frequency=FREQUENCY)
    peaks = simulated_peaks([one_mass()], Excitation.prepare(force, RATE, oversample=2), "unlocked", 0.0)
    reached = peaks.stroke["spring"]
    assert not peaks.beyond(Limits(stroke={"spring": 1.0001 * reached / POLICY.usable_share}))
    assert "deflection of the spring" in peaks.beyond(Limits(stroke={"spring": 0.9999 * reached / POLICY.usable_share}))
    for limits in (Limits(drive=2.0), Limits(force=2.0), Limits(channels={"body": 0.5 * peaks.channels["body"]})):
        assert peaks.beyond(limits)
    assert reached_so_far(Limits(), one_mass(), peaks).stroke["spring"] == pytest.approx(reached / POLICY.usable_share)
    assert reached_so_far(Limits(stroke={"spring": 1.0}), one_mass(), peaks).stroke == {"spring": 1.0}


def test_without_limits_the_runs_so_far_give_them() -> None:
    peaks = LargestMotions(stroke={"spring": 0.5}, speed={}, drive=0.5, force=0.0, channels={})
    assert reached_so_far(Limits(), one_mass(), peaks) == Limits(stroke={"spring": 0.5 / 0.9}, drive=0.5 / 0.9)
    assert reached_so_far(Limits(drive=4.0), one_mass(), peaks).drive == 4.0
    assert reached_so_far(Limits(gains=(0.0, 70.0)), one_mass(), peaks).drive is None
    nothing = LargestMotions(stroke={}, speed={}, drive=0.0, force=0.0, channels={})
    assert reached_so_far(Limits(), one_mass(), nothing) == Limits()


def test_largest_motions_are_those_of_every_model() -> None:
    one = LargestMotions(stroke={"a": 1.0}, speed={"a": 4.0}, drive=1.0, force=6.0, channels={"m": 1.0, "n": 2.0})
    two = LargestMotions(stroke={"a": 2.0, "b": 3.0}, speed={"a": 3.0}, drive=2.0, force=5.0, channels={"m": 3.0, "n": 1.0})
    assert largest_of([one, two]) == LargestMotions(
        stroke={"a": 2.0, "b": 3.0}, speed={"a": 4.0}, drive=2.0, force=6.0, channels={"m": 3.0, "n": 2.0}
    )


def test_the_force_of_a_drive_is_that_at_the_body_it_pushes_most() -> None:
    model = one_mass()
    soft = Link(name="soft", a="other", stiffness=1.0)
    two = msgspec.structs.replace(
        model, bodies=(*model.bodies, Body(name="other", mass=1.0)), links=(*model.links, soft),
        drive=msgspec.structs.replace(model.drive, factor=3.0, pushes={"body": 1.0, "other": -2.0}),
    )  # fmt: skip
    assert peaks_of(two, {}, np.array([0.5, -1.0]), RATE).force == 3.0 * 2.0


def test_the_tightest_limit_holds() -> None:
    one = Limits(stroke={"a": 1.0, "b": 2.0}, gains=(0.0, 70.0), force=5.0)
    both = one.within(Limits(stroke={"b": 1.0}, gains=(5.0, 90.0), seconds=20.0, lock_price=10.0))
    assert both == Limits(stroke={"a": 1.0, "b": 1.0}, gains=(5.0, 70.0), force=5.0, seconds=20.0, lock_price=10.0)
    with pytest.raises(ModelError, match="do not overlap"):
        one.within(Limits(gains=(80.0, 90.0)))
    with pytest.raises(ModelError, match=r"limits\.force is -1"):
        Limits(force=-1.0)


def test_natural_frequencies_of_a_locked_rig() -> None:
    model = wire_bonder()
    assert [mode.frequency for mode in natural_modes(one_mass(), "unlocked")] == pytest.approx([FREQUENCY])
    table = model.link("table")
    mass = model.body("table").mass + model.body("motor").mass + model.body("heatblock").mass
    low, high = (mode.frequency for mode in natural_modes(model, "locked"))
    # The heatblock is stiff enough to ride along.
    assert low == pytest.approx(np.sqrt(table.stiffness / mass) / 2 / np.pi, rel=1e-3)
    assert high > 160.0
    assert len(natural_modes(model, "unlocked")) == 3


def test_the_menu_keeps_gains_band_and_seconds() -> None:
    limits = Limits(gains=(5.0, 66.6667), band=(0.7, 300.0), seconds=15.0)
    runs = candidate_runs(wire_bonder(), limits, 1024.0, repeatable=[("u70", CandidateRun(
        configuration="unlocked", excitation="random", gain=50.0, seconds=15.0, band=(1.0, 20.0), seed=7))])  # fmt: skip
    assert {run.configuration for run in runs} == {"unlocked", "locked"}
    assert {run.excitation for run in runs} == {"random", "multisine", "sine", "sweep", "moves", "steps"}
    assert all(5.0 <= run.gain <= 66.6667 and run.seconds <= 15.0 for run in runs)
    assert all(run.band is None or (run.band[0] >= 0.7 and run.band[1] <= 300.0) for run in runs)
    assert len({run.seed for run in runs if run.repeat_of is None}) == len(runs) - 1
    again = [run for run in runs if run.repeat_of == "u70"]
    assert [run.seed for run in again] == [7]
    assert run_at_rest(wire_bonder(), limits).rests
    assert any(covers_all_modes(wire_bonder(), run) for run in runs)
    assert not covers_all_modes(wire_bonder(), again[0])
    whole = next(run for run in runs if covers_all_modes(wire_bonder(), run))
    assert not covers_all_modes(wire_bonder(), replace(whole, excitation="sweep"))
    assert not covers_all_modes(wire_bonder(), replace(whole, band=None))
    assert run_at_rest(wire_bonder(), Limits()).gain == 1.0


@pytest.mark.parametrize(("gain", "seconds", "allowed"), [(70.0, 12.345, True), (70.001, 12.0, False), (69.1234, 30.001, False)])
def test_a_repeated_drive_is_the_same_sample_for_sample(gain: float, seconds: float, allowed: bool) -> None:
    """Neither is its gain rounded, nor is it made longer or cut: a plan with such a repeat is refused."""
    earlier = CandidateRun(configuration="unlocked", excitation="random", gain=gain, seconds=seconds, band=(1.0, 20.0), seed=7)
    runs = candidate_runs(
        wire_bonder(), Limits(gains=(0.0, 70.0), band=(0.7, 300.0), seconds=30.0), 1024.0, repeatable=[("u", earlier)]
    )
    assert [run for run in runs if run.repeat_of] == ([replace(earlier, repeat_of="u")] if allowed else [])


def test_the_chosen_run_distinguishes_within_the_limits() -> None:
    """A weak end stop and a hardening spring look alike until the stroke is used, and a limit of the stroke forbids that."""
    stop = one_mass(link_laws=(laws.EndStop(stroke=0.004, contact_stiffness=0.5 * STIFFNESS),))
    hard = one_mass(link_laws=(cubic(),))
    question = Question(
        truths=(variant(stop, "end_stop"), variant(hard, "hardening_stiffness", "links.spring.laws.0.cubic_stiffness")),
        rivals=(variant(stop, "end_stop"), variant(hard, "hardening_stiffness", "links.spring.laws.0.cubic_stiffness")),
    )  # fmt: skip
    comparison = Comparison(question, NOISE, [])
    runs = [prospect(rms, seed=k) for k, rms in enumerate((0.2, 5.0, 40.0), 1)]

    def kept(one: Prospect) -> object:
        return simulated_peaks([stop, hard], one.excitation(whole=True), "unlocked", 0.0)

    free = Limits()
    found = choose(comparison, comparison.seen(runs, free, quiet), free, kept, configuration="unlocked", budget=60.0)
    assert comparison.probability([]) == 0.0
    first = found.choices[0]
    assert first.prospect.run.gain == 40.0
    assert first.probability > 0.9
    assert min(apart.distance for apart in first.apart) > 3.0
    assert first.gained == pytest.approx(first.probability)
    later = [choice.probability for choice in found.choices]
    assert [choice.gained for choice in found.choices[1:]] == pytest.approx(np.diff(later))
    # The largest distance with a single run is that with the strongest.
    largest = {(apart.truth.key, apart.rival.key): apart.distance for apart in first.apart}
    assert {(apart.truth.key, apart.rival.key): apart.distance for apart in found.best} == pytest.approx(largest)
    assert {(pair.truth.cause, pair.rival.cause) for pair in first.predicted_pairs} <= {
        ("end_stop", "hardening_stiffness"), ("hardening_stiffness", "end_stop")
    }  # fmt: skip

    tight = Limits(stroke={"spring": 0.001})
    found = choose(comparison, comparison.seen(runs, tight, quiet), tight, kept, configuration="unlocked", budget=60.0)
    assert all(not choice.peaks.beyond(tight) for choice in found.choices)
    assert 40.0 in {run.gain for run in found.refused}
    assert not any(choice.prospect.run.gain == 40.0 for choice in found.choices)


def test_a_cause_without_rivals_is_identified() -> None:
    only = variant(one_mass())
    assert Comparison(Question(truths=(only,), rivals=(only,)), NOISE, []).probability([]) == 1.0
    assert Comparison(Question(truths=(), rivals=(only,)), NOISE, []).probability([]) == 1.0


@pytest.mark.parametrize(("share", "before"), [(0.3, 1.0), (1e-9, 0.0)])
def test_what_the_runs_so_far_would_have_shown_needs_no_other(share: float, before: float) -> None:
    """A supposed cause that a strong run in hand would have revealed is settled; one too small for it is not."""
    question = Question(truths=(variant(one_mass(link_laws=(cubic(share),)), "a"),), rivals=(variant(one_mass()),), supposed=True)
    comparison = Comparison(question, NOISE, [prospect(40.0)])
    assert comparison.probability([]) == pytest.approx(before, abs=0.01)
    assert len(comparison.distances([])) == 1.0 - before


def test_candidates_without_time_are_left_out() -> None:
    question = Question(truths=(variant(one_mass(link_laws=(cubic(),)), "a"),), rivals=(variant(one_mass()),), supposed=True)
    comparison = Comparison(question, NOISE, [])
    calls: list[str] = []

    deadline = Deadline()

    def soon_over(text: str) -> None:
        calls.append(text)
        if len(calls) > 1:
            deadline.end()

    with deadline:
        seen = comparison.seen([prospect(1.0, seed=k) for k in range(3)], Limits(), soon_over)
    assert len(seen.pairs) == 1


def test_every_cause_of_the_catalogue_is_supposed() -> None:
    model = wire_bonder()
    drive = prospect(3.0, seconds=4.0).drive
    peaks = largest_of([simulated_peaks([model], Excitation.prepare(drive, 1024.0, oversample=2), "unlocked", 0.0)])
    causes = {found.cause for found in hypotheses(model, peaks, 1024.0)}
    assert causes == {
        "stribeck_friction", "presliding_friction", "asymmetric_friction", "hardening_stiffness", "softening_stiffness",
        "backlash", "end_stop", "quadratic_damping", "stiffness_drift", "extra_mode", "moment_coupling", "wrong_mass",
        "imperfect_lock", "channel_delay", "sensor_gain", "clipping", "crosstalk", "mains_hum", "relaxation", "damping_drift",
        "hysteresis", "asymmetric_stiffness", "asymmetric_damping", "bilinear_stiffness", "stiffening_hysteresis",
    }  # fmt: skip


def test_transfer_functions_of_the_linear_part() -> None:
    frequency = np.array([1.0, FREQUENCY, 12.0])
    omega = 2 * np.pi * frequency
    want = -(omega**2) / (STIFFNESS + 1j * omega * DAMPER - omega**2 * MASS)
    assert transfer(one_mass(), "unlocked", frequency)[0] == pytest.approx(want)


def test_figures_and_their_deviation() -> None:
    fitted = variant(one_mass(), std=0.02)
    assert parameter_by_name(fitted.model, "body_frequency")(fitted.model) == pytest.approx(FREQUENCY)
    assert parameter_by_name(fitted.model, "body_damping")(fitted.model) == pytest.approx(DAMPING)
    assert std_of_parameter(fitted, parameter_by_name(fitted.model, "body_frequency")) == pytest.approx(
        0.5 * 0.02 * FREQUENCY, rel=1e-3
    )
    assert std_of_parameter(fitted, parameter_by_name(fitted.model, "links.spring.damping")) == pytest.approx(
        0.02 * DAMPER, rel=1e-3
    )
    assert parameter_by_name(one_mass(friction=3.0), "friction_force")(one_mass(friction=3.0)) == 3.0
    with pytest.raises(ModelError, match="body_frequency"):
        parameter_by_name(fitted.model, "nonsense")


def test_precision_grows_with_the_length_and_the_wish_is_met_at_least_cost() -> None:
    fitted = variant(one_mass(), std=0.02)
    in_hand = prospect(1.0, seconds=8.0)
    known = KnownPrecision(fitted, parameter_by_name(fitted.model, "body_damping"), NOISE, [in_hand])
    assert known.linear
    now = known.std(known.now)
    # What the runs in hand gave, the damper's 2 % and half the stiffness's, is where it starts.
    assert now == pytest.approx(np.hypot(0.02, 0.01), rel=1e-3)
    again = known.information(in_hand)
    assert known.std(known.now + 3.0 * again) == pytest.approx(0.5 * now, rel=0.02)
    runs = [prospect(0.02, seconds=40.0, seed=2), prospect(1.0, seconds=40.0, seed=3)]
    (found,) = runs_for_uncertainty(
        known, [(run, known.information(run)) for run in runs], Limits(), lambda one: one.peaks([fitted.model], whole=True),
        wish=0.6 * now, configuration="unlocked", budget=60.0,
    )  # fmt: skip
    assert found.prospect.run.gain == 1.0
    assert found.std <= 0.6 * now
    assert found.prospect.run.seconds < 40.0
    assert len(found.prospect.drive) == round(found.prospect.run.seconds * RATE)


def test_new_drives() -> None:
    """A step moves the head a T^2 / 4 and back; a sweep made in parts is the sweep made at once."""
    rate = 4096.0
    values = steps(samples=round(4 * rate), sample_rate=rate, distance=3e-3, peak=10.0, pause=0.5, start=0.25)
    position = np.cumsum(np.cumsum(values)) / rate**2
    assert position.max() == pytest.approx(3e-3, rel=0.03)
    assert position.min() > -1e-4
    whole = sweep(samples=1000, sample_rate=100.0, peak=1.0, band=(1.0, 20.0))
    part = sweep(samples=300, sample_rate=100.0, peak=1.0, band=(1.0, 20.0), of=1000, first=500)
    assert whole[500:800] == pytest.approx(part)
