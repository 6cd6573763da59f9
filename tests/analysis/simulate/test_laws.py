"""Every law against its formula, the forces read off a free run; sensors, rocking and several contacts against closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from isorig.analysis import laws
from isorig.analysis.errors import SimulationError
from isorig.analysis.model.rig_model import Body, Chain, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation, simulate, trace
from isorig.analysis.simulate.excitation import random
from isorig.rig.wire_bonder.description import one_mass, wire_bonder
from thesis.friction import CONTACTS, LINKS, SENSORS, rubbed, sprung, swung

RATE = 8192.0
FORMULAS = {
    "viscous": lambda v: 30.0 * v,
    "Coulomb": lambda v: 10.0 * np.sign(v),
    "Coulomb with static": lambda v: 10.0 * np.sign(v),
    "Stribeck, exponential": lambda v: (10.0 + 6.0 * np.exp(-np.abs(v) / 0.05)) * np.sign(v),
    "Stribeck, rational": lambda v: (10.0 + 6.0 / (1.0 + np.abs(v) / 0.05)) * np.sign(v),
    "arctan": lambda v: 20.0 / np.pi * np.arctan(v / 0.02),
    "arctan, static and viscous": lambda v: (
        (10.0 + 6.0 * np.exp(-np.abs(v) / 0.05)) * 2.0 / np.pi * np.arctan(v / 0.005) + 15.0 * v
    ),
    "Karnopp": lambda v: 10.0 * np.sign(v),
    "Karnopp, falling and viscous": lambda v: (10.0 + 6.0 * np.exp(-np.abs(v) / 0.05)) * np.sign(v) + 15.0 * v,
    "asymmetric": lambda v: np.where(v > 0, 6.0 + 10.0 * v, -12.0),
}


def away_from_changes(times: list[float], n: int) -> np.ndarray:
    # A sample's force counts a change within half a sample, so those beside one are neither before nor after.
    kept = np.ones(n, dtype=bool)
    for time in times:
        k = int(time * RATE)
        kept[max(k - 1, 0) : k + 3] = False
    return kept


@pytest.mark.parametrize("name", FORMULAS)
def test_a_sliding_contact_resists_by_its_formula(name: str) -> None:
    found = swung(rubbed(CONTACTS[name]), 28.0)
    v, f = found.response.channels["v"], found.friction["rubbing"]
    slow = 0.03 if name.startswith("Karnopp") else 1e-4
    kept = (np.abs(v) > slow) & away_from_changes([change.time for change in found.changes], len(v))
    assert kept.sum() > 5_000
    assert np.abs(f[kept] - FORMULAS[name](v[kept])).max() < 1e-6 * np.abs(f).max()


@pytest.mark.parametrize(
    ("law", "breakaway"),
    [
        (CONTACTS["Coulomb"], 10.0),
        (CONTACTS["Coulomb with static"], 16.0),
        (CONTACTS["Stribeck, exponential"], 16.0),
        (CONTACTS["Stribeck, rational"], 16.0),
        (CONTACTS["Karnopp"], 16.0),
        (CONTACTS["Karnopp, falling and viscous"], 16.0),
        (CONTACTS["asymmetric"], 6.0),
    ],
    ids=str,
)
def test_a_contact_breaks_away_at_its_force(law: laws.FrictionLaw, breakaway: float) -> None:
    ramp = 20.0 * np.arange(4096) / 2048.0
    first = trace(rubbed(law), Excitation.prepare(ramp, 2048.0, oversample=1)).changes[0]
    assert first.slides == 1
    assert first.time == pytest.approx(breakaway / 20.0, rel=1e-12)


@pytest.mark.parametrize("name", ["Karnopp", "Karnopp, falling and viscous"])
def test_a_contact_held_in_karnopps_band_keeps_its_speed(name: str) -> None:
    found = swung(rubbed(CONTACTS[name]), 28.0)
    v, held = found.response.channels["v"], found.held["rubbing"] == 1.0
    kept = held[1:] & held[:-1]
    assert kept.sum() > 100
    assert np.abs(np.diff(v)[kept]).max() < 1e-12
    assert np.abs(v[held]).max() <= 0.03


def test_dahls_force_between_reversals() -> None:
    """df/dx = s (1 - f sign(v) / Fc) from (x0, f0) on: f = S Fc + (f0 - S Fc) exp(-s |x - x0| / Fc), Dahl 1968."""
    found = swung(rubbed(CONTACTS["Dahl"]), 28.0)
    x, v, f = found.response.channels["x"], found.response.channels["v"], found.friction["rubbing"]
    turns = np.flatnonzero(np.diff(np.sign(v[1:]))) + 2
    for begin, end in pairwise(turns[2:]):
        way, sign = np.abs(x[begin:end] - x[begin]), np.sign(v[begin + 1])
        want = 10.0 * sign + (f[begin] - 10.0 * sign) * np.exp(-2e3 * way / 10.0)
        assert np.abs(f[begin:end] - want).max() < 1e-5


def test_lugre_is_a_spring_before_it_slides_and_rests_on_its_curve() -> None:
    """Small: s0 x; steady: g(v) + s2 v (Canudas de Wit et al. 1995, eq. 4 and 6)."""
    law = laws.LuGre(
        friction_force=10.0, static_force=16.0, stribeck_velocity=0.05, bristle_stiffness=1e5, viscous_coefficient=5.0
    )
    small = swung(rubbed(law), 0.01)
    x, f = small.response.channels["x"], small.friction["rubbing"]
    assert np.abs(f - 1e5 * x).max() < 2e-3 * np.abs(f).max()
    free = replace(rubbed(law), links=())
    steady = trace(free, Excitation.prepare(np.full(8 * 2048, 18.0), 2048.0, oversample=1))
    v, f = steady.response.channels["v"][-1], steady.friction["rubbing"][-1]
    assert f == pytest.approx(18.0, rel=1e-6)
    assert f == pytest.approx(10.0 + 6.0 * np.exp(-((v / 0.05) ** 2)) + 5.0 * v, rel=1e-6)


SPRINGS = {
    "hardening": lambda d, v, t: 500.0 * d + 2.0 * v + 3e5 * d**3,
    "softening": lambda d, v, t: 500.0 * d + 2.0 * v - 6e4 * d**3,
    "bounded softening": lambda d, v, t: 500.0 * (0.2 * d + 0.8 * 0.01 * np.tanh(d / 0.01)) + 2.0 * v,
    "backlash": lambda d, v, t: 500.0 * np.sign(d) * np.maximum(np.abs(d) - 0.01, 0.0) + 2.0 * v,
    "quadratic damping": lambda d, v, t: 500.0 * d + 2.0 * v + 60.0 * v * np.abs(v),
    "drift": lambda d, v, t: 500.0 * (1.0 + 0.15 * t) * d + 2.0 * v,
}


@pytest.mark.parametrize("name", SPRINGS)
def test_a_link_passes_on_what_its_formula_says(name: str) -> None:
    found = swung(sprung(LINKS[name]), 16.0)
    d, v, f = found.response.channels["x"], found.response.channels["v"], found.transmitted["spring"]
    t = np.arange(len(d)) / RATE
    assert np.abs(f - SPRINGS[name](d, v, t)).max() < 1e-6 * np.abs(f).max()


def test_an_end_stop_presses_and_never_pulls() -> None:
    found = swung(sprung(LINKS["end stop"]), 16.0)
    d, v, f = found.response.channels["x"], found.response.channels["v"], found.transmitted["spring"]
    stop = f - 500.0 * d - 2.0 * v
    over = np.abs(d) - 0.025
    want = np.where(over > 0.0, np.maximum(4e3 * over + 5.0 * v * np.sign(d), 0.0) * np.sign(d), 0.0)
    # The force of a damped stop jumps as it is met: leave out the samples beside that.
    met = np.flatnonzero(np.diff((over > 0.0).astype(int)))
    kept = away_from_changes([k / RATE for k in met], len(d))
    assert np.abs(stop - want)[kept].max() < 1e-6 * np.abs(f).max()
    assert (over > 0.0).sum() > 500


def test_drift_holds_its_last_value() -> None:
    law = laws.Drift(drift_rate=0.5, until=1.0)
    found = swung(sprung(law), 16.0)
    d, v, f = found.response.channels["x"], found.response.channels["v"], found.transmitted["spring"]
    t = np.arange(len(d)) / RATE
    assert np.abs(f - 500.0 * (1.0 + 0.5 * np.minimum(t, 1.0)) * d - 2.0 * v).max() < 1e-5 * np.abs(f).max()


def test_faults_of_a_measurement_chain() -> None:
    model = wire_bonder(friction=False)
    tone = np.sin(2.0 * np.pi * 16.0 * np.arange(8192) / 1024.0)
    excitation = Excitation.prepare(tone, 1024.0)
    true = simulate(model, excitation).channels
    faults = {
        "motor": Chain(gain=1.2, delay=2.5e-3),
        "table": Chain(limit=0.02),
        "heatblock": Chain(crosstalk={"motor": 0.1}, offset=0.3),
    }
    faulty = replace(model, sensors=tuple(replace(s, chain=faults[s.channel]) for s in model.sensors))
    seen = simulate(faulty, excitation, as_recorded=True).channels
    assert np.array_equal(simulate(faulty, excitation).channels["motor"], true["motor"])
    late = slice(4096, 8192 - 128)
    w = np.exp(-2j * np.pi * 16.0 * np.arange(8192) / 1024.0)[late]
    turned = (seen["motor"][late] @ w) / (true["motor"][late] @ w)
    assert turned == pytest.approx(1.2 * np.exp(-2j * np.pi * 16.0 * 2.5e-3), rel=2e-3)
    assert np.array_equal(seen["table"], np.clip(true["table"], -0.02, 0.02))
    assert np.abs(seen["table"]).max() == 0.02
    assert np.allclose(seen["heatblock"], true["heatblock"] + 0.1 * true["motor"] + 0.3, atol=1e-12)


def test_a_drive_off_the_centre_of_gravity_rocks_the_motor() -> None:
    """Two bearings 0.2 m apart, the drive 0.05 m off the axis, an accelerometer 0.03 m off: against the hand-written matrices."""
    m, j, k, c, kr, cr, e, s = 16.0, 0.3, 2e4, 60.0, 4e3, 3.0, 0.05, 0.03
    model = RigModel(
        name="rocking",
        bodies=(Body(name="motor", mass=m), Body(name="rock", mass=j)),
        links=(
            Link(name="isolation", a="motor", stiffness=k, damping=c, arms={"rock": 0.02}),
            Link(name="bearings", a="rock", stiffness=kr, damping=cr),
        ),
        drive=Drive(channel="force", factor=1.0, pushes={"motor": -1.0, "rock": -e}, quantity="force"),
        sensors=(Sensor(channel="seen", body="motor", quantity="displacement", arms={"rock": s}),),
    )
    rate, n, line = 2048.0, 8192, 60
    w = 2.0 * np.pi * line * rate / n
    drive = np.tile(np.cos(w * np.arange(n) / rate), 6)
    seen = simulate(model, Excitation.prepare(drive, rate)).channels["seen"][-2 * n : -n]
    got = 2.0 / n * (seen @ np.exp(-1j * w * np.arange(n) / rate))
    mass = np.diag([m, j])
    stiffness = k * np.outer([1, 0.02], [1, 0.02]) + np.diag([0.0, kr])
    damping = c * np.outer([1, 0.02], [1, 0.02]) + np.diag([0.0, cr])
    want = np.array([1, s]) @ np.linalg.solve(stiffness + 1j * w * damping - w**2 * mass, np.array([-1.0, -e]))
    assert abs(got / want - 1.0) < 3e-4


def test_a_body_may_carry_an_extra_mode() -> None:
    """A light oscillator takes the table's motion away at its own frequency: the classical absorber (Den Hartog)."""
    plain = wire_bonder(friction=False)
    f = 30.0
    absorber = Link(name="extra", a="extra", b="table", stiffness=(2 * np.pi * f) ** 2 * 4.0)
    model = replace(plain, bodies=(*plain.bodies, Body(name="extra", mass=4.0)), links=(*plain.links, absorber))
    drive = np.sin(2.0 * np.pi * f * np.arange(65536) / 1024.0)
    excitation = Excitation.prepare(drive, 1024.0)
    quiet, loud = (simulate(rig, excitation).channels["table"][-8192:] for rig in (model, plain))
    w = np.exp(-2j * np.pi * f * np.arange(8192) / 1024.0)
    assert abs(quiet @ w) < 1e-3 * abs(loud @ w)


def test_contacts_side_by_side_are_each_alone() -> None:
    """Three separate masses in one rig, each on its own rubbing ground."""
    laws_of = {"a": laws.Coulomb(friction_force=8.0), "b": CONTACTS["Stribeck, exponential"], "c": CONTACTS["asymmetric"]}
    bodies = tuple(Body(name=name, mass=1.0 + k) for k, name in enumerate(laws_of))
    model = RigModel(
        name="three",
        bodies=bodies,
        links=tuple(Link(name=b.name, a=b.name, stiffness=700.0, damping=5.0) for b in bodies),
        contacts=tuple(Contact(name=name, a=name, law=law) for name, law in laws_of.items()),
        drive=Drive(channel="force", factor=1.0, pushes={name: 1.0 + k for k, name in enumerate(laws_of)}, quantity="force"),
        sensors=tuple(Sensor(channel=name, body=name, quantity="velocity") for name in laws_of),
    )
    drive = random(samples=4096, sample_rate=2048.0, rms=12.0, band=(1.0, 100.0), seed=3)
    excitation = Excitation.prepare(drive, 2048.0, oversample=1)
    together = simulate(model, excitation).channels
    for k, (name, law) in enumerate(laws_of.items()):
        alone = replace(
            rubbed(law, stiffness=700.0),
            bodies=(Body(name="m", mass=1.0 + k),),
            links=(Link(name="spring", a="m", stiffness=700.0, damping=5.0),),
            drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0 + k}, quantity="force"),
        )
        want = simulate(alone, excitation).channels["v"]
        assert np.abs(together[name] - want).max() < 1e-7 * np.abs(want).max(), name


def test_contacts_in_a_chain_share_the_holding_force() -> None:
    """A block on a block on the ground, both held: each contact carries what is above it."""
    model = RigModel(
        name="stack",
        bodies=(Body(name="low", mass=3.0), Body(name="high", mass=2.0)),
        contacts=(
            Contact(name="ground", a="low", law=laws.Coulomb(friction_force=20.0)),
            Contact(name="between", a="high", b="low", law=laws.Coulomb(friction_force=8.0)),
        ),
        drive=Drive(channel="force", factor=1.0, pushes={"high": 1.0}, quantity="force"),
        sensors=(
            Sensor(channel="high", body="high", quantity="velocity"),
            Sensor(channel="low", body="low", quantity="velocity"),
        ),
    )
    ramp = np.linspace(0.0, 12.0, 2049)
    found = trace(model, Excitation.prepare(ramp, 2048.0, oversample=1))
    # The upper breaks away at 8 N and the lower, which feels those 8 N alone, never does.
    assert [(change.contact, change.slides) for change in found.changes] == [("between", 1)]
    assert found.changes[0].time == pytest.approx(8.0 / 12.0, rel=1e-9)
    held = np.arange(2049) < 1360
    assert np.allclose(found.friction["ground"][held], ramp[held], atol=1e-9)
    assert np.allclose(found.friction["between"][held], ramp[held], atol=1e-9)
    assert found.friction["ground"][-1] == pytest.approx(8.0, rel=1e-9)
    t = 1.0 - 8.0 / 12.0 * 2049 / 2048
    assert found.response.channels["high"][-1] == pytest.approx(12.0 * t**2 / 2.0 / 2.0, rel=2e-2)
    assert np.abs(found.response.channels["low"]).max() < 1e-12


def test_a_softening_spring_without_restoring_force_is_reported() -> None:
    model = sprung(laws.Cubic(cubic_stiffness=-1e6))
    with pytest.raises(SimulationError, match="grows without bound"):
        simulate(model, Excitation.prepare(np.full(8192, 40.0), 2048.0))


def test_forces_inside_balance_the_motion() -> None:
    model = wire_bonder()
    drive = random(samples=4096, sample_rate=1024.0, rms=3.8, band=(0.5, 20.0), seed=1)
    found = trace(model, Excitation.prepare(drive, 1024.0, oversample=32))
    pushed, motion = -model.drive.factor * drive, found.response.channels
    table = model.link("table")
    assert {*found.transmitted} == {"table", "heatblock", "isolation"}
    kept = slice(40, -40)
    left = model.body("motor").mass * motion["motor"] - pushed + found.transmitted["isolation"]
    assert np.std(left[kept]) < 2e-3 * np.std(pushed)
    left = (
        model.body("table").mass * motion["table"]
        - found.transmitted["isolation"]
        - found.transmitted["heatblock"]
        + found.transmitted["table"]
    )
    assert table.b == "ground"
    assert np.std(left[kept]) < 2e-3 * np.std(pushed)
    assert found.response.channels.keys() == {"motor", "table", "heatblock"}
    same = simulate(model, Excitation.prepare(drive, 1024.0, oversample=32)).channels
    assert all(np.array_equal(same[name], motion[name]) for name in same)
    # Changes come in turns: what slides was held or slid the other way before.
    states = [change.slides for change in found.changes]
    assert all(a != b for a, b in pairwise(states))
    share = found.held["isolation"]
    assert 0.0 <= share.min() <= share.max() <= 1.0
    times = np.array([change.time for change in found.changes])
    stuck = sum(b - a for a, b, s in zip(times, [*times[1:], 4.0], states, strict=True) if s == 0) + times[0]
    assert share.mean() * 4.0 == pytest.approx(stuck, rel=1e-3)


def test_a_locked_rig_has_no_friction_inside() -> None:
    found = trace(one_mass(), Excitation.prepare(np.ones(256), 1024.0), configuration="locked")
    assert found.friction == found.held == found.transmitted == {}
    assert SENSORS
