"""Sweeps are held out as a whole: their ends have other frequencies than their beginnings."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from isorig.analysis.campaign import FloatArray
from isorig.analysis.fitting.held_out import BEFORE, OTHERWISE, ends_otherwise, with_sweeps_held_out
from isorig.analysis.fitting.trials import Trial

RATE, SAMPLES = 1000.0, 20_000


def sweep(low: float, high: float) -> FloatArray:
    """A logarithmic sweep by scipy."""
    from scipy.signal import chirp

    time = np.arange(SAMPLES) / RATE
    return np.asarray(chirp(time, low, time[-1], high, method="logarithmic"))


def mixed(share: float, before: float = 0.0) -> tuple[FloatArray, FloatArray]:
    """A beginning of 10 Hz, and a record whose end has this share of its power at 100 Hz, of which the beginning has a part."""
    time = np.arange(SAMPLES) / RATE
    slow, fast = np.sin(2.0 * np.pi * 10.0 * time), np.sin(2.0 * np.pi * 100.0 * time)
    beginning = slow + np.sqrt(before * share) * fast
    return beginning, np.concatenate([beginning, np.sqrt(1.0 - share) * slow + np.sqrt(share) * fast])


@pytest.mark.parametrize(("low", "high", "otherwise"), [(1.0, 100.0, True), (200.0, 10.0, True), (20.0, 20.5, False)])
def test_the_end_of_a_sweep_over_octaves_has_other_frequencies(low: float, high: float, otherwise: bool) -> None:
    drive = sweep(low, high)
    assert ends_otherwise(drive[:12_000], drive) is otherwise


@pytest.mark.parametrize(("cycles", "otherwise"), [(25.0, True), (15.0, False)])
def test_moves_are_no_sweep(cycles: float, otherwise: bool) -> None:
    end = np.sin(2.0 * np.pi * cycles * np.arange(8_000) / 8_000)
    assert ends_otherwise(np.zeros(12_000), np.concatenate([np.zeros(12_000), end])) is otherwise


def test_noise_steps_and_rest_end_as_they_began() -> None:
    noise = np.random.default_rng(3).normal(0.0, 1.0, SAMPLES)
    steps = np.repeat([0.0, 1.0, 0.0, 1.0, 0.0], SAMPLES // 5)
    for drive in (noise, steps, np.zeros(SAMPLES), sweep(1.0, 100.0)[:150]):
        assert not ends_otherwise(drive[: round(0.6 * len(drive))], drive)


@pytest.mark.parametrize(("share", "otherwise"), [(OTHERWISE + 0.02, True), (OTHERWISE - 0.02, False)])
def test_from_half_of_the_power_elsewhere_on_the_end_is_another(share: float, otherwise: bool) -> None:
    assert ends_otherwise(*mixed(share)) is otherwise


@pytest.mark.parametrize(("before", "otherwise"), [(0.8 * BEFORE, True), (1.25 * BEFORE, False)])
def test_what_the_beginning_had_is_no_other_frequency(before: float, otherwise: bool) -> None:
    assert ends_otherwise(*mixed(0.9, before)) is otherwise


@dataclass
class SweptRun:
    """What is asked of a trial."""

    excitation: object
    measured: FloatArray
    fitted: int
    samples: int
    run: object
    motion: object = None


def trial_of(drive: FloatArray, level: float, fitted: int = 12_000, configuration: str = "unlocked") -> Trial:
    """A trial with this drive whose records are the drive times a level."""
    return cast(
        Trial,
        SweptRun(
            excitation=SimpleNamespace(recorded=drive), measured=level * drive[None], fitted=fitted, samples=SAMPLES,
            run=SimpleNamespace(configuration=configuration),
        ),
    )  # fmt: skip


def test_the_second_strongest_sweep_of_a_configuration_is_held_out() -> None:
    up = sweep(1.0, 100.0)
    noise = np.random.default_rng(3).normal(0.0, 1.0, SAMPLES)
    trials = [
        trial_of(up, 1.0),
        trial_of(up, 3.0),
        trial_of(up, 2.0),
        trial_of(noise, 1.0),
        trial_of(up, 1.0, configuration="locked"),
    ]
    assert [trial.fitted for trial in with_sweeps_held_out(trials)] == [SAMPLES, SAMPLES, 0, 12_000, 12_000]


def test_a_sweep_that_is_marked_as_held_out_takes_its_place() -> None:
    up = sweep(1.0, 100.0)
    trials = [trial_of(up, 1.0, 0), trial_of(up, 3.0), trial_of(up, 2.0)]
    assert [trial.fitted for trial in with_sweeps_held_out(trials)] == [0, SAMPLES, SAMPLES]
