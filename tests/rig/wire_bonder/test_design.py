"""Profiles against closed forms, strokes against scipy, frequency responses against scipy's state space."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from isorig.analysis.errors import DataError
from isorig.analysis.model.linear import transfer
from isorig.analysis.model.rig_model import matrices
from isorig.analysis.model.spring import with_frequency
from isorig.analysis.simulate.move_profile import MOST, Move, Shape, head_acceleration
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.stroke import (
    frictionless,
    histories,
    linear_ratio,
    lowest_inside,
    rocking,
    stroke_study,
    strokes,
)

RATE = 2048.0
MOVES = [Move(distance=3e-3, acceleration=166.7, pause=0.05)] * 6


@given(
    distance=st.floats(1e-4, 0.05) | st.floats(-0.05, -1e-4), acceleration=st.floats(10.0, 200.0), pause=st.floats(0.0, 0.2),
    shape=st.sampled_from(["sine", "constant"]), repeat=st.integers(1, 5),
)  # fmt: skip
def test_profile_moves_exactly_so_far(distance: float, acceleration: float, pause: float, shape: Shape, repeat: int) -> None:
    move = Move(distance=distance, acceleration=acceleration, pause=pause, shape=shape, repeat=repeat)
    rate = max(RATE, 20.0 / move.duration)
    head = head_acceleration([move], rate, tail=0.1)
    speed = np.cumsum(head) / rate
    assert abs(speed[-1]) < 1e-9
    assert np.sum(speed) / rate == pytest.approx(repeat * distance, rel=0.02)
    assert np.abs(head).max() <= acceleration * (1.0 + 1e-9)


def test_move_lasts_as_the_closed_form_says() -> None:
    t = np.linspace(0.0, 1.0, 200_001)
    for shape, seconds in (("sine", np.sqrt(2 * np.pi * 3e-3 / 166.7)), ("constant", np.sqrt(4 * 3e-3 / 166.7))):
        move = Move(distance=3e-3, acceleration=166.7, pause=0.0, shape=shape)  # type: ignore[arg-type]
        assert move.duration == pytest.approx(seconds)
        assert np.trapezoid(move.speed(t), t) == pytest.approx(3e-3, rel=1e-4)


@pytest.mark.parametrize("frequency", [0.6, 1.0, 5.0])
def test_stroke_of_one_mass_is_scipys(frequency: float) -> None:
    # A table that cannot move leaves one mass on a spring: m x'' + c x' + k x = -head_mass * a.
    values = {**THESIS, "table_mass": 1e7, "table_frequency": 10.0}
    rig = frictionless(wire_bonder(values))
    fine = 16384.0
    t = np.arange(int(3.0 * fine)) / fine
    speed = np.zeros(len(t))
    begin = 0.02
    for move in MOVES:
        speed += move.speed(t - begin)
        begin += move.duration + move.pause
    omega, zeta = 2 * np.pi * frequency, THESIS["motor_damping"]
    # Driven by the head's speed, so that the drive has no steps: X = -(mh / m) s V / (s^2 + 2 zeta w s + w^2).
    system = ([-THESIS["head_mass"] / THESIS["motor_mass"], 0.0], [1.0, 2 * zeta * omega, omega**2])
    _, wanted, _ = signal.lsim(system, speed, t)
    found = strokes([rig], np.array([frequency]), head_acceleration(MOVES, RATE, tail=2.5), RATE)[0, 0]
    assert found == pytest.approx(np.abs(wanted).max(), rel=3e-3)


def test_batch_strokes_are_the_engines_with_friction() -> None:
    rig = wire_bonder()
    head = head_acceleration(MOVES, RATE, tail=1.0)
    frequencies = np.array([1.0, 2.5, 5.06])
    found = strokes([rig], frequencies, head, RATE)[0]
    for f, stroke in zip(frequencies, found, strict=True):
        seen = histories(with_frequency(rig, "isolation", float(f)), head, RATE)
        assert stroke == pytest.approx(np.abs(seen["motor"] - seen["table"]).max(), rel=0.02)


def test_study_carries_uncertainty_through() -> None:
    head = head_acceleration(MOVES, RATE, tail=1.2)
    grid = np.geomspace(0.4, 4.0, 40)
    masses = np.random.default_rng(3).normal(6.5, 0.2, 20)
    rigs = [frictionless(wire_bonder({**THESIS, "head_mass": m})) for m in (6.5, *masses)]
    found = stroke_study(rigs, grid, head, RATE, limit=5e-3)
    # Without friction strokes are proportional to the head's mass, draw by draw.
    np.testing.assert_allclose(found.draws, found.stroke * masses[:, None] / 6.5, rtol=1e-3)
    assert found.std > 0.0
    assert found.recommended > found.lowest
    safer = stroke_study(rigs[:1], grid, head, RATE, limit=5e-3, safety=1.5)
    assert safer.lowest > found.lowest
    assert safer.recommended == safer.lowest


@given(st.lists(st.floats(0.1, 10.0), min_size=2, max_size=20), st.floats(0.2, 5.0))
def test_lowest_inside(strokes_found: list[float], allowed: float) -> None:
    frequency = np.arange(1.0, len(strokes_found) + 1.0)
    stroke = np.array(strokes_found)
    lowest = lowest_inside(frequency, stroke, allowed)
    if np.isnan(lowest):
        assert stroke[-1] > allowed
    else:
        assert (stroke[frequency >= lowest] <= allowed).all()
        assert np.interp(lowest, frequency, stroke) <= allowed * (1 + 1e-9)


def test_frequency_response_is_scipys() -> None:
    rig = frictionless(wire_bonder())
    mass, damping, stiffness = matrices(rig)
    n, inverse = len(mass), np.linalg.inv(mass)
    push = np.array([0.0, 0.0, -rig.drive.factor])
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    b = np.concatenate([np.zeros(n), inverse @ push])[:, None]
    frequency = np.linspace(1.0, 200.0, 57)
    row = 1  # the heatblock
    system = signal.StateSpace(a, b, a[None, n + row, :], b[None, n + row, :])
    wanted = [(system.C @ np.linalg.solve(2j * np.pi * f * np.eye(2 * n) - a, b) + system.D).item() for f in frequency]
    np.testing.assert_allclose(transfer(rig, "unlocked", frequency)[2], wanted, rtol=1e-9)


def test_softer_springs_isolate_better_and_rocking_needs_an_offset() -> None:
    rig = frictionless(wire_bonder())
    lines = np.linspace(10.0, 60.0, 200)
    # Far above both, the spring's force falls as f^2 and the damper's as f.
    better = np.median(linear_ratio(with_frequency(rig, "isolation", 1.0), lines)) / np.median(linear_ratio(rig, lines))
    assert (1.0 / 5.06) ** 2 < better < 1.0 / 5.06
    head = head_acceleration(MOVES, RATE, tail=0.5)
    angles = [
        np.abs(histories(rocking(rig, offset, frequency=30.0, bearing_height=0.0), head, RATE)["rocking"]).max()
        for offset in (0.0, 0.01, 0.02)
    ]
    assert angles[0] < 1e-12
    assert angles[2] == pytest.approx(2.0 * angles[1], rel=1e-6)


def test_refusals() -> None:
    for bad in ({"distance": 0.0}, {"acceleration": -1.0}, {"pause": float("nan")}, {"repeat": 0}):
        with pytest.raises(DataError):
            Move(**{"distance": 1e-3, "acceleration": 10.0, "pause": 0.1, **bad})
    with pytest.raises(DataError, match="no moves"):
        head_acceleration([], RATE)
    most = Move(distance=1e-3, acceleration=10.0, pause=0.0, repeat=MOST)
    assert np.abs(np.sum(head_acceleration([most], RATE))) < 1e-6
    with pytest.raises(DataError, match=f"{MOST + 1} moves"):
        head_acceleration([most, MOVES[0]], RATE)
    with pytest.raises(DataError, match="fewer than 4 samples"):
        head_acceleration(MOVES, 100.0)
    with pytest.raises(DataError, match="safety"):
        stroke_study([wire_bonder()], np.array([1.0, 2.0]), np.zeros(100), RATE, limit=5e-3, safety=0.5)
    with pytest.raises(DataError, match="ascending"):
        stroke_study([wire_bonder()], np.array([2.0, 1.0]), np.zeros(100), RATE, limit=5e-3)
