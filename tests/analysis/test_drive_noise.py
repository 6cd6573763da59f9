"""The parts of the noise in a recorded drive, against values worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm, t

from isorig.analysis.fitting.drive_noise import _noise, _of_draws


def test_a_covariance_of_few_draws_is_widened_by_students_factor() -> None:
    """Four draws of one run: the 95 % limits are those of Student's distribution with four degrees of freedom."""
    found = _of_draws(np.ones((1, 4, 1)))
    assert np.sqrt(found[0, 0]) == pytest.approx(t.ppf(0.975, 4) / norm.ppf(0.975))
    assert not _of_draws(np.zeros((3, 0, 2))).any()


def test_noise_of_the_drive_is_common_to_all_responses_and_that_of_a_sensor_is_not() -> None:
    generator, bins = np.random.default_rng(1), 4000

    def white(*shape: int) -> np.ndarray:
        return (generator.normal(size=shape) + 1j * generator.normal(size=shape)) / np.sqrt(2.0)

    def stacked(rows: np.ndarray) -> np.ndarray:
        return np.concatenate([rows.real.ravel(), rows.imag.ravel()])

    gains, own = np.array([[1.0], [2.0]]), np.array([1.0, 3.0])
    residual = gains * 2.0 * white(bins) + np.sqrt(own)[:, None] * white(2, bins)
    drive = generator.normal(0.0, 10.0, 2 * bins - 2)
    trial = SimpleNamespace(channels=("a", "b"), excitation=SimpleNamespace(recorded=drive), fitted=len(drive))
    found = _noise(trial, stacked(residual), stacked(gains * white(bins)), generator.normal(size=len(drive)))  # type: ignore[arg-type]
    assert found.own.mean(axis=1) == pytest.approx(own, rel=0.15)
    # The response is that to noise of unit size: the drive's is twice as large in every bin.
    assert np.mean(found.drive**2) == pytest.approx(4.0 * len(drive), rel=0.15)
