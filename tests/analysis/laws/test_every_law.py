"""Every law that there is: complete, documented, and its simulated force equal to its formula across its envelope."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from msgspec.structs import fields
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from isorig.analysis import laws
from isorig.analysis.errors import ModelError, SimulationError
from isorig.analysis.laws.base import LinkConstants
from isorig.analysis.laws.hysteresis import SHORT, maxwell_carry
from isorig.analysis.model.parameter_units import rotational, unit_of
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor
from isorig.analysis.simulate import Excitation, trace

RATE, SECONDS = 2048.0, 1.5
STIFFNESS, DAMPING = 600.0, 3.0
LINK = LinkConstants(stiffness=STIFFNESS, damping=DAMPING)
PAGE = (Path(__file__).parents[3] / "docs" / "friction.md").read_text(encoding="utf-8")


def tag_of(law: type[laws.Law]) -> str:
    return str(law.__struct_config__.tag)


def broken_away(law: type[laws.Law], draw: np.random.Generator, ranges: dict[str, tuple[float, float]]) -> laws.Law:
    """A law with parameters from ranges; its breakaway is a multiple of its sliding friction."""
    force = float(draw.uniform(1.0, 12.0))
    values = {name: float(draw.uniform(*ends)) for name, ends in ranges.items()}
    return law(**{**values, "friction_force": force, "static_force": force * values["static_force"]})


def drawn_curve(draw: np.random.Generator) -> laws.Law:
    at = np.linspace(-1.0, 1.0, 9) * draw.uniform(0.01, 0.02)
    values = np.sort(draw.uniform(-5.0, 5.0, 9))
    return laws.Curve(over="deflection", at=tuple(at.tolist()), values=tuple((values - values[4]).tolist()))


def drawn_levels(draw: np.random.Generator) -> laws.Law:
    at = tuple(np.linspace(-0.02, 0.02, 7).tolist())
    return laws.FrictionCurve(over="position", at=at, levels=tuple(draw.uniform(3.0, 8.0, 7).tolist()))


def drawn_sliders(draw: np.random.Generator) -> laws.Law:
    count = int(draw.integers(1, 7))
    stiffnesses, forces = draw.uniform(2e2, 3e3, count), draw.uniform(0.3, 3.0, count)
    return laws.MaxwellSlip(stiffnesses=tuple(stiffnesses.tolist()), slip_forces=tuple(forces.tolist()))


#: Ranges, in the order in which they are drawn, of laws with a breakaway force: narrower than the envelope.
BREAKING: dict[type[laws.Law], dict[str, tuple[float, float]]] = {
    laws.Coulomb: {"static_force": (1.0, 1.6)},
    laws.Stribeck: {"static_force": (1.1, 1.6), "stribeck_velocity": (0.02, 0.1), "exponent": (1.0, 2.0)},
    laws.Arctan: {
        "smoothing_velocity": (5e-3, 0.05), "static_force": (1.0, 1.6), "stribeck_velocity": (0.02, 0.1), "exponent": (1.0, 2.0),
        "viscous_coefficient": (0.0, 20.0),
    },
    laws.Karnopp: {
        "static_force": (1.0, 1.6), "band": (1e-3, 0.03), "stribeck_velocity": (0.02, 0.1), "exponent": (1.0, 2.0),
        "viscous_coefficient": (0.0, 20.0),
    },
    laws.LuGre: {
        "bristle_stiffness": (1e3, 1e4), "static_force": (1.0, 1.6), "stribeck_velocity": (0.02, 0.1),
        "bristle_damping": (0.0, 20.0), "viscous_coefficient": (0.0, 20.0),
    },
}  # fmt: skip
#: Laws with tables.
TABLES = {laws.Curve: drawn_curve, laws.FrictionCurve: drawn_levels, laws.MaxwellSlip: drawn_sliders}


def drawn_law(law: type[laws.Law], seed: int) -> laws.Law:
    """A law with parameters from its envelope, log-uniform if the range is above zero; what it refuses is drawn again."""
    draw = np.random.default_rng(seed)
    if law in TABLES:
        return TABLES[law](draw)
    if law in BREAKING:
        return broken_away(law, draw, BREAKING[law])
    while True:
        values = {}
        for name, p in law.parameters.items():
            even = float(draw.uniform(0.0, 1.0))
            values[name] = p.low * (p.high / p.low) ** even if p.low > 0.0 else p.low + (p.high - p.low) * even
        with suppress(ModelError):
            return law(**values)


def rig(law: laws.Law) -> RigModel:
    """A kilogram on a soft spring, with the law."""
    spring = isinstance(law, laws.SpringLaw)
    return RigModel(
        name="one law",
        bodies=(Body(name="m", mass=1.0),),
        links=(Link(name="joint", a="m", stiffness=STIFFNESS, damping=DAMPING, laws=(law,) if spring else ()),),
        contacts=() if spring else (Contact(name="joint", a="m", law=law),),
        drive=Drive(channel="u", factor=1.0, pushes={"m": 1.0}, quantity="force"),
        sensors=(Sensor(channel="x", body="m", quantity="displacement"), Sensor(channel="v", body="m", quantity="velocity")),
    )


def simulated(law: laws.Law) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Position, speed and the law's force on samples, and which samples are not beside a change of state or held."""
    t = np.arange(round(SECONDS * RATE)) / RATE
    drive = 18.0 * np.sin(2.0 * np.pi * 1.3 * t) * np.minimum(t / 0.3, 1.0) + 5.0 * np.sin(2.0 * np.pi * 7.1 * t)
    found = trace(rig(law), Excitation.prepare(drive, RATE, oversample=1))
    d, v = found.response.channels["x"], found.response.channels["v"]
    kept = np.ones(len(t), dtype=bool)
    if isinstance(law, laws.SpringLaw):
        force = found.transmitted["joint"] - STIFFNESS * d - DAMPING * v
    else:
        force = found.friction["joint"]
        kept &= found.held["joint"] == 0.0
        for change in found.changes:
            k = int(change.time * RATE)
            kept[max(k - 2, 0) : k + 4] = False
    return d, v, force, kept


@pytest.mark.parametrize("law", laws.LAWS, ids=tag_of)
def test_a_law_is_complete(law: type[laws.Law]) -> None:
    numbers = {field.name for field in fields(law) if "float" in str(field.type)}
    assert set(law.parameters) == numbers, "each number has a unit and an envelope"
    for name, p in law.parameters.items():
        assert p.low < p.high
        assert unit_of(f"law.{name}") == p.unit or name in ("at", "values", "levels", "backward")
        assert set(re.findall("[A-Za-z]+", p.unit)) <= {"kg", "N", "m", "s"}, "its unit at a rotating part follows from these"
    assert f"`{tag_of(law)}`" in PAGE, "docs/friction.md has a row for it"
    assert law.__doc__
    for method in ("element", "force"):
        assert getattr(law, method) is not getattr(laws.Law, method), f"{method} is written"
    if law.remembers:
        assert law.rates is not laws.Law.rates
    assert drawn_law(law, 0) != drawn_law(law, 1)


def test_units_of_rotating_parts_follow_from_those_of_translating_parts() -> None:
    pairs = {
        "kg": "kg m^2", "N": "N m", "m": "rad", "m/s": "rad/s", "N/m": "N m/rad", "N s/m": "N m s/rad", "N/m^3": "N m/rad^3",
        "N s^2/m^2": "N m s^2/rad^2", "1/s": "1/s", "1": "1", "s": "s",
    }  # fmt: skip
    assert {unit: rotational(unit) for unit in pairs} == pairs


@pytest.mark.parametrize(
    ("law", "seed"),
    [
        *((law, 1) for law in laws.LAWS),
        # scipy's integration of a memory takes a quarter of a second and more.
        *(pytest.param(law, 2, marks=[pytest.mark.study] if law.remembers else []) for law in laws.LAWS),
    ],
)
def test_the_simulated_force_is_the_formulas(law: type[laws.Law], seed: int) -> None:
    the_simulated_force_is_the_formulas(drawn_law(law, seed))


@pytest.mark.parametrize("end", [1, -1])
@pytest.mark.parametrize("damping", [0.0, 20.0])
def test_a_stop_acts_at_one_end_only(end: Literal[1, -1], damping: float) -> None:
    law = laws.EndStop(stroke=0.008, contact_stiffness=5e3, contact_damping=damping, end=end)
    d, _, force, _ = simulated(law)
    pressed = (end * force)[end * d > 1.1 * law.stroke]
    assert pressed.max() > 1.0
    assert pressed.min() > -1e-6 * pressed.max()  # a damped one separates before
    assert np.abs(force[end * d < 0.9 * law.stroke]).max() < 1e-6 * np.abs(force).max()
    assert (end * d < -1.5 * law.stroke).any()
    the_simulated_force_is_the_formulas(law)


def jumps(law: laws.Law, d: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The last samples before a law's force jumps: it changes its state, and the forces of both states differ there."""
    element = law.element(LINK)
    assert element is not None
    found = [np.zeros(0, dtype=int)]
    for state in element.states:
        for end in state.exits:
            after, margin = element.states[end.to], end.const + end.d * d + end.v * v
            last = np.flatnonzero(np.diff((margin < 0.0).astype(int)))
            passed = margin[last] / (margin[last] - margin[last + 1])
            at_end, speed = (x[last] + passed * np.diff(x)[last] for x in (d, v))
            step = state.const - after.const + (state.d - after.d) * at_end + (state.v - after.v) * speed
            found.append(last[np.abs(step) > 1e-9 * np.abs(after.const)])
    return np.concatenate(found)


def the_simulated_force_is_the_formulas(drawn: laws.Law) -> None:
    """Laws that remember: their rates by scipy's integrator along the simulated motion."""
    d, v, force, kept = simulated(drawn)
    t = np.arange(len(d)) / RATE
    memory = np.zeros((len(drawn.begun()), len(d)))
    if drawn.remembers:
        motion = CubicSpline(t, np.stack([d, v], axis=1))
        found = solve_ivp(
            lambda now, z: drawn.rates(*motion(now).tolist(), z), (0.0, t[-1]), drawn.begun(), t_eval=t, rtol=1e-7, atol=1e-10,
            max_step=1.0 / RATE,
        )  # fmt: skip
        memory = found.y
    want = drawn.force(d, v, t, memory, LINK)
    if isinstance(drawn, laws.SpringLaw):
        # The samples around a jump of the force are left out.
        kept[np.unique(np.clip(jumps(drawn, d, v)[:, None] + np.arange(-2, 4), 0, len(d) - 1))] = False
    kept &= np.isfinite(want)
    assert kept.sum() > 100
    assert np.abs(force - want)[kept].max() < (2e-3 if drawn.remembers else 1e-5) * np.abs(want[kept]).max()


@pytest.mark.parametrize("law", [kind for kind in laws.LAWS if kind.remembers], ids=tag_of)
def test_the_force_along_a_measured_motion_is_the_simulated_one(law: type[laws.Law]) -> None:
    drawn = drawn_law(law, 3)
    d, v, force, _ = simulated(drawn)
    along = drawn.along(d, v, RATE, LINK)
    assert np.std(along - force) < 1e-3 * np.std(force)
    # Starting values are fitted with one course for all constants of the link.
    assert np.array_equal(along, drawn.along(d, v, RATE))


def test_the_force_within_karnopps_band_is_refused() -> None:
    law = laws.Karnopp(friction_force=5.0, static_force=6.0, band=0.01)
    outside, inside = np.array([0.02, -0.03]), np.array([0.02, 0.005])
    assert law.along(np.zeros(2), outside, RATE).tolist() == [5.0, -5.0]
    with pytest.raises(SimulationError, match="1 of 2 samples are within Karnopp's band"):
        law.along(np.zeros(2), inside, RATE)


def test_a_very_stiff_loop_slides_at_once() -> None:
    """Each sample slides 1e8 times as far as the force takes to build up: what has built up is not integrated further."""
    law = laws.BoucWen(friction_force=1e-3, initial_stiffness=1e9, sharpness=2.0, pinching=0.7)
    v = np.repeat([0.1, -0.1, 0.1], 20)
    force = law.along(np.cumsum(v) / 1000.0, v, 1000.0)
    np.testing.assert_allclose(force[1:], 1e-3 * np.sign(v[1:]), rtol=1e-9)  # nothing slides before the first sample


def test_bouc_wen_with_full_pinching_is_dahl() -> None:
    one = laws.BoucWen(friction_force=5.0, initial_stiffness=4e3, sharpness=1.0, pinching=1.0)
    other = laws.Dahl(friction_force=5.0, bristle_stiffness=4e3)
    x, y = simulated(one)[0], simulated(other)[0]
    assert np.abs(x - y).max() < 1e-5 * np.abs(y).max()


def test_maxwell_slip_is_its_sliders_side_by_side() -> None:
    one = laws.MaxwellSlip(stiffnesses=(2000.0, 700.0, 300.0), slip_forces=(1.0, 2.0, 2.5))
    rows = [laws.ElastoSlip(spring_stiffness=k, slip_force=f) for k, f in zip(one.stiffnesses, one.slip_forces, strict=True)]
    t = np.arange(round(SECONDS * RATE)) / RATE
    drive = Excitation.prepare(18.0 * np.sin(2.0 * np.pi * 1.3 * t), RATE, oversample=1)
    base = rig(rows[0])
    side_by_side = RigModel(
        name="side by side", bodies=base.bodies, drive=base.drive, sensors=base.sensors,
        links=(Link(name="joint", a="m", stiffness=STIFFNESS, damping=DAMPING, laws=tuple(rows)),),
    )  # fmt: skip
    x, y = (trace(model, drive).response.channels["x"] for model in (rig(one), side_by_side))
    assert np.abs(x - y).max() < 1e-5 * np.abs(y).max()


def test_friction_that_depends_on_the_place_breaks_away_at_its_level_there() -> None:
    law = laws.PositionDependent(friction_force=5.0, ripple=2.0, pitch=0.01)
    ramp = np.linspace(0.0, 10.0, 2049)
    found = trace(rig(law), Excitation.prepare(ramp, RATE, oversample=1))
    # 5 + 2 cos 0 at rest.
    assert found.changes[0].time == pytest.approx(0.7, rel=1e-3)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize(
    "law",
    [
        laws.ElastoSlip(spring_stiffness=900.0, slip_force=4.0, clearance=0.002),
        laws.ElastoSlip(spring_stiffness=900.0, slip_force=4.0),
        laws.MaxwellSlip(stiffnesses=(500.0, 900.0, 300.0), slip_forces=(1.0, 4.0, 3.0)),
    ],
    ids=["play and slider", "slider", "row of sliders"],
)  # fmt: skip
def test_the_distance_to_a_kink_ends_where_the_slope_changes(law: laws.Law, seed: int) -> None:
    draw = np.random.default_rng(seed)
    element = law.element(LINK)
    assert element is not None
    formula, p = element.formula, np.array(element.params)
    assert formula is not None
    assert formula.carry is not None
    assert formula.to_kink is not None
    carry, count = formula.carry, element.memories

    def force(memory: np.ndarray, d0: float, d1: float) -> tuple[float, np.ndarray]:
        after = np.zeros(count)
        carry(p, memory, after, d0, d1, d1 - d0, d1 - d0, d1 - d0, 0.0, 1.0, 1.0)
        return formula.resist(p, 1.0, after, d1, 0.0, 0.0), after

    # A reachable memory: after some random moves.
    d, memory = 0.0, np.zeros(count)
    for target in draw.uniform(-0.02, 0.02, 5):
        _, memory = force(memory, d, target)
        d = target
    sign = float(draw.choice([-1.0, 1.0]))
    for _ in range(6):
        # Beyond the last kink by more than rounding.
        d += sign * 1e-9
        distance = formula.to_kink(p, memory, d, sign)
        reach = min(distance, 0.02)
        grid = d + sign * reach * np.array([0.0, 0.25, 0.5, 0.75, 1.0])
        forces = [force(memory, d, x)[0] for x in grid]
        slopes = np.diff(forces) / np.diff(grid)
        assert slopes == pytest.approx(slopes[0], abs=1e-6 * element.steepest[0])
        if distance == np.inf:
            break
        beyond = (force(memory, d, grid[-1] + sign * 1e-5)[0] - forces[-1]) / (sign * 1e-5)
        assert abs(beyond - slopes[-1]) > 0.05 * element.steepest[0]
        _, memory = force(memory, d, grid[-1])
        d = grid[-1]
    assert distance == np.inf


@pytest.mark.parametrize("constants", [1e-8, SHORT, np.nextafter(SHORT, 1.0), 1.0, 50.0])
def test_a_relaxation_is_exact_in_short_and_long_steps(constants: float) -> None:
    """From an eighth to seven eighths of a step that takes so many time constants between them, by scipy's integrator."""
    velocity, after, h = np.array([0.3, -0.5, 0.4]), np.zeros(1), 1e-3
    parameters = np.array([1e3, 0.75 * h / constants])
    maxwell_carry(parameters, np.array([2.0]), after, 0.0, 0.0, *velocity, 0.125, 0.875, h)
    course = np.polynomial.Polynomial.fit([0.0, 0.5 * h, h], velocity, 2)
    found = solve_ivp(
        lambda t, f: parameters[0] * course(t) - f / parameters[1], (0.125 * h, 0.875 * h), [2.0], rtol=1e-12, atol=1e-14
    )  # fmt: skip
    assert after[0] == pytest.approx(found.y[0, -1], rel=1e-8)
