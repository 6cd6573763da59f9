"""The parts of the noise in a recorded drive, against values worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm, t
from small_rigs import stage

from isorig.analysis.fitting.drive_noise import DriveNoise, _noise, _of_draws, without_bias
from isorig.analysis.fitting.solve import Fit, Free


def test_a_covariance_of_few_draws_is_widened_by_students_factor() -> None:
    """Four draws of one run: the 95 % limits are those of Student's distribution with four degrees of freedom."""
    found = _of_draws(np.ones((1, 4, 1)))
    assert np.sqrt(found[0, 0]) == pytest.approx(t.ppf(0.975, 4) / norm.ppf(0.975))
    assert not _of_draws(np.zeros((3, 0, 2))).any()


@pytest.mark.parametrize("level", [2.0, 0.0])
def test_noise_of_the_drive_is_common_to_all_responses_and_that_of_a_sensor_is_not(level: float) -> None:
    generator, bins = np.random.default_rng(1), 4000

    def white(*shape: int) -> np.ndarray:
        return (generator.normal(size=shape) + 1j * generator.normal(size=shape)) / np.sqrt(2.0)

    def stacked(rows: np.ndarray) -> np.ndarray:
        return np.concatenate([rows.real.ravel(), rows.imag.ravel()])

    gains, own = np.array([[1.0], [2.0]]), np.array([1.0, 3.0])
    residual = gains * level * white(bins) + np.sqrt(own)[:, None] * white(2, bins)
    drive = generator.normal(0.0, 10.0, 2 * bins - 2)
    trial = SimpleNamespace(channels=("a", "b"), excitation=SimpleNamespace(recorded=drive), fitted=len(drive))
    found = _noise(trial, stacked(residual), stacked(gains * white(bins)), generator.normal(size=len(drive)))  # type: ignore[arg-type]
    assert found.own.mean(axis=1) == pytest.approx(own, rel=0.15)
    # The response is that to noise of unit size.
    assert np.mean(found.drive**2) == pytest.approx(level**2 * len(drive), rel=0.15, abs=0.1 * len(drive))


@pytest.mark.parametrize(("bias", "corrected"), [(300.0, 2200.0), (900.0, 2000.0), (-900.0, 3000.0)])
def test_a_value_without_bias_stays_between_its_bounds(bias: float, corrected: float) -> None:
    """The stiffness of the stage, fitted as 2500 N/m, may be 2000 to 3000 N/m."""
    free = (Free(path="links.rail.stiffness", low=2000.0, high=3000.0),)
    done = Fit(model=stage(), free=free, covariance=np.eye(1), cost=1.0, evaluations=1)
    found = without_bias(done, DriveNoise(np.array([bias]), np.eye(1)))
    assert found.values == {"links.rail.stiffness": corrected}
