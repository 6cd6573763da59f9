"""Hammer tests and noise that begins with the transient of a filter are distinguished by what the rig does between the pulses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from isorig.analysis.campaign import Channel, FloatArray, Run
from isorig.analysis.spectra.hits import COHERENT, RESOLVED, drives_in_pauses, looks_hit, pulses

RATE, COUNT = 2048.0, 40960


def acceleration(force: FloatArray) -> FloatArray:
    """Of the first of two masses on springs, which is driven."""
    mass, stiffness, damping = (np.array(x) for x in ([4.0, 1.5], [[4.9e5, -9e4], [-9e4, 9e4]], [[52.0, -12.0], [-12.0, 12.0]]))
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness / mass[:, None], -damping / mass[:, None]]])
    a, b, c, d, _ = signal.cont2discrete(
        (a, np.array([[0.0], [0.0], [0.25], [0.0]]), a[2:3], np.array([[0.25]])), 1.0 / RATE, method="foh"
    )
    top, bottom = signal.ss2tf(a, b, c, d)
    return np.asarray(signal.lfilter(top[0], bottom, force))


def band(draw: np.random.Generator) -> FloatArray:
    low, high = draw.uniform(10.0, 20.0), draw.uniform(300.0, 600.0)
    noise = signal.sosfilt(signal.butter(4, [low, high], "band", fs=RATE, output="sos"), draw.normal(size=COUNT))
    return np.asarray(noise / noise.std())


def transient(draw: np.random.Generator) -> FloatArray:
    """What a high-pass filter makes of an offset that begins up to 0.1 s after the record, 30 to 300 times the noise."""
    steps = 1.0 * (np.arange(COUNT) >= draw.integers(200))
    high = signal.butter(1, 10.0 ** draw.uniform(0.0, 1.5), "high", fs=RATE, output="sos")
    return np.asarray(draw.choice([30.0, 100.0, 300.0]) * signal.sosfilt(high, steps))


def hammer(draw: np.random.Generator, hits: int, *, double: bool) -> FloatArray:
    time, wide = np.arange(COUNT) / RATE, 10.0 ** draw.uniform(-3.0, -2.2)
    force = np.zeros(COUNT)
    for k in range(hits):
        first = (k + draw.uniform(0.1, 0.2)) * COUNT / RATE / hits
        for at, size in [(first, 1.0), (first + wide + draw.uniform(0.004, 0.02), 0.5 * double)]:
            phase = (time - at) / wide
            force += size * draw.uniform(120.0, 280.0) * np.where((phase > 0.0) & (phase < 1.0), np.sin(np.pi * phase) ** 2, 0.0)
    return np.asarray(signal.sosfilt(signal.butter(4, 800.0, fs=RATE, output="sos"), force))


def run(force: FloatArray, response: FloatArray, excitation: str = "other") -> Run:
    channels = {
        "force": Channel(name="force", samples=force, quantity="force", unit="N"),
        "a": Channel(name="a", samples=response),
    }
    return Run(id="a", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, excitation=excitation)


def seen(force: FloatArray, draw: np.random.Generator, *, noise: float = 0.0) -> Run:
    """Noise of both sensors, and mains hum in both."""
    response = acceleration(force)
    hum = noise * np.sin(2.0 * np.pi * 50.0 * np.arange(COUNT) / RATE)
    response = response + draw.normal(0.0, 0.01 * response.std(), COUNT) + 0.01 * hum
    return run(force + draw.normal(0.0, noise, COUNT) + hum, response)


def test_noise_with_a_transient_is_no_hammer_test() -> None:
    mistaken = 0
    for seed in range(50):
        draw = np.random.default_rng(seed)
        measured = seen(band(draw) + transient(draw), draw)
        assert not looks_hit(measured, "force"), seed
        mistaken += pulses(measured, "force") is not None
    # The pulses alone do not show it.
    assert mistaken > 40


@pytest.mark.parametrize(("hits", "double"), [(1, False), (3, False), (10, False), (1, True), (10, True)])
def test_hammer_tests_are_recognized(hits: int, double: bool) -> None:
    for seed in range(20):
        draw = np.random.default_rng(seed)
        measured = seen(hammer(draw, hits, double=double), draw, noise=float(draw.choice([0.0, 0.02, 0.6])))
        assert looks_hit(measured, "force"), seed


def resonator(force: FloatArray, rate: float, frequency: float, damping: float) -> FloatArray:
    """The acceleration of a mass on a spring."""
    w = 2.0 * np.pi * frequency
    a = np.array([[0.0, 1.0], [-w * w, -2.0 * damping * w]])
    a, b, c, d, _ = signal.cont2discrete((a, np.array([[0.0], [1.0]]), a[1:], np.eye(1)), 1.0 / rate, method="foh")
    top, bottom = signal.ss2tf(a, b, c, d)
    return np.asarray(signal.lfilter(top[0], bottom, force))


def test_slow_noise_in_short_records_is_no_hammer_test() -> None:
    """Bands from 0.3 Hz at rates up to 2048 Hz, from 6 s on, resonances with a damping ratio from 0.5 %."""
    mistaken = pulsed = 0
    for seed in range(100):
        draw = np.random.default_rng(seed)
        rate, low = float(draw.choice([200.0, 512.0, 2048.0])), 10.0 ** draw.uniform(-0.5, 1.0)
        count, high = int(draw.uniform(6.0, 40.0) * rate), min(low * draw.uniform(5.0, 40.0), 0.4 * rate)
        order, corner = int(draw.integers(1, 5)), 10.0 ** draw.uniform(0.0, 1.3)
        force = signal.sosfilt(signal.butter(order, [low, high], "band", fs=rate, output="sos"), draw.normal(size=count))
        steps = 10.0 ** draw.uniform(0.7, 2.3) * (np.arange(count) >= draw.integers(int(0.02 * rate)))
        force = force / force.std() + signal.sosfilt(signal.butter(2, corner, "high", fs=rate, output="sos"), steps)
        response = resonator(force, rate, np.exp(draw.uniform(np.log(1.2 * low), np.log(high))), 10.0 ** draw.uniform(-2.3, -1.0))
        response += 0.01 * response.std() * draw.normal(size=count)
        measured = replace(run(force, response), sample_rate=rate)
        pulsed += pulses(measured, "force") is not None
        mistaken += looks_hit(measured, "force")
    assert pulsed > 30
    # Two records have only three frequency bins of the drive's band, below the resonance.
    assert mistaken <= 2


@pytest.mark.parametrize("kind", ["white", "slow", "hum"])
def test_noisy_hammers_are_recognized(kind: str) -> None:
    """Noise of 4 % of a hit, as of a charge amplifier in a range far too large; white, below 1 % of the rate, or hum."""
    for seed in range(40):
        draw = np.random.default_rng(seed)
        rate, hits = float(draw.choice([512.0, 2048.0, 8192.0])), int(draw.integers(1, 9))
        each = int(draw.uniform(1.0, 4.0) * rate)
        time = np.arange(hits * each)
        force, wide = np.zeros(len(time)), draw.uniform(2.0, 12.0)
        for k in range(hits):
            phase = (time - (k + draw.uniform(0.05, 0.25)) * each) / wide
            force += draw.uniform(0.7, 1.3) * np.where((phase > 0.0) & (phase < 1.0), np.sin(np.pi * phase), 0.0)
        noise = {
            "white": draw.normal(size=len(time)),
            "slow": signal.sosfilt(signal.butter(1, 0.02, output="sos"), draw.normal(size=len(time) + 500))[500:],
            "hum": np.sin(2.0 * np.pi * 50.0 * time / rate + 1.0),
        }[kind]  # fmt: skip
        response = resonator(force, rate, draw.uniform(0.01, 0.2) * rate, 10.0 ** draw.uniform(-2.3, -1.0))
        response += 0.002 * np.abs(response).max() * draw.normal(size=len(time))
        measured = replace(run(force + 0.04 * noise / noise.std(), response), sample_rate=rate)
        assert looks_hit(measured, "force"), seed


@pytest.mark.parametrize("above", [True, False])
def test_boundary_of_the_coherence(above: bool) -> None:
    """A response of which this share of the power follows from the force in the pauses."""
    draw = np.random.default_rng(1)
    force = draw.normal(size=COUNT)
    force[400:410] += 300.0
    share = COHERENT + (0.1 if above else -0.1)
    response = np.sqrt(share) * force + np.sqrt(1.0 - share) * draw.normal(size=COUNT)
    assert drives_in_pauses(run(force, response), "force", np.array([400]), np.array([410])) is above
    assert looks_hit(run(force, response), "force") is not above


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_force_that_converters_do_not_resolve_is_none(share: float) -> None:
    """White noise of this share of the smallest force, which the response follows."""
    force = share * RESOLVED * 300.0 * np.random.default_rng(1).normal(size=COUNT)
    force[400:410] = 300.0
    assert drives_in_pauses(run(force, force), "force", np.array([400]), np.array([410])) is (share > 1.0)


def test_what_cannot_be_compared_is_no_drive() -> None:
    """A force without noise, pauses that are too short, and a run whose only response is a force."""
    pulse = np.zeros(COUNT)
    pulse[400:410] = 300.0
    where = np.array([400]), np.array([410])
    assert not drives_in_pauses(run(pulse, pulse), "force", *where)
    noise = pulse + np.random.default_rng(1).normal(size=COUNT)
    assert drives_in_pauses(run(noise, noise), "force", *where)
    assert not drives_in_pauses(run(noise[:600], noise[:600]), "force", *where)
    force = {name: Channel(name=name, samples=noise, quantity="force", unit="N") for name in ("force", "a")}
    assert not drives_in_pauses(
        Run(id="a", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=force), "force", *where
    )
