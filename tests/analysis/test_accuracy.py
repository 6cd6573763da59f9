"""The engine against an independent integrator with located events, on a force straight between samples.

A quarter of a second of each case under one drive, and one case each under two other drives, run with every test; ten seconds of
all (as published for other engines) with `make study`.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from reference import Reference, smooth
from scipy.linalg import expm

from isorig.analysis import laws
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, Sensor, matrices
from isorig.analysis.simulate import Excitation, excitation, simulate
from isorig.analysis.simulate.compiled import compile_rig
from isorig.analysis.simulate.free_run import run_rig
from isorig.rig.wire_bonder.description import THESIS, wire_bonder

RATE = 2048.0
K3 = (2 * np.pi * 5.06) ** 2 * 16.4
COULOMB = laws.Coulomb(friction_force=20.0)


def rubbing(law: laws.FrictionLaw, spring: laws.LinkLaw | None = None) -> RigModel:
    model = wire_bonder(THESIS)
    return replace(
        model,
        contacts=(Contact(name="isolation", a="motor", b="table", law=law),),
        drive=Drive(channel="force", factor=1.0, pushes={"motor": 1.0}, quantity="force"),
        links=tuple(replace(link, laws=(spring,)) if spring and link.name == "isolation" else link for link in model.links),
        free=(),
    )


def states(model: RigModel, force: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    width = 2 * len(model.bodies)
    out, log = np.zeros((width, len(force))), np.zeros((100_000, 3))
    changes, compiled = run_rig(model, "unlocked", force, 1.0 / RATE, 0.0, np.eye(width), out, log=log)
    return out, log[:changes], compiled.elements


def force(kind: str, seconds: float) -> np.ndarray:
    n = round(seconds * RATE)
    if kind == "sweep":
        return excitation.sweep(samples=n, sample_rate=RATE, peak=60.0 * np.sqrt(2.0), band=(1.0, 250.0))
    rms = float(kind.removeprefix("random "))
    return excitation.random(samples=n, sample_rate=RATE, rms=rms, band=(1.0, 250.0), seed=int(rms))


PIECEWISE = {
    "coulomb": (COULOMB, None, {"sliding": lambda v, s: 20.0 * s, "static": 20.0}),
    "static": (laws.Coulomb(friction_force=20.0, static_force=26.0), None, {"sliding": lambda v, s: 20.0 * s, "static": 26.0}),
    "backlash": (
        COULOMB,
        laws.Backlash(clearance=4e-4),
        {
            "sliding": lambda v, s: 20.0 * s, "static": 20.0, "corners": (-4e-4, 4e-4),
            "spring": lambda d, v, region: -K3 * (-4e-4, d, 4e-4)[region],
        },
    ),
    "end stop": (
        COULOMB,
        laws.EndStop(stroke=4e-4, contact_stiffness=2e5),
        {
            "sliding": lambda v, s: 20.0 * s, "static": 20.0, "corners": (-4e-4, 4e-4),
            "spring": lambda d, v, region: 2e5 * (d + 4e-4, 0.0, d - 4e-4)[region],
        },
    ),
}  # fmt: skip
CURVED = {
    "stribeck": (
        laws.Stribeck(friction_force=15.0, static_force=20.0, stribeck_velocity=0.01), None,
        {"sliding": lambda v, s: s * (15.0 + 5.0 * np.exp(-s * v / 0.01)), "static": 20.0},
    ),
    "cubic": (
        COULOMB, laws.Cubic(cubic_stiffness=1e9),
        {"sliding": lambda v, s: 20.0 * s, "static": 20.0, "spring": lambda d, v, _: 1e9 * d**3},
    ),
    "bounded softening": (
        COULOMB, laws.BoundedSoftening(softening=0.6, scale=5e-4),
        {"sliding": lambda v, s: 20.0 * s, "static": 20.0, "spring": lambda d, v, _: 0.6 * K3 * (5e-4 * np.tanh(d / 5e-4) - d)},
    ),
    "quadratic damping": (
        COULOMB, laws.QuadraticDamping(quadratic_damping=300.0),
        {"sliding": lambda v, s: 20.0 * s, "static": 20.0, "spring": lambda d, v, _: 300.0 * v * abs(v)},
    ),
}  # fmt: skip
CASES = [*PIECEWISE, *CURVED]
#: Case, drive and seconds: a smaller drive sticks more, the sweep's end slides fast.
QUICK = [*((case, "random 60", 0.25) for case in CASES), ("coulomb", "random 25", 0.25), ("backlash", "sweep", 0.5)]
WHOLE = [(case, kind, 10.0) for case in CASES for kind in ("random 60", "random 25", "sweep")]


@pytest.mark.timeout(900)
@pytest.mark.parametrize(("case", "kind", "seconds"), [*QUICK, *(pytest.param(*each, marks=pytest.mark.study) for each in WHOLE)])
def test_against_located_events(case: str, kind: str, seconds: float) -> None:
    law, spring, written = (PIECEWISE | CURVED)[case]
    drive = force(kind, seconds)
    reference = Reference(**written)
    want = reference.run(drive, 1.0 / RATE).T
    got, log, _ = states(rubbing(law, spring), drive)
    slip, right = got[5] - got[3], want[5] - want[3]
    assert np.abs(slip - right).max() <= (1e-9 if case in PIECEWISE else 1e-6) * np.abs(right).max()
    assert len(log) == reference.changes + reference.corners_met


SMOOTH = {
    "arctan": (
        laws.Arctan(friction_force=20.0, smoothing_velocity=1e-3),
        {"force": lambda inner, v: 20.0 * 2.0 / np.pi * np.arctan(v / 1e-3)},
    ),
    "arctan, static and viscous": (
        laws.Arctan(
            friction_force=15.0, static_force=20.0, stribeck_velocity=0.01, smoothing_velocity=1e-3, viscous_coefficient=2.0
        ),
        {"force": lambda inner, v: (15 + 5 * np.exp(-abs(v) / 0.01)) * 2.0 / np.pi * np.arctan(v / 1e-3) + 2.0 * v},
    ),
    "dahl": (
        laws.Dahl(friction_force=20.0, bristle_stiffness=1e5),
        {"force": lambda inner, v: inner, "memory": lambda inner, v: 1e5 * (v - abs(v) * inner / 20.0)},
    ),
    "lugre": (
        laws.LuGre(
            bristle_stiffness=1e5, bristle_damping=200.0, viscous_coefficient=2.0, friction_force=15.0, static_force=20.0,
            stribeck_velocity=0.01,
        ),
        {
            "force": lambda z, v: 1e5 * z + 200.0 * (v - 1e5 * abs(v) * z / (15 + 5 * np.exp(-((v / 0.01) ** 2)))) + 2.0 * v,
            "memory": lambda z, v: v - 1e5 * abs(v) * z / (15 + 5 * np.exp(-((v / 0.01) ** 2))),
        },
    ),
}  # fmt: skip


@pytest.mark.timeout(900)
@pytest.mark.parametrize("seconds", [0.25, pytest.param(10.0, marks=pytest.mark.study)])
@pytest.mark.parametrize("case", SMOOTH)
def test_laws_that_never_stick(case: str, seconds: float) -> None:
    law, written = SMOOTH[case]
    drive = force("random 60", seconds)
    want = smooth(drive, 1.0 / RATE, **written).T
    got, _, _ = states(rubbing(law), drive)
    assert np.abs((got[5] - got[3]) - (want[5] - want[3])).max() <= 1e-6 * np.abs(want[5] - want[3]).max()


def test_linear_rig_against_its_transfer_function() -> None:
    """A drive straight between samples is its samples convolved with a triangle: sinc^2 on every line, aliases and all."""
    model = replace(rubbing(COULOMB), contacts=())
    n, line = 8192, 200
    w = 2 * np.pi * line * RATE / n
    turns = 60
    drive = np.tile(np.cos(w * np.arange(n) / RATE), turns)
    got, _, _ = states(model, drive)
    tail = got[:, -n:]
    mass, damping, stiffness = matrices(model)

    def compliance(omega: float) -> np.ndarray:
        return np.linalg.solve(stiffness + 1j * omega * damping - omega**2 * mass, np.array([0.0, 0.0, 1.0]))

    # Images of the line at multiples of the sample rate come through the triangle and fold back on sampling.
    want = np.zeros(3, dtype=complex)
    for image in range(-400, 401):
        omega = w + 2 * np.pi * RATE * image
        want += compliance(omega) * np.sinc(omega / (2 * np.pi * RATE)) ** 2
    seen = 2.0 / n * (tail[:3] @ np.exp(-1j * w * np.arange(n) / RATE))
    assert np.abs(seen - want).max() <= 1e-9 * np.abs(want).max()


@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_an_undriven_rig_never_gains_energy(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 4))
    number = st.floats(0.2, 5.0)
    names = [f"b{k}" for k in range(count)]
    bodies = tuple(Body(name=name, mass=10.0 * data.draw(number)) for name in names)
    links = tuple(
        Link(
            name=name,
            a=name,
            b=names[k - 1] if k else "ground",
            stiffness=2e4 * data.draw(number),
            damping=20 * data.draw(number),
        )
        for k, name in enumerate(names)
    )
    contacts = tuple(
        Contact(
            name=f"c{k}",
            a=names[data.draw(st.integers(0, count - 1))],
            law=laws.Coulomb(friction_force=10.0 * data.draw(number)),
        )
        for k in range(data.draw(st.integers(0, 3)))
    )
    model = RigModel(
        name="random", bodies=bodies, links=links, contacts=contacts,
        drive=Drive(channel="force", factor=1.0, pushes={names[-1]: 1.0}, quantity="force"),
        sensors=(Sensor(channel="x", body=names[0], quantity="displacement"),),
    )  # fmt: skip
    drive = np.zeros(2048)
    drive[:80] = 500.0 * np.sin(np.pi * np.arange(80) / 80)
    got, _, _ = states(model, drive)
    mass, _, stiffness = matrices(model)
    x, v = got[:count, 81:], got[count:, 81:]
    energy = 0.5 * np.einsum("it,ij,jt->t", x, stiffness, x) + 0.5 * np.einsum("it,ij,jt->t", v, mass, v)
    assert np.all(np.diff(energy) <= 1e-12 * max(energy.max(), 1e-30))


@pytest.mark.parametrize("cubic_stiffness", [1e9, 1e12, 1e14, 1e16])
def test_a_spring_that_bends_much_within_a_step_keeps_its_energy(cubic_stiffness: float) -> None:
    """v^2 / 2 + k d^2 / 2 + k3 d^4 / 4 of a kilogram, at up to a quarter of a period per step."""
    model = RigModel(
        name="hardening",
        bodies=(Body(name="m", mass=1.0),),
        links=(Link(name="s", a="m", stiffness=100.0, laws=(laws.Cubic(cubic_stiffness=cubic_stiffness),)),),
        drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}, quantity="force"),
        sensors=(Sensor(channel="x", body="m", quantity="displacement"),),
    )
    drive = np.zeros(4096)
    drive[:40] = 20.0
    got, _, _ = states(model, drive)
    d, v = got[0, 41:], got[1, 41:]
    energy = 0.5 * v**2 + 50.0 * d**2 + 0.25 * cubic_stiffness * d**4
    assert np.abs(energy / energy[0] - 1.0).max() < 5e-6


def test_stiff_stop_is_cut_into_safe_steps() -> None:
    """A stop far stiffer than the step allows bounces back with the energy it came with."""
    model = RigModel(
        name="bouncing",
        bodies=(Body(name="m", mass=1.0),),
        links=(Link(name="s", a="m", stiffness=100.0, laws=(laws.EndStop(stroke=0.01, contact_stiffness=1e9),)),),
        drive=Drive(channel="force", factor=1.0, pushes={"m": 1.0}, quantity="force"),
        sensors=(Sensor(channel="x", body="m", quantity="displacement"),),
    )
    drive = np.zeros(4096)
    drive[:40] = 20.0
    got, log, _ = states(model, drive)
    assert len(log) > 20
    energy = 50.0 * got[0] ** 2 + 0.5 * got[1] ** 2 + 0.5e9 * np.maximum(np.abs(got[0]) - 0.01, 0.0) ** 2
    assert np.ptp(energy[41:]) < 1e-7 * energy[41]


def test_exact_step_is_the_matrix_exponential() -> None:
    model = replace(rubbing(COULOMB), contacts=())
    mass, damping, stiffness = matrices(model)
    step = 1.0 / RATE
    system = np.zeros((9, 9))
    system[:3, 3:6] = np.eye(3)
    system[3:6] = np.linalg.solve(mass, np.column_stack([-stiffness, -damping, np.zeros(3), [0.0, 0.0, 1.0], np.zeros(3)]))
    system[7, 8] = 1.0
    scale = np.array([1, 1, 1, step, step, step, 1, 1, step])
    want = scale[:, None] * expm(system * step) / scale
    whole = compile_rig(model, "unlocked", step).rig.whole
    assert np.allclose(whole[0, 0, :, :6].T, want[:6], rtol=1e-13, atol=1e-15)


def test_sampled_response_is_the_same_motion() -> None:
    drive = force("random 60", 1.0)
    model = replace(rubbing(COULOMB), sensors=(Sensor(channel="v", body="motor", quantity="velocity"),))
    excited = Excitation.prepare(drive, RATE, oversample=1)
    assert np.array_equal(simulate(model, excited).channels["v"], states(model, drive)[0][5])
