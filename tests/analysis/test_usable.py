"""The usable band: errors count up to it, in records of any filter, and noise is measured between what drive and friction do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import freqz
from small_rigs import Take, chain, played

from isorig.analysis.campaign import USABLE, Campaign, Channel, FloatArray, Run
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.score import score
from isorig.analysis.fitting.trials import Trial, expected, true_motion
from isorig.analysis.simulate.sampling import FALL, FLAT, _lowpass, within
from isorig.analysis.spectra.noise import noise_level, noise_levels

RATE, N = 1024.0, 8192


def run_of(values: FloatArray, usable_to: float | None = None) -> Run:
    channels = {"a": Channel(name="a", samples=values)}
    return Run(id="r", configuration="unlocked", sample_rate=RATE, gain=1.0, channels=channels, usable_to=usable_to)


def tone(share: float) -> FloatArray:
    return np.sin(2 * np.pi * share * np.arange(N))


@pytest.mark.parametrize("highest", [0.2, USABLE, FLAT])
def test_what_is_within_the_band_stays_and_what_is_above_it_goes(highest: float) -> None:
    inner = slice(200, -200)
    for share, left in ((0.1 * highest, 1.0), (highest, 1.0), (highest + FALL, 0.0), (0.499, 0.0)):
        found = within(tone(share), highest * RATE, RATE)[inner]
        assert np.abs(found - left * tone(share)[inner]).max() < 2e-4


def test_the_simulation_samples_flat_to_its_limit_and_without_aliases() -> None:
    taps = _lowpass(8)
    for share, wanted in ((FLAT, 1.0), (1.0 - FLAT, 0.0)):
        _, response = freqz(taps, worN=[2 * np.pi * share / 8])
        assert abs(abs(response[0]) - wanted) < 2e-4
    _, beyond = freqz(taps, worN=[2 * np.pi * 0.45 / 8])
    assert abs(beyond[0]) < 0.99


def test_a_run_is_usable_to_the_analyzers_share_unless_it_states_more_or_less() -> None:
    assert run_of(tone(0.1)).usable == pytest.approx(400.0)
    assert run_of(tone(0.1), usable_to=150.0).usable == 150.0


def bent(trial: Trial, share: float) -> Trial:
    wave = 0.2 * np.std(trial.measured) * np.sin(2 * np.pi * share * np.arange(trial.samples))
    return replace(trial, measured=trial.measured + wave)


def test_an_error_counts_below_the_usable_frequency_and_not_above() -> None:
    trial = prepare(played(chain(), seed=1, takes=(Take(3.0, 1),)), chain())[0]
    usual = score(chain(), [trial]).error.max()
    assert score(chain(), [bent(trial, USABLE - 0.005)]).error.max() > 0.05
    assert score(chain(), [bent(trial, USABLE + FALL + 0.005)]).error.max() < 1.2 * usual
    low = replace(trial, usable=0.2 * trial.sample_rate)
    assert score(chain(), [bent(low, 0.3)]).error.max() < 1.2 * usual


@pytest.mark.parametrize(("stated", "share"), [(None, USABLE), (0.25, 0.25), (0.5, FLAT)])
def test_a_trial_counts_as_its_run_states_and_as_the_simulation_samples(stated: float | None, share: float) -> None:
    campaign = played(chain(), seed=1, takes=(Take(3.0, 1),))
    rate = campaign.runs[0].sample_rate
    run = replace(campaign.runs[0], usable_to=None if stated is None else stated * rate)
    trial = prepare(replace(campaign, runs=(run,)), chain())[0]
    assert trial.usable == pytest.approx(share * rate)
    np.testing.assert_allclose(trial.usable_noise, np.sqrt(2.0 * share) * trial.noise)


def test_a_prediction_of_a_shorter_part_is_that_of_the_whole() -> None:
    trial = prepare(played(chain(), seed=1, takes=(Take(3.0, 1),)), chain())[0]
    whole = expected(chain(), trial)
    part = expected(chain(), trial, true_motion(chain(), trial, 1000))
    assert np.abs(part - whole[:, :1000]).max() < 3e-3 * np.std(whole)


def rubbing(draw: np.random.Generator, noise: float) -> FloatArray:
    # Acceleration of a sliding mass: a slow wave, a jump at each reversal six times a second, and noise.
    wave = 3.0 * np.sin(2 * np.pi * 3.0 * np.arange(N) / RATE + 0.3 * np.sin(0.01 * np.arange(N)))
    return wave + 1.5 * np.sign(wave) + draw.normal(0.0, noise, N)


def test_noise_is_measured_between_the_reversals_of_friction() -> None:
    draw = np.random.default_rng(3)
    found = noise_level(run_of(rubbing(draw, 2e-3)), "a")
    assert found == pytest.approx(2e-3, rel=0.2)


def test_noise_is_that_of_the_usable_band_where_a_filter_takes_the_rest() -> None:
    noise = within(np.random.default_rng(4).normal(0.0, 1.0, N), 0.2 * RATE, RATE)
    assert noise_level(run_of(noise, usable_to=0.2 * RATE), "a") == pytest.approx(1.0, rel=0.1)


def test_noise_is_what_is_not_coherent_with_a_drive_that_reaches_everywhere() -> None:
    draw = np.random.default_rng(5)
    force = draw.normal(0.0, 1.0, N)
    response = np.convolve(force, [0.5, 0.3, -0.1], mode="full")[:N]
    run = run_of(response + draw.normal(0.0, 1e-2, N))
    run = replace(run, channels={**run.channels, "f": Channel(name="f", samples=force + draw.normal(0.0, 1e-4, N))})
    campaign = Campaign(runs=(run,))
    assert noise_levels(campaign, ("f",))["a"] == pytest.approx(1e-2, rel=0.1)
    assert noise_level(run, "a") > 0.1
    # A drive's noise is at most what its responses' noise allows to see.
    assert noise_levels(campaign, ("f",))["f"] < 0.05


def test_an_encoder_has_at_least_the_noise_of_its_counts() -> None:
    still = np.zeros(N, dtype=np.int32)
    still[N // 2 :] = 1
    channel = Channel(name="a", samples=still, scale=1e-5, quantity="displacement", unit="m")
    assert noise_level(replace(run_of(tone(0.1)), channels={"a": channel}), "a") == pytest.approx(1e-5 / np.sqrt(12.0))
    assert noise_level(run_of(np.zeros(N)), "a") == 0.0
    assert noise_level(run_of(np.zeros(255)), "a") is None


def test_the_quietest_run_gives_the_noise() -> None:
    campaign = played(chain(), seed=2, takes=(Take(3.0, 1), Take(1.5, 2)))
    levels = [noise_levels(replace(campaign, runs=(run,)))["a0"] for run in campaign.runs]
    assert noise_levels(campaign)["a0"] == min(levels)
