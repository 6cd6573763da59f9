"""Sentences of the evidence say no more than the figures behind them."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from isorig.analysis.diagnose.estimate_pairs import Lines
from isorig.analysis.diagnose.evidence import homogeneity, poles
from isorig.analysis.diagnose.observe import agreeing
from isorig.analysis.spectra.hum import mains_in
from isorig.rig.wire_bonder.description import wire_bonder

AGREES = ("table between gains 70 and 7 by 0.5 %", 0.005, 0.004)
DIFFERS = ("motor between gains 70 and 7 by 12 %", 0.12, 0.004)
RATE = 1024.0


def test_nothing_in_common_is_no_agreement() -> None:
    sign = homogeneity("unlocked", [70.0, 7.0], [], misfit=0.3, linear=0.0)
    assert "is not known" in sign.text
    assert "linear" not in sign.text
    assert not sign.supported


def test_a_comparison_that_would_not_show_a_difference_is_no_agreement() -> None:
    for noise, known in ((0.049, True), (0.051, False)):
        sign = homogeneity("unlocked", [70.0, 7.0], [("table", 0.01, noise)], misfit=0.1, linear=0.1)
        assert ("is not known" not in sign.text) is known
    # A difference that is there shows, whatever else could not be compared.
    assert "depends on amplitude" in homogeneity("unlocked", [70.0, 7.0], [DIFFERS, ("table", 0.3, 0.4)], 0.3, 0.1).text


def test_agreement_is_about_the_lines_that_follow_the_drive() -> None:
    linear = homogeneity("locked", [70.0, 7.0], [AGREES], misfit=0.05, linear=0.04)
    assert "agrees at gains 70, 7 to within 0.8 %" in linear.text
    assert {cause for cause, _ in linear.supported} == {
        "extra_mode", "wrong_mass", "wrong_stiffness", "sensor_gain", "channel_delay", "low_pass", "crosstalk", "moment_coupling",
        "imperfect_lock", "asymmetric_damping", "bilinear_stiffness", "drive_lag",
    }  # fmt: skip
    other = homogeneity("locked", [70.0, 7.0], [AGREES], misfit=0.5, linear=0.04)
    assert "is not linear" in other.text
    assert not other.supported


def test_a_difference_names_its_channel_and_gains() -> None:
    sign = homogeneity("unlocked", [70.0, 7.0], [AGREES, DIFFERS], misfit=0.1, linear=0.1)
    assert "motor between gains 70 and 7 by 12 %" in sign.text
    assert "table" not in sign.text


def noise(seed: int, seconds: float = 40.0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=round(seconds * RATE))


@pytest.mark.parametrize("seed", range(8))
def test_noise_and_a_resonance_near_the_mains_have_no_line(seed: int) -> None:
    from scipy.signal import lfilter

    record = noise(seed)
    assert mains_in(record, RATE) is None
    # A mode at 59.7358 Hz with a damping ratio of 0.2 %: 0.24 Hz wide, ten bins.
    pole = np.exp(2.0 * np.pi * 59.7358 / RATE * (-0.002 + 1j))
    resonance = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], record)
    assert mains_in(resonance, RATE) is None


@pytest.mark.parametrize("frequency", [49.93, 60.08])
def test_a_hum_is_found(frequency: float) -> None:
    record = noise(3) + 0.2 * np.sin(2.0 * np.pi * frequency * np.arange(round(40 * RATE)) / RATE)
    assert mains_in(record, RATE) == pytest.approx(frequency, abs=0.01)


def test_runs_must_agree_on_the_frequency() -> None:
    assert agreeing([50.01, 50.02, 49.99]) == [50.01, 50.02, 49.99]
    assert agreeing([49.6, 50.01, 50.02]) == [50.01, 50.02]
    assert agreeing([]) == []


@pytest.mark.parametrize("least", [1e-6, 0.2])
def test_a_simulated_transfer_function_near_zero_gives_no_millions_of_per_cent(least: float) -> None:
    frequency = np.arange(10.0, 60.0, 0.5)
    measured = np.ones(len(frequency), dtype=complex)
    simulated = 1.0 - (1.0 - least) * np.exp(-(((frequency - 30.0) / 1.0) ** 2)) + 0j
    ones = np.ones(len(frequency))
    lines = Lines(
        frequency=frequency, measured=measured, simulated=simulated, std=1e-3 * ones, coherence=ones, simulated_coherence=ones,
        averages=50.0,
    )  # fmt: skip
    group: Any = SimpleNamespace(lines=lambda channel: lines if channel == "table" else None)
    (sign,) = poles(wire_bonder(), {("unlocked", 70.0): group})
    shares = [float(share) for share in re.findall(r"([\d.e+-]+) %", sign.text)]
    assert shares[0] == pytest.approx(100.0 * (1.0 - least), abs=1.0)
    assert shares[1] < 1.0
    assert "near 30 Hz" in sign.text
