"""Diagnoses of small rigs with effects of no catalogue, several causes at once, and rest before the drive."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lsim, sosfilt
from small_rigs import SESSION, Take, carts, chain, guessed, late, played, rubbing, stage, with_law

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, Run
from isorig.analysis.deadline import Deadline
from isorig.analysis.diagnose.diagnosis import Diagnosis, diagnose
from isorig.analysis.equations.system import HOLDS, equations_of
from isorig.analysis.model.rig_model import Body, Chain, Contact, Drive, Link, RigModel, Sensor

SEED = 20311
#: A drive, the same again, and a larger one.
TAKES = (*SESSION[:2], SESSION[3])


def found(model: RigModel, truth: RigModel, seed: int, **options: object) -> Diagnosis:
    takes = options.pop("takes", TAKES)
    return diagnose(played(truth, seed=seed, takes=takes), guessed(model, seed), **options)  # type: ignore[arg-type]


def named(diagnosis: Diagnosis) -> set[tuple[str, str, str]]:
    return {(step.cause, step.kind, step.location) for step in diagnosis.steps}


def test_a_sound_chain_with_rest_before_the_drive_is_adequate() -> None:
    takes = tuple(Take(take.level, take.wave, rest=1.5) for take in SESSION)
    diagnosis = found(chain(), chain(), SEED, takes=takes)
    assert (diagnosis.verdict, diagnosis.steps) == ("adequate", ())
    assert {candidate.standing for candidate in diagnosis.considered} == {"not tested"}


@pytest.mark.study
@pytest.mark.timeout(600)
def test_friction_and_a_late_drive_are_found_together() -> None:
    diagnosis = found(carts(), late(rubbing(carts(), "wall", 0.8), 0.0124), SEED + 1)
    assert diagnosis.verdict == "explained"
    assert named(diagnosis) == {("coulomb_friction", "friction_shape", "wall"), ("channel_delay", "sensor", "u")}
    values = {name: value for step in diagnosis.steps for name, (value, _, _) in step.parameters.items()}
    assert values["friction_force"] == pytest.approx(0.8, rel=0.01)
    assert values["delay"] == pytest.approx(0.0124, rel=0.01)


def test_friction_that_holds_a_body_most_of_the_time_is_found() -> None:
    # Without friction the best fit is a link so stiff and damped that nothing moves.
    truth = rubbing(stage(), "rail", 12.3)
    diagnosis = found(stage(), truth, SEED + 8)
    assert diagnosis.baseline_error > 0.9
    assert named(diagnosis) == {("coulomb_friction", "friction_shape", "rail")}
    assert diagnosis.steps[0].parameters["friction_force"][0] == pytest.approx(12.3, rel=0.01)


@pytest.mark.parametrize("cause", ["relaxation", "hysteresis"])
def test_a_force_with_a_memory_is_named_with_its_values(cause: str) -> None:
    values = {"relaxation_stiffness": 700.0, "relaxation_time": 0.03}
    truth = with_law(stage(), "rail", laws.Maxwell(**values))
    if cause == "hysteresis":
        values = {"friction_force": 6.0, "initial_stiffness": 4e3, "sharpness": 2.0, "pinching": 0.6}
        truth = replace(stage(), contacts=(Contact(name="rail", a="table", law=laws.BoucWen(**values)),))
    diagnosis = found(stage(), truth, SEED + 30)
    (step,) = diagnosis.steps
    assert (diagnosis.verdict, step.cause, step.location) == ("explained", cause, "rail")
    assert {name: value for name, (value, _, _) in step.parameters.items()} == pytest.approx(values, rel=0.01)


def test_friction_of_a_belt_acts_on_its_elongation() -> None:
    """The pulleys have different radii: the velocity of one relative to the other is not what rubs."""
    rig = replace(chain(), links=tuple(replace(x, arms={"m0": 0.5}) if x.name == "l1" else x for x in chain().links))
    diagnosis = found(rig, rubbing(rig, "l1", 3.0), SEED + 9, takes=TAKES[::2])
    assert named(diagnosis) == {("coulomb_friction", "friction_shape", "l1")}
    assert diagnosis.steps[0].parameters["friction_force"][0] == pytest.approx(3.0, rel=0.01)


@pytest.mark.study
def test_a_second_cause_that_shows_later_in_the_runs_is_found() -> None:
    # A gain shows at once; the chain hardens only where it swings far, after the first half second.
    truth = with_law(chain(), "l1", laws.Cubic(cubic_stiffness=2e7))
    sensors = tuple(replace(s, chain=Chain(gain=1.1)) if s.channel == "a2" else s for s in truth.sensors)
    diagnosis = found(chain(), replace(truth, sensors=sensors), SEED + 10)
    assert diagnosis.verdict == "explained"
    assert named(diagnosis) == {("sensor_gain", "sensor", "a2"), ("hardening_stiffness", "spring_shape", "l1")}


@pytest.mark.study
def test_a_small_gain_and_a_play_are_found_together() -> None:
    # The gain alone is fitted to 1: the play bends every value of a model without it.
    loose = with_law(chain(), "l1", laws.Backlash(clearance=2e-4))
    sensors = tuple(replace(one, chain=Chain(gain=1.04)) if one.channel == "a2" else one for one in loose.sensors)
    diagnosis = found(chain(), replace(loose, sensors=sensors), SEED + 12)
    assert named(diagnosis) == {("sensor_gain", "sensor", "a2"), ("backlash", "spring_shape", "l1")}
    values = {name: value for step in diagnosis.steps for name, (value, _, _) in step.parameters.items()}
    assert values["clearance"] == pytest.approx(2e-4, rel=0.01)


@pytest.mark.study
def test_a_further_cause_that_repairs_no_equation_is_found_where_both_fit() -> None:
    # With the friction that a fit without the other cause found, the equation remains broken.
    truth = with_law(rubbing(chain(), "l1", 4.0), "l1", laws.Cubic(cubic_stiffness=2e5))
    diagnosis = found(chain(), truth, SEED + 13)
    assert [(step.kind, step.location) for step in diagnosis.steps] == [("friction_shape", "l1"), ("spring_shape", "l1")]
    assert diagnosis.extended_error < diagnosis.floor


def test_an_accelerometer_that_loses_slow_motion_is_found_with_its_corner_frequency() -> None:
    # By a filter that is not the program's: of second-order sections, from scipy.
    campaign, corner = played(chain(), seed=SEED + 11, takes=TAKES[::2]), 1.6
    sections = butter(1, corner, "highpass", fs=campaign.runs[0].sample_rate, output="sos")

    def coupled(run: Run) -> Run:
        channel = run.channel("a1")
        return dataclasses.replace(
            run, channels=dict(run.channels) | {"a1": dataclasses.replace(channel, samples=sosfilt(sections, channel.read()))}
        )

    diagnosis = diagnose(dataclasses.replace(campaign, runs=tuple(map(coupled, campaign.runs))), guessed(chain(), SEED + 11))
    assert diagnosis.verdict == "explained"
    assert named(diagnosis) == {("ac_coupling", "sensor", "a1")}
    value, std, _ = diagnosis.steps[0].parameters["corner"]
    assert abs(value - corner) < 3.0 * std < 0.1 * corner


def test_a_sensor_behind_a_slow_amplifier_is_found_with_its_corner_frequency() -> None:
    # By scipy's solution of the filter's differential equation between samples that are interpolated by a cubic spline.
    campaign, cutoff = played(chain(), seed=SEED + 12, takes=TAKES[::2]), 150.0

    def slow(run: Run) -> Run:
        channel, fine = run.channel("a1"), np.arange(16 * len(run)) / (16.0 * run.sample_rate)
        values = CubicSpline(fine[::16], channel.read())(np.minimum(fine, fine[-16]))
        samples = lsim(([1.0], [1.0 / (2.0 * np.pi * cutoff), 1.0]), values, fine)[1][::16]
        return dataclasses.replace(run, channels=dict(run.channels) | {"a1": dataclasses.replace(channel, samples=samples)})

    diagnosis = diagnose(dataclasses.replace(campaign, runs=tuple(map(slow, campaign.runs))), guessed(chain(), SEED + 12))
    assert diagnosis.verdict == "explained"
    assert named(diagnosis) == {("low_pass", "sensor", "a1")}
    value, std, _ = diagnosis.steps[0].parameters["cutoff"]
    assert std < 0.01 * cutoff
    assert value == pytest.approx(cutoff, rel=0.02)


def test_cubic_damping_is_a_damping_of_another_form() -> None:
    at = np.linspace(-1.5, 1.5, 41)
    law = laws.Curve(over="speed", at=tuple(at), values=tuple(60.0 * at**3))
    diagnosis = found(chain(), with_law(chain(), "l1", law), SEED + 2, takes=TAKES[::2])
    assert diagnosis.verdict == "explained"
    (step,) = diagnosis.steps
    assert (step.cause, step.kind, step.location, step.form) == ("damping_shape", "damping_shape", "l1", None)
    assert step.closest is not None
    assert step.closest[0] == "quadratic_damping"
    assert step.curve is not None
    # The curve over the speeds that were reached often: the link's straight damping and the cubic on top.
    x, value, _ = (np.array(column) for column in zip(*step.curve.points, strict=True))
    inner = np.abs(x) < 0.6 * step.curve.reached[1]
    true = 3.0 * x + 60.0 * x**3
    assert np.abs(value - true)[inner].max() < 0.05 * np.abs(true[inner]).max()
    assert diagnosis.shares[0][0] > 0.95


def test_what_a_user_tolerates_is_adequate() -> None:
    at = np.linspace(-1.5, 1.5, 41)
    law = laws.Curve(over="speed", at=tuple(at), values=tuple(2.0 * at**3))
    campaign, model = played(with_law(chain(), "l1", law), seed=SEED + 3), guessed(chain(), SEED + 3)
    assert diagnose(campaign, model, tolerance=0.2).verdict == "adequate"


def test_a_search_that_runs_out_of_time_says_so_and_names_nothing() -> None:
    deadline = Deadline()

    def over(text: str) -> None:
        if text.startswith("fitting ") and "(" in text:
            deadline.end()

    with deadline:
        diagnosis = found(carts(), rubbing(carts(), "wall", 0.8), SEED + 4, progress=over)
    assert (diagnosis.cut_short, diagnosis.verdict, diagnosis.steps) == (True, "unexplained", ())


@pytest.mark.study
@pytest.mark.parametrize("last", ["no form makes the model adequate", "damping_shape (l1): held-out error"])
def test_what_was_fitted_before_the_time_ended_is_the_answer(last: str) -> None:
    """Without a free shape a form may be merely the closest: the kind is named, which the equations of motion show."""

    deadline = Deadline()

    def over(text: str) -> None:
        if text.startswith(last):
            deadline.end()

    at = np.linspace(-1.5, 1.5, 41)
    law = laws.Curve(over="speed", at=tuple(at), values=tuple(60.0 * at**3))
    with deadline:
        diagnosis = found(chain(), with_law(chain(), "l1", law), SEED + 2, progress=over)
    assert diagnosis.cut_short
    assert [(step.cause, step.form) for step in diagnosis.steps] == [("damping_shape", None)]
    (drag,) = (c for c in diagnosis.considered if (c.cause, c.location) == ("quadratic_damping", "l1"))
    assert drag.share is not None
    assert drag.share > 0.8


def geared() -> RigModel:
    """A pushed mass that drives another one through a lever: their common motion does not strain it."""
    return RigModel(
        name="geared pair",
        bodies=(Body(name="motor", mass=1.2), Body(name="load", mass=3.0)),
        links=(
            Link(name="belt", a="motor", b="load", arms={"load": 0.5}, stiffness=5200.0, damping=4.0),
            Link(name="mount", a="load", stiffness=3400.0, damping=5.0),
        ),
        drive=Drive(channel="f", factor=1.0, pushes={"motor": 1.0}, quantity="force"),
        sensors=(Sensor(channel="a0", body="motor"), Sensor(channel="a1", body="load")),
        free=("links.belt.stiffness", "links.belt.damping", "links.mount.stiffness", "links.mount.damping"),
    )


def test_a_lever_shows_the_mass_that_it_drives_to_the_equation_of_both() -> None:
    given = geared().replace({"bodies.load.mass": 2.5})
    equations = equations_of(played(geared(), seed=SEED + 20, takes=TAKES[::2]), given)
    assert not equations.unscaled
    assert [name for name, left in equations.residuals().items() if left >= HOLDS] == ["motor + load"]


def test_a_mass_that_no_equation_tests_is_found_by_simulation() -> None:
    """With a strap of another ratio any motion strains one of both, and the load's equation holds with any value of its mass."""
    strap = Link(name="strap", a="motor", b="load", arms={"load": 0.2}, stiffness=900.0, damping=1.0)
    rig = replace(geared(), links=(*geared().links, strap))
    given = rig.replace({"bodies.load.mass": 2.5})
    campaign = played(rig, seed=SEED + 20, takes=TAKES[::2])
    assert equations_of(campaign, given).unscaled == {"load"}
    assert max(equations_of(campaign, given).residuals().values()) < HOLDS
    diagnosis = diagnose(campaign, given)
    assert named(diagnosis) == {("wrong_mass", "known_value", "load")}
    assert diagnosis.steps[0].parameters["mass"][0] == pytest.approx(3.0, rel=0.01)


@pytest.mark.parametrize(
    ("law", "place", "cause", "value"),
    [
        pytest.param(
            laws.EndStop(stroke=0.02, contact_stiffness=8e3, contact_damping=8.0, end=-1), "l1", "end_stop", "contact_stiffness",
            marks=pytest.mark.study,
        ),
        (laws.Backlash(clearance=1e-4, damped=0.0), "l1", "backlash", "clearance"),
    ],
)  # fmt: skip
def test_the_variant_of_a_form_is_found(law: laws.SpringLaw, place: str, cause: str, value: str) -> None:
    """A stop at one end only, and play within which nothing damps."""
    diagnosis = found(chain(), with_law(chain(), place, law), SEED + 14)
    (step,) = diagnosis.steps
    assert (diagnosis.verdict, step.cause, step.location) == ("explained", cause, place)
    assert step.parameters[value][0] == pytest.approx(getattr(law, value), rel=0.02)
    (fitted,) = diagnosis.extended.model.link(place).laws
    assert {name: getattr(fitted, name) for name in ("end", "damped") if hasattr(fitted, name)} == {
        name: getattr(law, name) for name in ("end", "damped") if hasattr(law, name)
    }


@pytest.mark.study
def test_a_damper_whose_force_bends_near_rest_is_no_dry_friction() -> None:
    """A digressive damper on an imposed motion: steep below 25 mm/s, flat above; the points of a friction lie closer there."""
    rate, draw = 250.0, np.random.default_rng(SEED + 9)
    runs = []
    for number, size in enumerate((0.4, 0.7, 1.0)):
        t = np.arange(round(12.0 * rate)) / rate
        stroke = sum(0.011 * size * np.sin(2.0 * np.pi * f * t + draw.uniform(0.0, 6.0)) / 3.0 for f in (0.6, 0.9, 1.3))
        speed = CubicSpline(t, stroke)(t, 1)
        knee = np.clip(speed, -0.025, 0.025)
        force = 6000.0 * stroke + 2000.0 * speed + np.where(knee > 0.0, 4000.0, 1500.0) * knee
        channels = {
            "s": Channel(name="s", samples=stroke, quantity="displacement", unit="m"),
            "F": Channel(name="F", samples=force + draw.normal(0.0, 0.5, len(t)), quantity="force", unit="N"),
        }
        runs.append(Run(id=f"r{number}", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels))
    rig = RigModel(
        name="damper", bodies=(Body(name="rod", mass=1e-6),),
        links=(Link(name="oil", a="rod", stiffness=5500.0, damping=3000.0),),
        drive=Drive(channel="s", quantity="displacement", factor=1.0, pushes={}, imposes="rod"),
        sensors=(Sensor(channel="F", quantity="force", force_in="drive.s"),),
        free=("links.oil.stiffness", "links.oil.damping"),
    )  # fmt: skip
    diagnosis = diagnose(Campaign(runs=tuple(runs), source="damper"), rig)
    assert diagnosis.verdict == "explained"
    assert [(step.kind, step.location) for step in diagnosis.steps] == [("damping_shape", "oil")]
