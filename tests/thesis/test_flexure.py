"""Flexures against a beam of finite elements, and what is asked of the shortest leaves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh

from isorig.analysis.errors import DataError
from thesis.flexure import GRAVITY, SPRING_STEEL, Flexure, flexure, thinnest

ELEMENTS = 40


def beam(leaf: Flexure) -> tuple[float, float, float]:
    """A leaf of Hermite elements: stiffness guided at one end, largest stress at unit deflection, first mode clamped twice."""
    length = leaf.length / ELEMENTS
    inertia, area = leaf.width * leaf.thickness**3 / 12.0, leaf.width * leaf.thickness
    e = SPRING_STEEL.modulus * inertia / length**3
    own = e * np.array(
        [
            [12, 6 * length, -12, 6 * length], [6 * length, 4 * length**2, -6 * length, 2 * length**2],
            [-12, -6 * length, 12, -6 * length], [6 * length, 2 * length**2, -6 * length, 4 * length**2],
        ]
    )  # fmt: skip
    weight = SPRING_STEEL.density * area * length / 420.0
    heavy = weight * np.array(
        [
            [156, 22 * length, 54, -13 * length], [22 * length, 4 * length**2, 13 * length, -3 * length**2],
            [54, 13 * length, 156, -22 * length], [-13 * length, -3 * length**2, -22 * length, 4 * length**2],
        ]
    )  # fmt: skip
    size = 2 * ELEMENTS + 2
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    for k in range(ELEMENTS):
        part = slice(2 * k, 2 * k + 4)
        stiffness[part, part] += own
        mass[part, part] += heavy
    # Clamped at the foot; the head moves without turning.
    free = [*range(2, size - 2), size - 2]
    load = np.zeros(len(free))
    load[-1] = 1.0
    motion = np.linalg.solve(stiffness[np.ix_(free, free)], load)
    whole = np.zeros(size)
    whole[free] = motion / motion[-1]
    moment = (own @ whole[:4])[1]
    inner = list(range(2, size - 2))
    lowest = eigh(stiffness[np.ix_(inner, inner)], mass[np.ix_(inner, inner)], eigvals_only=True)[0]
    return 1.0 / motion[-1], abs(moment) * 0.5 * leaf.thickness / inertia, float(np.sqrt(lowest)) / (2.0 * np.pi)


def test_a_leaf_is_what_finite_elements_say() -> None:
    leaf = flexure(16.4, 1.0, 5e-3, thickness=0.5e-3, width=30e-3)
    stiffness, stress, mode = beam(leaf)
    assert leaf.leaves * stiffness == pytest.approx(leaf.stiffness, rel=1e-6)
    assert np.sqrt(leaf.leaves * stiffness / 16.4) / (2.0 * np.pi) == pytest.approx(leaf.frequency, rel=1e-6)
    assert stress * 5e-3 == pytest.approx(leaf.stress, rel=1e-6)
    assert mode == pytest.approx(leaf.leaf, rel=1e-4)
    # Up and down the same leaf with width and thickness exchanged.
    assert leaf.sag == pytest.approx(GRAVITY / (2.0 * np.pi * leaf.upright) ** 2, rel=1e-9)


@given(st.floats(0.3, 6.0), st.floats(1e-3, 10e-3), st.floats(5e-3, 0.2), st.integers(1, 12))
def test_the_shortest_leaves_bear_stroke_and_weight_and_no_shorter_ones_do(f: float, d: float, b: float, n: int) -> None:
    leaf = thinnest(16.4, f, d, width=b, leaves=n, safety=1.5)
    assert leaf.stress <= SPRING_STEEL.endurance / 1.5 * (1.0 + 1e-9)
    assert leaf.buckling >= 1.5 * (1.0 - 1e-9)
    assert min(SPRING_STEEL.endurance / leaf.stress, leaf.buckling) == pytest.approx(1.5)
    shorter = flexure(16.4, f, d, thickness=0.9 * leaf.thickness, width=b, leaves=n)
    assert shorter.length < leaf.length
    assert min(SPRING_STEEL.endurance / shorter.stress, shorter.buckling) < 1.5


@pytest.mark.parametrize("name", ["mass", "frequency", "stroke", "thickness", "width"])
def test_refusals(name: str) -> None:
    given_ = {"mass": 16.4, "frequency": 1.0, "stroke": 5e-3, "thickness": 1e-3, "width": 30e-3}
    for bad in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(DataError, match=name):
            flexure(**{**given_, name: bad})
