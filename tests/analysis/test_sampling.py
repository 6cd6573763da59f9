"""Sampled accelerations of a linear rig against its transfer function in closed form: what the fine grid costs."""

import numpy as np
import pytest
import scipy.signal

from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.sampling import AS_IT_IS, interpolate, within
from isorig.rig.wire_bonder.description import THESIS, wire_bonder
from isorig.rig.wire_bonder.four_set_ups import head_to_table

RATE = 1024.0


@pytest.mark.parametrize("frequency", [5.0, 40.0, 164.0, 300.0])
def test_eight_steps_a_sample_are_enough(frequency: float) -> None:
    n, settled = 16384, 12288
    drive = np.cos(2.0 * np.pi * frequency * np.arange(n) / RATE)
    values = {**THESIS, "motor_damping": 0.3, "table_damping": 0.2, "heatblock_damping": 0.05}
    seen = simulate(wire_bonder(values, friction=False), Excitation.prepare(drive, RATE)).channels["table"][settled:-64]
    turn = np.exp(2j * np.pi * frequency * np.arange(settled, n - 64) / RATE)
    parts = np.linalg.lstsq(np.stack([turn.real, -turn.imag], axis=1), seen, rcond=None)[0]
    want = head_to_table(values, np.array([frequency]))[0]
    assert abs(complex(*parts) / want - 1.0) < 2e-4


@pytest.mark.parametrize("share", [0.02, 0.1, 0.2, 0.3, 0.4])
def test_the_interpolation_neither_adds_nor_loses_amplitude(share: float) -> None:
    # A ripple of 1e-4 across a resonance is a bias of 1e-4 of its damping.
    n, over = 2048, 8
    fine = interpolate(np.sin(2.0 * np.pi * share * np.arange(n)), over, AS_IT_IS)[256 * over : -256 * over]
    true = np.sin(2.0 * np.pi * share * (np.arange(n * over) / over))[256 * over : -256 * over]
    assert np.abs(fine - true).max() < 2.5e-5


@pytest.mark.parametrize("factor", [2, 3, 8])
def test_filters_are_those_of_scipy(factor: int) -> None:
    x = np.random.default_rng(1).standard_normal(2500)
    taps = factor * scipy.signal.firwin(40 * factor + 1, 1.0 / factor, window=("kaiser", 10.0))
    want = scipy.signal.upfirdn(taps, x, up=factor)[20 * factor :][: factor * len(x)]
    np.testing.assert_allclose(interpolate(x, factor, AS_IT_IS), want, atol=1e-13)
    length, beta = scipy.signal.kaiserord(80.0, 0.12)
    low = scipy.signal.firwin(length | 1, 0.7 + 0.06, window=("kaiser", beta))
    np.testing.assert_allclose(within(x[None], 0.35, 1.0)[0], np.convolve(x, low, mode="same"), atol=1e-13)
