"""The noise of each run: its own where it is white, that of all runs where friction, impacts or the drive may be in it."""

from __future__ import annotations

import numpy as np
import pytest

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Run
from isorig.analysis.fitting.preparation import drive_noises
from isorig.analysis.spectra.noise import AGREE, WHITE, noise_levels, noise_of_runs

RATE, N, LEVELS = 500.0, 30000, (1e-2, 2e-2, 4e-2)


def low(generator: np.random.Generator) -> FloatArray:
    """A signal below a tenth of the sample rate."""
    spectrum = np.fft.rfft(generator.normal(size=N))
    spectrum[np.fft.rfftfreq(N) > 0.05] = 0.0
    return np.asarray(np.fft.irfft(spectrum, N))


def measured(*added: FloatArray, levels: tuple[float, ...] = LEVELS, seed: int = 3) -> Campaign:
    """A drive and a response in runs whose noise has these levels, with more in the response of the last run."""
    generator = np.random.default_rng(seed)
    runs = []
    for k, level in enumerate(levels):
        drive = low(generator)
        response = np.roll(drive, 5) + generator.normal(0.0, level, N)
        if k == len(levels) - 1:
            response += sum(added, np.zeros(N))
        channels = {
            "f": Channel(name="f", samples=drive + generator.normal(0.0, level, N), quantity="force", unit="N"),
            "a": Channel(name="a", samples=response),
        }
        runs.append(Run(id=f"run{k}", configuration="only", gain=1.0, sample_rate=RATE, channels=channels))
    return Campaign(runs=tuple(runs))


def of_response(campaign: Campaign) -> list[float]:
    return [noise["a"] for noise in noise_of_runs(campaign, ("f",))]


def test_ranges_of_an_instrument() -> None:
    """Its noise is a share of the range in each run."""
    campaign = measured()
    assert noise_levels(campaign, ("f",))["a"] == pytest.approx(LEVELS[0], rel=0.05)
    assert of_response(campaign) == pytest.approx(LEVELS, rel=0.05)
    assert drive_noises(campaign, "f") == pytest.approx(LEVELS, rel=0.05)


def test_impacts_are_no_noise() -> None:
    """Their spectrum is white, too, but they happen at some moments only."""
    impacts = np.zeros(N)
    impacts[np.random.default_rng(8).integers(0, N, N // 50)] = 0.5
    assert of_response(measured(impacts, levels=(1e-2, 1e-2)))[1] == pytest.approx(1e-2, rel=0.05)


def test_a_white_drive_is_no_noise() -> None:
    """What is coherent with the other side of the rig is none."""
    generator = np.random.default_rng(4)
    runs = []
    for level in (0.0, 1.0):
        drive = low(generator) + level * generator.normal(size=N)
        response = drive + generator.normal(0.0, 1e-2, N)
        channels = {"f": Channel(name="f", samples=drive, quantity="force", unit="N"), "a": Channel(name="a", samples=response)}
        runs.append(Run(id=f"run{level}", configuration="only", gain=1.0, sample_rate=RATE, channels=channels))
    assert noise_of_runs(Campaign(runs=tuple(runs)), ("f",))[1]["a"] == pytest.approx(1e-2, rel=0.3)


def coloured(ratio: float, generator: np.random.Generator) -> FloatArray:
    """Noise whose power falls by this ratio over the upper half of the usable band."""
    frequency = np.fft.rfftfreq(N)
    spectrum = np.fft.rfft(generator.normal(0.0, 3e-2, N)) * np.sqrt(ratio) ** (-(frequency - 0.2) / 0.13)
    return np.asarray(np.fft.irfft(spectrum, N))


@pytest.mark.parametrize(("ratio", "own"), [(1.0, True), (0.8 * WHITE, True), (1.6 * WHITE, False)])
def test_boundary_of_white_noise(ratio: float, own: bool) -> None:
    found = of_response(measured(coloured(ratio, np.random.default_rng(6)), levels=(1e-2, 1e-2)))[1]
    assert (found > 2e-2) is own


@pytest.mark.parametrize(("modulation", "own"), [(0.0, True), (0.9, False)])
def test_noise_that_changes_with_the_motion_is_none(modulation: float, own: bool) -> None:
    """Calm moments have less of it: that is friction, and the ways to estimate it differ by more than `AGREE`."""
    generator = np.random.default_rng(7)
    envelope = 1.0 + modulation * np.sin(2.0 * np.pi * np.arange(N) / 2000.0)
    found = of_response(measured(3e-2 * envelope * generator.normal(size=N), levels=(1e-2, 1e-2)))[1]
    assert (found > 2e-2) is own
    assert AGREE < 1.2
