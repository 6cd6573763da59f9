"""Every threshold of a proposal at its boundary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from small_rivals import DAMPER, RATE, STIFFNESS, one_mass, prospect, variant

from isorig.analysis import laws
from isorig.analysis.campaign import FloatArray
from isorig.analysis.deadline import Deadline
from isorig.analysis.diagnose.kinds import kind_of
from isorig.analysis.model.limits import Limits
from isorig.analysis.model.rig_model import Body, Link, RigModel
from isorig.analysis.proposals import precision
from isorig.analysis.proposals.choice import Chosen, ComparedRuns, Comparison, PairDistance, Question, choose
from isorig.analysis.proposals.hypotheses import hypotheses
from isorig.analysis.proposals.limits import LargestMotions, simulated_peaks
from isorig.analysis.proposals.menu import CandidateRun, candidate_runs, run_at_rest
from isorig.analysis.proposals.policy import POLICY
from isorig.analysis.proposals.precision import (
    KnownPrecision,
    PreciseRun,
    named_parameters,
    parameter_by_name,
    runs_for_uncertainty,
    unit_of_parameter,
)
from isorig.analysis.proposals.prediction import Prospect, Variant
from isorig.analysis.proposals.remedies import another_sensor, beyond_limits, pair_distance, with_more_sensors
from isorig.analysis.simulate.natural import HELD, natural_modes
from isorig.rig.files.rigfile import SHIPPED, read_description
from isorig.rig.next.sentences import cause
from isorig.rig.wire_bonder.description import wire_bonder

# The values of the policy, written once more: a test that imports them passes for every value.
ABOUT, LEVELS, DWELLS, RAISED = (0.75, 1.3), (1.0, 0.5, 0.2), (0.6, 1.0), (1.0, 1.5, 2.0, 3.0)
NOTHING = LargestMotions(stroke={}, speed={}, drive=0.0, force=0.0, channels={})
NOISE = {"body": 1e-3, "force": 1e-3}


def quiet(text: str) -> None:
    """Nobody watches."""


class Made(Comparison):
    """A comparison whose gains in probability are given by the runs' seeds."""

    def __init__(self, gains: Mapping[int, float]) -> None:
        self._gains = gains

    def probability(self, pairs: object) -> float:
        return 0.1 + sum(self._gains[run["seed"]] for run in pairs)  # type: ignore[attr-defined]

    def distances(self, pairs: object) -> list[PairDistance]:
        return []

    def predicted_pairs(self, *_: object, **__: object) -> tuple[()]:
        return ()


def chosen(
    gains: Mapping[int, float], limits: Limits | None = None, *, locked: int = 0, budget: float = 1e3, long: int = 0
) -> Chosen:
    """Which of some runs of 8 s, one of them locked and one of 16 s, are chosen by their gains."""
    runs = []
    for seed in gains:
        one = prospect(1.0, seed=seed, seconds=16.0 if seed == long else 8.0)
        setup = "locked" if seed == locked else "unlocked"
        runs.append((replace(one, run=replace(one.run, configuration=setup)), {"seed": seed}))
    seen = ComparedRuns(pairs=runs, refused={})  # type: ignore[arg-type]
    return choose(Made(gains), seen, limits or Limits(), lambda _: NOTHING, configuration="unlocked", budget=budget)


def first(found: Chosen) -> int:
    return found.choices[0].prospect.run.seed


@pytest.mark.parametrize(("gain", "taken"), [(0.99 * 0.02, 0), (1.01 * 0.02, 1)])
def test_a_run_is_taken_from_a_gain_that_is_worth_it(gain: float, taken: int) -> None:
    assert len(chosen({1: gain}).choices) == taken


def test_a_run_gains_what_it_adds_to_those_before() -> None:
    """The probability without any run is 0.1."""
    found = chosen({1: 0.1, 2: 0.2}).choices
    assert [each.prospect.run.seed for each in found] == [2, 1]
    assert [each.gained for each in found] == pytest.approx([0.2, 0.1])
    assert [each.probability for each in found] == pytest.approx([0.3, 0.4])


def test_a_proposal_has_so_many_runs_at_most() -> None:
    assert len(chosen(dict.fromkeys(range(1, 3 + 2), 0.1)).choices) == 3


@pytest.mark.parametrize(("share", "best"), [(0.99, 2), (1.01, 1)])
def test_a_run_costs_its_overhead_too(share: float, best: int) -> None:
    """Run 1 is twice as long as run 2: it is taken where it gains as much more as it costs more, both with their overhead."""
    worth = (16.0 + 20.0) / (8.0 + 20.0)
    assert first(chosen({1: share * worth * 0.1, 2: 0.1}, long=1)) == best


@pytest.mark.parametrize(("share", "best"), [(0.99, 2), (1.01, 1)])
@pytest.mark.parametrize("price", [None, 5.0])
def test_a_lock_costs_its_price(price: float | None, share: float, best: int) -> None:
    own = 8.0 + 20.0
    worth = (own + (60.0 if price is None else price)) / own
    assert first(chosen({1: share * worth * 0.1, 2: 0.1}, Limits(lock_price=price), locked=1)) == best


@pytest.mark.parametrize(("budget", "taken"), [(7.99, 0), (8.0, 1), (15.99, 1), (16.0, 2)])
def test_the_seconds_of_a_proposal(budget: float, taken: int) -> None:
    assert len(chosen({1: 0.1, 2: 0.1}, budget=budget).choices) == taken


def test_models_drawn_of_every_truth() -> None:
    """Of surviving causes some are drawn beside the fitted one, of supposed causes none."""
    truth, rival = variant(one_mass(), "a"), variant(one_mass(), "b")
    run = [prospect(1.0)]
    for supposed, count in ((False, 3), (True, 1)):
        comparison = Comparison(Question(truths=(truth,), rivals=(rival,), supposed=supposed), NOISE, [])
        said: list[str] = []
        ((_, pairs),) = comparison.seen(run, Limits(), said.append).pairs
        assert len(pairs[0, 0]) == count
        assert said == ["comparing candidate 1 of 1"]


def test_pictures_of_the_nearest_pairs() -> None:
    stiff = [one_mass().replace({"links.spring.damping": (1.0 + 0.5 * k) * DAMPER}) for k in range(5)]
    models = tuple(variant(model, f"cause {k}") for k, model in enumerate(stiff))
    # What the runs could absorb is held: only the stiffness is refitted.
    models = tuple(replace(one, free=one.free[:1], covariance=one.covariance[:1, :1]) for one in models)
    comparison = Comparison(Question(truths=models, rivals=models), NOISE, [])
    ((one, pairs),) = comparison.seen([prospect(20.0)], Limits(), quiet).pairs
    found = comparison.predicted_pairs(one, pairs)
    assert len(found) == 3
    assert all(a.distance <= b.distance for a, b in pairwise(found))
    assert all(pair.distance > 1.0 for pair in found)


def test_comparisons_simulate_so_many_seconds() -> None:
    long = prospect(1.0, seconds=6.0 + 2.0)
    assert len(long.excitation().recorded) == round(6.0 * RATE)
    assert len(long.excitation(whole=True).recorded) == len(long.drive)
    assert long.excitation().oversample == 2
    sweep = replace(long, run=replace(long.run, excitation="sweep"))
    assert len(sweep.excitation().recorded) == len(long.drive)


def runs_of(low: float, high: float, rate: float = 1024.0, top: float = 50.0) -> tuple[CandidateRun, ...]:
    return candidate_runs(wire_bonder(), Limits(gains=(0.0, top), band=(low, high)), rate)


def test_lengths_and_levels_of_candidates() -> None:
    runs = runs_of(0.5, 300.0)
    broad = {run.seconds for run in runs if run.excitation == "random"}
    assert broad == {20.0, 2.0 * 20.0}
    assert {run.seconds for run in runs if run.excitation in ("sine", "moves", "steps")} == {10.0}
    assert {run.gain for run in runs if run.excitation == "random"} == {share * 50.0 for share in LEVELS}
    assert {run.period for run in runs if run.excitation == "multisine"} == {4.0}
    assert run_at_rest(wire_bonder(), Limits(gains=(0.0, 50.0))).seconds == 5.0


def test_levels_below_the_lowest_gain_are_no_candidates() -> None:
    least = LEVELS[1] * 50.0
    for gain, levels in ((least, LEVELS[:2]), (1.01 * least, LEVELS[:1])):
        runs = candidate_runs(wire_bonder(), Limits(gains=(gain, 50.0), band=(0.5, 300.0)), 1024.0)
        assert {run.gain for run in runs if run.excitation == "random"} == {share * 50.0 for share in levels}


def test_bands_of_candidates() -> None:
    slowest = natural_modes(wire_bonder(), "unlocked")[0].frequency
    bands = {run.band for run in runs_of(0.05, 1e3) if run.excitation == "random" and run.configuration == "unlocked"}
    whole = (0.2, 0.4 * 1024.0)
    assert whole in bands
    for low, high in ((None, 4.0), (None, 0.6), ABOUT):
        want = 0.2 if low is None else low * slowest
        assert any(a == pytest.approx(want, rel=5e-3) and b == pytest.approx(high * slowest, rel=5e-3) for a, b in bands)
    assert not candidate_runs(wire_bonder(), Limits(gains=(0.0, 50.0), band=(0.01, 0.2)), 1024.0)


@pytest.mark.parametrize(("share", "there"), [(0.98, False), (1.02, True)])
def test_a_band_is_wide_enough(share: float, there: bool) -> None:
    """The band below the slowest mode, from a lowest frequency that leaves this much of it."""
    slowest = natural_modes(wire_bonder(), "unlocked")[0].frequency
    high = float(f"{0.6 * slowest:.3g}")
    bands = {run.band for run in runs_of(high / (share * 1.2), 300.0) if run.configuration == "unlocked"}
    assert any(band is not None and band[1] == high for band in bands) == there


@pytest.mark.parametrize("share", DWELLS)
def test_sines_at_shares_of_a_natural_frequency(share: float) -> None:
    slowest = natural_modes(wire_bonder(), "unlocked")[0].frequency
    at = float(f"{share * slowest:.3g}")
    for low, there in ((0.99 * share * slowest, True), (1.01 * share * slowest, False)):
        assert (at in {run.frequency for run in runs_of(low, 300.0)}) == there


@pytest.mark.parametrize(("share", "held"), [(0.5, 1), (2.0, 2)])
def test_a_spring_that_holds_a_body(share: float, held: int) -> None:
    """A second body on a spring whose frequency is about `HELD` of the first one's."""
    model = one_mass()
    soft = Link(name="soft", a="other", stiffness=share * HELD**2 * STIFFNESS)
    other = msgspec.structs.replace(
        model, bodies=(*model.bodies, Body(name="other", mass=model.body("body").mass)), links=(*model.links, soft)
    )  # fmt: skip
    assert len(natural_modes(other, "unlocked")) == held


def known(in_hand: Prospect) -> KnownPrecision:
    fitted = variant(one_mass(), std=0.02)
    return KnownPrecision(fitted, parameter_by_name(fitted.model, "body_damping"), NOISE, [in_hand])


def runs_for(known: KnownPrecision, runs: list[Prospect], *, wish: float, budget: float, most: int) -> list[PreciseRun]:
    return runs_for_uncertainty(
        known, [(run, known.information(run)) for run in runs], Limits(), lambda _: NOTHING, wish=wish,
        configuration="unlocked", budget=budget, most=most,
    )  # fmt: skip


def test_bins_without_coherence_have_no_information() -> None:
    """Noise that hides the response leaves an H1 estimate's coherence near what it is of noise alone."""
    fitted = variant(one_mass(), std=0.02)
    figure = parameter_by_name(fitted.model, "body_damping")
    for noise, told in ((1e-3, True), (1e4, False)):
        one = KnownPrecision(fitted, figure, {"body": noise, "force": 1e-3}, [])
        assert bool(np.any(one.information(prospect(1.0)) > 1.0)) == told


def test_a_sweep_is_not_shortened_and_a_design_has_so_many_runs_at_most() -> None:
    now = known(prospect(1.0)).std(known(prospect(1.0)).now)
    run = prospect(1.0, seconds=40.0, seed=3)
    sweep = replace(run, run=replace(run.run, excitation="sweep"))
    for runs, wish, seconds in (([sweep], 0.9 * now, [40.0]), ([run], 1e-6, [40.0]), ([run], 0.999 * now, [5.0])):
        found = runs_for(known(prospect(1.0)), runs, wish=wish, budget=80.0, most=1)
        assert [one.prospect.run.seconds for one in found] == seconds


def test_a_parameter_of_a_law_is_not_found_from_transfer_functions() -> None:
    path = "links.spring.laws.0.cubic_stiffness"
    fitted = variant(one_mass(link_laws=(laws.Cubic(cubic_stiffness=STIFFNESS / 0.01**2),)), "hardening_stiffness", path)
    assert not KnownPrecision(fitted, parameter_by_name(fitted.model, path), NOISE, [prospect(20.0)]).linear


def designed(budget: float, wish: float, in_hand: float = 8.0) -> list[float]:
    runs = [prospect(1.0, seconds=40.0, seed=3)]
    found = runs_for(known(prospect(1.0, seconds=in_hand)), runs, wish=wish, budget=budget, most=3)
    return [run.prospect.run.seconds for run in found]


def test_the_shortest_run_for_a_parameter() -> None:
    assert designed(5.0 - 0.01, 1e-6) == []
    assert designed(5.0, 1e-6) == [5.0]
    now = known(prospect(1.0)).std(known(prospect(1.0)).now)
    assert designed(60.0, 0.999 * now) == [5.0]


class Informed(KnownPrecision):
    """What another one knows, and of every run that it says so large a share of it."""

    def __init__(self, other: KnownPrecision, share: float) -> None:
        self.__dict__.update(other.__dict__)
        self._share = share

    def information(self, prospect: Prospect) -> FloatArray:
        return np.asarray(self._share * self.now)


@pytest.mark.parametrize(("share", "taken"), [(0.99, False), (1.01, True)])
def test_a_run_that_hardly_helps_is_not_proposed(share: float, taken: bool) -> None:
    """A run that says q of what is known leaves 1 / sqrt(1 + q) of the deviation."""
    enough = 1.0 / 0.99**2 - 1.0
    informed = Informed(known(prospect(1.0)), share * enough)
    assert bool(runs_for(informed, [prospect(1.0, seed=2)], wish=1e-9, budget=60.0, most=1)) == taken


def two_springs() -> tuple[Comparison, tuple[tuple[str, str], tuple[str, str]], tuple[RigModel, RigModel]]:
    """A stop and a hardening spring, which lie apart where the stroke is used only."""
    stop = one_mass(link_laws=(laws.EndStop(stroke=0.004, contact_stiffness=0.5 * STIFFNESS),))
    hard = one_mass(link_laws=(laws.Cubic(cubic_stiffness=0.3 * STIFFNESS / 0.01**2),))
    fitted = (variant(stop, "end_stop"), variant(hard, "hardening_stiffness", "links.spring.laws.0.cubic_stiffness"))
    return Comparison(Question(truths=fitted, rivals=fitted), NOISE, []), (fitted[0].key, fitted[1].key), (stop, hard)


def test_gains_are_raised_step_by_step() -> None:
    """Nothing parts the pair until the gain is raised until they are distinguishable; an end of the time is no answer."""
    comparison, pair, models = two_springs()
    asked: list[float] = []

    def beyond(factor: float) -> list[Prospect]:
        asked.append(factor)
        return [prospect(12.0 * factor)]

    def peaks(one: Prospect) -> LargestMotions:
        return simulated_peaks(models, one.excitation(whole=True), "unlocked", 0.0)

    found = beyond_limits(comparison, pair, beyond, peaks, quiet)
    assert tuple(asked) == RAISED[: len(asked)]
    assert found is not None
    assert found.distance >= 3.0
    asked.clear()
    assert beyond_limits(comparison, pair, lambda factor: beyond(factor) and [prospect(0.01)], peaks, quiet) is None
    assert tuple(asked) == RAISED

    with Deadline(0.0):
        assert beyond_limits(comparison, pair, beyond, peaks, quiet) is None


def test_the_smallest_stroke_beyond_the_limits_is_proposed() -> None:
    comparison, pair, _ = two_springs()

    def found(strokes: Mapping[int, Mapping[str, float]]) -> int:
        runs = [prospect(40.0, seed=seed) for seed in strokes]
        peaks = {seed: replace(NOTHING, stroke=stroke) for seed, stroke in strokes.items()}
        remedy = beyond_limits(comparison, pair, lambda _: runs, lambda one: peaks[one.run.seed], quiet)
        assert remedy is not None
        return remedy.prospect.run.seed

    assert found({1: {"spring": 0.9}, 2: {"spring": 0.8}, 3: {"spring": 0.85}}) == 2
    # The largest stroke of a run counts.
    assert found({1: {"spring": 0.9, "rail": 0.1}, 2: {"spring": 0.5, "rail": 0.5}}) == 2
    # A run in which all links are locked has no stroke.
    assert found({1: {"spring": 0.5}, 2: {}}) == 2


def test_the_larger_of_the_two_distances_of_a_pair_counts() -> None:
    a, b, c = (variant(one_mass(), cause) for cause in "abc")
    apart = [
        PairDistance(truth=truth, rival=rival, distance=size, probability=0.0)
        for truth, rival, size in ((a, b, 1.0), (b, a, 2.0), (a, c, 3.0))
    ]
    assert pair_distance(apart, (a.key, b.key)) == 2.0
    assert pair_distance(apart, (b.key, c.key)) == 0.0


@pytest.mark.parametrize(("rms", "enough"), [(12.0, True), (1e-3, False)])
def test_a_sensor_is_proposed_where_it_distinguishes(rms: float, enough: bool) -> None:
    comparison, pair, _ = two_springs()
    found = another_sensor(comparison, comparison.seen([prospect(rms)], Limits(), quiet), pair, quiet)
    assert (found is not None) == enough
    assert found is None or found.distance >= 3.0


def test_another_sensor_is_tried_with_the_best_candidates() -> None:
    comparison, pair, _ = two_springs()
    seen = comparison.seen([prospect(rms, seed=k) for k, rms in enumerate((0.1, 0.2, 0.3, 0.4, 0.5), 1)], Limits(), quiet)
    tried: list[str] = []
    another_sensor(comparison, seen, pair, tried.append)
    assert len(tried) == 3


def test_where_a_second_sensor_sits() -> None:
    model = wire_bonder()
    above = {s.channel: s for s in with_more_sensors(model, "unlocked").sensors}
    assert "second motor" in above
    assert "deflection isolation" in above
    (sensor,) = (s for s in model.sensors if s.channel == "motor")
    rocking = msgspec.structs.replace(
        model, bodies=(*model.bodies, Body(name="rocking", mass=0.1)), links=(*model.links, Link(name="bearing", a="rocking")),
        sensors=(msgspec.structs.replace(sensor, arms={"rocking": 0.02}), msgspec.structs.replace(sensor, channel="still")),
    )  # fmt: skip
    watching = {s.channel: s for s in with_more_sensors(rocking, "locked").sensors}
    second = watching["second motor"]
    assert watching["second still"].arms == {"rocking": 0.0}
    assert second.arms["rocking"] == pytest.approx(0.02 + 0.05)


def supposed() -> dict[tuple[str, str], Variant]:
    model = wire_bonder()
    peaks = LargestMotions(
        stroke={link.name: 0.01 for link in model.links}, speed={link.name: 0.5 for link in model.links}, drive=4.0, force=26.0,
        channels={**{s.channel: 2.0 for s in model.sensors}, "head": 4.0},
    )  # fmt: skip
    return {found.key: found for found in hypotheses(model, peaks, 1024.0)}


def test_causes_are_supposed_at_their_smallest_size() -> None:
    """Each in the quantity that its size is counted in, worked out by hand."""
    found, model = supposed(), wire_bonder()

    def value(cause: str, place: str, path: str) -> float:
        return found[cause, place].model.get(path)

    stiffness, friction = model.link("isolation").stiffness, model.get("contacts.isolation.law.friction_force")
    spring, contact = "links.isolation.laws.0", "contacts.isolation.law"
    sizes = {
        value("hardening_stiffness", "isolation", f"{spring}.cubic_stiffness") * 0.01**2 / stiffness: 0.1,
        value("softening_stiffness", "isolation", f"{spring}.softening"): 0.1,
        value("softening_stiffness", "isolation", f"{spring}.scale") / 0.01: 0.25,
        value("stribeck_friction", "isolation", f"{contact}.static_force") / friction - 1.0: 0.5 / 3.0,
        value("stribeck_friction", "isolation", f"{contact}.stribeck_velocity") / 0.5: 0.075,
        friction / value("presliding_friction", "isolation", f"{contact}.bristle_stiffness") / 0.01: 0.01,
        value("asymmetric_friction", "isolation", f"{contact}.forward_force") / friction - 1.0: 0.25 / 3.0,
        value("backlash", "isolation", f"{spring}.clearance") / 0.01: 0.02,
        value("end_stop", "isolation", f"{spring}.stroke") / 0.01: 0.75,
        value("end_stop", "isolation", f"{spring}.contact_stiffness") / stiffness: 0.5,
        value("stiffness_drift", "isolation", f"{spring}.drift_rate") * 720.0: 0.1 / 3.0,
        value("wrong_mass", "motor", "bodies.motor.mass") / model.body("motor").mass - 1.0: 0.02,
        value("sensor_gain", "motor", "sensors.motor.chain.gain") - 1.0: 0.05 / 3.0,
        value("channel_delay", "motor", "sensors.motor.chain.delay") * 1024.0: 0.8 / 3.0,
        value("clipping", "motor", "sensors.motor.chain.limit") / 2.0: 1.0 - 0.35 / 3.0,
    }  # fmt: skip
    for got, want in sizes.items():
        assert got == pytest.approx(want, rel=1e-6)
    assert found["mains_hum", "motor"].hum == ("motor", pytest.approx(0.01), 50.0)


def test_what_does_not_move_has_a_size_all_the_same() -> None:
    """The sizes of `test_causes_are_supposed_at_their_smallest_size`, of 1e-12 m, m/s and m/s^2."""
    still = {v.key: v.model for v in hypotheses(wire_bonder(), NOTHING, 1024.0)}
    assert still["end_stop", "isolation"].get("links.isolation.laws.0.stroke") == pytest.approx(0.75e-12, abs=0.0)
    velocity = still["stribeck_friction", "isolation"].get("contacts.isolation.law.stribeck_velocity")
    assert velocity == pytest.approx(0.075e-12, abs=0.0)
    assert still["clipping", "motor"].get("sensors.motor.chain.limit") == pytest.approx((1.0 - 0.35 / 3.0) * 1e-12, abs=0.0)


def test_causes_in_sensors_are_supposed_first() -> None:
    """They do not change the motion, so one simulation serves them all."""
    kinds = [kind_of(cause) == "sensor" for cause, _ in supposed()]
    assert kinds == sorted(kinds, reverse=True)
    assert kinds[0]
    assert not kinds[-1]


def test_a_displacement_sensor_resolves_so_much() -> None:
    """A gauge sees a difference of many times what it resolves and none far below."""
    comparison, pair, _ = two_springs()
    for rms, sees in ((12.0, True), (1e-3, False)):
        one = prospect(rms)
        apart = comparison.with_sensors(one, partial(with_more_sensors, configuration="unlocked"), pair)
        assert (apart["deflection spring"] > 1.0) == sees


def test_resolution_of_transfer_functions() -> None:
    """Lines lie 0.5 Hz apart; a band of no line tells nothing."""
    fitted = variant(one_mass(), std=0.02)
    one = KnownPrecision(fitted, parameter_by_name(fitted.model, "body_damping"), NOISE, [])
    between = prospect(1.0, band=(10 * 0.5 + 0.1, 11 * 0.5 - 0.1))
    at = prospect(1.0, band=(10 * 0.5 - 0.1, 10 * 0.5 + 0.1))
    assert not one.information(between).any()
    assert one.information(at).any()


def test_neighbouring_lines_count_once(monkeypatch: pytest.MonkeyPatch) -> None:
    fitted = variant(one_mass(), std=0.02)
    one = KnownPrecision(fitted, parameter_by_name(fitted.model, "body_damping"), NOISE, [])
    told = one.information(prospect(1.0))
    monkeypatch.setattr(precision, "POLICY", replace(POLICY, correlated_bins=2.0 * 1.5))
    assert one.information(prospect(1.0)) == pytest.approx(0.5 * told)


def test_hidden_oscillators_are_supposed_at_these_frequencies() -> None:
    model = wire_bonder()
    peaks = LargestMotions(
        stroke={}, speed={}, drive=4.0, force=26.0, channels={**{s.channel: 2.0 for s in model.sensors}, "head": 4.0}
    )  # fmt: skip
    found = [v.model for v in hypotheses(model, peaks, 1024.0) if v.key == ("extra_mode", "motor")]
    at = sorted(np.sqrt(m.link("motor_added").stiffness / m.body("motor_added").mass) / 2 / np.pi for m in found)
    assert at == pytest.approx([30.0, 110.0], rel=1e-6)
    assert [m.body("motor_added").mass / m.body("motor").mass for m in found] == pytest.approx([0.02 / 3.0] * 2, rel=1e-6)


@pytest.mark.parametrize(("name", "there"), [("shaken-base", False), ("damper-test", True)])
def test_the_inertia_of_an_imposed_body_is_supposed_only_where_its_force_is_measured(name: str, there: bool) -> None:
    model = read_description(SHIPPED[name])[0]
    (body,) = model.imposed
    found = {v.key for v in hypotheses(model, NOTHING, 512.0)}
    assert {("extra_mode", body) in found, ("wrong_mass", body) in found} == {there}
    others = [each.name for each in model.bodies if each.name != body]
    assert all(("extra_mode", other) in found for other in others)


def test_no_two_hypotheses_have_the_same_words() -> None:
    for name in SHIPPED:
        model = read_description(SHIPPED[name])[0]
        names = [cause(v) for v in hypotheses(model, NOTHING, 512.0)]
        assert len(set(names)) == len(names), name
    names = [cause(v) for v in hypotheses(wire_bonder(), NOTHING, 1024.0)]
    assert {"crosstalk at motor from head", "extra mode at motor with 30 Hz", "wrong mass at motor"} <= set(names)


def test_a_body_on_a_soft_spring_has_a_frequency_and_a_damping_ratio() -> None:
    rig = one_mass()
    body, link = rig.bodies[0].name, rig.links[0].name
    soft = rig.replace({f"links.{link}.stiffness": 0.5})
    assert {name: unit_of_parameter(name, soft) for name in named_parameters(soft)} == {
        f"{body}_mass": "kg", f"{body}_frequency": "Hz", f"{body}_damping": "1"
    }  # fmt: skip
    assert set(named_parameters(rig.replace({f"links.{link}.stiffness": 0.0}))) == {f"{body}_mass"}
