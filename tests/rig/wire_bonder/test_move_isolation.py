"""Isolation on a move against an independent integration, closed forms and what friction must do to it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from isorig.analysis.errors import DataError
from isorig.analysis.model.rig_model import matrices
from isorig.analysis.simulate.move_profile import Move
from isorig.rig.wire_bonder.description import THESIS, one_mass, wire_bonder
from isorig.rig.wire_bonder.move_isolation import isolation_by_level, move_within, response_to_move
from isorig.rig.wire_bonder.stroke import frictionless

TOLERANCE = 2e-6
MOVE = Move(distance=3e-3, acceleration=166.7, pause=0.0)


def test_heatblock_on_the_table_is_scipys() -> None:
    rig = frictionless(wire_bonder())
    mass, damping, stiffness = matrices(rig)
    inverse, n = np.linalg.inv(mass), len(mass)
    push = np.array([0.0, 0.0, -rig.drive.factor])

    def head(t: float) -> float:
        return MOVE.acceleration * np.sin(2.0 * np.pi * t / MOVE.duration) if 0.0 <= t <= MOVE.duration else 0.0

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        return np.concatenate([z[n:], inverse @ (push * head(t) - damping @ z[n:] - stiffness @ z[:n])])

    times = np.linspace(0.0, 0.1, 4001)
    z = solve_ivp(rates, (0.0, 0.1), np.zeros(2 * n), t_eval=times, rtol=1e-9, atol=1e-14, max_step=1e-4).y
    wanted = z[1] - z[0]
    found = response_to_move(rig, MOVE, tolerance=TOLERANCE)
    near = (found.time >= 0.0) & (found.time <= 0.1)
    np.testing.assert_allclose(np.interp(found.time[near], times, wanted), found.motion[near], atol=0.01 * np.abs(wanted).max())
    assert found.largest == pytest.approx(np.abs(wanted).max(), rel=0.01)


def test_settling_is_the_decay_of_the_heatblocks_mode() -> None:
    found = response_to_move(wire_bonder(), MOVE, tolerance=TOLERANCE, configuration="locked")
    after = found.time > MOVE.duration
    # Locked, the mode of heatblock against table decays as exp(-zeta w t), zeta and w of the pair.
    riding = THESIS["table_mass"] + THESIS["motor_mass"]
    factor = np.sqrt(1.0 + THESIS["heatblock_mass"] / riding)
    rate = THESIS["heatblock_damping"] * factor * 2.0 * np.pi * THESIS["heatblock_frequency"] * factor
    top = np.abs(found.motion[after][:60]).max()
    assert found.settling == pytest.approx(np.log(top / TOLERANCE) / rate, rel=0.15)
    late = found.time > MOVE.duration + found.settling
    assert np.abs(found.motion[late]).max() <= TOLERANCE
    assert response_to_move(wire_bonder(), MOVE, tolerance=1.0).settling == 0.0
    assert np.isnan(response_to_move(wire_bonder(), MOVE, tolerance=1e-12, configuration="locked").settling)


def test_friction_matters_the_less_the_harder_the_move_is() -> None:
    levels = np.array([12.5, 30.0, 166.7])
    rough, smooth = (
        isolation_by_level(rig, 3e-3, levels, tolerance=TOLERANCE) for rig in (wire_bonder(), frictionless(wire_bonder()))
    )
    assert np.all(np.diff(rough.isolation) > 0.0)
    assert rough.isolation[-1] == pytest.approx(0.96, abs=0.01)
    assert rough.isolation[1] == pytest.approx(0.7, abs=0.06)
    assert rough.isolation[0] < 0.35
    assert smooth.isolation[-1] == pytest.approx(0.98, abs=0.01)
    # A linear rig isolates alike at all levels of one shape; here the shape's length goes with the level too.
    assert np.all(rough.isolation < smooth.isolation)
    # Twice the friction at twice the level is the same motion doubled.
    twice = isolation_by_level(wire_bonder({**THESIS, "friction_force": 40.0}), 6e-3, 2.0 * levels, tolerance=TOLERANCE)
    np.testing.assert_allclose(twice.isolation, rough.isolation, atol=2e-3)


def test_a_move_has_the_given_duration() -> None:
    for shape in ("sine", "constant"):
        move = move_within(4e-3, 11e-3, shape=shape)  # type: ignore[arg-type]
        assert move.duration == pytest.approx(11e-3)
    assert move_within(4e-3, 11e-3, shape="constant").acceleration < 17.0 * 9.81 < move_within(4e-3, 11e-3).acceleration


def test_refusals() -> None:
    with pytest.raises(DataError, match="above zero"):
        move_within(1e-3, 0.0)
    from msgspec.structs import replace

    with pytest.raises(DataError, match="no locked configuration"):
        isolation_by_level(
            replace(one_mass(), configurations={"unlocked": one_mass().configurations["unlocked"]}),
            1e-3,
            [10.0],
            tolerance=TOLERANCE,
        )
