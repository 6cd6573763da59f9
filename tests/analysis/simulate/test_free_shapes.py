"""Tabulated laws against the formulas that they sample, and elements in a row against a plain integration in small steps."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from isorig.analysis import laws
from isorig.analysis.campaign import FloatArray
from isorig.analysis.errors import ModelError
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation, simulate

RATE, SECONDS = 512.0, 2.0
STIFFNESS, DAMPING = 900.0, 6.0


def rig(law: laws.LinkLaw | None = None, friction: laws.FrictionLaw | None = None) -> RigModel:
    """A kilogram on a soft spring, with one more law."""
    return RigModel(
        name="one law",
        bodies=(Body(name="m", mass=1.0),),
        links=(Link(name="spring", a="m", stiffness=STIFFNESS, damping=DAMPING, laws=(law,) if law else ()),),
        contacts=(Contact(name="rubbing", a="m", law=friction),) if friction else (),
        drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}, quantity="force"),
        sensors=(
            Sensor(channel="x", body="m", quantity="displacement"),
            Sensor(channel="v", body="m", quantity="velocity"),
        ),
    )


def drive() -> Excitation:
    """Three sines that reach some millimetres and about 0.3 m/s, in N."""
    t = np.arange(round(SECONDS * RATE)) / RATE
    force = 9.0 * np.sin(2 * np.pi * 3.1 * t) + 6.0 * np.sin(2 * np.pi * 5.3 * t) + 3.0 * np.sin(2 * np.pi * 0.9 * t)
    return Excitation.prepare(force, RATE, oversample=4)


def apart(one: RigModel, other: RigModel) -> float:
    """Largest difference of the two rigs' positions as a share of the first one's rms."""
    x, y = (simulate(model, drive()).channels["x"] for model in (one, other))
    return float(np.abs(x - y).max() / np.std(x))


def test_a_spline_through_a_cubic_spring_moves_like_it() -> None:
    at = np.linspace(-0.05, 0.05, 41)
    curve = laws.Curve(over="deflection", at=tuple(at), values=tuple(4e5 * at**3))
    assert apart(rig(laws.Cubic(cubic_stiffness=4e5)), rig(curve)) < 1e-4
    assert apart(rig(laws.Cubic(cubic_stiffness=4e5)), rig()) > 0.1


def test_a_spline_through_quadratic_damping_moves_like_it() -> None:
    at = np.linspace(-1.0, 1.0, 65)
    curve = laws.Curve(over="speed", at=tuple(at), values=tuple(20.0 * at * np.abs(at)))
    assert apart(rig(laws.QuadraticDamping(quadratic_damping=20.0)), rig(curve)) < 2e-3


def test_a_stiffness_over_time_moves_like_a_drift() -> None:
    curve = laws.Curve(over="time", at=(0.0, 1.0), values=(0.0, 0.2 * STIFFNESS))
    assert apart(rig(laws.Drift(drift_rate=0.2, until=1.0)), rig(curve)) < 1e-12


@pytest.mark.parametrize("over", ["speed", "position", "time"])
def test_a_constant_level_is_coulomb_friction(over: str) -> None:
    curve = msgspec.convert({"law": "friction_curve", "over": over, "at": [0.0, 0.3], "levels": [2.0, 2.0]}, laws.FrictionCurve)
    assert apart(rig(friction=laws.Coulomb(friction_force=2.0)), rig(friction=curve)) < 1e-9


def test_a_level_over_speed_moves_like_stribeck_friction() -> None:
    at = 0.6 * np.linspace(0.0, 1.0, 33) ** 2
    curve = laws.FrictionCurve(over="speed", at=tuple(at), levels=tuple(1.5 + 1.5 * np.exp(-at / 0.05)))
    law = laws.Stribeck(friction_force=1.5, static_force=3.0, stribeck_velocity=0.05)
    assert apart(rig(friction=law), rig(friction=curve)) < 1e-3


def test_levels_each_way_are_asymmetric_friction() -> None:
    curve = laws.FrictionCurve(over="speed", at=(0.0, 1.0), levels=(1.0, 1.5), backward=(2.0, 3.0))
    law = laws.Asymmetric(forward_force=1.0, backward_force=2.0, forward_viscosity=0.5, backward_viscosity=1.0)
    assert apart(rig(friction=law), rig(friction=curve)) < 1e-6


def stepped(force_of: object, steps: int = 400) -> FloatArray:
    """Position at the samples by semi-implicit Euler steps, the law's force a function of (d, v, dt) that remembers."""
    fine = np.interp(np.arange(round(SECONDS * RATE) * steps) / (RATE * steps), np.arange(round(SECONDS * RATE)) / RATE, WAVE)
    x, v, dt, out = 0.0, 0.0, 1.0 / (RATE * steps), []
    for k, push in enumerate(fine):
        if k % steps == 0:
            out.append(x)
        v += dt * (push - STIFFNESS * x - DAMPING * v - force_of(x, v, dt))  # type: ignore[operator]
        x += dt * v
    return np.array(out)


WAVE = drive().recorded


class Row:
    """Play, spring and slider as a plain rule."""

    def __init__(self, stiffness: float, slip: float, play: float) -> None:
        self.k, self.slip, self.play, self.u = stiffness, slip, play, 0.0

    def __call__(self, d: float, v: float, dt: float) -> float:
        reach = self.slip / self.k + self.play
        self.u = min(max(self.u, d - reach), d + reach)
        x = d - self.u
        return self.k * (np.sign(x) * max(abs(x) - self.play, 0.0))


class SpringAndDamper:
    """A spring and a damper in a row as a plain rule."""

    def __init__(self, stiffness: float, damping: float) -> None:
        self.k, self.c, self.f = stiffness, damping, 0.0

    def __call__(self, d: float, v: float, dt: float) -> float:
        self.f += dt * (self.k * v - self.k / self.c * self.f)
        return self.f


@pytest.mark.parametrize("clearance", [0.0, 0.003])
def test_play_spring_and_slider_in_a_row(clearance: float) -> None:
    law = laws.ElastoSlip(spring_stiffness=2000.0, slip_force=4.0, clearance=clearance)
    found = simulate(rig(law), drive()).channels["x"]
    wanted = stepped(Row(2000.0, 4.0, clearance))
    assert np.abs(found - wanted).max() < 2e-3 * np.std(wanted)
    assert np.abs(found - stepped(Row(2000.0, 4.4, clearance), steps=40)).max() > 2e-2 * np.std(wanted)


def test_spring_and_damper_in_a_row() -> None:
    law = laws.Maxwell(relaxation_stiffness=1500.0, relaxation_time=0.02)
    found = simulate(rig(law), drive()).channels["x"]
    wanted = stepped(SpringAndDamper(1500.0, 30.0))
    assert np.abs(found - wanted).max() < 2e-3 * np.std(wanted)


@pytest.mark.parametrize("frequency", [2.0, 8.0, 30.0])
def test_a_relaxing_link_has_its_complex_stiffness(frequency: float) -> None:
    # Standard linear solid: k + c j w + k1 j w T / (1 + j w T).
    k1, time = 1500.0, 0.02
    model = rig(laws.Maxwell(relaxation_stiffness=k1, relaxation_time=time))
    link, mass = model.links[0], model.bodies[0].mass
    jw, t = 2j * np.pi * frequency, np.arange(8192) / RATE
    x = simulate(model, Excitation.prepare(np.sin(2 * np.pi * frequency * t), RATE, oversample=8)).channels["x"]
    # The last four seconds hold whole periods, after the free vibration.
    ratio = 2j * np.mean((x * np.exp(-jw * t))[-4096:])
    wanted = 1.0 / (mass * jw**2 + link.damping * jw + link.stiffness + k1 * jw * time / (1.0 + jw * time))
    assert abs(ratio - wanted) < 1e-3 * abs(wanted)
    elongation, rate = np.sin(2 * np.pi * frequency * t), (jw * np.exp(jw * t) / 1j).real
    along = model.links[0].laws[0].along(elongation, rate, RATE)
    force = 2j * np.mean((along * np.exp(-jw * t))[-4096:])
    assert abs(force - k1 * jw * time / (1.0 + jw * time)) < 5e-3 * k1


def test_friction_that_varies_with_the_place_breaks_away_where_it_is_weak() -> None:
    # Held where the level is 3 N, a slowly growing push breaks away at 3 N however large the level is elsewhere.
    law = laws.FrictionCurve(over="position", at=(-0.01, 0.0, 0.01), levels=(9.0, 3.0, 9.0))
    held = msgspec.structs.replace(rig(friction=law), links=(Link(name="spring", a="m", stiffness=1e-9),))
    for push, moves in ((2.99, False), (3.01, True)):
        ramp = np.minimum(np.arange(2048) / 1024.0, 1.0) * push
        found = simulate(held, Excitation.prepare(ramp, RATE, oversample=1)).channels["x"]
        assert bool(np.abs(found[1024:]).max() > 1e-4) is moves


@pytest.mark.parametrize(
    ("law", "told"),
    [
        ({"over": "deflection", "at": [0.0, 1.0], "values": [1.0]}, "2 points and 1 values"),
        ({"over": "deflection", "at": [0.0], "values": [1.0]}, "1 points"),
        ({"over": "deflection", "at": [0.0, 0.0], "values": [1.0, 1.0]}, "do not increase"),
        ({"over": "speed", "at": [0.0, float("nan")], "values": [1.0, 1.0]}, "not finite"),
    ],
)
def test_a_curve_that_is_none_is_refused(law: dict[str, object], told: str) -> None:
    with pytest.raises((ModelError, msgspec.ValidationError), match=told):
        msgspec.convert({"law": "curve", **law}, laws.Curve)


def test_friction_levels_below_zero_are_refused() -> None:
    with pytest.raises(ModelError, match="zero or more"):
        laws.FrictionCurve(over="speed", at=(0.0, 1.0), levels=(1.0, -1.0))
