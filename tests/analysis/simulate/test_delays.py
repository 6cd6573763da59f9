"""A delayed signal: band-limited inside, and at rest beyond its ends wherever it rests."""

from __future__ import annotations

import numpy as np
import pytest

from isorig.analysis.simulate.sampling import shift

RATE = 250.0


@pytest.mark.parametrize("delay", [-0.03, -0.0013, 0.0007, 0.02, 0.3])
def test_a_smooth_signal_is_shifted_exactly_where_it_is_known(delay: float) -> None:
    def wave(t: np.ndarray) -> np.ndarray:
        return np.asarray(0.3 + np.exp(-(((t - 2.0) / 0.2) ** 2)) * np.sin(2.0 * np.pi * 12.0 * t))

    t = np.arange(1000) / RATE
    assert shift(wave(t), delay, RATE) == pytest.approx(wave(t - delay), abs=1e-9)


@pytest.mark.parametrize("delay", [0.02, -0.02])
def test_a_mass_that_is_released_stays_where_it_was_until_then(delay: float) -> None:
    """At its start it is held away from zero, at its end it rests elsewhere: neither rings into the record."""
    t = np.arange(1000) / RATE
    x = 0.1 * np.cos(2.0 * np.pi * 1.4 * np.minimum(t, 2.5))
    expected = np.interp(t - delay, t, x)
    assert shift(x, delay, RATE) == pytest.approx(expected, abs=1e-4)
    assert shift(np.full(500, 0.12), delay, RATE) == pytest.approx(0.12, abs=1e-12)
