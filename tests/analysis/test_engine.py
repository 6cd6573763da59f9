"""The engine against closed forms, tight-tolerance integration, and recordings of another program."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from isorig.analysis import laws
from isorig.analysis.diagnose.causes.at_link import added
from isorig.analysis.errors import DataError, ModelError
from isorig.analysis.model.rig_model import Body, Configuration, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.excitation import half_sine
from isorig.rig.files.recording import read
from isorig.rig.wire_bonder.description import THESIS, wire_bonder


def one_mass(friction: float = 0.0, law: laws.LinkLaw | None = None) -> RigModel:
    return RigModel(
        name="one mass",
        bodies=(Body(name="m", mass=10.0),),
        links=(Link(name="s", a="m", stiffness=9869.6, damping=157.0, laws=() if law is None else (law,)),),
        contacts=(Contact(name="s", a="m", law=laws.Coulomb(friction_force=friction)),) if friction else (),
        drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}, quantity="force"),
        sensors=(Sensor(channel="x", body="m", quantity="displacement"),),
        configurations={"unlocked": Configuration()},
    )


def test_linear_rig_against_the_closed_form() -> None:
    rate, n, line = 1024.0, 65536, 640
    w = 2 * np.pi * line * rate / n
    drive = 50.0 * np.sin(w * np.arange(n) / rate)
    response = simulate(one_mass(), Excitation.prepare(drive, rate, oversample=16))
    tail = response.channels["x"][n // 2 :]
    got = 2.0 / len(tail) * np.vdot(np.exp(1j * w * np.arange(n // 2, n) / rate), tail)
    want = -1j * 50.0 / (9869.6 - 10.0 * w**2 + 1j * w * 157.0)
    # The interpolation filter is flat to 1e-4 (Kaiser window, beta 8).
    assert abs(got / want - 1.0) < 1e-4


@pytest.mark.parametrize("law", [None, laws.Cubic(cubic_stiffness=3e7), laws.QuadraticDamping(quadratic_damping=300.0)], ids=str)
def test_sliding_against_tight_integration(law: laws.LinkLaw | None) -> None:
    rate, over = 1024.0, 8
    t = np.arange(600) / rate
    drive = 400.0 * np.sin(2 * np.pi * 4.0 * t) * np.minimum(t / 0.1, 1.0)
    excitation = Excitation.prepare(drive, rate, oversample=over)
    model = one_mass(20.0, law)
    got = simulate(model, excitation).channels["x"]
    h = 1.0 / (rate * over)

    def rhs(time: float, z: np.ndarray, sign: float) -> list[float]:
        k = min(int(time / h), len(excitation.fine) - 2)
        f = excitation.fine[k] + (excitation.fine[k + 1] - excitation.fine[k]) * (time / h - k)
        spring = 9869.6 * z[0] + 157.0 * z[1]
        if isinstance(law, laws.Cubic):
            spring += law.cubic_stiffness * z[0] ** 3
        elif isinstance(law, laws.QuadraticDamping):
            spring += law.quadratic_damping * z[1] * abs(z[1])
        return [z[1], (f - spring - 20.0 * sign) / 10.0]

    # Breakaway where the drive passes 20 N, then phase by phase with the reversal as a terminal event.
    time = float(np.interp(20.0, excitation.fine[: over * 30], np.arange(over * 30) * h))
    z, sign, want_t, want_x = np.zeros(2), 1.0, [0.0], [0.0]
    end = 0.3

    def reversal(time: float, z: np.ndarray, sign: float) -> float:
        return float(z[1])

    reversal.terminal = True  # type: ignore[attr-defined]
    while time < end:
        reversal.direction = -sign  # type: ignore[attr-defined]
        piece = solve_ivp(rhs, (time, end), z, args=(sign,), events=reversal, rtol=1e-10, atol=1e-13, max_step=h * 4)
        want_t += piece.t[1:].tolist()
        want_x += piece.y[0, 1:].tolist()
        time, z = float(piece.t[-1]), piece.y[:, -1].copy()
        if time < end:
            z[1] = 0.0
            push = rhs(time, z, 0.0)[1] * 10.0
            assert abs(push) > 20.0, "the case was chosen to reverse without sticking"
            sign = float(np.sign(push))
            time += 0.0
            z[1] = sign * 1e-12
    samples = np.arange(20, 280)
    want = np.interp(samples / rate, want_t, want_x)
    assert np.abs(got[samples] - want).max() < 2e-3 * np.abs(want).max()


@pytest.mark.parametrize(("friction", "stays"), [(200.0, True), (20.0, False)])
def test_thesis_one_mass_stays_or_swings(friction: float, stays: bool) -> None:
    rate = 1024.0
    t = np.arange(2048) / rate
    drive = np.where(t < 0.1, 500.0 * np.sin(np.pi * t / 0.1), 0.0)
    x = simulate(one_mass(friction), Excitation.prepare(drive, rate)).channels["x"]
    assert np.ptp(x[-200:]) < 1e-6
    # With 200 N it rests off centre where it went, with 20 N it swings back and rests near the middle.
    assert bool(abs(x[-300]) * 9869.6 > 50.0) is stays
    assert abs(x[-300]) * 9869.6 <= friction * 1.01


def test_undriven_rig_stays_at_rest() -> None:
    response = simulate(wire_bonder(), Excitation.prepare(np.zeros(256), 1024.0))
    assert all(np.abs(values).max() == 0.0 for values in response.channels.values())


def test_locked_motor_rides_on_the_table() -> None:
    drive = np.random.default_rng(5).normal(size=2048)
    response = simulate(wire_bonder(), Excitation.prepare(drive, 1024.0), configuration="locked")
    assert np.allclose(response.channels["motor"], response.channels["table"], atol=1e-12)


def test_a_free_law_is_the_law_of_its_limit() -> None:
    drive = 3.0 * np.random.default_rng(6).normal(size=4096)
    plain = wire_bonder({**THESIS, "friction_force": 5.0})
    link = plain.link("isolation")
    excitation = Excitation.prepare(drive, 1024.0)
    want = simulate(plain, excitation).channels["motor"]
    for law in (
        laws.Cubic(cubic_stiffness=0.0),
        laws.BoundedSoftening(softening=0.0, scale=1e-3),
        laws.Backlash(clearance=0.0),
        laws.EndStop(stroke=1.0, contact_stiffness=1e6),
        laws.QuadraticDamping(quadratic_damping=0.0),
        laws.Drift(drift_rate=0.0),
    ):
        got = simulate(added(plain, link, law), excitation).channels["motor"]
        assert np.abs(got - want).max() < 1e-6 * np.abs(want).max(), law


def test_campaign_of_another_program(shared: Path) -> None:
    answers = json.loads((shared / "campaigns" / "answers.json").read_text())["campaign-a"]
    campaign = read(shared / "campaigns" / "campaign-a.h5")
    model = wire_bonder(answers["rig"])
    for run in campaign.runs:
        excitation = Excitation.prepare(run.read("head"), run.sample_rate)
        response = simulate(model, excitation, configuration=run.configuration)
        for name in ("motor", "table", "heatblock"):
            measured = run.read(name)
            error = float(np.std(response.channels[name] - measured))
            limit = 0.01 * measured.std() if run.gain > 10 else 1.15 * answers["sensor_noise_rms"]
            assert error < limit, (run.id, name)


@settings(max_examples=25, deadline=None)
@given(
    mass=st.floats(0.5, 300.0),
    frequency=st.floats(1.0, 40.0),
    damping_ratio=st.floats(0.0, 0.3),
    friction=st.floats(0.0, 100.0),
)
def test_energy_never_grows_once_the_drive_ends(mass: float, frequency: float, damping_ratio: float, friction: float) -> None:
    omega = 2 * np.pi * frequency
    model = RigModel(
        name="one mass",
        bodies=(Body(name="m", mass=mass),),
        links=(Link(name="s", a="m", stiffness=mass * omega**2, damping=2 * damping_ratio * omega * mass),),
        contacts=(Contact(name="s", a="m", law=laws.Coulomb(friction_force=friction)),),
        drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}, quantity="force"),
        sensors=(
            Sensor(channel="x", body="m", quantity="displacement"),
            Sensor(channel="v", body="m", quantity="velocity"),
        ),
    )
    rate = 2048.0
    drive = half_sine(samples=2048, sample_rate=rate, peak=500.0, length=0.05)
    response = simulate(model, Excitation.prepare(drive, rate))
    energy = 0.5 * mass * (response.channels["v"] ** 2 + (omega * response.channels["x"]) ** 2)
    # The filters of the drive ring for some samples; they are flat to 1e-4.
    quiet = energy[round(0.05 * rate) + 40 : -40]
    assert np.all(np.diff(quiet) <= 1e-3 * energy.max() + 1e-15)


@given(values=st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=5))
def test_a_drive_that_cannot_be_used_is_refused(values: list[float]) -> None:
    if len(values) < 2 or not np.isfinite(values).all():
        with pytest.raises(DataError, match="drive"):
            Excitation.prepare(np.array(values), 1024.0)


@pytest.mark.parametrize("mass", [-1.0, 0.0, np.nan, np.inf])
def test_an_impossible_mass_is_refused(mass: float) -> None:
    with pytest.raises(ModelError, match="mass"):
        wire_bonder().replace({"bodies.motor.mass": mass})
