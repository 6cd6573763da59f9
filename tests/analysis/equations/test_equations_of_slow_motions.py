"""A motor and a load on a shaft, of which the speeds are recorded: slow turns, friction, free inertias; own integrator."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.equations import system
from isorig.analysis.equations.forms import start_values
from isorig.analysis.equations.sliding import Sliding, SlidingRun, shortly_low_passed
from isorig.analysis.equations.system import HOLDS, equations_of
from isorig.analysis.lowpass import lowpass_gain
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor

RATE, SAMPLES, SEED = 1000.0, 12_000, 2301
TRUE = {"bodies.motor.mass": 2.0e-3, "bodies.load.mass": 7.0e-3, "links.shaft.stiffness": 60.0}
#: Inertias and stiffness described up to 15 % off.
SHAFT = RigModel(
    name="shaft",
    bodies=tuple(Body(name=name, mass=mass, motion="rotation") for name, mass in (("motor", 1.8e-3), ("load", 8e-3))),
    links=(
        Link(name="shaft", a="motor", b="load", stiffness=52.0, damping=0.015),
        Link(name="motor_bearing", a="motor", damping=4e-3), Link(name="load_bearing", a="load", damping=6e-3),
    ),
    contacts=(Contact(name="seal", a="motor", law=laws.Coulomb(friction_force=0.02)),),
    drive=Drive(channel="torque", pushes={"motor": 1.0}, quantity="torque"),
    sensors=tuple(Sensor(channel=f"w_{name}", body=name, quantity="angular_velocity") for name in ("motor", "load")),
    free=(*TRUE, "links.shaft.damping", "links.motor_bearing.damping", "links.load_bearing.damping"),
)  # fmt: skip


def recorded(noise: float) -> Campaign:
    """Slow turns of the whole shaft, with its mode at 31 Hz, and noise as a share of the speeds' rms."""
    draw, time = np.random.default_rng(SEED), np.arange(SAMPLES) / RATE
    spectrum = np.zeros(SAMPLES // 2 + 1, dtype=complex)
    spectrum[6:600] = np.exp(2j * np.pi * draw.uniform(size=594))
    spectrum[6:40] *= 12.0
    torque = 0.2 * np.fft.irfft(spectrum) / np.std(np.fft.irfft(spectrum))

    def rates(t: float, y: FloatArray) -> list[float]:
        twist, motor, load = y
        through = 60.0 * twist + 0.015 * (motor - load)
        pushed = np.interp(t, time, torque) - 4e-3 * motor - 0.02 * np.tanh(motor / 0.02)
        return [motor - load, (pushed - through) / 2e-3, (through - 6e-3 * load) / 7e-3]

    course = solve_ivp(rates, (0.0, time[-1]), np.zeros(3), t_eval=time, rtol=1e-7, atol=1e-9, max_step=0.002).y
    channels = {"torque": Channel(name="torque", samples=torque, quantity="torque", unit="N m")}
    for name, speed in (("w_motor", course[1]), ("w_load", course[2])):
        values = speed + draw.normal(0.0, noise * float(np.std(speed)), SAMPLES)
        channels[name] = Channel(name=name, samples=values, quantity="angular_velocity", unit="rad/s")
    run = Run(id="r0", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels)
    return Campaign(runs=(run,), source="shaft")


@pytest.fixture(scope="module")
def measured() -> Campaign:
    return recorded(2e-3)


def test_equations_of_a_shaft_that_turns_slowly_hold(measured: Campaign) -> None:
    """The twist that the slow torque makes is the small difference of two integrated speeds."""
    equations = equations_of(measured, SHAFT)
    assert {"motor", "motor + load"} <= equations.residuals().keys()
    assert max(equations.residuals().values()) < HOLDS
    for path, value in TRUE.items():
        assert start_values(equations)[path] == pytest.approx(value, rel=0.02)
    (sliding, found) = equations.sliding["motor"]
    assert sliding.drifts
    assert found.values[2] == pytest.approx(0.02, rel=0.1)


def test_the_slow_force_is_no_part_of_what_is_left(measured: Campaign) -> None:
    equations = equations_of(measured, SHAFT)
    sliding, found = equations.sliding["motor"]
    element = equations.primary(equations.balance_of("motor"))
    block = sliding.active[1]
    matrix, _ = sliding.evaluated(block, equations.base_columns(element))
    left = sliding.left(block, matrix, found.values)
    whole = block.run.force[block.first + block.used] - matrix @ found.values
    assert np.std(left) < 0.3 * np.std(whole)
    assert float(np.mean(left**2)) == pytest.approx(found.arithmetic, rel=0.6)


@pytest.mark.parametrize(("noise", "least", "most"), [(0.0, 4.0 / 12.0, 8.0 / 12.0), (1e3, 2.99, 3.0)])
def test_the_slow_force_bends_as_slowly_as_the_noise_allows(
    measured: Campaign, noise: float, least: float, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Never more slowly than four times in a run, never faster than at a tenth of the lowest mode."""
    equations = equations_of(measured, SHAFT)
    balance = equations.balance_of("motor")
    bearing = next(element for element, _ in balance.crossing if element.name == "motor_bearing")
    monkeypatch.setattr(equations, "_deflection_noise", lambda element, low, record: noise)
    assert least <= equations.cut(balance, bearing) < most


def test_a_mass_that_is_solved_for_has_the_noise_of_a_given_one(measured: Campaign) -> None:
    noise = []
    for free in (SHAFT.free, ()):
        equations = equations_of(measured, replace(SHAFT, free=free))
        noise.append(equations.sliding["motor + load"][0].noise)
    assert noise[0] == pytest.approx(noise[1], rel=1e-6)


@pytest.mark.parametrize("order", [0, 1])
def test_the_noise_of_derivatives_is_that_of_white_noise_below_the_edge(
    measured: Campaign, order: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not that of a record's ends: the integral of the density of white noise times that of the derivatives and the low-pass."""
    equations = equations_of(measured, SHAFT)
    equations.edge, record = 40.0, equations.records[0]
    monkeypatch.setattr(type(equations.combos), "orders", {"w_motor": order, "w_load": order})
    found = equations._processed_noise(record, [("w_load", 2, 1.0)], SAMPLES)
    frequency = np.linspace(0.0, 60.0, 6001)
    density = 2.0 * record.noise["w_load"] ** 2 / RATE * lowpass_gain(frequency, 40.0) ** 2
    power = np.trapezoid(density * (2.0 * np.pi * frequency) ** (2 * (2 - order)), frequency)
    assert found == pytest.approx(np.sqrt(power), rel=0.1)


def test_both_sides_of_an_equation_pass_one_low_pass() -> None:
    time = np.arange(4000) / RATE
    signal = np.sin(2.0 * np.pi * 31.0 * time) + np.sin(2.0 * np.pi * 48.0 * time)
    run = SlidingRun(
        run=0, force=shortly_low_passed(signal, RATE, 50.0), deflection=time, velocity=np.ones(4000),
        fixed=signal[:, None], time=time,
        usable=np.ones(4000, dtype=bool), slow=np.zeros(4000), slow_velocity=np.zeros(4000),
    )  # fmt: skip
    sliding = Sliding(
        [run], RATE, 0.1, integrated=False, drifts=False, stiffness=0.0, noise=0.0, velocity_noise=0.0, parts=1.0, edge=50.0,
        rubs=False,
    )  # fmt: skip
    for block in sliding.active[1:-1]:
        matrix, _ = sliding.evaluated(block, lambda d, v, one, place: one.fixed[place])
        assert matrix[:, 0] == pytest.approx(run.force[block.first + block.used], abs=1e-12)


@pytest.mark.parametrize(("frequency", "passed"), [(30.0, (0.98, 1.02)), (72.0, (-0.015, 0.015)), (200.0, (-0.015, 0.015))])
def test_the_short_low_pass_passes_what_is_below_its_edge(frequency: float, passed: tuple[float, float]) -> None:
    time = np.arange(4000) / RATE
    seen = shortly_low_passed(np.cos(2.0 * np.pi * frequency * time), RATE, 50.0)
    assert passed[0] <= seen[2000] / np.cos(2.0 * np.pi * frequency * time[2000]) <= passed[1]


def test_a_record_shorter_than_the_low_pass_passes_it() -> None:
    assert shortly_low_passed(np.ones(9), RATE, 50.0).shape == (9,)


def test_an_equation_of_noise_holds() -> None:
    """Its noise may be 1.6 times as large as estimated."""
    sliding = object.__new__(Sliding)
    sliding.noise, sliding.power, sliding.parts = 1.0, 0.0, 0.0
    assert sliding.allowed == pytest.approx(1.6**2)
    assert system.PERIODS_OF_CUT == 4.0
