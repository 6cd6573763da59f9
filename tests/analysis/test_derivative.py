"""The derivative of a record, compared with closed formulas."""

from __future__ import annotations

import numpy as np
import pytest

from isorig.analysis.derivative import WEIGHTS, derivative


@pytest.mark.parametrize(("period", "error"), [(40.0, 1e-9), (12.0, 1e-5), (8.0, 2e-4)])
def test_of_a_sine(period: float, error: float) -> None:
    """The period is in samples; the difference of the two neighbours is wrong by 4 % at the second one."""
    rate, omega = 50.0, 2.0 * np.pi * 50.0 / period
    t = np.arange(400) / rate
    inside = slice(len(WEIGHTS), -len(WEIGHTS))
    assert derivative(np.sin(omega * t), rate)[inside] == pytest.approx(omega * np.cos(omega * t)[inside], abs=error * omega)


def test_of_polynomials_up_to_its_order() -> None:
    t = np.linspace(-1.0, 1.0, 41)
    found = derivative(t**8 - t**3, 20.0)
    assert found[4:-4] == pytest.approx((8.0 * t**7 - 3.0 * t**2)[4:-4], abs=1e-9)


@pytest.mark.parametrize("n", [2, 5, 8, 9])
def test_of_short_records(n: int) -> None:
    assert derivative(3.0 * np.arange(n), 10.0) == pytest.approx(np.full(n, 30.0))
