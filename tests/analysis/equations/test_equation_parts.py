"""Filters, columns, laws and combinations of the equations against closed forms."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import quad
from small_rigs import SESSION, carts, chain, guessed, played, rubbing, stage, with_law
from strange_rigs import StrangeRig, campaign

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Quantity
from isorig.analysis.equations import repeats
from isorig.analysis.equations.balances import Element, balances, elements, locks
from isorig.analysis.equations.columns import SHAPES, Course
from isorig.analysis.equations.filters import ROCKING_DAMPING, resonator, rocked, rocker
from isorig.analysis.equations.hidden import estimable, fitted, transfer
from isorig.analysis.equations.known import law_columns, law_forces
from isorig.analysis.equations.motion import Combinations, derivatives, highpass_gain
from isorig.analysis.equations.ranking import CUTOFFS, GAINS, ROUNDS, Regressions, _Done, ranking
from isorig.analysis.equations.repeats import MOST_INTEGRATED, pitch_of
from isorig.analysis.equations.sliding import Columns, Sliding, SlidingFit, SlidingRun, spline_columns
from isorig.analysis.equations.slip import slip_operator
from isorig.analysis.equations.spectral import DETERMINED, SHORTEST, Prepared, Spectra, _solve
from isorig.analysis.equations.system import HOLDS, Equations, equations_of
from isorig.analysis.model.rig_model import Body, Configuration, Drive, Link, RigModel, Sensor
from isorig.rig.files.rigfile import SHIPPED, read_description
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.session import VirtualRun, virtual_campaign

RATE, N = 100.0, 1000
TIME = np.arange(N) / RATE


def test_an_attached_resonator_is_a_mass_on_a_spring_and_a_damper() -> None:
    mass, own, damping = 2.0, 2.0 * np.pi * 7.0, 0.05
    omega = 2.0 * np.pi * np.array([1.0, 7.0, 30.0])
    force = mass * own**2 + 1j * omega * 2.0 * damping * own * mass
    assert resonator(omega, 7.0, damping) == pytest.approx(force / (force - mass * omega**2))


def test_a_rocking_body_follows_a_sine() -> None:
    """At half its natural frequency: angle, and its derivatives relative to the natural frequency."""
    factor = 1.0 / (1.0 - 0.25 + 2j * 0.035 * 0.5)
    wave = np.exp(2j * np.pi * 5.0 * TIME)
    found = rocked(wave.real, RATE, 10.0)
    for values, relative in zip(found, (1.0, 0.5j, -0.25), strict=True):
        assert values == pytest.approx((relative * factor * wave).real, abs=1e-9)


def course(deflection: float, velocity: float, time: float) -> Course:
    """One sample of an element whose largest deflection is 2 m, largest velocity 3 m/s, until 4 s."""
    return Course(
        deflection=np.array([deflection]), velocity=np.array([velocity]), time=np.array([time]), whole=np.zeros(1),
        place=np.array([0]), rate=RATE, low=-2.0, high=2.0, fastest=3.0, speed=1.5, swing=2.0, own=5.0, end=4.0, memory={},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("shape", "at", "columns"),
    [
        ("damping over velocity", (0.0, 3.0, 0.0), [3.0, 3.0, 3.0]),
        ("damping over velocity", (0.0, -1.5, 0.0), [-0.75, -0.375, 0.75]),
        ("drift of stiffness", (2.0, 0.0, 4.0), [1.0, 1.0]),
        ("drift of stiffness", (1.0, 0.0, 2.0), [0.25, 0.125]),
        ("drift of damping", (0.0, 1.5, 4.0), [1.0, 1.0]),
        ("drift of damping", (0.0, 0.75, 2.0), [0.25, 0.125]),
        ("friction by direction", (0.0, 0.75, 0.0), [1.0]),
        ("friction by direction", (0.0, -0.75, 0.0), [1.0]),
    ],
)
def test_columns_of_a_shape(shape: str, at: tuple[float, float, float], columns: list[float]) -> None:
    found = next(s for s in SHAPES if s.name == shape).columns(course(*at))
    assert found[0] == pytest.approx(columns)


def test_damping_over_deflection_is_a_spline_times_the_velocity() -> None:
    found = next(s for s in SHAPES if s.name == "damping over deflection").columns(course(0.5, 0.75, 0.0))
    assert found[0] == pytest.approx(0.5 * spline_columns(np.array([0.5]), -2.0, 2.0, 32)[0])


def test_shapes_that_need_friction_and_shapes_that_are_smooth() -> None:
    assert {s.name for s in SHAPES if s.with_friction} == {
        "drift of friction", "friction by direction", "friction over velocity", "friction over position", "slip"
    }  # fmt: skip
    assert {s.name for s in SHAPES if s.smooth} == {
        "force over deflection", "friction over position", "damping over deflection"
    }  # fmt: skip
    plain = next(s for s in SHAPES if not s.smooth)
    assert plain.penalty(3, 2, 1.0, 1.0) is None


def test_the_penalty_of_a_curve_is_that_of_its_second_differences() -> None:
    """A curve whose second differences are 0.15 % of the rms force costs as much as the allowed error of one coefficient."""
    smooth = next(s for s in SHAPES if s.smooth)
    penalty = smooth.penalty(3, 1, power=4.0, allowed=0.25)
    assert penalty is not None
    curve = np.array([9.0, 0.0, 0.0, 0.0015 * 2.0])
    assert curve @ penalty @ curve == pytest.approx(0.25)


def test_cubic_splines_over_deflection() -> None:
    found = spline_columns(np.array([-1.0, -0.5, 0.0, 3.0, 9.0]), -1.0, 3.0, 8)
    assert found.shape == (5, 11)
    assert found.sum(axis=1) == pytest.approx(1.0)
    for row, knot in ((0, 0), (1, 1), (2, 2)):
        assert found[row, knot : knot + 3] == pytest.approx([1 / 6, 4 / 6, 1 / 6])
    assert found[3] == pytest.approx(found[4])


def test_a_spring_that_slips() -> None:
    found = slip_operator(np.array([0.0, 0.5, 3.0, 2.5, 1.0, -4.0, -3.5]), 1.0)
    assert found == pytest.approx([0.0, 0.5, 1.0, 0.5, -1.0, -1.0, -0.5])
    assert slip_operator(np.array([0.0, 0.5]), 2.0) == pytest.approx([0.0, 0.25])


CUBIC, MAXWELL = laws.Cubic(cubic_stiffness=5.0), laws.Maxwell(relaxation_stiffness=3.0, relaxation_time=0.02)
SLIP = laws.ElastoSlip(spring_stiffness=1.0, slip_force=1.0)


def rail(*added: laws.LinkLaw) -> tuple[RigModel, Element]:
    model = stage()
    for law in added:
        model = with_law(model, "rail", law)
    return model, elements(model)[0]


@pytest.mark.parametrize(
    ("added", "count"), [((), 0), ((CUBIC,), 1), ((CUBIC, CUBIC), 1), ((MAXWELL,), 1), ((CUBIC, MAXWELL), 2), ((SLIP, CUBIC), 6)]
)
def test_number_of_columns_of_an_elements_laws(added: tuple[laws.LinkLaw, ...], count: int) -> None:
    model, element = rail(*added)
    assert law_columns(element) == count
    if added:
        d, v = np.sin(TIME), np.cos(TIME)
        assert law_forces(model, element, d, v, TIME, RATE).shape == (N, count)


def test_forces_of_laws_along_a_motion() -> None:
    """A cube, and a spring and a damper in series at a sine: k j w T / (1 + j w T)."""
    model, element = rail(CUBIC, MAXWELL)
    wave = np.exp(2j * np.pi * 5.0 * TIME)
    ratio = 2j * np.pi * 5.0 * 0.02
    plain, relaxing = law_forces(model, element, wave.real, wave.imag, TIME, RATE).T
    assert plain == pytest.approx(5.0 * wave.real**3)
    assert relaxing == pytest.approx((3.0 * ratio / (1.0 + ratio) * wave).real, abs=1e-9)


def test_derivatives_of_a_sine() -> None:
    """The limit of derivatives applies to the first one, that of integrals to each."""
    omega, wave = 2.0 * np.pi * 5.0, np.exp(2j * np.pi * 5.0 * TIME)
    inner = slice(200, -200)
    up = derivatives(wave.imag, 0, RATE, 1.0, 5.0).orders
    assert up[1][inner] == pytest.approx((0.5 * 1j * omega * wave).imag[inner], rel=0.01, abs=0.01 * omega)
    assert up[2][inner] == pytest.approx((-0.5 * omega**2 * wave).imag[inner], rel=0.01, abs=0.01 * omega**2)
    down = derivatives(wave.imag, 2, RATE, 1.0, np.inf).orders
    assert down[1][inner] == pytest.approx((wave / (1j * omega)).imag[inner], rel=0.01, abs=0.01 / omega)
    assert down[0][inner] == pytest.approx((-wave / omega**2).imag[inner], rel=0.01, abs=0.01 / omega**2)


@pytest.mark.parametrize("order", [1, 2])
def test_an_integral_is_right_up_to_the_ends_of_a_record_that_is_not_periodic(order: int) -> None:
    """Two sines that end with another value, slope and speed than they began; an accelerometer with a constant error."""
    waves = ((1.0, 2.0 * np.pi * 1.13), (0.4, 2.0 * np.pi * 2.71))
    motion = [sum(a * w**k * np.sin(w * TIME + 0.4 + k * np.pi / 2.0) for a, w in waves) for k in range(3)]
    found = derivatives(motion[order] + 0.3 * (order == 2), order, RATE, 0.25, np.inf).orders
    for k in range(order):
        error = (found[k] - motion[k]) / motion[k].std()
        assert np.abs(error).max() < 0.3
        assert np.abs(error[100:-100]).max() < 0.12


def test_edge_of_the_high_pass() -> None:
    assert highpass_gain(np.array([1.0, 2.0, 3.0, 4.0, 9.0]), 4.0) == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0])


def test_channels_that_give_a_motion() -> None:
    relative = replace(chain(), sensors=(Sensor(channel="a0", body="m0"), Sensor(channel="d", body="m1", relative_to="m0")))
    combos = Combinations(relative)
    assert combos.measured == ("m0", "m1")
    assert combos.of(np.array([0.0, 1.0, 0.0]), 2) == pytest.approx({"a0": 1.0, "d": 1.0})
    assert combos.of(np.array([-1.0, 1.0, 0.0]), 2) == pytest.approx({"d": 1.0})
    assert combos.of(np.array([0.0, 0.0, 1.0]), 2) is None
    assert combos.of(np.zeros(3), 2) == {}


def test_a_rigid_lock_is_an_equation_and_an_elastic_one_is_not() -> None:
    model = wire_bonder()
    (found,) = locks(model, balances(model))
    assert (found.element.name, found.configuration) == ("isolation", "locked")
    elastic = {name: replace(setup, lock_stiffness=1e6) for name, setup in model.configurations.items()}
    assert locks(replace(model, configurations=elastic), ()) == ()


def test_a_force_sensor_gives_the_force_of_its_link() -> None:
    model = stage()
    gauge = Sensor(channel="gauge", force_in="links.rail", quantity="force")
    gauged = replace(model, sensors=(*model.sensors, gauge))
    found = {balance.name: balance.forces for balance in balances(gauged)}
    assert found["force in rail"] == {"gauge": 1.0}
    # A link that is locked in every configuration has no force of its own.
    locked = {name: Configuration(rigid=("rail",)) for name in model.configurations}
    assert "force in rail" not in {balance.name for balance in balances(replace(gauged, configurations=locked))}


def test_the_force_of_an_actuator_moves_its_body_once() -> None:
    """It equals the inertia of the body that it imposes a motion on, and the forces of all elements there."""
    model = read_description(SHIPPED["damper-test"])[0]
    (body,) = model.imposed
    (found,) = (balance for balance in balances(model) if balance.forces)
    assert dict(found.weights) == {body: 1.0}
    acting = {name for element, _ in found.crossing for name in element.names}
    assert acting == {joint.name for joint in model.joints if body in joint.joined}


def row_of(count: int) -> RigModel:
    """Bodies in a row, the first one on the ground, each with a sensor."""
    names = [f"b{k}" for k in range(count)]
    ends = ["ground", *names]
    return replace(
        chain(), bodies=tuple(Body(name=name, mass=1.0) for name in names), free=(),
        links=tuple(Link(name=f"s{k}", a=name, b=ends[k], stiffness=1e3) for k, name in enumerate(names)),
        drive=replace(chain().drive, pushes={names[-1]: 1.0}),
        sensors=tuple(Sensor(channel=f"a{k}", body=name) for k, name in enumerate(names)),
    )  # fmt: skip


@pytest.mark.parametrize(("count", "all_sets"), [(10, True), (11, False)])
def test_up_to_ten_bodies_all_sets_are_considered(count: int, all_sets: bool) -> None:
    """Then every link of a row has an equation that contains no other link."""
    found = balances(row_of(count))
    assert all(len(balance.crossing) == 1 for balance in found) == all_sets


def test_where_a_contact_acts_no_motion_is_estimated() -> None:
    model = replace(chain(), sensors=(Sensor(channel="a0", body="m0"),))
    assert estimable(model) == ("m1", "m2")
    # The contact with the ground acts on one of the two.
    to_ground = replace(rubbing(model, "l2", 1.0).contacts[0], b="ground")
    assert estimable(replace(model, contacts=(to_ground,))) == ()


def test_the_motion_of_a_body_between_two_others() -> None:
    model, omega = chain(), 2.0 * np.pi * np.array([1.0, 8.0, 20.0])
    of_bodies, of_drives = transfer(model, ("m1",), ("m0", "m2"), omega)
    links = [model.link(name).stiffness + 1j * omega * model.link(name).damping for name in ("l1", "l2")]
    own = sum(links) - omega**2 * model.body("m1").mass
    assert of_bodies[:, 0, 0] == pytest.approx(links[0] / own)
    assert of_bodies[:, 0, 1] == pytest.approx(links[1] / own)
    assert of_drives == {}


@pytest.mark.parametrize(("wanted", "found"), [(2.0, 2.0), (0.5, 0.5), (10.0, 3.0), (0.1, 1 / 3)])
def test_values_of_hidden_bodies_are_found_within_a_factor_of_three(wanted: float, found: float) -> None:
    paths = ("links.l1.stiffness", "links.l1.damping")
    given = {path: chain().get(path) for path in paths}

    def left(model: RigModel) -> float:
        return sum(np.log(model.get(path) / (wanted * value)) ** 2 for path, value in given.items())

    best = fitted(chain(), paths, left)
    assert [best.get(path) / value for path, value in given.items()] == pytest.approx([found] * 2, rel=1e-3)


def test_an_error_of_a_channel_in_an_equation() -> None:
    """Its part in the known row less its parts in the others times their values."""
    rows = [{("a", 2): 2.0, ("b", 0): 7.0}, {("a", 0): 3.0}, {("b", 0): 5.0}]
    found = Regressions._error(rows, np.array([0.5, 4.0]), "a", {0: np.full(2, 10.0), 2: np.ones(2)})
    assert found == pytest.approx(2.0 - 0.5 * 3.0 * 10.0)


@pytest.mark.parametrize(("power", "determined"), [(1.01 * DETERMINED, True), (0.99 * DETERMINED, False)])
def test_a_combination_of_signals_that_is_mostly_noise_has_the_coefficient_zero(power: float, determined: bool) -> None:
    """Of two motions with the same noise, their sum is known and their difference has this power over that of its noise."""
    noise = np.diag([0.0, 1.0, 1.0])
    own, shared = 10.0 + 0.5 * power, 10.0 - 0.5 * power
    one, other = _solve(np.array([[9.0, 5.0, 3.0], [5.0, own, shared], [3.0, shared, own]]) + noise, noise).values
    assert one + other == pytest.approx((5.0 + 3.0) / (own + shared))
    assert one - other == pytest.approx((5.0 - 3.0) / (own - shared) if determined else 0.0)


def test_an_equation_without_unknown_values_leaves_its_known_part() -> None:
    found = _solve(np.array([[2.0]]), np.array([[0.5]]))
    assert (found.residual, len(found.values)) == (2.0, 0)


def sliding(integrated: bool, still: float, velocity_noise: float = 0.0, *, rubs: bool = True) -> Sliding:
    """A run of 40 s that is at rest for a share of the time."""
    n = 4000
    velocity = np.where(np.arange(n) < still * n, 0.0, np.cos(2.0 * np.pi * 5.0 * np.arange(n) / RATE))
    run = SlidingRun(
        run=0, force=velocity, deflection=np.cumsum(velocity) / RATE, velocity=velocity, fixed=np.zeros((n, 0)),
        time=np.arange(n) / RATE, usable=np.ones(n, dtype=bool), slow=np.zeros(n), slow_velocity=np.zeros(n),
    )  # fmt: skip
    return Sliding(
        [run], RATE, 0.2, integrated=integrated, drifts=False, stiffness=1.0, noise=0.0, velocity_noise=velocity_noise, parts=1.0,
        edge=np.inf, rubs=rubs,
    )  # fmt: skip


def test_fewer_samples_than_the_slow_part_has_coefficients_leave_it_small_without_a_described_spring() -> None:
    one = sliding(integrated=True, still=0.0, rubs=False)
    one.stiffness, block = 0.0, one.active[0]
    block.used = np.arange(2)
    reduced = one._reduced(block, lambda d, v, run, place: np.column_stack([d, v]), np.array([100.0, 1.0]), damped=False)
    assert np.abs(reduced.back).max() < 10.0


def test_only_a_measured_position_shows_that_an_element_rests() -> None:
    assert sliding(integrated=False, still=0.6).rests
    assert not sliding(integrated=False, still=0.0).rests
    assert not sliding(integrated=True, still=0.6).rests


@pytest.mark.parametrize(
    ("integrated", "noise", "slowest"),
    [(True, 0.0, 0.1), (False, 0.0, 0.03), (False, 0.02, 0.06), (False, 0.05, 0.1)],
)
def test_a_contact_slides_from_a_share_of_the_largest_velocity_on(integrated: bool, noise: float, slowest: float) -> None:
    """Of 10 % if it is integrated; of 3 % if it is measured, from three times its noise on, at most of 10 %."""
    one = sliding(integrated, 0.0)
    assert sliding(integrated, 0.0, noise * one.speed).slow == pytest.approx(slowest * one.speed)


def test_the_slow_part_is_a_spline_and_its_derivative() -> None:
    """Equal coefficients are a constant, rising ones a line; a knot lies between two coefficients."""
    one = sliding(integrated=True, still=0.0, rubs=False)
    assert one._value.sum(axis=1) == pytest.approx(1.0)
    assert one._slope.sum(axis=1) == pytest.approx(0.0, abs=1e-9)
    assert one._slope @ np.arange(4.0) == pytest.approx(RATE / one.knot)


@pytest.mark.parametrize("grid", [CUTOFFS, GAINS])
def test_refinements_of_a_fault_stay_above_zero(grid: np.ndarray) -> None:
    least, step = float(grid[0]), float(grid[1] - grid[0])
    for _ in range(ROUNDS):  # towards zero in every round
        least, step = least - step, step / 4.0
    assert least > 0.0


def test_a_segment_has_twenty_periods_of_the_lowest_mode() -> None:
    """As a power of two samples: of the stage at 4.0 Hz and 400 Hz nearest to 2010."""
    assert equations_of(played(stage(), seed=1, longer=2.0), stage()).length == 2048


def test_blocks_above_three_times_the_median_residual_are_not_sound() -> None:
    """A force that changes its sign from sample to sample, as no column does: its mean square in each block."""
    one = sliding(integrated=False, still=0.0, rubs=False)
    powers = np.array([100.0, 100.0, 290.0, 100.0, 310.0, 100.0, 100.0, 100.0])
    amplitude = np.repeat(np.sqrt(powers), one.length)
    (run,) = one.runs
    run.force = np.resize(amplitude, len(run.force)) * (-1.0) ** np.arange(len(run.force))
    found = one.fit(lambda d, v, run, place: np.column_stack([d, v]), np.zeros(2), 1)
    assert found.sound == (0, 1, 2, 3, 5, 6, 7)


@pytest.mark.parametrize("held_out", [True, False])
def test_noise_of_a_motion_is_removed_where_a_shape_is_added(held_out: bool) -> None:
    """Twice a motion in three runs; its record has noise of its own size, which alone would halve the coefficient."""
    spectra, draw, columns = Spectra(100.0, 256, 1.0, 50.0, [("y", 0), ("x", 0)], {"y": 0, "x": 0}), np.random.default_rng(8), {}
    for run in range(3):
        motion, noise, other = draw.normal(size=(3, 20000))
        spectra.add(run, {("y", 0): 2.0 * motion, ("x", 0): motion + noise}, {"y": 0.0, "x": 1.0})
        columns[run] = spectra.segments(other, run)[None]
    equation = Prepared(spectra, [{("y", 0): 1.0}, {("x", 0): 1.0}], range(3), np.array([2.0]))
    values = equation.shaped(columns, held_out=held_out).values
    assert values == pytest.approx([2.0, 0.0], abs=0.1)


def test_crosstalk_between_positions_is_found_in_an_equation_with_friction() -> None:
    """The position of one cart contains a twentieth of that of the other one; friction acts between both."""
    driven = replace(carts(), drive=Drive(channel="f", pushes={"first": 1.0}, quantity="force"), free=())
    truth, runs = rubbing(driven, "between", 2.0), []
    for run in played(truth, seed=23, takes=SESSION).runs:
        mixed = run.channels["x0"].read() + 0.05 * run.channels["x1"].read()
        x0 = dataclasses.replace(run.channels["x0"], samples=mixed)
        runs.append(dataclasses.replace(run, channels={**run.channels, "x0": x0}))
    equations = equations_of(Campaign(runs=tuple(runs)), truth)
    (name,) = equations.sliding
    tried, base = Regressions(equations, _Done()), equations.sliding[name][1]
    left, share = tried._sliding_fault(name, "crosstalk", "x0", "x1", alone=True)
    assert share == pytest.approx(0.05, rel=0.05)
    assert left < HOLDS < equations.residuals()[name]
    # Spring and damper then have a force from the other cart's position and velocity, of the size of that in the equation.
    for signals, found in zip(equations.signals, tried._faulty(name, "crosstalk", "x0", "x1", base).values(), strict=True):
        force = base.values[0] * signals["x1", 0] + base.values[1] * signals["x1", 1]
        assert np.abs(found) == pytest.approx(np.abs(equations.thinned(force)))


@pytest.mark.parametrize("samples", [4096, 700])
def test_runs_shorter_than_a_segment_count(samples: int) -> None:
    """Their noise is that of white noise in the energy of their own segments."""
    spectra = Spectra(100.0, 2048, 1.0, 50.0, [("a", 0)], {"a": 0})
    found = []
    for seed in range(20):
        spectra.runs.clear()
        spectra.add(0, {("a", 0): np.random.default_rng(seed).normal(0.0, 2.0, samples)}, {"a": 2.0})
        (run,) = spectra.runs
        assert run.segments.shape[1] >= 2
        found.append(float(np.real(run.power.sum() / run.noise.sum())))
    assert np.mean(found) == pytest.approx(1.0, abs=0.1)


def test_a_run_too_short_for_two_segments_does_not_count() -> None:
    assert Spectra(100.0, 2048, 1.0, 50.0, [("a", 0)], {"a": 0}).segments(np.ones(2 * SHORTEST - 1), 0).shape[0] == 0


@pytest.mark.parametrize(("decay", "free", "loud"), [(3.2, True, True), (0.01, True, False), (3.2, False, False)])
def test_the_loud_start_of_a_decay_counts(decay: float, free: bool, loud: bool) -> None:
    """The middle of the first segment is there; otherwise a run's first quarter segment is left out."""
    time = np.arange(4096) / 100.0
    spectra = Spectra(100.0, 1024, 1.0, 50.0, [("a", 0)], {"a": 0})
    spectra.add(0, {("a", 0): np.exp(-decay * time) * np.cos(30.0 * time)}, {"a": 1e-3}, free=free)
    assert (0 in spectra.largest_at_start) == loud
    power = np.sum(np.abs(spectra.runs[0].segments[0]) ** 2, axis=1)
    assert power[0] > 10.0 * power[1] or not loud


@pytest.mark.parametrize(
    ("teeth", "speed", "shown"),
    # At 200 samples per second, a range of 4 m, and 0.5 m/s, the samples show up to 800 periods.
    [(3.0, 0.2, True), (90.0, 0.2, True), (700.5, 0.2, True), (1800.0, 0.2, True), (790.0, 0.5, True), (810.0, 0.5, False)],
)
def test_a_pitch_is_found_over_the_range_of_the_motion(
    teeth: float, speed: float, shown: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw = np.random.default_rng(4)
    d = draw.uniform(-1.0, 3.0, 20000)
    left = np.sin(2.0 * np.pi * teeth * d / 4.0 + 0.7) + draw.normal(0.0, 1.0, len(d))
    monkeypatch.setattr(repeats, "_residual", lambda *given: (d, left))
    runs = [SimpleNamespace(velocity=speed * sign * np.array([1.0, -1.0])) for sign in (1.0, 3.0)]
    sliding = SimpleNamespace(range=(-1.0, 3.0), integrated=teeth < MOST_INTEGRATED, rate=200.0, runs=runs)
    found = pitch_of(cast(Sliding, sliding), cast(SlidingFit, None), cast(Columns, None))
    assert (found == pytest.approx(4.0 / teeth, rel=1e-2 / teeth + 1e-4)) is shown


def test_a_wandering_zero_does_not_hide_the_curve_of_a_joint() -> None:
    """The zero of an accelerometer beside the joint wanders by metres, once integrated twice."""
    model = replace(chain(), sensors=chain().sensors[1:])
    made = played(with_law(chain(), "l2", laws.Cubic(cubic_stiffness=3e8)), seed=5)
    draw, runs = np.random.default_rng(6), []
    for run in made.runs:
        channel = run.channels["a2"]
        wander = np.cumsum(draw.normal(0.0, 1.0, len(run)))
        values = channel.read() + wander * 0.1 * float(np.std(channel.read())) / float(np.std(wander))
        runs.append(dataclasses.replace(run, channels={**run.channels, "a2": dataclasses.replace(channel, samples=values)}))
    equations = equations_of(dataclasses.replace(made, runs=tuple(runs)), model)
    assert equations.wandering == {"a2"}
    best = ranking(equations).explanations[0]
    assert (best.kind, best.place) == ("spring_shape", "l2")


def test_an_elastic_lock_with_damping_is_found_with_its_stiffness() -> None:
    model = wire_bonder()
    locked = Configuration(rigid=("isolation",), lock_stiffness=4e6, lock_damping=4e3)
    takes = [
        VirtualRun(id=f"{configuration}", configuration=configuration, gain=70.0, seconds=30.0, start=start, band=(0.5, 200.0))
        for configuration, start in (("unlocked", 0.0), ("locked", 60.0))
    ]
    campaign = virtual_campaign(replace(model, configurations={**model.configurations, "locked": locked}), takes, seed=3)
    equations = equations_of(campaign, model)
    found = next(e for e in ranking(equations).explanations if e.what == "elastic lock")
    assert found.residuals["lock of isolation"] < 0.01 * equations.residuals()["lock of isolation"]
    assert found.values["stiffness"] == pytest.approx(4e6, rel=0.1)


def test_the_equations_of_a_rig_with_a_body_without_a_sensor_hold() -> None:
    """Its links are given up to a quarter off; the equations find values with which they hold."""
    partly = replace(chain(), sensors=chain().sensors[1:])
    equations = equations_of(played(chain(), seed=21), guessed(partly, 21))
    assert equations.hidden == ("m0",)
    assert max(equations.residuals().values()) < HOLDS


def test_only_the_ends_of_a_run_are_left_out() -> None:
    """Filters act there; no more than a tenth of a run is left out at each end, here less."""
    truth = rubbing(stage(), "rail", 4.0)
    equations = equations_of(played(truth, seed=22), truth)
    (sliding, _), *_ = equations.sliding.values()
    for run in sliding.runs:
        assert 0 < np.argmax(run.usable) < len(run.usable) // 10


def test_an_estimated_motion_adds_no_sensor_noise() -> None:
    rig = StrangeRig(
        masses=(3.0, 2.0, 1.5), joints=((0, -1, 7e3, 12.0), (1, 0, 6e3, 8.0), (2, 1, 5e3, 6.0)),
        sensors=(("a", 0, "acceleration"), ("c", 2, "acceleration")),
    )  # fmt: skip
    measured = campaign(rig, seconds=16.0)
    equations = Equations(measured, rig.description(), [{"a": 0.0, "c": 1e-2}] * len(measured.runs))
    assert equations.hidden == ("m1",)
    share = {element.name: equations.noise_share(element, 1.0) for element in equations.elements()}
    assert share["l0"] == share["l1"] == 0.0
    assert 0.0 < share["l2"] < 0.2


@pytest.mark.parametrize(
    ("stiffness", "free", "solved"), [(0.5, (), True), (0.0, (), False), (0.0, ("links.rail.stiffness",), True)]
)
def test_a_stiffness_is_solved_for_where_it_is_given_or_free(stiffness: float, free: tuple[str, ...], solved: bool) -> None:
    model = replace(stage().replace({"links.rail.stiffness": stiffness}), free=free)
    assert Equations.springs(cast(Equations, SimpleNamespace(model=model)), model.link("rail")) is solved


@pytest.mark.parametrize(("quantity", "integrated"), [("displacement", False), ("velocity", True), ("acceleration", True)])
def test_a_deflection_is_an_integral_unless_it_is_measured(quantity: Quantity, integrated: bool) -> None:
    model = replace(stage(), sensors=(Sensor(channel="s", body="table", quantity=quantity),))
    seen = cast(Equations, SimpleNamespace(combos=Combinations(model), counted=False))
    assert Equations.integrated(seen, elements(model)[0]) is integrated


def test_a_measured_position_of_a_rig_without_a_spring_keeps_its_slow_part() -> None:
    model, travel = replace(stage(), sensors=stage().sensors[:1]), 3.0 + 0.1 * TIME
    seen = SimpleNamespace(
        combos=Combinations(model), counted=True, rate=RATE, edge=np.inf, integrated=lambda element: False, imposing=set()
    )  # fmt: skip
    found, _ = Equations.elongation(cast(Equations, seen), {("x", 0): travel}, elements(model)[0], 1.0)
    assert found == pytest.approx(travel)


def test_noise_of_an_acceleration_integrated_twice() -> None:
    """White noise of spectral density S is S / (2 pi f)^4 as a deflection: its variance from 2 Hz on, by quadrature."""
    model, low, noise = replace(stage(), sensors=stage().sensors[1:]), 2.0, 0.3
    measured = played(model, seed=24)
    equations = Equations(measured, model, [{"a": noise}] * len(measured.runs))
    (element,) = equations.elements()
    density = 2.0 * noise**2 / equations.rate
    variance, _ = quad(lambda f: density / (2.0 * np.pi * f) ** 4, low, np.inf)
    largest = max(float(np.std(equations.elongation(signals, element, low)[0])) for signals in equations.signals)
    assert equations.noise_share(element, low) == pytest.approx(np.sqrt(variance) / largest)


def test_an_equation_whose_sliding_samples_all_vanish_is_not_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples that seem to slide are at rest once the slow part of the motion is known: first all slide, then none."""
    truth = rubbing(chain(), "l1", 4.0)
    measured = played(truth, seed=3)
    (balance,) = (each for each in equations_of(measured, truth).balances if each.rubs)
    assert equations_of(measured, truth).in_time(balance, equations_of(measured, truth).primary(balance)) is not None
    chosen = Sliding.select

    def vanishing(sliding: Sliding) -> int:
        first = not hasattr(sliding, "active")
        count = chosen(sliding)
        if first:
            return count
        for block in sliding.blocks:
            block.used = block.used[:0]
        sliding.active = []
        return 0

    monkeypatch.setattr(Sliding, "select", vanishing)
    equations = equations_of(measured, truth)
    assert equations.in_time(balance, equations.primary(balance)) is None
    assert balance.name not in equations.sliding
    assert balance.name not in equations.residuals()


def test_a_rocking_body_resonates_at_its_frequency() -> None:
    """There the torque of its spring and its inertia cancel, and damping alone is left; far above it has inertia alone."""
    at, above = rocker(2.0 * np.pi * np.array([7.0, 7e4]), 7.0)
    assert at == pytest.approx(-0.5j / ROCKING_DAMPING)
    assert above == pytest.approx(-1.0, abs=1e-4)
