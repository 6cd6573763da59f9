"""The equations of motion of the records hold on sound rigs; a cause breaks its own, and the right regression repairs them."""

from __future__ import annotations

from dataclasses import replace as changed
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from msgspec.structs import replace
from small_rigs import carts, chain, guessed, played, rubbing, stage, with_law

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.diagnose.observe import observe
from isorig.analysis.diagnose.suspects import (
    ALIKE,
    BROKEN,
    LEAST_SCORE,
    REFUTED,
    REPAIRED,
    SHOWN,
    Suspects,
    repairs,
    suspected,
    suspects,
)
from isorig.analysis.equations import forms
from isorig.analysis.equations.balances import balances
from isorig.analysis.equations.columns import SHAPES, relaxing
from isorig.analysis.equations.forms import ElementForce, element_force, fitted_form, shape_of, start_values
from isorig.analysis.equations.hidden import estimable, estimated
from isorig.analysis.equations.motion import derivatives
from isorig.analysis.equations.ranking import HINTS, OWN, Explanation, ranking
from isorig.analysis.equations.sliding import RESTS, still
from isorig.analysis.equations.slip import slip_operator
from isorig.analysis.equations.system import HIGHEST_CUT, HOLDS, NOISY, SURE, equations_of
from isorig.analysis.fitting.candidate import Candidate
from isorig.analysis.fitting.solve import Fit, Free
from isorig.analysis.model.rig_model import Body, Chain, Contact, Link, RigModel
from isorig.analysis.parameters.joint_fit import fit_baseline
from isorig.analysis.rounding import DWELL, is_command, rounding
from isorig.analysis.simulate.natural import lowest_mode
from isorig.analysis.simulate.sampling import Excitation
from isorig.analysis.simulate.simulation import simulate
from isorig.analysis.spectra.noise import noise_levels
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.session import SESSION, virtual_campaign

SEED = 4100


def test_the_wire_bonder_has_an_equation_for_each_link() -> None:
    found = {balance.name: [element.name for element, _ in balance.crossing] for balance in balances(wire_bonder())}
    assert found == {"table + heatblock + motor": ["table"], "heatblock": ["heatblock"], "motor": ["isolation"]}


@pytest.mark.parametrize("rig", [chain, carts, stage], ids=lambda rig: rig.__name__)
def test_the_equations_of_a_sound_rig_hold(rig: type[RigModel]) -> None:
    truth = rig()
    equations = equations_of(played(truth, seed=SEED), guessed(truth, SEED))
    assert equations.residuals()
    assert max(equations.residuals().values()) < HOLDS


def test_a_hardening_link_breaks_its_own_equation_only_and_its_curve_repairs_it() -> None:
    truth = with_law(chain(), "l1", laws.Cubic(cubic_stiffness=2e7))
    equations = equations_of(played(truth, seed=SEED + 1), guessed(chain(), SEED + 1))
    before = equations.residuals()
    broken = {name for name, value in before.items() if value > HOLDS}
    assert broken == {"m1 + m2"}
    found = suspects(equations)
    assert found is not None
    assert found.includes("hardening_stiffness", "l1")
    best = ranking(equations).explanations[0]
    assert best.place == "l1"
    values = start_values(equations, best)
    assert values["links.l0.stiffness"] == pytest.approx(4200.0, rel=0.005)
    assert values["links.l2.stiffness"] == pytest.approx(3500.0, rel=0.005)


def test_spectra_tell_a_curve_that_noise_hides_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the samples have the force that one half of the segments gives: their difference is its noise."""
    truth = with_law(chain(), "l1", laws.Cubic(cubic_stiffness=5e6))
    equations = equations_of(played(truth, seed=SEED + 1, longer=3.0), guessed(chain(), SEED + 1))
    best = ranking(equations).explanations[0]
    monkeypatch.setattr(forms, "HIDDEN", np.inf)
    in_time = element_force(equations, "l1", shape_of(best))
    assert in_time is not None
    for factor, hidden in ((1.01, False), (0.99, True)):
        monkeypatch.setattr(forms, "HIDDEN", factor * float(np.mean(in_time.left**2) / np.mean(in_time.force**2)))
        force = element_force(equations, "l1", shape_of(best))
        assert force is not None
        assert np.array_equal(force.force, in_time.force) is not hidden
        assert np.std(force.left) < 0.02 * np.std(force.force)
        columns = np.stack([force.deflection, force.deflection**3, force.velocity], 1)
        values, *_ = np.linalg.lstsq(columns, force.force, rcond=None)
        own = truth.link("l1")
        assert values == pytest.approx([own.stiffness, 5e6, own.damping], rel=0.05)


def test_spectra_do_not_tell_the_force_where_more_than_a_curve_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = rubbing(with_law(chain(), "l1", laws.Cubic(cubic_stiffness=2e7)), "l1", 1.0)
    equations = equations_of(played(truth, seed=SEED + 1), guessed(chain(), SEED + 1))
    spring = next(shape for shape in SHAPES if shape.name == "force over deflection")
    in_time = element_force(equations, "l1", spring)
    monkeypatch.setattr(forms, "HIDDEN", 0.0)
    again = element_force(equations, "l1", spring)
    assert in_time is not None
    assert again is not None
    assert np.array_equal(again.force, in_time.force)


def test_the_curve_of_a_stiff_link_is_read_from_where_noise_is_small() -> None:
    """From the lowest frequencies on, noise would be half of the heatblock's integrated deflection."""
    rig = wire_bonder({**THESIS, "friction_force": 9.0})
    takes = [changed(take, seconds=15.0) for take in SESSION]
    campaign = virtual_campaign(with_law(rig, "heatblock", laws.Cubic(cubic_stiffness=3e18)), takes, seed=SEED)
    equations = equations_of(campaign, rig)
    best, second, *_ = ranking(equations).explanations
    assert (best.place, best.what) == ("heatblock", "force over deflection")
    assert best.score > 5.0 * second.score
    force = element_force(equations, best.place, shape_of(best))
    assert force is not None
    assert np.std(force.left) < 0.05 * np.std(force.force)
    columns = np.stack([force.deflection, force.deflection**3, force.velocity], 1)
    sizes = columns.std(axis=0)
    stiffness, cubic, _ = np.linalg.lstsq(columns / sizes, force.force, rcond=None)[0] / sizes
    assert stiffness == pytest.approx(rig.link("heatblock").stiffness, rel=0.1)
    assert cubic == pytest.approx(3e18, rel=0.2)


@pytest.mark.parametrize(("share", "raised"), [(0.9, False), (1.1, True)])
def test_the_slow_part_is_fitted_up_to_where_noise_is_a_tenth_of_the_deflection(share: float, raised: bool) -> None:
    rig = wire_bonder()
    equations = equations_of(virtual_campaign(rig, SESSION[:1], noise=1e-5, seed=SEED), rig)
    balance = equations.balance_of("heatblock")
    ((element, _),) = balance.crossing
    usual = HIGHEST_CUT * equations.lowest
    assert equations.cut(balance, element) == usual
    scale = share * NOISY / equations.noise_share(element, SURE * usual)
    equations.records = [
        changed(record, noise={channel: scale * level for channel, level in record.noise.items()}) for record in equations.records
    ]
    assert (equations.cut(balance, element) > usual) == raised


def test_a_wrong_gain_is_named_with_its_factor() -> None:
    truth = chain()
    sensors = tuple(replace(s, chain=Chain(gain=1.1)) if s.channel == "a1" else s for s in truth.sensors)
    best = ranking(equations_of(played(replace(truth, sensors=sensors), seed=SEED + 2), guessed(truth, SEED + 2))).explanations[0]
    assert (best.kind, best.place, best.what) == ("sensor", "a1", "gain")
    assert best.values["value"] == pytest.approx(1.1, abs=0.01)


def with_chain(rig: RigModel, channel: str, chain: Chain) -> RigModel:
    return replace(rig, sensors=tuple(replace(s, chain=chain) if s.channel == channel else s for s in rig.sensors))


def test_a_static_curve_of_a_sensor_ranks_before_every_link() -> None:
    peak = max(np.abs(run.channel("a1").read()).max() for run in played(chain(), seed=SEED + 6).runs)
    at = np.linspace(-1.5, 1.5, 13)
    bent = Chain(bend=tuple((float(x * peak), float(0.04 * peak * x**2)) for x in at))
    campaign = played(with_chain(chain(), "a1", bent), seed=SEED + 6)
    first, second, *_ = ranking(equations_of(campaign, guessed(chain(), SEED + 6))).explanations
    assert (first.kind, first.place, first.what) == ("sensor", "a1", "static curve")
    assert first.score > 2.0 * second.score


def test_two_sensors_of_one_motion_tell_a_bent_sensor_from_a_bent_spring() -> None:
    """Position and acceleration of one mass: in its only equation of motion the position stands for the spring's force alone."""
    campaign, model = played(stage(), seed=SEED + 12), guessed(stage(), SEED + 12)
    assert equations_of(campaign, model).residuals()["x as a"] < HOLDS
    peak = max(np.abs(run.channel("x").read()).max() for run in campaign.runs)
    bent = Chain(bend=tuple((float(x * peak), float(0.06 * peak * x**2)) for x in np.linspace(-1.5, 1.5, 13)))
    best, *others = ranking(equations_of(played(with_chain(stage(), "x", bent), seed=SEED + 12), model)).explanations
    assert (best.kind, best.place, best.what) == ("sensor", "x", "static curve")
    assert all(best.score > 2.0 * other.score for other in others if other.kind != "sensor")
    stiff = with_law(stage(), "rail", laws.Cubic(cubic_stiffness=0.2 * 2500.0 / peak**2))
    equations = equations_of(played(stiff, seed=SEED + 12), model)
    assert equations.residuals()["x as a"] < HOLDS
    # Each equation has its own curve of a sensor, so that the simulation decides here.
    best, *others = ranking(equations).explanations
    spring = next(item for item in (best, *others) if (item.kind, item.place) == ("spring_shape", "rail"))
    assert spring.score > 0.95 * best.score


@pytest.mark.parametrize("share", [-0.25, pytest.param(0.25, marks=pytest.mark.study)])
def test_crosstalk_of_a_quarter_is_named_with_its_source(share: float) -> None:
    campaign = played(with_chain(chain(), "a1", Chain(crosstalk={"a0": share})), seed=SEED + 7)
    best = ranking(equations_of(campaign, guessed(chain(), SEED + 7))).explanations[0]
    assert (best.kind, best.place, best.what, best.source) == ("sensor", "a1", "crosstalk", "a0")
    assert best.values["value"] == pytest.approx(share, abs=0.01)


def loaded(rig: RigModel, body: str, mass: float, frequency: float) -> RigModel:
    stiffness = mass * (2.0 * np.pi * frequency) ** 2
    link = Link(name="load", a="load", b=body, stiffness=stiffness, damping=0.02 * mass * 2.0 * np.pi * frequency)
    return replace(rig, bodies=(*rig.bodies, Body(name="load", mass=mass)), links=(*rig.links, link))


@pytest.mark.parametrize("scale", ["given", "free"])
def test_an_attached_resonator_is_named_with_and_without_a_known_scale(scale: str) -> None:
    # With a free mass and a free drive no equation has a known scale: each one has a coefficient of its own.
    given = carts()
    known = ("drive.factor", "bodies.second.mass") if scale == "given" else ()
    free = tuple(path for path in given.free if path not in known)
    campaign = played(loaded(given, "second", 0.15, 4.4), seed=SEED + 8)
    best = ranking(equations_of(campaign, guessed(replace(given, free=free), SEED + 8))).explanations[0]
    assert (best.kind, best.place, best.what) == ("added_motion", "second", "resonator")
    assert best.values["frequency"] == pytest.approx(4.4, rel=0.05)


def test_a_body_given_too_light_starts_with_its_own_mass_and_stiffness() -> None:
    # Its own equation holds with any mass: that of all bodies gives the mass, and its stiffness grows with it.
    truth = chain()
    given = guessed(truth, SEED + 9).replace({"bodies.m2.mass": 0.6 * truth.body("m2").mass})
    equations = equations_of(played(truth, seed=SEED + 9), given)
    best = ranking(equations).explanations[0]
    assert (best.kind, best.place, best.what) == ("known_value", "m2", "mass")
    assert best.values["mass"] == pytest.approx(truth.body("m2").mass, rel=0.02)
    assert start_values(equations, best)["links.l2.stiffness"] == pytest.approx(truth.link("l2").stiffness, rel=0.03)


def test_the_level_of_dry_friction_follows_from_the_equation() -> None:
    truth = rubbing(stage(), "rail", 4.0)
    path = "contacts.rail.law.friction_force"
    given = guessed(replace(truth, free=(*truth.free, path)), SEED + 3)
    assert start_values(equations_of(played(truth, seed=SEED + 3), given))[path] == pytest.approx(4.0, rel=0.05)


def test_values_beside_an_unknown_factor_of_the_drive_follow_from_the_given_mass() -> None:
    truth = rubbing(carts(), "wall", 1.2)
    free = ("drive.factor", "links.wall.stiffness")
    given = replace(carts(), free=tuple(path for path in carts().free if path != "bodies.second.mass")).replace(
        {path: 0.75 * truth.get(path) for path in free}
    )
    equations = equations_of(played(truth, seed=SEED + 12), given)
    best = ranking(equations).explanations[0]
    assert (best.kind, best.place) == ("friction_shape", "wall")
    values = start_values(equations, best)
    assert [values[path] for path in free] == pytest.approx([truth.get(path) for path in free], rel=0.05)
    force, element = (
        element_force(equations, best.place, shape_of(best)),
        next(e for e in equations.elements() if e.name == "wall"),
    )
    path = "contacts.wall.law.friction_force"
    own = [Free(path=path, low=0.01, high=50.0), *(Free(path=f"links.wall.{name}") for name in ("stiffness", "damping"))]
    assert force is not None
    found = fitted_form(rubbing(given, "wall", 0.1), own, element, force)
    assert found is not None
    assert found[0][path] == pytest.approx(1.2, rel=0.15)


def test_a_form_whose_force_has_no_square_is_fitted_without_a_warning() -> None:
    """A search may pass values with such forces."""
    start = with_law(carts(), "between", laws.Cubic(cubic_stiffness=1e170))
    element = next(e for e in equations_of(played(carts(), seed=SEED), carts()).elements() if e.name == "between")
    d = np.linspace(-1.0, 1.0, 50)
    force = ElementForce(deflection=d, velocity=d, time=d, force=d, left=d, motions=(), rate=1.0)
    assert fitted_form(start, [Free(path="links.between.laws.0.cubic_stiffness", high=1e200)], element, force) is not None


def test_a_form_is_fitted_to_the_recorded_force() -> None:
    truth = with_law(carts(), "between", laws.Cubic(cubic_stiffness=3e6))
    given = guessed(carts(), SEED + 4)
    equations = equations_of(played(truth, seed=SEED + 4), given)
    best = next(x for x in ranking(equations).explanations if (x.place, x.what) == ("between", "force over deflection"))
    force = element_force(equations, best.place, shape_of(best))
    assert force is not None
    assert np.std(force.left) < 0.1 * np.std(force.force)
    start = with_law(given, "between", laws.Cubic(cubic_stiffness=1e4))
    path = "links.between.laws.0.cubic_stiffness"
    element = next(e for e in equations.elements() if e.name == "between")
    free = [Free(path=path, low=1.0, high=1e9), Free(path="links.between.stiffness"), Free(path="links.between.damping")]
    found = fitted_form(start, free, element, force)
    assert found is not None
    # No drive acts on the second cart: its mass sets the scale of its equation.
    scale = given.body("second").mass / truth.body("second").mass
    assert found[0][path] == pytest.approx(3e6 * scale, rel=0.1)


def test_a_form_with_memory_is_fitted_to_the_recorded_force() -> None:
    law = laws.ElastoSlip(spring_stiffness=2000.0, slip_force=1.5)
    campaign, given = played(with_law(stage(), "rail", law), seed=SEED + 15), guessed(stage(), SEED + 15)
    equations = equations_of(campaign, given)
    best = ranking(equations).explanations[0]
    assert (best.kind, best.place, best.what) == ("memory", "rail", "slip")
    force, path = element_force(equations, best.place, shape_of(best)), "links.rail.laws.0"
    assert force is not None
    start = with_law(given, "rail", laws.ElastoSlip(spring_stiffness=500.0, slip_force=0.5))
    free = [Free(path=f"{path}.{name}", low=1e-3, high=1e6) for name in ("spring_stiffness", "slip_force")]
    free += [Free(path=f"links.rail.{name}") for name in ("stiffness", "damping")]
    found = fitted_form(start, free, equations.elements()[0], force)
    assert found is not None
    values = [found[0][f"{path}.{name}"] for name in ("spring_stiffness", "slip_force")]
    assert values == pytest.approx([2000.0, 1.5], rel=0.1)


def test_a_resonator_is_found_in_the_upper_half_of_the_usable_band() -> None:
    # Second derivatives of encoders are noisy: the band ends near the modes.
    rig, given = carts(), guessed(carts(), SEED + 16)
    band = float(equations_of(played(rig, seed=SEED + 16), given).spectra.frequency[-1])
    mass, own = 0.15, 2.0 * np.pi * 0.7 * band
    added = Link(name="loose", a="part", b="first", stiffness=mass * own**2, damping=mass * 2.0 * 0.02 * own)
    truth = replace(rig, bodies=(*rig.bodies, Body(name="part", mass=mass)), links=(*rig.links, added))
    best = ranking(equations_of(played(truth, seed=SEED + 16), given)).explanations[0]
    assert (best.kind, best.place, best.what) == ("added_motion", "first", "resonator")
    assert best.values["frequency"] == pytest.approx(0.7 * band, rel=0.01)
    assert best.values["mass"] == pytest.approx(mass, rel=0.1)


def test_an_absorber_that_is_tuned_to_the_lowest_mode_is_found() -> None:
    given = guessed(carts(), SEED + 17)
    lowest = lowest_mode(carts())
    best = ranking(equations_of(played(loaded(carts(), "second", 0.15, lowest), seed=SEED + 17), given)).explanations[0]
    assert (best.kind, best.place, best.what) == ("added_motion", "second", "resonator")
    assert best.values["frequency"] == pytest.approx(lowest, rel=0.02)


def wavy(rig: RigModel, link: str, force: float, pitch: float) -> RigModel:
    at = np.linspace(-2.5 * pitch, 2.5 * pitch, 65)
    values = force * np.sin(2.0 * np.pi * at / pitch)
    return with_law(rig, link, laws.Curve(over="deflection", at=tuple(at.tolist()), values=tuple(values.tolist())))


def test_a_curve_is_fitted_to_a_force_that_rises_and_falls_and_suffices_alone() -> None:
    # Cogging with several periods over the swing: the curve starts flat.
    swing = max(np.ptp(run.channel("x").read()) for run in played(stage(), seed=SEED + 10).runs) / 2.0
    truth = wavy(stage(), "rail", 6.0, 0.8 * swing)
    campaign = played(truth, seed=SEED + 10)
    given = guessed(stage(), SEED + 10)
    found = suspects(equations_of(campaign, given))
    assert found is not None
    assert (found.chosen[0].kind, found.chosen[0].place) == ("spring_shape", "rail")
    fitted, trials = fit_baseline(campaign, given)
    evidence = observe(campaign, fitted.model, trials, given, given)
    shapes = found.shapes(fitted, evidence)
    assert {shape.key for shape in shapes} == {("spring_shape", "rail")}
    assert len(shapes) == 1
    assert not found.leaves_another(fitted, evidence)
    # Springs that remove less than half of what the curve does are not simulated.
    simulated = {candidate.cause for candidate in found.candidates(fitted, evidence)}
    assert simulated.isdisjoint({"end_stop", "hardening_stiffness", "backlash"})


def test_the_motion_of_a_body_without_a_sensor_follows_from_the_others() -> None:
    rig = chain()
    partly = replace(rig, sensors=rig.sensors[1:])
    assert estimable(partly) == ("m0",)
    drive = np.random.default_rng(1).normal(0.0, 3.0, 8192)
    channels = simulate(rig, Excitation.prepare(drive, 512.0, oversample=4)).channels
    found = estimated(partly, ("m0",), {"m1": channels["a1"], "m2": channels["a2"]}, {"f": drive}, 512.0)["m0"]
    inner = slice(2048, -2048)
    assert np.std((found - channels["a0"])[inner]) < 0.02 * np.std(channels["a0"][inner])


def test_derivatives_and_integrals_of_a_sine() -> None:
    t = np.arange(8192) / 1024.0
    omega = 2.0 * np.pi * 20.0
    inner = slice(1024, -1024)
    down = derivatives(-(omega**2) * np.sin(omega * t), 2, 1024.0, 0.5, np.inf).orders
    up = derivatives(np.sin(omega * t), 0, 1024.0, 0.5, np.inf).orders
    assert np.abs(down[0] - np.sin(omega * t))[inner].max() < 2e-3
    assert np.abs(up[2] + omega**2 * np.sin(omega * t))[inner].max() < 2e-3 * omega**2


@pytest.mark.parametrize(("dwell", "command"), [(DWELL, True), (DWELL - 1.0, False)])
def test_a_staircase_is_a_command_from_a_mean_dwell_on(dwell: float, command: bool) -> None:
    levels = np.random.default_rng(2).normal(size=30)
    assert is_command(np.repeat(levels, int(dwell))) is command
    if command:  # a drive that is exact, whatever its spectrum
        made = {"f": Channel(name="f", samples=np.repeat(np.random.default_rng(3).normal(size=60), 40))}
        run = Run(id="r", configuration="unlocked", sample_rate=400.0, gain=1.0, channels=made)
        assert noise_levels(Campaign(runs=(run,), source="made"), ("f",)) == {"f": 0.0}
        assert noise_levels(Campaign(runs=(run,), source="made"))["f"] > 0.0
    hits = np.zeros(4000)  # a hammer's record that is zero between hits
    hits[1000:1030] = np.sin(np.linspace(0.1, 3.0, 30))
    assert not is_command(hits)


def test_counts_have_the_noise_of_their_rounding() -> None:
    values = np.random.default_rng(2).normal(0.0, 1.0, 5000)
    assert rounding(np.round(values / 0.1) * 0.1) == pytest.approx(0.1 / np.sqrt(12.0))
    assert rounding(values) == 0.0


@pytest.mark.parametrize(("levels", "rounded"), [(7, False), (8, True)])
def test_a_command_with_few_levels_is_exact(levels: int, rounded: bool) -> None:
    held = np.repeat(np.arange(levels, dtype=float), 100)
    assert (rounding(held) > 0.0) == rounded


def test_a_slipping_spring_along_a_ramp_and_back() -> None:
    force = slip_operator(np.array([0.0, 0.5, 1.0, 3.0, 2.5, 1.0]), 1.0)
    assert force.tolist() == [0.0, 0.5, 1.0, 1.0, 0.5, -1.0]


def test_a_relaxation_is_half_its_spring_and_out_of_phase_at_its_corner() -> None:
    assert relaxing(np.array([1j * 0.4]), 0.4)[0] == pytest.approx(0.5 + 0.5j)


def explanation(place: str, score: float) -> Explanation:
    return Explanation(kind="sensor", place=place, what="gain", score=score, residuals={}, values={})


def test_explanations_with_less_than_a_share_of_the_best_score_are_not_suspected() -> None:
    close, far = explanation("b", 1.001 * ALIKE), explanation("c", 0.999 * ALIKE)
    assert [item.place for item in suspected([explanation("a", 1.0), close, far], {})] == ["a", "b"]


@pytest.mark.parametrize(("score", "count"), [(0.801, 5), (0.799, 3)])
def test_more_than_three_explanations_are_suspected_if_they_are_as_good_as_the_best(score: float, count: int) -> None:
    """Four fifths of its score."""
    alike = [explanation(place, score) for place in "bcde"]
    assert len(suspected([explanation("a", 1.0), *alike], {})) == count


@pytest.mark.parametrize(("score", "count"), [(1.01, 1), (0.99, 0)])
def test_an_explanation_that_removes_hardly_anything_is_not_suspected(score: float, count: int) -> None:
    assert len(suspected([explanation("a", score * LEAST_SCORE)], {})) == count


def test_explanations_close_to_a_best_one_that_removes_little_are_suspected_too() -> None:
    near = [explanation("a", 1.01 * LEAST_SCORE), explanation("b", 0.9 * LEAST_SCORE)]
    assert suspected(near, {}) == tuple(near)


@pytest.mark.parametrize(
    ("score", "share", "place", "outdone"),
    [(0.41, 0.59, "rail", True), (0.39, 0.59, "rail", False), (0.41, 0.61, "rail", False), (0.41, 0.59, "other", False)],
)
def test_a_memory_is_not_simulated_where_dry_friction_explains_more_of_the_force(
    score: float, share: float, place: str, outdone: bool
) -> None:
    """By both the score of its explanation and the share of the recorded force that it leaves."""
    memory, friction = (
        Candidate(cause=cause, location=at, family="", starts=(), free=(), reported=())
        for cause, at in (("hysteresis", "rail"), ("coulomb_friction", place))
    )
    known = {id(memory): (0.4, 0.6), id(friction): (score, share)}
    found = SimpleNamespace(_share_of_force=lambda candidate, current: known[id(candidate)])
    current = cast("Fit", None)
    assert Suspects._outdone(cast("Suspects", found), memory, [memory, friction], current) == outdone


@pytest.mark.parametrize(
    ("best", "left", "refuted"),
    [(0.99, 0.99 * REFUTED, False), (0.99, 1.01 * REFUTED, True), (1.01, 1.01 * REFUTED, False)],
)
def test_an_explanation_that_leaves_an_equation_broken_is_refuted_by_one_that_leaves_none(
    best: float, left: float, refuted: bool
) -> None:
    first = changed(explanation("a", 1.0), residuals={"x": 1.0, "y": best * BROKEN})
    other = changed(explanation("b", 0.9), residuals={"x": left, "y": 1.0})
    assert suspected([first, other], {}) == ((first,) if refuted else (first, other))


@pytest.mark.parametrize(
    ("left", "score", "other", "joins"),
    [
        (1.01 * BROKEN, 1.01 * LEAST_SCORE, 0.9, True),
        (0.99 * BROKEN, 1.01 * LEAST_SCORE, 0.9, False),
        (1.01 * BROKEN, 0.99 * LEAST_SCORE, 0.9, False),
        # Where the place is certain, the force there need not look like any force with a memory.
        (1.01 * BROKEN, -0.01, 0.99 - SHOWN, True),
        (1.01 * BROKEN, -0.01, 1.01 - SHOWN, False),
        (0.99 * BROKEN, -0.01, 0.99 - SHOWN, False),
    ],
)
def test_a_force_with_a_memory_is_suspected_where_the_best_explanation_leaves_much(
    left: float, score: float, other: float, joins: bool
) -> None:
    best = changed(explanation("a", 1.0), kind="spring_shape", residuals={"x": left})
    memory = changed(explanation("a", score), kind="memory", residuals={"x": 9.0 * BROKEN})
    elsewhere = changed(explanation("b", score), kind="memory", residuals={"x": 9.0 * BROKEN})
    rival = changed(explanation("b", other), residuals={"x": 2.0 * BROKEN})
    listed, first = [best, rival, elsewhere, memory], (best, rival) if other >= ALIKE else (best,)
    assert suspected(listed, {"x": 10.0 * BROKEN}) == ((*first, memory) if joins else first)
    if score < LEAST_SCORE:
        assert suspected(listed, {"x": 10.0 * BROKEN}, further=True) == first


@pytest.mark.parametrize(("share", "moved"), [(1.02 * RESTS, True), (0.98 * RESTS, False)])
def test_an_element_that_rests_is_moved_and_a_weak_run_is_no_rest(share: float, moved: bool) -> None:
    count = 10_000
    speed = np.where(np.arange(count) < share * count, 0.0, 1.0)
    assert (still([speed, 0.01 * speed]) > RESTS) is moved


@pytest.mark.parametrize(
    ("left", "another", "own"), [(1.0, 20.0, True), (14.2, 20.0, True), (14.4, 20.0, False), (1.0, 4.7, False), (1.0, 5.3, True)]
)
def test_what_repairs_one_equation_is_suspected_beside_what_repairs_the_largest(left: float, another: float, own: bool) -> None:
    large = changed(explanation("a", 1.0), residuals={"x": 1.0, "y": another})
    small = changed(explanation("b", 0.01), residuals={"x": 1000.0, "y": left})
    assert (small in suspected([large, small], {"x": 1000.0, "y": 20.0})) is own


@pytest.mark.parametrize(
    ("before", "after", "own"),
    [
        (1.01 * BROKEN, 0.99 * REPAIRED * BROKEN, True),
        (1.01 * HINTS, 1.0 + 0.99 * REPAIRED * (1.01 * HINTS - 1.0), True),
        (1.01 * HINTS, 1.0 + 1.01 * REPAIRED * (1.01 * HINTS - 1.0), False),
        (0.99 * HINTS, 0.1, False),
        (2.0 * BROKEN, 1.01 * REPAIRED * 2.0 * BROKEN, False),
    ],
)
def test_a_further_cause_repairs_an_equation_of_its_own(before: float, after: float, own: bool) -> None:
    assert repairs({"a": before}, {"a": after}) is own


def test_two_causes_are_both_found() -> None:
    truth = with_law(chain(), "l1", laws.Cubic(cubic_stiffness=2e7))
    sensors = tuple(replace(s, chain=Chain(gain=1.1)) if s.channel == "a2" else s for s in truth.sensors)
    given = guessed(chain(), SEED + 5)
    campaign = played(replace(truth, sensors=sensors), seed=SEED + 5)
    first = suspects(equations_of(campaign, given))
    assert first is not None
    assert first.includes("sensor_gain", "a2")
    with_gain = replace(
        given, sensors=tuple(replace(s, chain=Chain(gain=1.1)) if s.channel == "a2" else s for s in given.sensors)
    )
    then = suspects(equations_of(campaign, with_gain), further=True)
    assert then is not None
    assert then.includes("hardening_stiffness", "l1")
    assert changed(then, chosen=()).includes("hardening_stiffness", "l1") is False


def test_an_equation_of_which_nothing_remains_to_be_tested_is_left_out() -> None:
    # A body that friction holds most of the time leaves an equation without a usable moment.
    equations = equations_of(played(with_law(chain(), "l1", laws.Cubic(cubic_stiffness=2e7)), seed=4), chain())
    gone = next(name for name in equations.prepared if name in {balance.name for balance in equations.balances})
    del equations.prepared[gone]
    ranked = ranking(equations)
    assert gone not in ranked.residuals
    assert ranked.explanations


@pytest.mark.parametrize(
    ("fault", "what"),
    [
        (Chain(corner=2.5), "high-pass"),
        # Shorter runs do not show it.
        pytest.param(Chain(bend=((-80.0, 0.0), (-2.0, 0.0), (2.0, 0.0), (80.0, -70.0))), "static curve", marks=pytest.mark.study),
    ],
)
def test_rocking_does_not_stand_for_the_force_that_makes_it_rock(fault: Chain, what: str) -> None:
    """The torque contains the isolation's force: without its resonance it is that force, which then fits any record."""
    rig = wire_bonder()
    takes = [changed(take, seconds=20.0) for take in SESSION] if what == "high-pass" else SESSION
    equations = equations_of(virtual_campaign(with_chain(rig, "motor", fault), takes, seed=SEED + 13), rig)
    best = ranking(equations).explanations[0]
    assert (best.kind, best.place, best.what) == ("sensor", "motor", what)
    sliding, base = equations.sliding["motor"]
    columns = equations.base_columns(equations.primary(equations.balance_of("motor")))
    assert sliding.share_kept(columns, base.values, OWN * base.values) == pytest.approx(OWN)


def test_a_contact_with_the_name_of_a_link_and_other_arms_is_an_element_of_its_own() -> None:
    rig = rubbing(chain(), "l1", 3.0)
    geared = replace(rig, links=tuple(replace(x, arms={"m0": 0.5}) if x.name == "l1" else x for x in rig.links))
    lossy = with_law(geared, "l1", laws.Maxwell(relaxation_stiffness=900.0, relaxation_time=0.02))
    campaign = played(lossy, seed=SEED + 14)
    equations = equations_of(campaign, lossy)
    assert {element.name for element in equations.elements()} == {"l0", "l1", "l2", "friction of l1"}
    # The law of a link beside a contact is known in the equation of what slides; without it, it is found there.
    assert max(ranking(equations).residuals.values()) < HINTS
    best = ranking(equations_of(campaign, geared)).explanations[0]
    assert (best.kind, best.place, best.what) == ("memory", "l1", "relaxation")


def test_lost_motion_between_two_bodies_that_both_rub_is_in_the_link_between_them() -> None:
    rail = [Contact(name=body, a=body, law=laws.Coulomb(friction_force=0.4)) for body in ("first", "second")]
    given = replace(carts(), contacts=tuple(rail), free=(*carts().free, *(f"contacts.{c.name}.law.friction_force" for c in rail)))
    loose = with_law(given, "between", laws.Backlash(clearance=1e-3))
    equations = equations_of(played(loose, seed=SEED + 15), given)
    assert all(balance.rubs for balance in equations.balances)
    best = ranking(equations).explanations[0]
    assert (best.kind, best.place) == ("spring_shape", "between")


@pytest.mark.parametrize("delay", [0.006, -0.006])
def test_a_late_record_shows_in_an_equation_with_friction_and_an_unknown_mass(delay: float) -> None:
    """Sensor and drive are the only ones: a late sensor is an early drive."""
    rig = rubbing(replace(stage(), sensors=stage().sensors[1:]), "rail", 3.0)
    ranked = ranking(equations_of(played(replace(rig, drive=replace(rig.drive, chain=Chain(delay=delay))), seed=5), rig))
    first = {item.place: item for item in ranked.explanations[:2]}
    assert {item.what for item in first.values()} == {"delay"}
    assert first["f"].values["value"] == pytest.approx(delay, rel=0.02)
    assert first["a"].values["value"] * delay < 0.0
    assert all(item.residuals["table"] < 1.0 for item in first.values())  # all that is left is noise
    assert ranked.residuals["table"] > 50.0


def test_a_gain_of_the_only_known_force_explains_nothing() -> None:
    """A smaller force leaves less with any motion; with a known mass its size counts."""
    campaign, gains = played(rubbing(stage(), "rail", 2.0), seed=SEED), np.array([0.7, 1.0, 1.6])
    for rig, constant in ((stage(), True), (replace(stage(), free=stage().free[:2]), False)):
        equations = equations_of(campaign, rig)
        added, values = equations.fault("gain", "f", gains, None)
        left = [one.residual for one in equations.prepared["table"].without_fault(added, values)]
        assert bool(max(left) < 1.01 * min(left)) is constant


@pytest.mark.parametrize(("what", "value"), [("gain", 1.3), ("delay", 0.002), ("high-pass", 0.4), ("crosstalk", 0.2)])
def test_an_equation_without_a_fault_is_that_of_the_corrected_signals(what: str, value: float) -> None:
    equations = equations_of(played(chain(), seed=SEED), guessed(chain(), SEED))
    prepared = equations.prepared["m1 + m2"]
    added, gains = equations.fault(what, "a1", np.array([0.5 * value, value]), "a2" if what == "crosstalk" else None)
    corrected = prepared.solve(correction=np.eye(len(added)) + gains[1][:, None, None] * added)
    quick = prepared.without_fault(added, gains)[1]
    assert quick.residual == pytest.approx(corrected.residual, rel=1e-9)
    np.testing.assert_allclose(quick.values, corrected.values, rtol=1e-9)
