"""Rigs that are moved step by step or by a displacement, as a laboratory records them, simulated by scipy with one hidden cause.

Carts with encoders behind a force held from sample to sample that acts late, with and without dry friction, or pulled and
released; a floor with a stop at one end; and a damper whose stroke is imposed and whose force is the response.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import isorig as iso
from isorig.analysis.campaign import SI_UNIT, Campaign, Channel, FloatArray, Quantity, Run
from isorig.analysis.model.rig_model import from_tree
from isorig.rig.cli import main
from isorig.rig.files.rigfile import description_text

#: Rate of the carts' records in Hz, their encoder's step in m, and the force in N of each run.
RATE, COUNT, LEVELS = 400.0, 2.27e-5, (4.0, 7.0, 5.5)
#: Rate of the records of a released cart in Hz.
RELEASED_RATE = 250.0
#: Masses in kg, springs in N/m and dampers in N s/m of the carts, from the ground on.
MASSES, SPRINGS, DAMPERS = (0.8, 0.6), (480.0, 390.0), (2.2, 1.6)
#: Rate of the damper's records in Hz, its damping in N s/m, and amplitude (m) and frequency (Hz) of each run.
FAST, OIL, STROKES = 500.0, 900.0, ((0.01, 1.0), (0.006, 2.0))

#: Mass in kg, spring in N/m and damper in N s/m of the single cart, and its dry friction in N.
MASS, SPRING, DAMPER, DRY = 1.7, 520.0, 2.4, 0.9
#: Stiffness of its stop in N/m.
STOP = 2.0e4
#: The same of the floor, and its stop in m and N/m.
FLOOR, STRUT, FILM, GAP, BUMPER = 5.2, 9.0e4, 25.0, 4.0e-4, 3.2e5
#: Steps of its simulation from sample to sample.
STEPS = 16


def command(time: FloatArray, level: float) -> FloatArray:
    """Forward, back to zero, backward and zero again, two seconds each, from half a second on."""
    part = np.floor((time - 0.5) / 2.0).astype(int)
    return np.where(time < 0.5, 0.0, level * np.array([1.0, 0.0, -1.0, 0.0])[part % 4])


def run(name: str, rate: float, level: float, channels: Mapping[str, tuple[Quantity, FloatArray]]) -> Run:
    """A run of these channels."""
    made = {key: Channel(name=key, samples=values, quantity=what, unit=SI_UNIT[what]) for key, (what, values) in channels.items()}
    return Run(id=name, configuration="normal", sample_rate=rate, gain=level, channels=made, excitation="steps")


def carts(late: float, seed: int) -> tuple[list[Run], dict[str, Any]]:
    """Two carts whose drive acts `late` seconds after its command, and their description with springs and dampers off."""
    draw, time, runs = np.random.default_rng(seed), np.arange(int(8 * RATE)) / RATE, []
    for k, level in enumerate(LEVELS):

        def slope(t: float, y: FloatArray, level: float = level) -> Sequence[float]:
            x, v = y[:2], y[2:]
            push = command(np.array([t - late]), level)[0]
            first = SPRINGS[0] * x[0] + DAMPERS[0] * v[0]
            second = SPRINGS[1] * (x[1] - x[0]) + DAMPERS[1] * (v[1] - v[0])
            return [v[0], v[1], (push - first + second) / MASSES[0], -second / MASSES[1]]

        found = solve_ivp(slope, (0.0, time[-1]), np.zeros(4), t_eval=time, method="LSODA", rtol=1e-7, atol=1e-10, max_step=2e-3)
        counted = np.round(found.y[:2] / COUNT + draw.normal(0.0, 0.05, (2, len(time)))) * COUNT
        runs.append(run(f"r{k}", RATE, level, {"motor": ("force", command(time, level)), "x1": ("displacement", counted[0]),
                                               "x2": ("displacement", counted[1])}))  # fmt: skip
    off = (1.0 + 0.2 * draw.uniform(-1.0, 1.0, 4)).tolist()
    tree = {
        "name": "two carts", "bodies": [{"name": "cart1", "mass": MASSES[0]}, {"name": "cart2", "mass": MASSES[1]}],
        "links": [
            {"name": "spring1", "a": "cart1", "b": "ground", "stiffness": SPRINGS[0] * off[0], "damping": DAMPERS[0] * off[1]},
            {"name": "spring2", "a": "cart2", "b": "cart1", "stiffness": SPRINGS[1] * off[2], "damping": DAMPERS[1] * off[3]},
        ],
        "drive": {"channel": "motor", "quantity": "force", "pushes": {"cart1": 1.0}},
        "sensors": [{"channel": f"x{k}", "body": f"cart{k}", "quantity": "displacement"} for k in (1, 2)],
        "free": [f"links.spring{k}.{key}" for k in (1, 2) for key in ("stiffness", "damping")],
    }  # fmt: skip
    return runs, tree


def rubbed(time: FloatArray, push: Callable[[float], float], changes: Sequence[float], start: float) -> FloatArray:
    """Displacement of the single cart with dry friction under a force that is constant between changes."""
    found, y = np.zeros(len(time)), np.array([start, 0.0])

    def turns(_: float, y: FloatArray) -> float:
        return float(y[1])

    turns.terminal = True  # type: ignore[attr-defined]
    for begin, end in pairwise([0.0, *changes, float(time[-1])]):
        now, force = begin, push(0.5 * (begin + end))
        while now < end:
            pull = force - SPRING * y[0]
            if y[1] == 0.0 and abs(pull) <= DRY:
                found[time >= now] = y[0]
                break
            way = np.sign(y[1] or pull)
            y[1] += 1e-9 * way
            turns.direction = -way  # type: ignore[attr-defined]

            def slope(_: float, y: FloatArray, force: float = force, way: float = way) -> Sequence[float]:
                return [y[1], (force - SPRING * y[0] - DAMPER * y[1] - DRY * way) / MASS]

            solved = solve_ivp(slope, (now, end), y, events=turns, dense_output=True, rtol=1e-9, atol=1e-12)
            inside = (time >= now) & (time <= solved.t[-1])
            found[inside], now, y = solved.sol(time[inside])[0], float(solved.t[-1]), solved.y[:, -1]
            y[1] = 0.0 if solved.status == 1 else y[1]
    return found


def cart_tree(
    drive: str, off: Sequence[float], configurations: Mapping[str, Any], free: Sequence[str] = ()
) -> dict[str, Any]:  # fmt: skip
    """The description of the single cart, whose spring and damper are off by these factors, with further free parameters."""
    return {
        "name": "cart", "bodies": [{"name": "cart", "mass": MASS}],
        "links": [{"name": "spring", "a": "cart", "b": "ground", "stiffness": SPRING * off[0], "damping": DAMPER * off[1]}],
        "drive": {"channel": drive, "quantity": "force", "pushes": {"cart": 1.0}},
        "sensors": [{"channel": "x", "body": "cart", "quantity": "displacement"}],
        "free": ["links.spring.stiffness", "links.spring.damping", *free], "configurations": configurations,
    }  # fmt: skip


def cart(late: float, seed: int, start: float = 0.0) -> tuple[list[Run], dict[str, Any]]:
    """A cart with dry friction behind a late drive, or released from `start`, and its description with spring and damper off."""
    draw, time, runs = np.random.default_rng(seed), np.arange(int((4 if start else 9) * RATE)) / RATE, []
    for k, level in enumerate((0.0,) if start else LEVELS):
        changes = [0.5 + 2.0 * j + late for j in range(5)]
        x = rubbed(time, lambda t, level=level: float(command(np.array([t - late]), level)[0]), changes, start)  # type: ignore[misc]
        counted = np.round(x / COUNT + draw.normal(0.0, 0.05, len(time))) * COUNT
        runs.append(run(f"r{k}", RATE, level, {"motor": ("force", command(time, level)), "x": ("displacement", counted)}))
    off = (1.0 + 0.2 * draw.uniform(-1.0, 1.0, 2)).tolist()
    released = {"initial_position": {"cart": 0.95 * start}} if start else {}
    free = [f"configurations.normal.{key}.cart" for key in released]
    return runs, cart_tree("motor", off, {"normal": released}, free)


def staircase(time: FloatArray, level: float, draw: np.random.Generator) -> FloatArray:
    """25 random levels."""
    return level * np.repeat(draw.uniform(-1.0, 1.0, 25), len(time) // 25)


def sweep(time: FloatArray, level: float, draw: np.random.Generator) -> FloatArray:
    """From 0.3 to 8.3 Hz, larger than a staircase."""
    return 2.0 * level * np.sin(2.0 * np.pi * (0.3 * time + 4.0 * time**2 / time[-1]))


def axis(
    spring: float, late: float, dry: float, sensor: Quantity, seed: int, *, gap: float = np.inf, gain: float = 1.0,
    drive: Callable[[FloatArray, float, np.random.Generator], FloatArray] = staircase,
) -> tuple[list[Run], dict[str, Any]]:  # fmt: skip
    """A mass behind a drive that acts late, recorded by one sensor with a gain; its spring, if any, may have a stop."""
    draw, samples, fine, runs = np.random.default_rng(seed), int(10 * RATE), 40, []
    step, time = 1.0 / (RATE * fine), np.arange(samples) / RATE
    for k, level in enumerate(LEVELS):
        push = drive(time, level, draw)
        delayed = np.roll(np.repeat(push, fine), round(late / step))
        delayed[: round(late / step)] = 0.0
        x, v, moved = 0.0, 0.0, np.zeros((2, samples))
        for j, force in enumerate(delayed.tolist()):
            if j % fine == 0:
                moved[:, j // fine] = x, v
            pull = spring * x + DAMPER * v + STOP * max(x - gap, 0.0)
            ahead = v + step * (force - pull) / MASS
            v = ahead - min(max(ahead, -step * dry / MASS), step * dry / MASS)  # dry friction stops it, and does not turn it
            x += step * v
        noisy = gain * moved[int(sensor == "velocity")] + draw.normal(0.0, 2e-3 if sensor == "velocity" else 2e-5, samples)
        runs.append(run(f"r{k}", RATE, level, {"motor": ("force", push), "x": (sensor, noisy)}))
    tree = cart_tree("motor", (1.15, 0.85), {"normal": {}})
    tree["sensors"] = [{"channel": "x", "body": "cart", "quantity": sensor}]
    if not spring:
        tree["links"][0]["stiffness"] = 0.0
        tree["free"] = ["links.spring.damping"]
    return runs, tree


def releases(gain: float, late: float, seed: int) -> tuple[list[Run], dict[str, Any]]:
    """A cart with dry friction, released from four places, its position read with a gain or late, and its description."""
    draw, time, runs = np.random.default_rng(seed), np.arange(int(9 * RELEASED_RATE)) / RELEASED_RATE, []
    starts = (0.11, 0.08, -0.06, 0.04)
    for k, start in enumerate(starts):
        x = np.interp(time - late, time, rubbed(time, lambda t: 0.0, [], start))
        noisy = gain * x + draw.normal(0.0, 0.003 * float(np.std(x)), len(x))
        made = run(f"r{k}", RELEASED_RATE, 1.0, {"push": ("force", np.zeros(len(x))), "x": ("displacement", noisy)})
        runs.append(replace(made, configuration=f"release {k}", excitation="free"))
    configurations = {f"release {k}": {"initial_position": {"cart": start}} for k, start in enumerate(starts)}
    return runs, cart_tree("push", (1.12, 0.9), configurations)


def floor(seed: int) -> tuple[list[Run], dict[str, Any]]:
    """A floor on struts that hits a bumper on one side only, with an accelerometer."""
    draw, rate, runs = np.random.default_rng(seed), 500.0, []
    time = np.arange(int(8 * rate)) / rate
    tones = np.arange(6.0, 60.0, 0.37)
    for k, level in enumerate((0.5, 1.0)):
        phase = draw.uniform(0.0, 2.0 * np.pi, len(tones))
        size = level * 9.0 / np.sqrt(len(tones)) * np.sqrt(2.0)

        def pushed(t: FloatArray, phase: FloatArray = phase, size: float = size) -> FloatArray:
            turns = np.cos(2.0 * np.pi * np.multiply.outer(t, tones) + phase)
            return np.asarray(size * turns.sum(axis=-1) * np.minimum(t / 0.3, 1.0))

        def fall(x: float, v: float, force: float) -> float:
            return (force - STRUT * x - FILM * v - BUMPER * max(x - GAP, 0.0)) / FLOOR

        # The method of Runge and Kutta in plain numbers, in steps so short that the impacts' moments do not matter.
        step, fine = 1.0 / (STEPS * rate), np.arange(len(time) * 8 + 1) / (8.0 * rate)
        force = CubicSpline(fine, pushed(fine))(0.5 * step * np.arange(2 * STEPS * len(time) + 1)).tolist()
        x, v, accelerations = 0.0, 0.0, []
        for j, (begin, middle, end) in enumerate(zip(force[:-2:2], force[1:-1:2], force[2::2], strict=True)):
            a0 = fall(x, v, begin)
            if j % STEPS == 0:
                accelerations.append(a0)
            a1 = fall(x + 0.5 * step * v, v + 0.5 * step * a0, middle)
            a2 = fall(x + 0.5 * step * (v + 0.5 * step * a0), v + 0.5 * step * a1, middle)
            a3 = fall(x + step * (v + 0.5 * step * a1), v + step * a2, end)
            x += step * (v + step * (a0 + a1 + a2) / 6.0)
            v += step * (a0 + 2.0 * (a1 + a2) + a3) / 6.0
        a = np.array(accelerations) + draw.normal(0.0, 1e-3, len(time))
        runs.append(run(f"r{k}", rate, level, {"shaker": ("force", pushed(time)), "a": ("acceleration", a)}))
    tree = {
        "name": "floor", "bodies": [{"name": "floor", "mass": FLOOR}],
        "links": [{"name": "struts", "a": "floor", "b": "ground", "stiffness": 1.2 * STRUT, "damping": 0.8 * FILM}],
        "drive": {"channel": "shaker", "quantity": "force", "pushes": {"floor": 1.0}},
        "sensors": [{"channel": "a", "body": "floor", "quantity": "acceleration"}],
        "free": ["links.struts.stiffness", "links.struts.damping"],
    }  # fmt: skip
    return runs, tree


def damper(dry: float, seed: int) -> tuple[list[Run], dict[str, Any]]:
    """A damper with dry friction whose stroke is imposed."""
    draw, time, runs = np.random.default_rng(seed), np.arange(int(6 * FAST)) / FAST, []
    for k, (size, frequency) in enumerate(STROKES):
        turn = 2.0 * np.pi * frequency
        x = size * (np.sin(turn * time) + 0.3 * np.sin(2.7 * turn * time)) * np.minimum(time, 1.0)
        v = np.gradient(x, time)
        force = OIL * v + dry * np.tanh(v / 1e-3) + draw.normal(0.0, 0.3, len(time))
        stroke = x + draw.normal(0.0, 2e-6, len(time))
        runs.append(run(f"r{k}", FAST, size, {"stroke": ("displacement", stroke), "force": ("force", force)}))
    tree = {
        "name": "damper", "bodies": [{"name": "rod", "mass": 1.0}],
        "links": [{"name": "oil", "a": "rod", "b": "ground", "stiffness": 0.0, "damping": 1.2 * OIL}],
        "drive": {"channel": "stroke", "quantity": "displacement", "imposes": "rod"},
        "sensors": [{"channel": "force", "force_in": "links.oil", "quantity": "force"}], "free": ["links.oil.damping"],
    }  # fmt: skip
    return runs, tree


def rack(dry: float, seed: int) -> tuple[list[Run], dict[str, Any]]:
    """Two storeys, pulled at the upper one and let go between two samples; their positions by laser."""
    draw, rate = np.random.default_rng(seed), 200.0
    time, masses, springs, dampers = np.arange(int(10 * rate)) / rate, (120.0, 90.0), (6e4, 4.5e4), (90.0, 60.0)
    runs = []
    for k, pull in enumerate((900.0, 500.0, 700.0)):
        held = np.array([pull / springs[0], pull / springs[0] + pull / springs[1]])

        def slope(t: float, y: FloatArray) -> Sequence[float]:
            lower = springs[0] * y[0] + dampers[0] * y[2] + dry * np.tanh(y[2] / 1e-3)
            upper = springs[1] * (y[1] - y[0]) + dampers[1] * (y[3] - y[2])
            return [y[2], y[3], (upper - lower) / masses[0], -upper / masses[1]]

        moves = time >= 1.0
        solved = solve_ivp(
            slope, (1.0, time[-1]), [*held, 0.0, 0.0], method="LSODA", t_eval=time[moves], rtol=1e-8, atol=1e-11, max_step=2e-3
        )
        placed = np.concatenate([np.tile(held[:, None], int((~moves).sum())), solved.y[:2]], axis=1)
        low, top = placed + draw.normal(0.0, 2e-5, placed.shape)
        rope = np.where(moves, 0.0, pull) + draw.normal(0.0, 0.3, len(time))
        runs.append(
            run(f"pull{k}", rate, pull, {"rope": ("force", rope), "low": ("displacement", low), "top": ("displacement", top)})
        )
    off = 1.0 + draw.uniform(-0.2, 0.2, 4)
    return runs, {
        "name": "rack",
        "bodies": [{"name": "first", "mass": masses[0]}, {"name": "second", "mass": masses[1]}],
        "links": [
            {"name": "feet", "a": "first", "b": "ground", "stiffness": springs[0] * off[0], "damping": dampers[0] * off[1]},
            {"name": "posts", "a": "second", "b": "first", "stiffness": springs[1] * off[2], "damping": dampers[1] * off[3]},
        ],
        "drive": {"channel": "rope", "quantity": "force", "pushes": {"second": 1.0}},
        "sensors": [
            {"channel": "low", "body": "first", "quantity": "displacement"},
            {"channel": "top", "body": "second", "quantity": "displacement"},
        ],
        "free": ["links.feet.stiffness", "links.feet.damping", "links.posts.stiffness", "links.posts.damping"],
    }


def diagnosed(made: tuple[list[Run], dict[str, Any]], folder: Path) -> dict[str, Any]:
    """The findings of the command."""
    runs, tree = made
    text = description_text(from_tree({"configurations": {"normal": {}}, **tree}), {})
    iso.write(folder / "a.h5", replace(Campaign(runs=tuple(runs), source="lab"), description=text))
    assert main(["diagnose", str(folder / "a.h5"), "-o", str(folder / "d")]) == 0
    return dict(json.loads((folder / "d" / "findings.json").read_text()))


@pytest.mark.parametrize("late", [0.02, pytest.param(0.008, marks=pytest.mark.study)])
def test_a_drive_that_acts_late(late: float, tmp_path: Path) -> None:
    found = diagnosed(carts(late, 4), tmp_path)
    (step,) = found["steps"]
    assert (found["verdict"], step["cause"], step["location"]) == ("explained", "channel_delay", "motor")
    assert step["parameters"]["delay"]["value"] == pytest.approx(-late, abs=0.02 / RATE)


def test_a_command_that_acts_at_its_samples(tmp_path: Path) -> None:
    found = diagnosed(carts(0.0, 4), tmp_path)
    assert (found["verdict"], found["steps"]) == ("adequate", [])


@pytest.mark.parametrize("dry", [40.0, 0.0])
def test_a_damper_with_an_imposed_stroke(dry: float, tmp_path: Path) -> None:
    found = diagnosed(damper(dry, 1), tmp_path)
    if not dry:
        assert found["verdict"] == "adequate"
        return
    (step,) = found["steps"]
    assert (found["verdict"], step["kind"], step["location"]) == ("explained", "friction_shape", "oil")
    row = step["parameters"]["friction_force"]
    assert row["value"] == pytest.approx(dry, abs=max(3.0 * row["std"], 0.05 * dry))


def near(step: Mapping[str, Any], name: str, truth: float, within: float) -> bool:
    """Whether a value is within three standard uncertainties, or this share, of the truth."""
    row = step["parameters"][name]
    return abs(row["value"] - truth) <= max(3.0 * row["std"], within * abs(truth))


def test_dry_friction_and_a_drive_that_acts_late(tmp_path: Path) -> None:
    found = diagnosed(cart(0.016, 5), tmp_path)
    steps = {(step["cause"], step["location"]): step for step in found["steps"]}
    assert (found["verdict"], set(steps)) == ("explained", {("coulomb_friction", "spring"), ("channel_delay", "motor")})
    assert near(steps["coulomb_friction", "spring"], "friction_force", DRY, 0.02)
    assert near(steps["channel_delay", "motor"], "delay", -0.016, 0.05)


@pytest.mark.parametrize(
    ("spring", "late", "dry", "sensor"),
    [
        # A delay alone, a delay beside friction and a sound rig on a spring are also diagnosed above, in fewer seconds.
        pytest.param(SPRING, 0.02, 0.0, "displacement", marks=pytest.mark.study),
        pytest.param(SPRING, 0.02, 0.5, "displacement", marks=pytest.mark.study),
        pytest.param(SPRING, 0.0, 0.0, "displacement", marks=pytest.mark.study),
        pytest.param(0.0, 0.01, 1.2, "displacement", marks=pytest.mark.study),
        (0.0, 0.0, 0.8, "velocity"),
        (0.0, 0.0, 0.0, "velocity"),
    ],
)
def test_a_staircase_that_drives_a_mass(spring: float, late: float, dry: float, sensor: Quantity, tmp_path: Path) -> None:
    """A drive's delay of many samples, also where no spring holds the mass, and with its velocity alone."""
    found = diagnosed(axis(spring, late, dry, sensor, 3), tmp_path)
    steps = {step["cause"]: step for step in found["steps"]}
    assert found["verdict"] == ("explained" if late or dry else "adequate")
    assert set(steps) == {*(["channel_delay"] if late else []), *(["coulomb_friction"] if dry else [])}
    if late:
        step = steps["channel_delay"]  # of two channels, which one is late cannot be told
        assert near(step, "delay", late if step["location"] == "x" else -late, 0.02)
    if dry:
        assert near(steps["coulomb_friction"], "friction_force", dry, 0.02)


def test_a_stop_that_is_hit_in_a_few_impacts(tmp_path: Path) -> None:
    """From close values a fit to whole runs loses the motion after an impact."""
    found = diagnosed(axis(SPRING, 0.0, 0.0, "displacement", 8, gap=0.01), tmp_path)
    (step,) = found["steps"]
    assert (found["verdict"], step["cause"], step["location"]) == ("explained", "end_stop", "spring")
    assert near(step, "stroke", 0.01, 0.002)
    assert near(step, "contact_stiffness", STOP, 0.02)


@pytest.mark.study
def test_a_sweep_with_dry_friction_and_a_late_drive(tmp_path: Path) -> None:
    """What friction leaves in a sweep looks like a change in time, as long as the delay is not known well."""
    found = diagnosed(axis(0.0, 0.015, 1.0, "velocity", 46, drive=sweep), tmp_path)
    assert {step["cause"] for step in found["steps"]} == {"channel_delay", "coulomb_friction"}


@pytest.mark.study
def test_dry_friction_beside_a_wrong_gain(tmp_path: Path) -> None:
    """As long as the gain is not known, friction behind play looks as good."""
    found = diagnosed(axis(SPRING, 0.0, 0.6, "displacement", 20, gain=1.05, drive=sweep), tmp_path)
    assert {step["cause"] for step in found["steps"]} == {"sensor_gain", "coulomb_friction"}


def test_releases_with_damping_that_grows_with_the_velocity(tmp_path: Path) -> None:
    """In a decay the amplitude falls with time, which is no drift of the damping: the runs have no start times."""
    draw, time, runs, starts = np.random.default_rng(72), np.arange(int(8 * RATE)) / RATE, [], (0.06, 0.04, -0.05)
    for k, start in enumerate(starts):
        solved = solve_ivp(
            lambda t, y: [y[1], -(SPRING * y[0] + (DAMPER + 6.0 * abs(y[1])) * y[1]) / MASS], (0.0, time[-1]), [start, 0.0],
            t_eval=time, rtol=1e-9, atol=1e-12,
        )  # fmt: skip
        x = solved.y[0] + draw.normal(0.0, 2e-5, len(time))
        made = run(f"r{k}", RATE, 1.0, {"push": ("force", np.zeros(len(x))), "x": ("displacement", x)})
        runs.append(replace(made, configuration=f"release {k}", excitation="free"))
    configurations = {f"release {k}": {"initial_position": {"cart": start}} for k, start in enumerate(starts)}
    found = diagnosed((runs, cart_tree("push", (1.12, 0.9), configurations)), tmp_path)
    (step,) = found["steps"]
    assert (found["verdict"], step["cause"]) == ("explained", "quadratic_damping")
    assert near(step, "quadratic_damping", 6.0, 0.01)


def test_a_single_release_with_dry_friction(tmp_path: Path) -> None:
    """A record this short shows no reversal to the equations, and a free memory follows it in part."""
    time = np.arange(int(8 * RATE)) / RATE
    x = rubbed(time, lambda t: 0.0, [], 0.02) + np.random.default_rng(33).normal(0.0, 2e-5, len(time))
    made = run("r0", RATE, 1.0, {"push": ("force", np.zeros(len(x))), "x": ("displacement", x)})
    tree = cart_tree("push", (1.12, 0.9), {"normal": {"initial_position": {"cart": 0.02}}})
    found = diagnosed(([replace(made, excitation="free")], tree), tmp_path)
    (step,) = found["steps"]
    assert (found["verdict"], step["cause"]) == ("explained", "coulomb_friction")
    assert near(step, "friction_force", DRY, 0.02)


@pytest.mark.study
def test_a_cart_with_dry_friction_that_is_released(tmp_path: Path) -> None:
    found = diagnosed(cart(0.0, 6, start=0.03), tmp_path)
    (step,) = found["steps"]
    assert (found["verdict"], step["cause"], step["location"]) == ("explained", "coulomb_friction", "spring")
    assert near(step, "friction_force", DRY, 0.02)


@pytest.mark.study
@pytest.mark.parametrize(
    ("gain", "late", "second", "name", "size"),
    [(1.0, 0.0, None, "", 0.0), (1.07, 0.0, "sensor_gain", "factor", 1.07), (1.0, 0.008, "channel_delay", "delay", 0.008)],
)
def test_noisy_releases_from_several_places(
    gain: float, late: float, second: str | None, name: str, size: float, tmp_path: Path
) -> None:  # fmt: skip
    """The cart rests for most of each run, and its position is too noisy for the equations to show a reversal."""
    found = diagnosed(releases(gain, late, 11), tmp_path)
    steps = {(step["cause"], step["location"]): step for step in found["steps"]}
    assert found["verdict"] == "explained"
    assert set(steps) == {("coulomb_friction", "spring"), *([(second, "x")] if second else [])}
    assert near(steps["coulomb_friction", "spring"], "friction_force", DRY, 0.02)
    if second:
        assert near(steps[second, "x"], name, size, 0.02)


# With positions such a stop is also diagnosed in tests/analysis/diagnose/test_other_forms.py.
@pytest.mark.study
def test_a_stop_at_one_end(tmp_path: Path) -> None:
    found = diagnosed(floor(7), tmp_path)
    (step,) = found["steps"]
    assert (found["verdict"], step["cause"], step["location"]) == ("explained", "end_stop", "struts")
    assert near(step, "stroke", GAP, 0.01)
    assert near(step, "contact_stiffness", BUMPER, 0.03)
    assert '"end":1' in (tmp_path / "d" / "model.json").read_text().replace(" ", "")


def smooth_sine(time: FloatArray, size: float, frequency: float) -> FloatArray:
    """A sine that fades in within half a second."""
    return np.asarray(size * np.sin(2.0 * np.pi * frequency * time) * (0.5 - 0.5 * np.cos(np.pi * np.minimum(2.0 * time, 1.0))))


@pytest.mark.parametrize("curved", [pytest.param(True, marks=pytest.mark.study), False])
def test_a_damper_whose_stroke_is_recorded_with_noise(curved: bool, tmp_path: Path) -> None:
    """Noise of the stroke becomes 8 % of the damping force when it is differentiated; the curve bends the force by 1 %."""
    draw, rate, runs = np.random.default_rng(6), 1024.0, []
    oil, gas, most = 1500.0, 8e3, 500.0
    time = np.arange(int(5 * rate)) / rate
    for k, (size, frequency) in enumerate(((0.012, 0.5), (0.012, 1.5), (0.02, 1.0), (0.006, 3.0))):
        x = smooth_sine(time, size, frequency)
        pull = oil * np.gradient(x, time)
        force = (most * np.tanh(pull / most) if curved else pull) + gas * x
        recorded = {"force": ("force", force + draw.normal(0.0, 2e-3 * force.std(), len(time))),
                    "stroke": ("displacement", x + draw.normal(0.0, 5e-6, len(time)))}  # fmt: skip
        runs.append(run(f"r{k}", rate, size, recorded))  # type: ignore[arg-type]
    tree = {
        "name": "damper", "bodies": [{"name": "rod", "mass": 1.0}],
        "links": [{"name": "oil", "a": "rod", "b": "ground", "stiffness": 0.9 * gas, "damping": 1.2 * oil}],
        "drive": {"channel": "stroke", "quantity": "displacement", "imposes": "rod"},
        "sensors": [{"channel": "force", "force_in": "links.oil", "quantity": "force"}],
        "free": ["links.oil.damping", "links.oil.stiffness"],
    }  # fmt: skip
    found = diagnosed((runs, tree), tmp_path)
    if not curved:
        assert found["verdict"] == "adequate"
        return
    (step,) = found["steps"]
    assert (found["verdict"], step["kind"], step["location"]) == ("explained", "damping_shape", "oil")


#: Moment of inertia (kg m^2) and viscous damping (N m s/rad) of the motor, its cogging torque (N m) and pitch (rad), and
#: amplitude (rad/s) and frequency (Hz) of its velocity in each run.
INERTIA, BEARING, COGGING, PITCH, TURNS = 3.1e-3, 4.0e-3, 0.03, 2.0 * np.pi / 7.0, ((6.0, 0.15), (3.0, 0.1), (10.0, 0.2))


def motor(dry: float, seed: int) -> tuple[list[Run], dict[str, Any]]:
    """A motor that turns to and fro over several turns with known torque: cogging, and dry friction (N m)."""
    draw, time, runs = np.random.default_rng(seed), np.arange(20 * 500) / 500.0, []
    phase = draw.uniform(0.0, 2.0 * np.pi)
    for k, (fast, frequency) in enumerate(TURNS):
        w = 2.0 * np.pi * frequency
        begun = 0.5 - 0.5 * np.cos(np.pi * np.minimum(time / 0.5, 1.0))
        turning = fast * (np.sin(w * time) + 0.3 * np.sin(1.7 * w * time)) * begun
        angle = CubicSpline(time, turning).antiderivative()(time)
        torque = INERTIA * CubicSpline(time, turning)(time, 1) + BEARING * turning + dry * np.tanh(turning / 2e-2)
        torque += COGGING * np.sin(2.0 * np.pi * angle / PITCH + phase)
        torque += draw.normal(0.0, 2e-3 * torque.std(), len(time))
        counted = np.round(angle / (2.0 * np.pi / 8192.0) + draw.normal(0.0, 0.1, len(time))) * 2.0 * np.pi / 8192.0
        runs.append(run(f"r{k}", 500.0, fast, {"torque": ("torque", torque), "angle": ("angle", counted)}))
    tree = {
        "name": "motor", "bodies": [{"name": "rotor", "mass": INERTIA, "motion": "rotation"}],
        "links": [{"name": "bearing", "a": "rotor", "b": "ground", "stiffness": 0.0, "damping": 1.2 * BEARING}],
        "drive": {"channel": "torque", "quantity": "torque", "pushes": {"rotor": 1.0}},
        "sensors": [{"channel": "angle", "body": "rotor", "quantity": "angle"}], "free": ["links.bearing.damping"],
    }  # fmt: skip
    return runs, tree


@pytest.mark.parametrize("dry", [0.0, pytest.param(0.06, marks=pytest.mark.study)])
def test_cogging_over_many_turns(dry: float, tmp_path: Path) -> None:
    found = diagnosed(motor(dry, seed=31), tmp_path)
    assert found["verdict"] == "explained"
    steps = {step["cause"]: step for step in found["steps"]}
    assert set(steps) == ({"cogging", "coulomb_friction"} if dry else {"cogging"})
    assert near(steps["cogging"], "periodic_force", COGGING, 0.05)
    assert near(steps["cogging"], "pitch", PITCH, 1e-3)


def test_a_rig_that_is_pulled_and_let_go_between_two_samples(tmp_path: Path) -> None:
    # The recorded force does not tell when: half a sample is no delay of a channel.
    found = diagnosed(rack(0.0, 8), tmp_path)
    assert (found["verdict"], found["steps"]) == ("adequate", [])
