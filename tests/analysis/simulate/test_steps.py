"""Parts of a step: the zero of a margin."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from small_rigs import stage

from isorig.analysis.laws import ElastoSlip
from isorig.analysis.simulate.compiled import LEFT_OUT, compile_rig
from isorig.analysis.simulate.free_run import run_rig
from isorig.analysis.simulate.step import EXACT, falls, polynomial
from isorig.analysis.simulate.workspace import cache_lines


@settings(deadline=None)  # the first call may compile
@given(
    zero=st.floats(1e-6, 0.999),
    height=st.floats(1e-9, 1e9),
    others=st.lists(st.floats(-1.0, 1.0), min_size=0, max_size=15),
)
def test_a_margin_falls_below_zero_where_it_does(zero: float, height: float, others: list[float]) -> None:
    # A falling line through the zero times a factor between 1/4 and 7/4.
    factor = np.array([1.0, *(0.75 * c / max(1.0, float(np.abs(others).sum())) for c in others)])
    p = height * np.convolve([zero, -1.0], factor)
    found = falls(p, 1.0, polynomial(p, 1.0))
    assert found == pytest.approx(zero, rel=1e-10, abs=1e-14)


@pytest.mark.parametrize(
    ("p", "zero"),
    [([1.0, 0.0, -4.0], 0.5), ([0.25, -1.25, 1.0], 0.25), ([1.0, 2.0, -15.0], 1 / 3), ([0.5, -1.0, 0.0], 0.5)],
    ids=["level start", "rising again", "rising first", "straight"],
)
def test_the_zero_of_a_parabola(p: list[float], zero: float) -> None:
    high = 0.9
    assert falls(np.array(p), high, polynomial(np.array(p), high)) == pytest.approx(zero, rel=1e-14)


@pytest.mark.parametrize(
    ("p", "high", "below", "zero"),
    [
        ([0.0, 1.0, -2.0], 0.9, -0.72, 0.5),  # no parabola from a value of zero: its zero is the start
        ([1e-200, -1.0], 1.0, -1.0, 1e-200),  # squares vanish
        ([1e200, -2e200], 0.9, -0.8e200, 0.5),  # squares overflow
        ([1e-210, -2.0], 1e-200, -2e-200, 5e-211),
        ([1.0, 0.0, 0.0, -8.0], 0.9, -4.832, 0.5),
    ],
    ids=["zero at the start", "small", "large", "small step", "flat start"],
)
def test_a_parabola_that_cannot_be_computed_is_replaced_by_halving(
    p: list[float], high: float, below: float, zero: float
) -> None:  # fmt: skip
    assert falls(np.array(p), high, below) == pytest.approx(zero, rel=1e-9, abs=1e-14 * high)


@pytest.mark.parametrize("apart", [1e-1, 1e-2, 1e-3, 1e-4])
def test_of_two_close_zeros_the_one_at_which_the_margin_falls_is_found(apart: float) -> None:
    # Between them, Halley's correction vanishes at the minimum, which is no zero.
    generator = np.random.default_rng(0)
    for _ in range(300):
        middle = generator.uniform(1.01 * apart, 0.95)
        high = generator.uniform(middle, min(1.0, middle + 0.99 * apart))
        others = [1.0, *(0.05 * generator.uniform(-1.0, 1.0, 6))]
        p = np.convolve([(middle - apart) * (middle + apart), -2.0 * middle, 1.0], others)
        # Rounding of the margin moves its zero by 1e-16 / slope, Halley's method at EXACT by its third power.
        room = 1e-15 / apart + EXACT**3 / apart**2
        assert falls(p, high, polynomial(p, high)) == pytest.approx(middle - apart, abs=room)


@pytest.mark.parametrize("phase", [0.01, 0.3, 0.8, 1.19])
def test_a_series_ends_where_its_next_term_is_rounding(phase: float) -> None:
    # 2500 N/m and 4 kg.
    terms = compile_rig(stage(), "unlocked", phase / 25.0).rig.terms
    left_out = [phase**k / math.factorial(k) for k in range(31)]
    assert left_out[terms] <= LEFT_OUT
    assert terms == 6 or left_out[terms - 1] > LEFT_OUT


def test_groups_of_eight_are_in_one_cache_line_each() -> None:
    for groups in range(1, 20):
        rows = cache_lines(groups)
        assert rows.shape == (groups, 8)
        assert rows.ctypes.data % 64 == 0
        assert not rows.any()


def test_corners_of_a_force_refine_no_step() -> None:
    # Eight sliders with play reverse, touch and slip in a fifth of the steps.
    rail = stage().links[0]
    sliders = tuple(ElastoSlip(spring_stiffness=700.0, slip_force=0.5 + 0.3 * k, clearance=2e-4 * k) for k in range(8))
    model = replace(stage(), links=(replace(rail, laws=sliders),))
    t = np.arange(800) / 400.0
    drive = 60.0 * np.sin(2.0 * np.pi * 3.0 * t)
    coarse, fine = np.zeros((1, len(t))), np.zeros((1, 16 * len(t)))
    _, compiled = run_rig(model, "unlocked", drive, 1.0 / 400.0, 0.0, np.eye(2)[:1], coarse)
    run_rig(model, "unlocked", np.interp(np.arange(16 * len(t)) / 6400.0, t, drive), 1.0 / 6400.0, 0.0, np.eye(2)[:1], fine)
    assert compiled.cuts == 1
    assert coarse[0] == pytest.approx(fine[0, ::16], abs=1e-5 * float(np.abs(fine).max()))
