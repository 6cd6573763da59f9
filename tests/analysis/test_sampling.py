"""Sampled accelerations of a linear rig against its transfer function in closed form: what the fine grid costs."""

import numpy as np
import pytest
import scipy.signal
from msgspec.structs import replace

from isorig.analysis.equations.known import true_records
from isorig.analysis.model.linear import transfer
from isorig.analysis.model.rig_model import Chain
from isorig.analysis.simulate import Excitation, simulate
from isorig.analysis.simulate.sampling import AS_IT_IS, high_passed, interpolate, lagging, within
from isorig.rig.wire_bonder.description import THESIS, wire_bonder

RATE = 1024.0


@pytest.mark.parametrize("frequency", [5.0, 40.0, 164.0, 300.0])
def test_eight_steps_a_sample_are_enough(frequency: float) -> None:
    n, settled = 16384, 12288
    drive = np.cos(2.0 * np.pi * frequency * np.arange(n) / RATE)
    values = {**THESIS, "motor_damping": 0.3, "table_damping": 0.2, "heatblock_damping": 0.05}
    rig = wire_bonder(values, friction=False)
    seen = simulate(rig, Excitation.prepare(drive, RATE)).channels["table"][settled:-64]
    turn = np.exp(2j * np.pi * frequency * np.arange(settled, n - 64) / RATE)
    parts = np.linalg.lstsq(np.stack([turn.real, -turn.imag], axis=1), seen, rcond=None)[0]
    want = transfer(rig, "unlocked", np.array([frequency]))[1, 0]  # the table
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


@pytest.mark.parametrize("cutoff", [2.0, 30.0, 150.0, 900.0])
def test_a_low_pass_is_an_analog_one_and_is_taken_out_again(cutoff: float) -> None:
    rate, n = 400.0, 4000
    time, tau = np.arange(n) / rate, 1.0 / (2.0 * np.pi * cutoff)
    frequency, fine = np.array([1.3, 17.0, 61.0]), np.arange(64 * n) / (64 * rate)
    x, exact = (3.0 + np.sin(2.0 * np.pi * np.outer(t, frequency) + 0.3).sum(axis=1) for t in (time, fine))
    # From rest at its first value; scipy's is exact for straight lines between fine values.
    want = x[0] + scipy.signal.lsim(([1.0], [tau, 1.0]), exact - x[0], fine)[1][::64]
    recorded = lagging(x, cutoff, rate)
    inner = slice(40, -40)
    np.testing.assert_allclose(recorded[inner], want[inner], rtol=0.0, atol=2e-3)
    model = wire_bonder()
    slow = replace(model.sensor("motor"), chain=Chain(cutoff=cutoff))
    sensors = tuple(slow if sensor.channel == "motor" else sensor for sensor in model.sensors)
    back = true_records(replace(model, sensors=sensors), {"motor": recorded}, rate)["motor"]
    np.testing.assert_allclose(back[400:-400], x[400:-400], rtol=0.0, atol=5e-3)


@pytest.mark.parametrize("corner", [0.05, 1.6, 40.0])
def test_a_high_pass_is_that_of_scipy_and_is_taken_out_again(corner: float) -> None:
    rate = 400.0
    x = np.random.default_rng(3).standard_normal(8000).cumsum()
    x -= x[0]
    b, a = scipy.signal.butter(1, corner, "highpass", fs=rate)
    recorded = high_passed(x, corner, rate)
    np.testing.assert_allclose(recorded, scipy.signal.lfilter(b, a, x), rtol=0.0, atol=1e-9 * np.abs(x).max())
    # What it is charged with at the start is not recorded.
    np.testing.assert_allclose(high_passed(x + 5.0, corner, rate), recorded, rtol=0.0, atol=1e-9 * np.abs(x).max())
    model = wire_bonder()
    coupled = replace(model.sensor("motor"), chain=Chain(corner=corner))
    sensors = tuple(coupled if sensor.channel == "motor" else sensor for sensor in model.sensors)
    back = true_records(replace(model, sensors=sensors), {"motor": recorded}, rate)["motor"]
    line = np.polynomial.Polynomial.fit(np.arange(8000.0), back - x, 1)
    assert np.std(back - x - line(np.arange(8000.0))) < 1e-9 * np.std(x)
