"""A motor turns an inertia slowly through a stiff shaft: encoders show the whole motion, and hardly any twist.

The rigs are integrated here, not by the engine, and described up to a fifth off. A drawn force is hidden in a bearing.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from linear_motion import moved
from scipy.signal import butter, lfilter, sosfiltfilt

import isorig as iso
from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.diagnose.observe import observe, swings
from isorig.analysis.diagnose.suspects import SHOWN
from isorig.analysis.equations.ranking import ranking
from isorig.analysis.equations.system import HOLDS, equations_of
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.residuals import Problem
from isorig.analysis.laws import Coulomb
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.rounding import IS_ROUNDING, is_rounded, sensor_noise
from isorig.analysis.simulate.inverse import required_drive
from isorig.rig.cli import main
from isorig.rig.files.rigfile import description_text

#: kg m^2 of both, shaft in N m/rad and N m s/rad, both bearings in N m s/rad; with the described values of the free ones.
MOTOR, LOAD, SHAFT, DAMPING, BEARINGS = 0.006, 0.04, 250.0, 0.1, (0.015, 0.03)
DESCRIBED = {"load": 0.047, "shaft": 210.0, "damping": 0.12, "motor_bearing": 0.018, "load_bearing": 0.025}
#: Steps of the integration and of the record per second, seconds of a run, and counts of a turn.
FINE, RATE, SECONDS, COUNTS = 10_000, 200, 15, 10_000
RIG = RigModel(
    name="motor and inertia",
    bodies=(
        Body(name="motor", mass=MOTOR, motion="rotation"),
        Body(name="load", mass=DESCRIBED["load"], motion="rotation"),
    ),
    drive=Drive(channel="torque", factor=1.0, pushes={"motor": 1.0}, quantity="torque"),
    links=(
        Link(name="shaft", a="motor", b="load", stiffness=DESCRIBED["shaft"], damping=DESCRIBED["damping"]),
        Link(name="motor_bearing", a="motor", b="ground", damping=DESCRIBED["motor_bearing"]),
        Link(name="load_bearing", a="load", b="ground", damping=DESCRIBED["load_bearing"]),
    ),
    sensors=tuple(Sensor(channel=f"{body}_angle", body=body, quantity="angle") for body in ("motor", "load")),
    free=(
        "bodies.load.mass", "links.shaft.stiffness", "links.shaft.damping", "links.motor_bearing.damping",
        "links.load_bearing.damping",
    ),
)  # fmt: skip


def turned(
    draw: np.random.Generator, hidden: Callable[[float, float], float], seconds: int
) -> tuple[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Torque and both angles of a run: a controller turns the motor at drawn speeds, against a force of its angle and speed."""
    steps, h = seconds * FINE, 1.0 / FINE
    knots = np.cumsum(draw.uniform(0.4, 2.0, 40))
    reference = np.interp(np.arange(steps) * h, knots, np.repeat(draw.uniform(-2.5, 2.5, 20), 2)).tolist()
    gain = 6.0 * (MOTOR + LOAD)
    angle = speed = other = rate = integral = 0.0
    torque, motor, load = np.empty(steps), np.empty(steps), np.empty(steps)
    for k in range(steps):
        error = reference[k] - speed
        integral += 3.0 * gain * error * h
        push = gain * error + integral
        twist = SHAFT * (angle - other) + DAMPING * (speed - rate)
        speed += h * (push - twist - BEARINGS[0] * speed - hidden(angle, speed)) / MOTOR
        rate += h * (twist - BEARINGS[1] * rate) / LOAD
        angle, other = angle + h * speed, other + h * rate
        torque[k], motor[k], load[k] = push, angle, other
    return torque, motor, load


def campaign(seed: int, hidden: Callable[[float, float], float], *, tachometer: bool = False) -> Campaign:
    """Two runs: a filtered torque with noise, and counted angles, or of the load a speed with noise, for twice as long."""
    draw = np.random.default_rng(seed)
    sections = butter(6, 0.4 * RATE, fs=FINE, output="sos")
    runs = []
    for k in range(2):
        torque, *angles = turned(draw, hidden, 2 * SECONDS if tachometer else SECONDS)
        torque = sosfiltfilt(sections, torque)[:: FINE // RATE]
        torque = torque + draw.normal(0.0, 0.003 * torque.std(), len(torque))
        channels = {"torque": Channel(name="torque", samples=torque, quantity="torque", unit="N m")}
        for name, values in zip(("motor_angle", "load_angle"), angles, strict=True):
            count = 2.0 * np.pi / COUNTS
            counted = np.round(values[:: FINE // RATE] / count) * count
            channels[name] = Channel(name=name, samples=counted, quantity="angle", unit="rad")
        if tachometer:
            speed = np.gradient(channels.pop("load_angle").read(), 1.0 / RATE)
            speed += draw.normal(0.002, 0.01, len(speed))
            channels["load_speed"] = Channel(name="load_speed", samples=speed, quantity="angular_velocity", unit="rad/s")
        runs.append(
            Run(
                id=f"r{k}", configuration="unlocked", sample_rate=float(RATE), gain=1.0, channels=channels, excitation="moves"
            )
        )  # fmt: skip
    return Campaign(runs=tuple(runs), source="slow rotations")


def diagnosed(found: Campaign, folder: Path) -> dict[str, Any]:
    """What `rig diagnose` writes of a campaign with this rig's description."""
    iso.write(folder / "a.h5", replace(found, description=description_text(RIG, {})))
    assert main(["diagnose", str(folder / "a.h5"), "-o", str(folder / "d")]) == 0
    answer: dict[str, Any] = json.loads((folder / "d" / "findings.json").read_text())
    return answer


@pytest.fixture(scope="module")
def sound() -> Campaign:
    """A campaign without a hidden force."""
    return campaign(1, lambda angle, speed: 0.0)


def test_a_sound_rig_is_adequate_and_its_inertia_found(sound: Campaign, tmp_path: Path) -> None:
    answer = diagnosed(sound, tmp_path)
    assert answer["verdict"] == "adequate"
    load = iso.read_rig(tmp_path / "d" / "model.json").model.body("load")
    assert load.mass == pytest.approx(LOAD, rel=0.01)


def test_a_hidden_cogging_is_named(tmp_path: Path) -> None:
    answer = diagnosed(campaign(2, lambda angle, speed: 0.02 * np.sin(16.0 * angle)), tmp_path)
    (step,) = answer["steps"]
    assert answer["verdict"] == "explained"
    assert step["cause"] == "cogging"
    assert step["location"] in ("motor_bearing", "load_bearing")  # the shaft hardly twists
    pitch = step["parameters"]["pitch"]
    assert pitch["value"] == pytest.approx(2.0 * np.pi / 16.0, abs=3.0 * pitch["std"])
    assert step["parameters"]["periodic_force"]["value"] == pytest.approx(0.02, rel=0.05)


@pytest.mark.study
def test_a_hidden_friction_is_named(tmp_path: Path) -> None:
    answer = diagnosed(campaign(6, lambda angle, speed: 0.05 * np.tanh(speed / 1e-3)), tmp_path)
    assert answer["verdict"] in ("explained", "partly explained")
    assert answer["steps"][0]["kind"] == "friction_shape"
    assert {item["channel"] for item in answer["discrepancies"]} <= {"torque"}
    assert set(answer["budget"]["baseline"]["by_channel"]) == {"torque"}
    assert answer["steps"][0]["location"] in ("motor_bearing", "load_bearing")


@pytest.mark.study
def test_friction_and_cogging_are_both_named(tmp_path: Path) -> None:
    """Beside friction the cogging is the only further cause that the equations show, and no doubt about the drive's unit."""
    answer = diagnosed(campaign(4, lambda angle, speed: 0.05 * np.tanh(speed / 1e-3) + 0.03 * np.sin(9.0 * angle)), tmp_path)
    assert not answer["doubts"]
    assert {step["cause"] for step in answer["steps"]} >= {"coulomb_friction", "cogging"}
    step = next(step for step in answer["steps"] if step["cause"] == "cogging")
    assert step["parameters"]["pitch"]["value"] == pytest.approx(2.0 * np.pi / 9.0, rel=0.01)
    assert step["parameters"]["periodic_force"]["value"] == pytest.approx(0.03, rel=0.1)


#: The rig with a tachometer at the load, and known friction in the motor's bearing.
WITH_TACHOMETER = msgspec.structs.replace(
    RIG,
    sensors=(RIG.sensors[0], Sensor(channel="load_speed", body="load", quantity="angular_velocity")),
    contacts=(Contact(name="motor_bearing", a="motor", b="ground", law=Coulomb(friction_force=0.025)),),
    free=(*RIG.free, "contacts.motor_bearing.law.friction_force"),
)


def test_the_slow_part_of_a_twist_between_an_angle_and_an_integrated_speed_is_unknown() -> None:
    """The tachometer's noise and zero integrate to more than the twist, and counts are as large: that breaks no equation."""
    found = campaign(4, lambda angle, speed: 0.02 * np.tanh(speed / 1e-3), tachometer=True)
    equations = equations_of(found, WITH_TACHOMETER)
    assert max(equations.residuals().values()) < HOLDS


def test_friction_that_falls_with_velocity_shows_near_reversals() -> None:
    found = campaign(5, lambda angle, speed: (0.02 + 0.05 * np.exp(-abs(speed) / 0.2)) * np.tanh(speed / 1e-3), tachometer=True)
    best = ranking(equations_of(found, WITH_TACHOMETER)).explanations[0]
    assert (best.what, best.place) == ("friction over velocity", "motor_bearing")
    assert best.score > SHOWN


def test_an_attached_body_has_no_recorded_motion(sound: Campaign) -> None:
    trials = prepare(sound, RIG)
    attached = msgspec.structs.replace(
        RIG,
        bodies=(*RIG.bodies, Body(name="motor_added", mass=1e-3, motion="rotation")),
        links=(*RIG.links, Link(name="motor_added", a="motor_added", b="motor", stiffness=5.0)),
    )
    deflection, speed = swings(attached, trials)
    assert all(np.isfinite([*deflection.values(), *speed.values()]))
    assert {"motor_added", "shaft"} <= set(deflection)


def test_a_rig_that_is_judged_by_its_drive_is_not_simulated_however_stiff_it_is(sound: Campaign) -> None:
    """A fit may therefore pass values at which a simulation would need too many parts a step."""
    problem = Problem(prepare(sound, RIG))
    assert problem.parts_of_step(RIG.replace({"links.shaft.damping": 1e9})) == 1


def test_the_drive_follows_from_the_quietest_group_of_bodies(sound: Campaign) -> None:
    """A stiff shaft makes a large torque of the encoders' noise, so the motor alone shows nothing."""
    found = replace(sound, description=description_text(RIG, {}))
    (one, _) = prepare(found, RIG)
    assert one.motion is not None
    assert one.motion.groups == (("motor", "load"),)
    assert one.channels == ("torque",)
    soft = RIG.replace({"links.shaft.stiffness": 2.0, "links.shaft.damping": 0.0})
    both, _ = prepare(found, soft)
    assert both.channels == ("torque", "torque of motor + load")
    assert both.unit_of("torque of motor + load") == "N m"
    assert both.recorded("torque of motor + load") == "torque"


#: kg m^2 of both, N m/rad and N m s/rad of a shaft that twists by some counts, and bearings, as described; counts of a turn.
SOFT = msgspec.structs.replace(
    RIG,
    bodies=(Body(name="motor", mass=0.012, motion="rotation"), Body(name="load", mass=0.0085, motion="rotation")),
    links=(
        Link(name="shaft", a="load", b="motor", stiffness=160.0, damping=0.032),
        Link(name="motor_bearing", a="motor", b="ground", damping=0.0175),
        Link(name="load_bearing", a="load", b="ground", damping=0.0105),
    ),
)
TRUE = {"bodies.load.mass": 0.01, "links.shaft.stiffness": 173.0, "links.shaft.damping": 0.048}


def coasting(seed: int, *, rest: int) -> Campaign:
    """Three runs of 20 s of smoothed torque steps without any effect, the last `rest` seconds of which the rig coasts to rest."""
    rate, finer, seconds = 1000, 10, 20
    draw, model = np.random.default_rng(seed), SOFT.replace(TRUE)
    masses = np.array([model.body(name).mass for name in ("motor", "load")])
    k, c = model.links[0].stiffness, model.links[0].damping
    apart = np.array([[1.0, -1.0], [-1.0, 1.0]])
    lost = np.diag([link.damping for link in model.links[1:]]) + c * apart
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-k * apart / masses[:, None], -lost / masses[:, None]]])
    runs = []
    for each in range(3):
        at = np.cumsum(draw.uniform(0.1, 0.6, 80))
        time = np.arange(seconds * rate * finer) / (rate * finer)
        torque = draw.uniform(-1.0, 1.0, 81)[np.searchsorted(at, time)] * (time < seconds - rest)
        for _ in range(2):
            torque = lfilter([0.025], [1.0, -0.975], torque)
        force = np.array([0.0, 0.0, 1.0 / masses[0], 0.0])[:, None]
        angles = moved(system, force, torque[None], 1.0 / (rate * finer))[:2]
        count = 2.0 * np.pi / 8192
        recorded = torque[::finer] + draw.normal(0.0, 0.001, seconds * rate)
        channels = {"torque": Channel(name="torque", samples=recorded, quantity="torque", unit="N m")}
        for name, values in zip(("motor_angle", "load_angle"), angles, strict=True):
            channels[name] = Channel(name=name, samples=np.round(values[::finer] / count) * count, quantity="angle", unit="rad")
        runs.append(
            Run(
                id=f"r{each}", configuration="unlocked", sample_rate=float(rate), gain=1.0, channels=channels,
                excitation="moves",
            )
        )  # fmt: skip
    return Campaign(runs=tuple(runs), source="a drive that coasts to rest")


def test_noise_does_not_determine_the_coefficients_of_an_equation() -> None:
    """The shaft's own equation is a combination of the columns of that of both bodies: only noise would determine its share."""
    assert max(equations_of(coasting(6, rest=6), SOFT).residuals().values()) < 1.2


def test_bearings_without_a_spring_give_no_columns_of_their_angles() -> None:
    """The difference of both angles is the twist: it would stand for the force of the load's own equation."""
    campaign, paths = coasting(6, rest=6), ("links.motor_bearing.stiffness",)
    for free, columns in ((SOFT.free, 0), ((*SOFT.free, *paths), 1)):
        equations = equations_of(campaign, msgspec.structs.replace(SOFT, free=free))
        (_, _, *bearings), _ = equations.rows(equations.balance_of("motor + load"))
        assert [len(row) for row in bearings] == [1, columns, 1, 0]  # damping and stiffness of each


def test_counts_of_a_motion_that_comes_to_rest_break_no_model() -> None:
    """Rounding of a slow motion makes steps, whose spectrum is low and not white."""
    found = iso.diagnose(coasting(7, rest=6), SOFT)
    assert found.verdict == "adequate"


def test_the_noise_of_counts_has_the_spectrum_of_their_rounding() -> None:
    """At rest there is none, and a slow motion has more of it at low frequencies than white noise of the same power."""
    draw = np.random.default_rng(8)
    motion = 40.0 * np.sin(2.0 * np.pi * 0.1 * np.arange(20_000) / 1000) * (np.arange(20_000) > 8000)
    counted = np.round(motion)
    noise = sensor_noise(counted, 1.0 / np.sqrt(12.0), draw)
    assert np.ptp(noise[:7990]) == 0.0

    def low(values: FloatArray) -> float:
        power = np.abs(np.fft.rfft(values[8100:] * np.hanning(11_900))) ** 2
        return float(power[np.fft.rfftfreq(11_900, 1e-3) < 60.0].sum())

    error = counted - motion
    assert low(noise) == pytest.approx(low(error), rel=0.3)
    assert low(noise) > 4.0 * low(draw.normal(0.0, error.std(), 20_000))
    rounded = np.sqrt(1.0 / 12.0)
    assert is_rounded(counted, 0.99 * IS_ROUNDING * rounded)
    assert not is_rounded(counted, 1.01 * IS_ROUNDING * rounded)
    assert sensor_noise(motion, 0.01, draw).std() == pytest.approx(0.01, rel=0.05)


def test_a_gear_of_ratio_one_to_twenty_is_the_same_rig() -> None:
    """An arm makes the shaft's twist motor - 20 load, and the load then counts with a twentieth of its own torque."""
    ratio, plain = 20.0, coasting(9, rest=6)
    shaft, motor_bearing, load_bearing = SOFT.links
    replaced = msgspec.structs.replace
    geared = replaced(
        SOFT,
        bodies=(SOFT.bodies[0], replaced(SOFT.bodies[1], mass=SOFT.bodies[1].mass * ratio**2)),
        links=(
            replaced(shaft, a="motor", b="load", arms={"load": 1.0 - ratio}),
            motor_bearing,
            replaced(load_bearing, damping=load_bearing.damping * ratio**2),
        ),
    )
    slowed = replace(plain, runs=tuple(
        replace(run, channels={**run.channels, "load_angle": replace(
            run.channels["load_angle"], samples=run.channels["load_angle"].read() / ratio)})
        for run in plain.runs
    ))  # fmt: skip
    # The same twist, motor - 20 load, of a shaft that is described as one to the ground.
    to_ground = replaced(geared, links=(replaced(shaft, a="motor", b="ground", arms={"load": -ratio}), *geared.links[1:]))
    of_plain, *of_geared = (
        equations_of(*pair).residuals() for pair in ((plain, SOFT), (slowed, geared), (slowed, to_ground))
    )  # fmt: skip
    for each in of_geared:
        assert each == pytest.approx(of_plain, rel=0.05)
    drives = [prepare(found, model)[0] for found, model in ((plain, SOFT), (slowed, geared))]
    needed = [required_drive(model, trial.motion) for trial, model in zip(drives, (SOFT, geared), strict=True) if trial.motion]
    assert needed[1] == pytest.approx(needed[0], abs=1e-6 * np.abs(needed[0]).max())
    assert observe(slowed, geared, prepare(slowed, geared), geared, geared).deflection["shaft"] < 0.1
