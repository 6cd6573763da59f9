"""Modes common to several sensors, and hammer tests, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from isorig.analysis.campaign import Channel, Run
from isorig.analysis.spectra.hammer_test import hammer_test
from isorig.analysis.spectra.modal_analysis import modal_analysis
from isorig.analysis.spectra.welch import estimate

RATE = 1024.0


def run_of(force: np.ndarray, answers: dict[str, np.ndarray], name: str = "a") -> Run:
    channels = {"force": Channel(name="force", samples=force, quantity="force", unit="N")}
    channels |= {key: Channel(name=key, samples=value, quantity="acceleration", unit="m/s^2") for key, value in answers.items()}
    return Run(id=name, configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation="random")


def acceleration(force: np.ndarray, modes: list[tuple[float, float, float]]) -> np.ndarray:
    """Sum of oscillators of (frequency Hz, damping ratio, amplitude 1/kg), exact for a force that is held over each sample."""
    total = np.zeros_like(force)
    h = 1.0 / RATE
    for frequency, zeta, amplitude in modes:
        omega = 2 * np.pi * frequency
        damped = omega * np.sqrt(1 - zeta**2)
        decay, c, s = np.exp(-zeta * omega * h), np.cos(damped * h), np.sin(damped * h)
        # Displacement of x'' + 2 zeta omega x' + omega^2 x = f, stepped exactly.
        k = zeta * omega / damped
        b1 = (1 - decay * (c + k * s)) / omega**2
        b2 = (decay**2 - decay * (c - k * s)) / omega**2
        x = lfilter([0.0, b1, b2], [1.0, -2 * decay * c, decay**2], force)
        v = lfilter([0.0, decay * s / damped, -decay * s / damped], [1.0, -2 * decay * c, decay**2], force)
        total += amplitude * (force - 2 * zeta * omega * v - omega**2 * x)
    return total


def test_two_close_modes_are_found_without_guesses_on_all_sensors() -> None:
    draw = np.random.default_rng(50)
    force = draw.normal(0.0, 1.0, int(400 * RATE))
    ways = {"one": (1.0, 0.7), "two": (0.8, -0.9), "three": (0.3, 1.0)}
    clean = {name: acceleration(force, [(50.0, 0.008, a), (52.0, 0.006, b)]) for name, (a, b) in ways.items()}
    run = run_of(force, {name: x + draw.normal(0.0, 0.01 * x.std(), len(x)) for name, x in clean.items()})
    spectra = estimate([run], references=["force"], resolution=0.25)
    found = modal_analysis([spectra.frf(name, "force") for name in ways], (40.0, 62.0))
    assert [mode.frequency for mode in found.modes] == pytest.approx([50.0, 52.0], abs=0.03)
    assert [mode.damping for mode in found.modes] == pytest.approx([0.008, 0.006], rel=0.08)


def test_hits_of_a_hammer_give_the_mode() -> None:
    draw = np.random.default_rng(51)
    n = int(60 * RATE)
    force = np.zeros(n)
    for start in range(2048, n - 8192, 6144):
        pulse = np.sin(np.pi * np.arange(1, 7) / 7) * draw.uniform(80.0, 120.0)
        force[start : start + 6] += pulse
    answer = acceleration(force, [(50.1, 0.01, 0.5)])
    run = run_of(force + draw.normal(0, 0.02, n), {"block": answer + draw.normal(0, 1e-3 * answer.std(), n)})
    test = hammer_test([run], reference="force", resolution=0.25)
    (mode,) = modal_analysis([test.spectra.frf("block", "force")], (40.0, 60.0)).modes
    assert mode.frequency == pytest.approx(50.1, abs=1e-3)
    assert mode.damping == pytest.approx(0.01, rel=1e-3)
    assert len(test.hits) == 9


def test_seven_close_modes_are_found_on_five_sensors_within_their_deviations() -> None:
    """As in a ground vibration test of an aircraft: modes down to 1.2 Hz apart, with bandwidths of 0.6 to 1.4 Hz."""
    modes = ((42.0, 0.008), (46.5, 0.012), (49.0, 0.006), (52.5, 0.010), (53.7, 0.009), (61.0, 0.007), (63.5, 0.011))
    draw = np.random.default_rng(61)
    force = draw.normal(0.0, 1.0, int(300 * RATE))
    each = np.stack([acceleration(force, [(f, zeta, 1.0)]) for f, zeta in modes])
    shapes = draw.uniform(0.3, 1.0, (5, len(modes))) * draw.choice([-1.0, 1.0], (5, len(modes)))
    answers = {f"sensor {k}": row @ each for k, row in enumerate(shapes)}
    run = run_of(force, {name: x + draw.normal(0.0, 0.02 * x.std(), len(x)) for name, x in answers.items()})
    spectra = estimate([run], references=["force"], resolution=0.25)
    found = modal_analysis([spectra.frf(name, "force") for name in answers], (36.0, 70.0))
    assert len(found.modes) == len(modes)
    off = np.array(
        [
            ((mode.frequency - f) / mode.frequency_std, (mode.damping - zeta) / mode.damping_std)
            for mode, (f, zeta) in zip(found.modes, modes, strict=True)
        ]
    )
    # Of 14 normal values the largest is below 3.3 and the rms below 1.5 with a probability of 99 %.
    assert np.abs(off).max() < 3.3
    assert np.sqrt(np.mean(off**2)) < 1.5
    assert max(mode.damping_std / mode.damping for mode in found.modes) < 0.03
