"""Noise and distortion told apart from one run, against amounts put in by hand."""

from __future__ import annotations

import numpy as np
import pytest

from isorig.analysis.campaign import Channel, Run
from isorig.analysis.errors import DataError
from isorig.analysis.simulate.excitation import multisine
from isorig.analysis.spectra.periodic import detect

PERIOD = 1024


def run_of(answer: object, *, noise: float = 0.0, periods: int = 40, period: int | None = PERIOD) -> Run:
    drive, _ = multisine(period=PERIOD, periods=periods, sample_rate=1024.0, rms=1.0, band=(2.0, 200.0), seed=1)
    values = answer(drive) + noise * np.random.default_rng(0).normal(size=len(drive))  # type: ignore[operator]
    channels = {name: Channel(name=name, samples=v) for name, v in (("head", drive), ("motor", values))}
    return Run(id="m", configuration="unlocked", sample_rate=1024.0, gain=1.0, channels=channels, period=period)


def driven_level() -> float:
    drive, lines = multisine(period=PERIOD, periods=1, sample_rate=1024.0, rms=1.0, band=(2.0, 200.0), seed=1)
    return float(np.sqrt(np.mean(np.abs(np.fft.rfft(drive)[lines.astype(int)]) ** 2)))


@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_noise_is_estimated_as_simulated_and_without_distortion(noise: float) -> None:
    found = detect(run_of(lambda x: 2.0 * x, noise=noise), response="motor", reference="head")
    # White noise of that rms has a line of rms noise * sqrt(PERIOD) in a period.
    assert found.noise == pytest.approx(noise * np.sqrt(PERIOD) / (2.0 * driven_level()), rel=0.05)
    assert found.periods == 39
    assert max(found.odd, found.even) < found.noise / np.sqrt(39)


@pytest.mark.parametrize(("power", "kind"), [(2, "even"), (3, "odd")])
def test_even_and_odd_distortion_are_distinguished_in_noise(power: int, kind: str) -> None:
    bent = run_of(lambda x: x + 0.1 * x**power, noise=0.05)
    found = detect(bent, response="motor", reference="head")
    # The same lines without noise, from one period by plain Fourier.
    values = bent.read("head")[:PERIOD]
    spectrum = np.abs(np.fft.rfft(values + 0.1 * values**power))
    lines = np.flatnonzero(np.abs(np.fft.rfft(values)) > 1.0)
    free = np.setdiff1d(np.arange(lines[0], lines[-1] + 1), lines)
    free = free[free % 2 == (kind == "odd")]
    share = np.sqrt(np.mean(spectrum[free] ** 2)) / np.sqrt(np.mean(spectrum[lines] ** 2))
    assert getattr(found, kind) == pytest.approx(share, rel=0.05)
    assert getattr(found, "odd" if kind == "even" else "even") < 0.1 * share


def test_a_run_without_enough_periods_is_refused() -> None:
    with pytest.raises(DataError, match=r"contains 2\.0 periods"):
        detect(run_of(lambda x: x, periods=2), response="motor", reference="head")
    with pytest.raises(DataError, match="has no period"):
        detect(run_of(lambda x: x, period=None), response="motor", reference="head")
