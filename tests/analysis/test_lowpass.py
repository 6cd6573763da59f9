"""The low-pass of records and the frequencies at which they are noise, against closed formulas."""

from __future__ import annotations

import numpy as np
import pytest

from isorig.analysis.lowpass import (
    SIGNAL,
    SLOPE_NOISE,
    derivative_edge,
    force_edge,
    low_passed,
    lowpass_gain,
    mirrored,
    signal_edge,
    smoothed,
    velocity_corner,
)
from isorig.analysis.simulate import Excitation

RATE, COUNT = 1000.0, 20_000
TIME = np.arange(COUNT) / RATE


def test_the_gain_is_half_at_the_corner() -> None:
    assert lowpass_gain(np.array([1.0, 3.0, 4.0, 5.0, 9.0]), 4.0) == pytest.approx([1.0, 1.0, 0.5, 0.0, 0.0])
    assert (lowpass_gain(np.array([0.0, 1e9]), np.inf) == 1.0).all()


def test_a_straight_line_passes_unchanged() -> None:
    line = 3.0 + 2.0 * TIME
    assert smoothed(line, RATE, 5.0) == pytest.approx(line, abs=1e-9)
    assert np.abs(low_passed(line, RATE, 5.0) - line).max() > 1e-3  # a mirror image has a kink at the end of the line


@pytest.mark.parametrize("level", [3e-4, 5e-4, 1e-3])
def test_what_passes_of_the_noise_is_a_fixed_share_of_the_velocity(level: float) -> None:
    clean = np.sin(2.0 * np.pi * 2.0 * TIME)
    noise = np.random.default_rng(1).normal(0.0, level, COUNT)
    corner = velocity_corner(clean + noise, RATE)
    velocity = np.gradient(smoothed(noise, RATE, corner), 1.0 / RATE)[500:-500]
    share = velocity.std() / np.gradient(clean, 1.0 / RATE).std()
    # A third of the square of a corner is the mean square frequency below it.
    assert corner**3 == pytest.approx(3.0 * (SLOPE_NOISE * 2.0 / level) ** 2 * 0.5 * RATE / 2.0, rel=0.15)
    assert share == pytest.approx(SLOPE_NOISE, rel=0.15)
    assert corner > signal_edge(clean + noise, RATE)


def test_another_grid_has_the_same_drive() -> None:
    """The low-pass acts once: a comparison of two step sizes must not compare two drives."""
    clean = np.sin(4.0 * np.pi * TIME) + np.random.default_rng(4).normal(0.0, 1e-3, COUNT)
    drive = Excitation.prepare(clean, RATE, oversample=2, corner=30.0)
    assert (drive.resampled(4).recorded == drive.recorded).all()
    assert drive.resampled(4).fine[::4] == pytest.approx(drive.fine[::2], abs=1e-3)
    assert (drive.with_drive(clean).recorded == drive.recorded).all()


def test_a_record_that_is_noise_alone_or_has_little_is_kept() -> None:
    draw = np.random.default_rng(3)
    assert velocity_corner(np.sin(4.0 * np.pi * TIME) + draw.normal(0.0, 1e-5, COUNT), RATE) == np.inf
    assert velocity_corner(np.random.default_rng(2).normal(size=COUNT), RATE) == np.inf


@pytest.mark.parametrize("derivatives", [1, 2])
def test_a_force_ends_where_the_noise_of_a_motion_outweighs_it(derivatives: int) -> None:
    """White force of 0.5 N at a body of 2 kg: its power is `SIGNAL` times that of the noise's inertia force at one frequency."""
    draw, rate, mass, push, noise = np.random.default_rng(5), 1000.0, 2.0, 0.5, 1e-6 if derivatives == 2 else 3e-4
    expected = (push / (mass * noise * np.sqrt(SIGNAL))) ** (1.0 / derivatives) / (2.0 * np.pi)
    found = force_edge(draw.normal(0.0, push, 40_000), draw.normal(0.0, noise, 40_000), rate, mass, derivatives)
    assert found == pytest.approx(expected, rel=0.3)
    assert 0.0 < expected < 0.5 * rate


def test_a_force_below_the_noise_of_a_motion_has_no_edge() -> None:
    draw = np.random.default_rng(5)
    assert force_edge(np.zeros(4000), draw.normal(0.0, 1.0, 4000), 1000.0, 2.0, 2) == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 101, 10_007])
def test_a_mirrored_record_continues_beyond_both_ends(count: int, sign: float) -> None:
    values = np.random.default_rng(count).normal(size=(count, 2))
    whole, near = mirrored(values, sign), max(count // 2 - 1, 0)
    assert (whole[:count] == values).all()
    assert (whole[count : count + near] == sign * values[count - 1 - near : count - 1][::-1]).all()
    assert (whole[len(whole) - near :] == sign * values[1 : near + 1][::-1]).all()
    rest = len(whole)
    for prime in (2, 3, 5):
        while rest % prime == 0:
            rest //= prime
    assert rest == 1
    assert len(whole) <= 2.1 * count


@pytest.mark.parametrize("counts", [20_000, 65_536])
def test_the_counts_of_a_steady_speed_are_no_motion(counts: int) -> None:
    """Their steps follow each other regularly, at frequencies that are aliased to any, up to that of every second sample."""
    way = np.where(TIME // 2.0 % 2.0, -1.0, 1.0) * np.choose((TIME // 4.0).astype(int) % 3, [0.1, 0.3, 0.05])
    angle = np.cumsum(low_passed(way, RATE, 5.0)) / RATE
    step = 2.0 * np.pi / counts
    as_noise = signal_edge(angle + np.random.default_rng(1).normal(0.0, step / np.sqrt(12.0), COUNT), RATE)
    assert signal_edge(step * np.round(angle / step), RATE) == pytest.approx(as_noise, rel=0.6)


def test_the_edge_of_a_counted_decay_is_above_its_oscillation() -> None:
    """Below it there is nothing but the noise of the counts."""
    decay = 2000.0 * np.exp(-TIME) * np.sin(2.0 * np.pi * 20.0 * TIME)
    as_noise = signal_edge(decay + np.random.default_rng(1).normal(0.0, 1.0 / np.sqrt(12.0), COUNT), RATE)
    assert 20.0 < signal_edge(np.round(decay), RATE) == pytest.approx(as_noise, rel=0.6)


def band(low: float, high: float, rms: float, seed: int) -> np.ndarray:
    """Noise between two frequencies."""
    spectrum = np.fft.rfft(np.random.default_rng(seed).normal(size=COUNT))
    frequency = np.fft.rfftfreq(COUNT, 1.0 / RATE)
    found = np.fft.irfft(np.where((frequency >= low) & (frequency <= high), spectrum, 0.0), COUNT)
    return rms * found / found.std()


@pytest.mark.parametrize(("resonance", "low", "high"), [(0.02, 30.0, 35.0), (0.002, 1.0, 25.0)])
def test_a_derivative_is_taken_up_to_a_resonance_only_if_that_exceeds_the_noise_below_it(
    resonance: float, low: float, high: float
) -> None:
    """Between a slow motion and a resonance of 30 to 31 Hz there is noise only; both resonances exceed it."""
    clean = band(0.2, 1.0, 1.0, 1) + band(30.0, 31.0, resonance, 2)
    noisy = clean + np.random.default_rng(3).normal(0.0, 5e-3, COUNT)
    assert 30.0 < signal_edge(noisy, RATE) < 33.0
    assert low < derivative_edge([noisy], RATE, 2) < high


def test_the_noise_of_a_derivative_is_at_most_a_tenth_of_its_power() -> None:
    clean, noise = band(0.2, 1.0, 1.0, 1) + band(30.0, 31.0, 0.002, 2), np.random.default_rng(3).normal(0.0, 5e-3, COUNT)
    edge, frequency = derivative_edge([clean + noise], RATE, 2), np.fft.rfftfreq(COUNT, 1.0 / RATE)
    spectra = [np.abs(np.fft.rfft(values * np.hanning(COUNT))) ** 2 for values in (noise, clean + noise)]
    shares = []
    for corner in (edge, 1.1 * edge):  # more than one step of the search higher
        of_noise, whole = ((each * lowpass_gain(frequency, corner) ** 2 * frequency**4).sum() for each in spectra)
        shares.append(of_noise / whole)
    assert shares[0] < 0.105
    assert shares[1] > 0.1


def test_the_derivative_of_several_records_may_be_taken_as_far_as_in_the_loudest() -> None:
    loud = np.sin(2.0 * np.pi * 5.0 * TIME) * np.exp(-3.0 * (TIME % 2.0))  # broad about 5 Hz
    noise = np.random.default_rng(4).normal(0.0, 1e-3, (2, COUNT))
    alone = derivative_edge([loud + noise[0]], RATE, 2)
    assert derivative_edge([loud + noise[0], 0.03 * loud + noise[1]], RATE, 2) == pytest.approx(alone, rel=0.15)
    assert derivative_edge([0.03 * loud + noise[1]], RATE, 2) < 0.8 * alone
    assert derivative_edge([loud], RATE, 2) == np.inf
