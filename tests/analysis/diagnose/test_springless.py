"""Rigs that no spring holds: heavy sides that turn, single pulls, and what their drive cannot judge."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import msgspec
import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, solve_ivp

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.diagnose.search import Job
from isorig.analysis.diagnose.suspects import MOST_TURNS, TURN, Suspects
from isorig.analysis.equations.forms import ElementForce
from isorig.analysis.equations.ranking import Explanation, Ranking
from isorig.analysis.equations.system import Equations
from isorig.analysis.fitting import by_drive, held_out
from isorig.analysis.fitting.plausible import doubts_of_records
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.score import signal_powers
from isorig.analysis.model.rig_model import Body, Configuration, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate.sampling import TAPS

SEED = 5200
RATE = 250.0


def turned(heavy_side: float) -> tuple[Campaign, RigModel]:
    """Two runs of a table that a motor turns slowly to and fro through two turns, by scipy; its heavy side in N m."""
    inertia, drag, runs = 0.02, 0.03, []
    for number, speeds in enumerate(((1.5, -0.8, 0.6, -1.4), (-1.1, 1.3, -0.5, 0.9))):
        t = np.arange(round(16.0 * RATE)) / RATE
        speed = np.repeat(speeds, len(t) // 4)
        wanted = np.convolve(np.pad(speed, 20, mode="edge"), np.hanning(41) / np.hanning(41).sum(), "valid")
        wanted *= np.minimum(t / 0.4, 1.0)
        angle = cumulative_trapezoid(wanted, dx=1.0 / RATE, initial=0.0)
        acceleration = np.gradient(wanted, 1.0 / RATE)
        torque = inertia * acceleration + drag * wanted + heavy_side * np.sin(angle + 0.7)
        draw = np.random.default_rng(SEED + number)
        channels = {
            "torque": Channel(
                name="torque", samples=torque + draw.normal(0.0, 1e-4, len(t)), quantity="torque", unit="N m"
            ),
            "angle": Channel(
                name="angle", samples=angle + draw.normal(0.0, 2e-4, len(t)), quantity="angle", unit="rad"
            ),
        }  # fmt: skip
        runs.append(
            Run(id=f"r{number}", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation="moves")
        )
    rig = RigModel(
        name="table", bodies=(Body(name="table", mass=0.018, motion="rotation"),),
        links=(Link(name="bearing", a="table", damping=0.036),),
        drive=Drive(channel="torque", factor=1.0, pushes={"table": 1.0}, quantity="torque"),
        sensors=(Sensor(channel="angle", body="table", quantity="angle"),),
        free=("bodies.table.mass", "links.bearing.damping"),
    )  # fmt: skip
    return Campaign(runs=tuple(runs), source="turned"), rig


def test_a_heavy_side_is_a_force_that_repeats_with_each_turn() -> None:
    found = diagnose(*turned(0.02))
    assert [(step.cause, step.location) for step in found.steps] == [("cogging", "bearing")]
    force, pitch = (found.steps[0].parameters[name][0] for name in ("periodic_force", "pitch"))
    assert force == pytest.approx(0.02, rel=0.05)
    assert pitch == pytest.approx(2.0 * np.pi, rel=0.05)


def pulled(
    friction: float, *, zero: float = 0.0, speed: float = 0.0, noise: float = 1.5e-4, seconds: float = 4.0
) -> tuple[Campaign, RigModel]:  # fmt: skip
    """A rack that a winch pulls once, by scipy, and that coasts to rest; a noisy position, measured from `zero` in m.

    It moves with `speed` in m/s at the start.
    """
    mass, drag, rate = 1.6, 1.1, 500.0
    t = np.arange(round(seconds * rate)) / rate

    def force(time: FloatArray | float) -> FloatArray:
        return np.asarray(5.0 * np.clip((np.asarray(time) - 0.4) / 0.2, 0.0, 1.0) * (np.asarray(time) < 1.6))

    def rates(time: float, y: FloatArray) -> list[float]:
        return [y[1], (float(force(time)) - drag * y[1] - friction * np.tanh(y[1] / 1e-4)) / mass]

    moved = solve_ivp(rates, (0.0, t[-1]), (0.0, speed), t_eval=t, method="LSODA", rtol=1e-9, atol=1e-12, max_step=0.02).y[0]
    draw = np.random.default_rng(SEED)
    channels = {
        "winch": Channel(name="winch", samples=force(t) + draw.normal(0.0, 5e-3, len(t)), quantity="force", unit="N"),
        "pos": Channel(name="pos", samples=moved + zero + draw.normal(0.0, noise, len(t)), quantity="displacement", unit="m"),
    }
    rig = RigModel(
        name="rack", bodies=(Body(name="rack", mass=1.8),), links=(Link(name="slide", a="rack", damping=0.95),),
        drive=Drive(channel="winch", factor=1.0, pushes={"rack": 1.0}, quantity="force"),
        sensors=(Sensor(channel="pos", body="rack", quantity="displacement"),),
        free=("bodies.rack.mass", "links.slide.damping"),
    )  # fmt: skip
    return Campaign(
        runs=(Run(id="r1", configuration="unlocked", sample_rate=rate, gain=1.0, channels=channels, excitation="moves"),),
        source="pull",
    ), rig


def test_the_friction_of_a_rack_that_is_pulled_once_follows_from_its_course() -> None:
    """The noise of the position hides its acceleration, not where the rack stops."""
    found = diagnose(*pulled(0.4))
    assert [(step.cause, step.location) for step in found.steps] == [("coulomb_friction", "slide")]
    assert found.steps[0].parameters["friction_force"][0] == pytest.approx(0.4, rel=0.03)
    assert diagnose(*pulled(0.0)).verdict == "adequate"


@pytest.mark.parametrize("seconds", [4.0, 7.0])
def test_a_drive_that_rests_while_a_rack_coasts_judges_it(seconds: float) -> None:
    """However long the rack stands afterwards; an accurate position, so that the drive judges."""
    campaign, rig = pulled(0.4, noise=5e-6, seconds=seconds)
    (trial,) = prepare(campaign, rig)
    assert trial.motion is not None
    end = trial.fitted / trial.sample_rate
    assert 1.0 < end < 2.5  # most of the motion, not the end of it, which comes at 2.9 s
    assert signal_powers([trial])[0, 0] == pytest.approx(np.mean(trial.measured**2))
    found = diagnose(campaign, rig)
    assert [(step.cause, step.location) for step in found.steps] == [("coulomb_friction", "slide")]
    assert found.steps[0].parameters["friction_force"][0] == pytest.approx(0.4, rel=0.1)


def run_down(speeds: tuple[float, float], friction: float = 4e-3) -> tuple[Campaign, RigModel]:
    """A rotor that runs down from 60 and from 35 rad/s, in closed form; its described speeds, and its friction in N m."""
    inertia, drag, rate, runs = 0.018, 8e-4, 200.0, []
    t = np.arange(round(20.0 * rate)) / rate
    for name, begun in (("fast", 60.0), ("slow", 35.0)):
        rest = friction / drag
        speed = np.maximum((begun + rest) * np.exp(-drag / inertia * t) - rest, 0.0)
        counted = 0.06 * np.round(speed / 0.06)
        channels = {
            "torque": Channel(name="torque", samples=np.zeros(len(t)), quantity="torque", unit="N m"),
            "speed": Channel(name="speed", samples=counted, quantity="angular_velocity", unit="rad/s"),
        }
        runs.append(Run(id=name, configuration=name, sample_rate=rate, gain=1.0, channels=channels, excitation="free"))
    rig = RigModel(
        name="rotor", bodies=(Body(name="rotor", mass=inertia, motion="rotation"),),
        links=(Link(name="bearing", a="rotor", damping=9e-4),),
        drive=Drive(channel="torque", factor=1.0, pushes={"rotor": 1.0}, quantity="torque"),
        sensors=(Sensor(channel="speed", body="rotor", quantity="angular_velocity"),),
        configurations={
            "unlocked": Configuration(), "fast": Configuration(initial_velocity={"rotor": speeds[0]}),
            "slow": Configuration(initial_velocity={"rotor": speeds[1]}),
        },
        free=("links.bearing.damping",),
    )  # fmt: skip
    return Campaign(runs=tuple(runs), source="run-down"), rig


def test_a_run_down_begins_at_the_recorded_speed() -> None:
    """Its described one is a few per cent off, and no spring brings the rotor back."""
    campaign, rig = run_down((63.0, 34.0))
    for trial, speed in zip(prepare(campaign, rig), (60.0, 35.0), strict=True):
        assert trial.moving is not None
        assert trial.moving.measured.shape[1] == TAPS + 200  # a twentieth of the run
        ((_, found),) = trial.moving.state(rig, trial.excitation).values()
        assert found == pytest.approx(speed, rel=0.005)
    found = diagnose(campaign, rig)
    assert [(step.cause, step.location) for step in found.steps] == [("coulomb_friction", "bearing")]
    assert found.steps[0].parameters["friction_force"][0] == pytest.approx(4e-3, rel=0.02)


@pytest.mark.parametrize(("zero", "judged"), [(0.0, False), (0.3, True)])
def test_a_run_is_simulated_where_a_noisy_motion_begins_at_rest_at_zero(zero: float, judged: bool) -> None:
    (trial,) = prepare(*pulled(0.4, zero=zero))
    assert (trial.motion is not None) is judged


@pytest.mark.parametrize(("share", "judged"), [(0.8, False), (1.2, True)])
def test_a_motion_of_a_hundredth_of_the_largest_is_rest(share: float, judged: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the largest motion in a tenth of a second."""
    monkeypatch.setattr(by_drive, "HARDLY", 0.0)
    (run,) = pulled(0.0)[0].runs
    course, first = run.read("pos"), round(by_drive.AT_REST * run.sample_rate)
    limit = held_out.CALM * float(np.abs(course[first:] - course[:-first]).max()) / by_drive.AT_REST
    (trial,) = prepare(*pulled(0.0, speed=share * limit, noise=1e-5))
    assert (trial.motion is not None) is judged


@pytest.mark.parametrize(("ratio", "judged"), [(0.99, True), (1.01, False)])
def test_the_drive_judges_up_to_a_limit_of_the_noise(ratio: float, judged: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    shares = np.array([ratio * by_drive.HARDLY]), np.array([0.5])
    monkeypatch.setattr(by_drive, "_shares_of_groups", lambda model, motions: shares)
    (trial,) = prepare(*pulled(0.4))
    assert (trial.motion is not None) is judged


def test_a_rack_that_ends_elsewhere_has_no_wrong_unit() -> None:
    campaign, rig = pulled(0.4)
    assert doubts_of_records(rig, campaign) == ()
    run = campaign.runs[0]
    wrong = replace(run.channel("pos"), samples=1e3 * run.read("pos"))
    doubted = replace(campaign, runs=(replace(run, channels={**run.channels, "pos": wrong}),))
    assert [doubt.kind for doubt in doubts_of_records(rig, doubted)] == ["unit"]


@pytest.mark.parametrize("judged", [True, False])
def test_a_drive_judges_no_body_without_a_record(judged: bool) -> None:
    campaign, rig = pulled(0.4)
    (trial,) = prepare(campaign, rig)
    job = SimpleNamespace(current=SimpleNamespace(model=rig), trials=(replace(trial, motion=object() if judged else None),))
    attached = (*rig.links, Link(name="rack_added", a="rack_added", b="rack", stiffness=10.0))
    more = msgspec.structs.replace(rig, bodies=(*rig.bodies, Body(name="rack_added", mass=0.1)), links=attached)
    candidates = [SimpleNamespace(starts=(model,)) for model in (rig, more)]
    assert [Job.judges(job, one) for one in candidates] == [True, not judged]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("turns", "stiffness", "pitch"), [(0.99 * MOST_TURNS, 0.0, TURN), (1.01 * MOST_TURNS, 0.0, None), (1.0, 5.0, None)]
)
def test_a_turn_is_a_pitch_where_a_curve_over_the_angle_has_points_for_it(
    turns: float, stiffness: float, pitch: float | None
) -> None:
    """Of a body that no spring holds."""
    what = "force over deflection"
    item = Explanation(kind="spring_shape", place="bearing", what=what, score=1.0, residuals={}, values={})
    rig = msgspec.structs.replace(turned(0.02)[1], links=(Link(name="bearing", a="table", damping=0.04, stiffness=stiffness),))
    element = SimpleNamespace(names={"bearing"}, link=rig.link("bearing"))
    equations = SimpleNamespace(elements=lambda: [element], model=rig)
    found = Suspects(ranking=cast("Ranking", None), chosen=(item,), places={}, equations=cast("Equations", equations))
    found._values[item] = {}, cast("ElementForce", SimpleNamespace(deflection=np.array([0.0, turns * TURN])))
    assert found._pitch(item) == pitch


def test_a_short_pull_is_prepared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its drive has fewer samples than a run has blocks, and a body at rest must not move for longer than the record."""
    monkeypatch.setattr(by_drive, "HARDLY", np.inf)
    campaign, rig = pulled(0.4)
    (run,) = campaign.runs
    cut = {name: replace(one, samples=one.read()[: round(run.sample_rate)]) for name, one in run.channels.items()}
    short = replace(campaign, runs=(replace(run, channels=cut),))
    (trial,) = prepare(short, rig)
    assert trial.motion is not None
    assert trial.fitted == round(held_out.FIT_SHARE * trial.samples)
    monkeypatch.setattr(by_drive, "HARDLY", 0.0)
    monkeypatch.setattr(by_drive, "AT_REST", 2.0)
    (trial,) = prepare(short, rig)
    assert trial.motion is None
