"""The pitch of a force that repeats with the position, found in what an equation leaves."""

from __future__ import annotations

import numpy as np
import pytest

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.analysis.equations.repeats import FEWEST, MOST, pitch_of
from isorig.analysis.equations.sliding import Sliding, SlidingFit, SlidingRun

RATE, N = 100.0, 8000
SWING = 3.0


def turning(pitch: float, noise: float, frequency: float = 0.1) -> Sliding:
    """A run of 80 s to and fro over three rad either way, whose force repeats with a pitch."""
    time = np.arange(N) / RATE
    deflection = SWING * np.sin(2.0 * np.pi * frequency * time)
    force = np.sin(2.0 * np.pi * deflection / pitch + 0.4) + np.random.default_rng(8).normal(0.0, noise, N)
    run = SlidingRun(
        run=0, force=force, deflection=deflection, velocity=np.gradient(deflection, time), fixed=np.zeros((N, 0)), time=time,
        usable=np.ones(N, dtype=bool), slow=np.zeros(N), slow_velocity=np.zeros(N),
    )  # fmt: skip
    return Sliding(
        [run], RATE, 1.0, integrated=False, drifts=False, stiffness=0.0, noise=noise, velocity_noise=0.0, parts=1.0, edge=np.inf,
        rubs=False,
    )  # fmt: skip


def columns(d: FloatArray, v: FloatArray, run: SlidingRun, place: IntArray) -> FloatArray:
    return np.column_stack([d, v])


def found(pitch: float, noise: float = 0.3, frequency: float = 0.1) -> float | None:
    base = SlidingFit(values=np.zeros(2), geometric=1.0, arithmetic=1.0, sound=())
    return pitch_of(turning(pitch, noise, frequency), base, columns)


@pytest.mark.parametrize("pitch", [0.11, 0.9, 2.0])
def test_the_pitch_is_found_in_noise(pitch: float) -> None:
    assert found(pitch) == pytest.approx(pitch, rel=2e-3)


def test_it_is_sought_between_two_periods_and_many() -> None:
    low, high = turning(1.0, 0.0).range
    few, many = (high - low) / FEWEST, (high - low) / MOST
    assert found(0.95 * few, 0.0) == pytest.approx(0.95 * few, rel=0.02)
    longer, shorter = found(1.5 * few, 0.0), found(0.8 * many, 0.0)
    assert longer is not None
    assert longer <= few * (1.0 + 1e-6)
    assert shorter is not None
    assert shorter >= many * (1.0 - 1e-6) / (1.0 + 0.25 / MOST)


def test_a_motion_that_is_too_fast_for_two_periods_shows_none() -> None:
    """Its samples tell hardly more than the two periods from which a force may repeat, or fewer."""
    pitches = [found(2.0, frequency=frequency) for frequency in np.arange(12.0, 15.0, 0.05)]
    assert pitches[-1] is None
    low, high = turning(2.0, 0.0).range
    assert all(pitch is None or pitch <= (high - low) / FEWEST for pitch in pitches)
