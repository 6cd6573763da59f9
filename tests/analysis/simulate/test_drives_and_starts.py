"""Several drives, imposed motion, measured forces, initial states and floating rigs, against references of another kind."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp

from isorig.analysis import laws
from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.model.rig_model import Body, Configuration, Contact, Drive, Link, RigModel, Sensor, from_tree, to_tree
from isorig.analysis.simulate import Excitation, simulate, trace
from isorig.analysis.simulate.excitation import random
from isorig.analysis.simulate.natural import natural_modes

RATE, N = 1000.0, 1500
TIME = np.arange(N) / RATE
INSIDE = slice(30, -30)
A, B = (random(samples=N, sample_rate=RATE, rms=2.0, band=(1.0, 30.0), seed=seed) for seed in (1, 2))
K, C, M = 2000.0, 6.0, 2.0


def base(quantity: Any = "acceleration", *, friction: float = 0.0) -> RigModel:
    """A mass on a base that is moved."""
    rubs = (Contact(name="c", a="m", b="base", law=laws.Coulomb(friction_force=friction)),) if friction else ()
    return RigModel(
        name="base", bodies=(Body(name="base", mass=5.0), Body(name="m", mass=M)),
        links=(Link(name="k", a="m", b="base", stiffness=K, damping=C),), contacts=rubs,
        drive=Drive(channel="move", imposes="base", quantity=quantity),
        sensors=(
            Sensor(channel="x", body="m", relative_to="base", quantity="displacement"), Sensor(channel="a", body="m"),
            Sensor(channel="base_a", body="base"), Sensor(channel="base_x", body="base", quantity="displacement"),
            Sensor(channel="needed", force_in="drive.move", quantity="force"),
            Sensor(channel="cell", force_in="links.k", quantity="force"),
        ),
    )  # fmt: skip


def relative(friction: float) -> RigModel:
    """The same in coordinates relative to the base: the base's acceleration pushes with the mass."""
    rubs = (Contact(name="c", a="m", law=laws.Coulomb(friction_force=friction)),) if friction else ()
    return RigModel(
        name="relative", bodies=(Body(name="m", mass=M),), links=(Link(name="k", a="m", stiffness=K, damping=C),), contacts=rubs,
        drive=Drive(channel="move", pushes={"m": -M}), sensors=(Sensor(channel="x", body="m", quantity="displacement"),),
    )  # fmt: skip


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_a_command_is_held_from_sample_to_sample() -> None:
    step, first, omega = 3.0, 200, np.sqrt(K / M)
    rig = replace(relative(0.0), links=(Link(name="k", a="m", stiffness=K),))
    known = -M * step / K * (1.0 - np.cos(omega * np.maximum(TIME - first / RATE, 0.0)))
    command = np.where(np.arange(N) < first, 0.0, step)
    off = [
        np.abs(simulate(rig, Excitation.prepare(command, RATE, held=held, oversample=4)).channels["x"] - known)[INSIDE].max()
        for held in (True, False)
    ]
    # Band-limited interpolation puts the step halfway between the two samples.
    assert off[0] < 2e-4 * np.abs(known).max() < 50.0 * off[0] < off[1]


@pytest.mark.parametrize("friction", [0.0, 1.5])
def test_an_imposed_acceleration_is_the_motion_in_relative_coordinates(friction: float) -> None:
    seen = simulate(base(friction=friction), Excitation.prepare(A, RATE)).channels
    known = simulate(relative(friction), Excitation.prepare(A, RATE)).channels
    assert np.abs(seen["x"] - known["x"]).max() < 1e-10 * np.abs(known["x"]).max()
    assert rms((seen["base_a"] - A)[INSIDE]) < 1e-3 * rms(A)
    # Newton: what moves base and mass together is the only force on them; the mass is moved by what passes the spring alone.
    assert rms((seen["needed"] - 5.0 * seen["base_a"] - M * seen["a"])[INSIDE]) < 5e-3 * rms(seen["needed"])
    assert rms((seen["cell"] + M * seen["a"])[INSIDE]) < 2e-2 * rms(seen["cell"])


@pytest.mark.parametrize("quantity", ["displacement", "velocity"])
def test_an_imposed_position_or_velocity_against_an_integrator(quantity: str) -> None:
    omega, phase, size = 6.0 * np.pi, 0.3, 0.01
    shift = 0.0 if quantity == "displacement" else size * np.sin(phase)

    def position(t: Any) -> Any:
        return size * np.sin(omega * t + phase) - shift

    def velocity(t: Any) -> Any:
        return size * omega * np.cos(omega * t + phase)

    drive = position(TIME) if quantity == "displacement" else velocity(TIME)
    seen = simulate(base(quantity), Excitation.prepare(drive, RATE)).channels
    known = solve_ivp(
        lambda t, y: [y[1], (K * (position(t) - y[0]) + C * (velocity(t) - y[1])) / M], (0.0, TIME[-1]), [0.0, 0.0],
        t_eval=TIME, rtol=1e-10, atol=1e-13,
    ).y[0]  # fmt: skip
    assert np.abs(seen["base_x"] - position(TIME))[INSIDE].max() < 1e-5 * size
    assert np.abs(seen["x"] - known + position(TIME))[INSIDE].max() < 1e-4 * size


def test_the_force_that_an_imposed_motion_takes_on_a_damper() -> None:
    omega, size = 6.0 * np.pi, 0.01
    x, v = size * np.sin(omega * TIME), size * omega * np.cos(omega * TIME)
    model = RigModel(
        name="damper", bodies=(Body(name="rod", mass=0.5),),
        links=(Link(name="oil", a="rod", damping=300.0, laws=(laws.QuadraticDamping(quadratic_damping=200.0),)),),
        contacts=(Contact(name="seal", a="rod", law=laws.Coulomb(friction_force=5.0)),),
        drive=Drive(channel="x", imposes="rod", quantity="displacement"),
        sensors=(
            Sensor(channel="needed", force_in="drive.x", quantity="force"),
            Sensor(channel="seal", force_in="contacts.seal", quantity="force"),
        ),
    )  # fmt: skip
    seen = simulate(model, Excitation.prepare(x, RATE)).channels
    force = 300.0 * v + 200.0 * v * np.abs(v) + 5.0 * np.sign(v) - 0.5 * omega**2 * x
    # The seal's step is smoothed by the sampling filter.
    assert rms((seen["needed"] - force)[INSIDE]) < 0.01 * rms(force)
    assert np.median(np.abs(seen["needed"] - force)[INSIDE]) < 1e-3 * rms(force)
    assert np.median(np.abs(np.abs(seen["seal"]) - 5.0)) < 1e-2


def test_an_imposed_displacement_may_end_anywhere() -> None:
    # A damper's force is its damping times the speed, up to the last sample, also where the record does not end at zero.
    omega = 2.0 * np.pi * 2.0
    x, v = 0.01 * np.sin(omega * TIME + 0.4), 0.01 * omega * np.cos(omega * TIME + 0.4)
    model = RigModel(
        name="damper", bodies=(Body(name="rod", mass=1.0),), links=(Link(name="oil", a="rod", damping=300.0),),
        drive=Drive(channel="x", imposes="rod", quantity="displacement"),
        sensors=(Sensor(channel="force", force_in="links.oil", quantity="force"),),
    )  # fmt: skip
    seen = simulate(model, Excitation.prepare(x, RATE)).channels["force"]
    assert np.abs(seen - 300.0 * v)[-40:].max() < 0.01 * 300.0 * np.abs(v).max()


def two() -> RigModel:
    """Two masses that rub on each other, on a hardening spring."""
    return RigModel(
        name="two", bodies=(Body(name="l", mass=3.0), Body(name="r", mass=2.0)),
        links=(
            Link(name="kl", a="l", stiffness=4000.0, damping=4.0, laws=(laws.Cubic(cubic_stiffness=1e8),)),
            Link(name="kr", a="r", b="l", stiffness=3000.0, damping=4.0),
        ),
        contacts=(Contact(name="c", a="r", b="l", law=laws.Coulomb(friction_force=0.5)),),
        drive=Drive(channel="f1", quantity="force", pushes={"l": 1.0}),
        more_drives=(Drive(channel="f2", quantity="force", pushes={"r": 1.0}),),
        sensors=(Sensor(channel="x", body="r", quantity="displacement"), Sensor(channel="a", body="l")),
    )  # fmt: skip


def test_two_drives_of_one_wave_are_one_drive_of_both_bodies() -> None:
    both = simulate(two(), Excitation.prepare(A, RATE, others=[2.0 * A])).channels
    one = replace(two(), more_drives=(), drive=Drive(channel="f", quantity="force", pushes={"l": 1.0, "r": 2.0}))
    merged = simulate(one, Excitation.prepare(A, RATE)).channels
    for name, values in merged.items():
        assert np.abs(both[name] - values).max() < 1e-9 * np.abs(values).max()


def test_two_drives_against_an_integrator() -> None:
    model = replace(two(), contacts=())
    model = replace(model, links=tuple(replace(link, laws=()) for link in model.links))
    f1, f2 = np.sin(2 * np.pi * 4.0 * TIME), 0.7 * np.sin(2 * np.pi * 7.0 * TIME)

    def rates(t: float, y: Any) -> Any:
        k = 3000.0 * (y[1] - y[0]) + 4.0 * (y[3] - y[2])
        a = (np.sin(8 * np.pi * t) - 4000.0 * y[0] - 4.0 * y[2] + k) / 3.0
        return [y[2], y[3], a, (0.7 * np.sin(14 * np.pi * t) - k) / 2.0]

    known = solve_ivp(rates, (0.0, TIME[-1]), np.zeros(4), t_eval=TIME, rtol=1e-10, atol=1e-13).y[1]
    seen = simulate(model, Excitation.prepare(f1, RATE, others=[f2])).channels["x"]
    assert np.abs(seen - known)[INSIDE].max() < 2e-4 * np.abs(known).max()


def released() -> RigModel:
    """A mass on a rubbing slide, let go or thrown."""
    return RigModel(
        name="released", bodies=(Body(name="m", mass=M),), links=(Link(name="k", a="m", stiffness=K),),
        contacts=(Contact(name="c", a="m", law=laws.Coulomb(friction_force=2.0)),),
        drive=Drive(channel="f", quantity="force", pushes={"m": 1.0}),
        configurations={
            "pulled": Configuration(initial_position={"m": 0.0105}), "thrown": Configuration(initial_velocity={"m": -0.3}),
            "held": Configuration(initial_position={"m": 0.0009}),
        },
        sensors=(Sensor(channel="x", body="m", quantity="displacement"), Sensor(channel="v", body="m", quantity="velocity")),
    )  # fmt: skip


def test_a_released_mass_loses_two_steps_a_swing() -> None:
    # Without viscous damping each half swing loses 2 F / k = 2 mm and it sticks within F / k = 1 mm: 10.5, -8.5, 6.5, -4.5, 2.5,
    # -0.5 mm (Coulomb friction, Ginsberg 2001, Mechanical and Structural Vibrations, sec. 2.4).
    found = trace(released(), Excitation.prepare(np.zeros(N), RATE), configuration="pulled")
    x = found.response.channels["x"]
    half = np.pi / np.sqrt(K / M)
    assert x[0] == pytest.approx(0.0105, rel=1e-5)
    for k, expected in enumerate((-8.5e-3, 6.5e-3, -4.5e-3, 2.5e-3, -0.5e-3), start=1):
        assert np.interp(k * half, TIME, x) == pytest.approx(expected, abs=2e-6)
    assert x[-1] == pytest.approx(-0.5e-3, abs=1e-9)
    assert found.changes[0].slides == -1


def test_a_mass_that_is_held_where_it_is_put_stays() -> None:
    x = simulate(released(), Excitation.prepare(np.zeros(N), RATE), configuration="held").channels["x"]
    np.testing.assert_allclose(x, 0.0009, rtol=1e-9)


def test_a_thrown_mass_slides_at_once() -> None:
    found = trace(released(), Excitation.prepare(np.zeros(N), RATE), configuration="thrown")
    omega = np.sqrt(K / M)
    # x'' = -k/m x + F/m while it moves backwards: x = F/k (1 - cos) - v/omega sin.
    t = TIME[20:45]
    expected = 1e-3 * (1.0 - np.cos(omega * t)) - 0.3 / omega * np.sin(omega * t)
    np.testing.assert_allclose(found.response.channels["x"][20:45], expected, atol=2e-6)


def test_a_floating_rig_moves_as_its_momentum_says() -> None:
    model = RigModel(
        name="floating", free_free=True, bodies=(Body(name="a", mass=2.0), Body(name="b", mass=1.0)),
        links=(Link(name="k", a="a", b="b", stiffness=90000.0, damping=8.0),),
        drive=Drive(channel="f", quantity="force", pushes={"a": 1.0}),
        sensors=(Sensor(channel="a", body="a"), Sensor(channel="b", body="b")),
    )  # fmt: skip
    seen = simulate(model, Excitation.prepare(A, RATE)).channels
    assert rms((2.0 * seen["a"] + seen["b"] - A)[INSIDE]) < 1e-3 * rms(A)
    (mode,) = natural_modes(model, "unlocked")
    assert mode.frequency == pytest.approx(
        np.sqrt(90000.0 * 1.5) / np.sqrt(2.0) ** 2 / np.pi / 1.0 * 0.5 * 2.0 / np.sqrt(1.0), rel=1.0
    )
    assert mode.frequency == pytest.approx(np.sqrt(90000.0 * (1 / 2.0 + 1 / 1.0)) / (2 * np.pi), rel=1e-9)
    with pytest.raises(ModelError, match="free_free = true"):
        replace(model, free_free=False)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"drive": {"channel": "f"}}, "pushes nothing"),
        ({"drive": {"channel": "f", "imposes": "l", "pushes": {"r": 1.0}}}, "has pushes, a factor, a curve"),
        ({"drive": {"channel": "f", "imposes": "l", "quantity": "force"}}, "its quantity is force"),
        ({"drive": {"channel": "f", "imposes": "q"}}, "which does not exist"),
        ({"more_drives": [{"channel": "f1", "pushes": {"l": 1.0}}]}, "the channel name 'f1' occurs 2 times"),
        ({"sensors": [{"channel": "s", "force_in": "links.q", "quantity": "force"}]}, "'links.q', which does not exist"),
        ({"sensors": [{"channel": "s", "force_in": "links.kl"}]}, 'give it force_in and quantity = "force"'),
        ({"sensors": [{"channel": "s"}]}, "names no body"),
        ({"sensors": [{"channel": "s", "body": "l", "quantity": "force"}]}, "force_in in place of body"),
        ({"configurations": {"u": {"initial_position": {"q": 1.0}}}}, "which does not exist"),
    ],
)  # fmt: skip
def test_what_contradicts_itself_is_refused_by_name(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ModelError, match=said):
        from_tree({**to_tree(two()), **change})


def test_what_cannot_be_simulated_is_refused_by_name() -> None:
    locked = replace(
        two(), configurations={"locked": Configuration(rigid=("kr",))},
        sensors=(Sensor(channel="s", force_in="links.kr", quantity="force"),),
    )  # fmt: skip
    with pytest.raises(SimulationError, match="the force in a perfect lock is not simulated"):
        simulate(locked, Excitation.prepare(A, RATE, others=[B]), configuration="locked")
    apart = replace(two(), configurations={"u": Configuration(rigid=("kr",), initial_position={"l": 0.1, "r": 0.2})})
    with pytest.raises(SimulationError, match="moves bodies apart that its rigid links join"):
        simulate(apart, Excitation.prepare(A, RATE, others=[B]), configuration="u")


def test_a_description_may_have_numpys_numbers() -> None:
    """Values computed in a notebook are scalars of numpy."""
    tree: dict[str, Any] = {
        "name": "one", "bodies": [{"name": "m", "mass": np.float64(2.0)}],
        "links": [{"name": "k", "a": "m", "b": "ground", "stiffness": np.float32(400.0), "damping": np.int64(3)}],
        "drive": {"channel": "f", "pushes": {"m": np.float64(1.0)}}, "sensors": [{"channel": "x", "body": "m"}],
    }  # fmt: skip
    model = from_tree(tree)
    assert (model.get("bodies.m.mass"), model.get("links.k.stiffness"), model.get("links.k.damping")) == (2.0, 400.0, 3.0)


def test_what_is_locked_to_the_ground_stays_at_rest() -> None:
    """The rig has no coordinate that a sensor could read, whatever else is in the memory."""
    model = replace(two(), configurations={"locked": Configuration(rigid=("kl", "kr"))})
    seen = simulate(model, Excitation.prepare(A, RATE, others=[B]), configuration="locked").channels
    assert all(not values.any() for values in seen.values())
