"""Contacts that change at one instant, against two other methods: located events with bounded least squares, small steps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from reference_contacts import Located, time_stepped

from isorig.analysis import laws
from isorig.analysis.campaign import FloatArray, IntArray
from isorig.analysis.errors import SimulationError
from isorig.analysis.model.rig_model import Body, Contact, Drive, Link, RigModel, direction, matrices
from isorig.analysis.simulate import free_run
from isorig.analysis.simulate.compiled import compile_rig
from isorig.analysis.simulate.excitation import random
from isorig.analysis.simulate.free_run import run_rig
from isorig.rig.wire_bonder.description import THESIS, one_mass, wire_bonder

RATE = 2048.0


def rig(
    masses: dict[str, float],
    springs: dict[tuple[str, str], tuple[float, float]],
    frictions: list[tuple[str, str, float, float]],
    pushes: dict[str, float],
) -> RigModel:
    """Bodies in kg, springs and dampers between them in N/m and N s/m, contacts with sliding and breakaway friction in N."""
    return RigModel(
        name="rubbing",
        bodies=tuple(Body(name=name, mass=mass) for name, mass in masses.items()),
        links=tuple(Link(name=f"{a}-{b}", a=a, b=b, stiffness=k, damping=c) for (a, b), (k, c) in springs.items()),
        contacts=tuple(
            Contact(name=f"{a}-{b} {k}", a=a, b=b, law=laws.Coulomb(friction_force=sliding, static_force=breakaway))
            for k, (a, b, sliding, breakaway) in enumerate(frictions)
        ),
        drive=Drive(channel="u", factor=1.0, pushes=pushes, quantity="force"),
    )


def reference(model: RigModel) -> Located:
    mass, damping, stiffness = matrices(model)
    push = sum(weight * direction(model, name, "ground", {}) for name, weight in model.drive.pushes.items())
    # Contacts between the same two bodies are one.
    merged: dict[tuple[str, str], list[float]] = {}
    for contact in model.contacts:
        level = merged.setdefault((contact.a, contact.b), [0.0, 0.0])
        level[0] += contact.law.friction_force
        level[1] += contact.law.static_force
    sliding, breakaway = np.array(list(merged.values())).T
    rows = np.array([direction(model, a, b, {}) for a, b in merged])
    return Located(mass, damping, stiffness, push, rows, sliding, breakaway)


def engine(model: RigModel, drive: FloatArray, rate: float = RATE) -> tuple[FloatArray, FloatArray]:
    """Positions and speeds at the samples, shape (samples, 2 n), and the changes of state."""
    width = 2 * len(model.bodies)
    out, log = np.zeros((width, len(drive))), np.zeros((100_000, 3))
    changes, _ = run_rig(model, "unlocked", drive, 1.0 / rate, 0.0, np.eye(width), out, log=log)
    return out.T, log[:changes]


def noise(rms: float, seconds: float = 0.25, seed: int = 1) -> FloatArray:
    return random(samples=round(seconds * RATE), sample_rate=RATE, rms=rms, band=(1.0, 150.0), seed=seed)


def apart(got: FloatArray, want: FloatArray) -> float:
    """Largest error of a speed as a share of the largest speed."""
    n = want.shape[1] // 2
    return float(np.abs(got - want)[:, n:].max() / np.abs(want[:, n:]).max())


BONDER = wire_bonder(THESIS)
PAIR, SPRING = {"a": 5.0, "b": 5.0}, (1e4, 2.0)
CHAIN = {"low": 30.0, "high": 7.0}
CASES = {
    "two alike, pushed alike": (
        rig(PAIR, {("a", "ground"): SPRING, ("b", "ground"): SPRING}, [("a", "ground", 12.0, 12.0), ("b", "ground", 12.0, 12.0)],
            {"a": 1.0, "b": 1.0}),
        30.0,
    ),
    "two alike that rub on each other": (
        rig(PAIR, {("a", "ground"): SPRING, ("b", "ground"): SPRING}, [("a", "ground", 12.0, 12.0), ("a", "b", 9.0, 9.0)],
            {"a": 1.0, "b": 1.0}),
        30.0,
    ),
    "a chain": (
        rig(CHAIN, {("low", "ground"): (9e4, 80.0), ("high", "low"): (8e3, 9.0)},
            [("low", "ground", 40.0, 40.0), ("high", "low", 22.0, 22.0)], {"high": 1.0}),
        90.0,
    ),
    "a chain that breaks away late": (
        rig(CHAIN, {("low", "ground"): (9e4, 80.0), ("high", "low"): (8e3, 9.0)},
            [("low", "ground", 40.0, 52.0), ("high", "low", 22.0, 30.0)], {"high": 1.0}),
        90.0,
    ),
    "the wire bonder rubbing at isolation and table": (
        rig({body.name: body.mass for body in BONDER.bodies},
            {(link.a, link.b): (link.stiffness, link.damping) for link in BONDER.links},
            [("motor", "table", 20.0, 26.0), ("table", "ground", 10.0, 13.0)], {"motor": 1.0}),
        60.0,
    ),
    "two contacts between the same bodies": (
        rig(CHAIN, {("low", "ground"): (9e4, 80.0), ("high", "low"): (8e3, 9.0)},
            [("high", "low", 14.0, 17.0), ("high", "low", 8.0, 11.0), ("low", "ground", 25.0, 25.0)], {"high": 1.0}),
        80.0,
    ),
    "a loop of three contacts": (
        rig(CHAIN, {("low", "ground"): (9e4, 80.0), ("high", "low"): (8e3, 9.0)},
            [("high", "low", 14.0, 14.0), ("low", "ground", 20.0, 20.0), ("high", "ground", 10.0, 10.0)], {"high": 1.0}),
        80.0,
    ),
}  # fmt: skip


@pytest.mark.timeout(300)
@pytest.mark.parametrize("case", CASES)
def test_against_located_events_and_least_squares(case: str) -> None:
    model, rms = CASES[case]
    drive = noise(rms)
    got, log = engine(model, drive)
    assert len(log) > 10
    assert apart(got, reference(model).run(drive, 1.0 / RATE)) < 1e-10


@pytest.mark.timeout(300)
@pytest.mark.parametrize("case", ["two alike, pushed alike", "a chain", "a loop of three contacts"])
def test_small_steps_approach_it(case: str) -> None:
    """Moreau's scheme is of first order: four times as many steps, a quarter of the error."""
    model, rms = CASES[case]
    drive = noise(rms, 0.05)
    got, _ = engine(model, drive)
    coarse, fine = (apart(got, time_stepped(reference(model), drive, 1.0 / RATE, parts)) for parts in (8, 32))
    assert fine < 6e-3
    assert fine < 0.4 * coarse


def test_contacts_between_the_same_bodies_are_one() -> None:
    """Shares of 14 and 8 N, which break away together at 28 N, are one contact of 22 and 28 N, event by event."""
    model, rms = CASES["two contacts between the same bodies"]
    merged = replace(
        model,
        contacts=(
            Contact(name="both", a="high", b="low", law=laws.Coulomb(friction_force=22.0, static_force=28.0)),
            model.contacts[2],
        ),
    )
    drive = noise(rms, 1.0)
    got, log = engine(model, drive)
    want, once = engine(merged, drive)
    assert apart(got, want) < 1e-11
    # Both shares change, at the same moments.
    assert len(log) == len(once) + (once[:, 1] == 0).sum()


def drawn(seed: int) -> tuple[RigModel, FloatArray]:
    """One to three bodies, one to four contacts between any of them: alone, side by side, in loops.

    Half of those without loops break away late.
    """
    draw = np.random.default_rng(seed)
    names = [f"b{k}" for k in range(draw.integers(1, 4))]
    masses = {name: float(np.exp(draw.uniform(0.0, np.log(50.0)))) for name in names}
    under = {name: str(draw.choice(["ground", *names[:k]])) for k, name in enumerate(names)}
    springs = {}
    for name, other in under.items():
        omega = 2.0 * np.pi * draw.uniform(2.0, 40.0)
        springs[name, other] = (masses[name] * omega**2, 2.0 * draw.uniform(0.005, 0.2) * masses[name] * omega)
    pairs = [(a, b) for k, a in enumerate(names) for b in ("ground", *names[:k])]
    met = [pairs[draw.integers(0, len(pairs))] for _ in range(draw.integers(1, 5))]
    ends = ["ground", *names]
    rows = np.array([np.eye(len(ends))[ends.index(a)] - np.eye(len(ends))[ends.index(b)] for a, b in sorted(set(met))])
    late = np.linalg.matrix_rank(rows) == len(rows) and draw.random() < 0.5
    frictions = []
    for a, b in met:
        level = float(np.exp(draw.uniform(np.log(5.0), np.log(40.0))))
        frictions.append((a, b, level, level * (draw.uniform(1.0, 1.5) if late else 1.0)))
    pushes = {name: 1.0 for k, name in enumerate(names) if k == len(names) - 1 or draw.random() < 0.3}
    level = max(friction[2] for friction in frictions)
    return rig(masses, springs, frictions, pushes), noise(float(draw.uniform(0.7, 4.0)) * level, 0.125, seed)


def compared(seed: int) -> None:
    model, drive = drawn(seed)
    got, _ = engine(model, drive)
    want = reference(model).run(drive, 1.0 / RATE)
    if np.abs(want).max() > 0.0:
        assert apart(got, want) < 1e-9, seed
    else:
        assert np.abs(got).max() < 1e-12


@pytest.mark.timeout(300)
@pytest.mark.parametrize("seed", range(6))
def test_random_rigs(seed: int) -> None:
    compared(seed)


@pytest.mark.study
@pytest.mark.timeout(600)
@pytest.mark.parametrize("seed", range(200))
def test_two_hundred_random_rigs(seed: int) -> None:
    compared(seed)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_an_undriven_rig_never_gains_energy(seed: int) -> None:
    model, drive = drawn(seed)
    drive = np.concatenate([drive[:64], np.zeros(1024)])
    got, _ = engine(model, drive)
    mass, _, stiffness = matrices(model)
    n = len(model.bodies)
    x, v = got[65:, :n], got[65:, n:]
    energy = 0.5 * np.einsum("ti,ij,tj->t", x, stiffness, x) + 0.5 * np.einsum("ti,ij,tj->t", v, mass, v)
    assert np.all(np.diff(energy) <= 1e-12 * max(energy.max(), 1e-15))


@pytest.mark.parametrize("more", [{}, {"viscous_coefficient": 40.0}, {"stribeck_velocity": 0.1, "viscous_coefficient": 40.0}])
def test_karnopps_band_is_left_once(more: dict[str, float]) -> None:
    """At the band's edge a contact holds, is pulled, or slides: never by more than two changes at one moment."""
    law = laws.Karnopp(friction_force=20.0, static_force=26.0, band=0.02, **more)
    model = replace(one_mass(), contacts=(Contact(name="rubbing", a="motor", law=law),))
    for seed in range(4):
        _, log = engine(model, noise(60.0, 2.0, seed))
        assert len(log) > 20
        _, counts = np.unique(log[:, 0], return_counts=True)
        assert counts.max() <= 2


def test_four_steps_at_once_are_four_steps() -> None:
    """The last steps of a record are taken one by one, those before four at once: a shorter record has the same beginning."""
    model = rig(CHAIN, {("low", "ground"): SPRING, ("high", "low"): SPRING}, [("high", "low", 5.0, 6.0)], {"high": 1.0})
    model = replace(model, more_drives=(Drive(channel="w", pushes={"low": 1.0}, quantity="force"),))
    drives = np.array([noise(20.0), noise(30.0, seed=2)])

    def run(end: int) -> tuple[FloatArray, IntArray]:
        out, modes = np.zeros((4, end)), np.zeros(end, dtype=np.int64)
        run_rig(model, "unlocked", drives[:, :end], 1.0 / RATE, 0.0, np.eye(4), out, modes=modes)
        return out.T, modes

    whole, modes = run(drives.shape[1])
    assert np.count_nonzero(np.diff(modes)) > 20
    for end in range(2, 200):
        cut, short = run(end)
        assert np.abs(cut - whole[:end]).max() < 1e-12 * np.abs(whole).max()
        assert (short == modes[:end]).all()


def test_contacts_keep_sticking_where_several_motions_are_possible() -> None:
    """Breakaway 30 N, sliding 10 N under a growing push: between 10 and 30 N the block could slide, and holds."""
    model = rig({"block": 1.0}, {}, [("block", "ground", 10.0, 30.0)], {"block": 1.0})
    ramp = np.linspace(0.0, 40.0, 2049)
    _, log = engine(model, ramp)
    assert [int(state) for state in log[:, 2]] == [1]
    assert log[0, 0] == pytest.approx(0.75, rel=1e-9)


def test_the_most_overloaded_lets_go_first() -> None:
    """A push on the upper of two blocks: when the lower contact gives, the upper one is relieved and goes on holding."""
    model = rig(
        {"low": 4.0, "high": 4.0}, {}, [("high", "low", 15.0, 24.0), ("low", "ground", 5.0, 20.0)], {"high": 1.0}
    )  # fmt: skip
    ramp = np.linspace(0.0, 40.0, 2049)
    got, log = engine(model, ramp)
    # The lower one breaks away at 20 N; together the blocks take 7.5 N to what the upper contact carries.
    assert (int(log[0, 1]), int(log[0, 2])) == (1, 1)
    assert log[0, 0] == pytest.approx(0.5, rel=1e-9)
    # The upper contact carries (push + 5) / 2, which reaches 24 N only beyond the ramp's end.
    assert len(log) == 1
    assert got[-1, 2] == pytest.approx(got[-1, 3], abs=1e-12)


def test_contacts_that_cannot_be_settled_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    model, rms = CASES["a chain"]

    def broken(*given: object) -> object:
        compiled = compile_rig(*given)  # type: ignore[arg-type]
        from dataclasses import replace as change

        return change(compiled, rig=compiled.rig._replace(possible=np.zeros_like(compiled.rig.possible)))

    monkeypatch.setattr(free_run, "compile_rig", broken)
    with pytest.raises(SimulationError, match="without end"):
        engine(model, noise(rms))


def test_a_contact_whose_ends_cannot_move_apart_is_left_out() -> None:
    model, rms = CASES["the wire bonder rubbing at isolation and table"]
    locked = replace(model, configurations={"unlocked": replace(BONDER.configurations["locked"], rigid=("motor-table",))})
    got, log = engine(locked, noise(rms))
    assert np.isfinite(got).all()
    assert len(log)
