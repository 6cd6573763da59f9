"""Flat tops of records: a clipped record has them; a rest, a plateau of a command and a slow swing have not."""

from __future__ import annotations

import numpy as np
import pytest

from isorig.analysis.campaign import SI_UNIT, Campaign, Channel, Run
from isorig.analysis.diagnose.observe import FLAT_ROWS, FLAT_SAMPLES, FLAT_SHARE, PILE, flat_tops
from isorig.analysis.equations.errors import clipped
from isorig.analysis.spectra.overload import SCATTER, SCATTER_NOISE, WIDE_NOISE, WIDEST, noisy_limit, plateaus

TIME = np.arange(4000) / 400.0


def campaign(samples: np.ndarray) -> Campaign:
    channel = Channel(name="motor", samples=samples, quantity="force", unit=SI_UNIT["force"])
    run = Run(id="r", configuration="normal", sample_rate=400.0, gain=1.0, channels={"motor": channel})
    return Campaign(runs=(run,), source="test")


def found(samples: np.ndarray) -> dict[str, float]:
    return flat_tops(campaign(samples), {"motor": float(np.abs(samples).max())})


def test_a_clipped_record_has_flat_tops() -> None:
    assert found(np.clip(np.sin(2 * np.pi * 3.1 * TIME), -0.8, 0.8)) == {"motor": pytest.approx(0.8, rel=2e-3)}


@pytest.mark.parametrize(("noise", "flat"), [(0.0008, True), (0.0014, True), (0.01, True), (0.03, False)])
def test_noise_after_a_limit_does_not_hide_it(noise: float, flat: bool) -> None:
    noisy = np.random.default_rng(5).normal(0.0, 0.8 * noise, len(TIME))
    samples = np.clip(np.sin(2 * np.pi * 3.1 * TIME), -0.8, 0.8) + noisy
    assert found(samples) == ({"motor": pytest.approx(0.8, rel=max(1e-3, 0.3 * noise))} if flat else {})


@pytest.mark.parametrize("noise", [0.0008, 0.0014])
def test_what_is_missing_beyond_a_noisy_limit_is_computed_all_the_same(noise: float) -> None:
    sine = np.sin(2 * np.pi * 3.1 * TIME)
    samples = np.clip(sine, -0.8, 0.8) + np.random.default_rng(5).normal(0.0, 0.8 * noise, len(TIME))
    (error,) = clipped(samples, float(np.abs(samples).max()), 400.0)
    beyond = np.abs(sine) > 0.82
    assert np.mean(error[beyond] != 0.0) > 0.98
    assert np.std(error[beyond] + (sine - samples)[beyond]) < 0.2 * np.std((sine - samples)[beyond])


@pytest.mark.parametrize(("far", "limited"), [(0.99 * SCATTER, True), (1.01 * SCATTER, False)])
def test_noise_scatters_a_limit_up_to_a_share_of_it(far: float, limited: bool) -> None:
    assert (noisy_limit(np.repeat([1.0, 1.0 + far], [60, 40])) is not None) is limited


@pytest.mark.parametrize(("far", "limited"), [(0.99, True), (1.01, False)])
def test_noise_of_known_size_scatters_a_limit_further(far: float, limited: bool) -> None:
    noise = 0.5 * WIDEST / WIDE_NOISE
    assert (noisy_limit(np.repeat([1.0, 1.0 + far * SCATTER_NOISE * noise], [60, 40]), noise) is not None) is limited


@pytest.mark.parametrize(("share", "limited"), [(0.99, True), (1.01, False)])
def test_more_noise_than_the_widest_range_allows_is_no_reason_to_look_further(share: float, limited: bool) -> None:
    noise = share * WIDEST / WIDE_NOISE / 0.98
    assert (noisy_limit(np.repeat([1.0, 0.98 + 0.02 * 1.9], [60, 40]), noise) is not None) is limited


def test_values_spread_evenly_up_to_a_largest_one_have_no_limit() -> None:
    assert noisy_limit(np.linspace(0.0, 1.0, 1000)) is None
    assert noisy_limit(np.zeros(0)) is None


@pytest.mark.parametrize("count", [FLAT_SAMPLES - 1, FLAT_SAMPLES])
def test_flat_tops_begin_at_their_number_of_samples(count: int) -> None:
    samples = 0.9 * np.sin(2 * np.pi * 20.0 * TIME)
    for first, stop in zip((40, 140, 240), (40 + count - 10, 145, 245), strict=True):
        samples[first:stop] = 1.0
    assert bool(found(samples)) is (count >= FLAT_SAMPLES)


@pytest.mark.parametrize("rows", [FLAT_ROWS - 1, FLAT_ROWS])
def test_a_limit_cuts_off_several_times(rows: int) -> None:
    """A body that stops once or twice at its largest position is at rest there."""
    samples = 0.9 * np.sin(2 * np.pi * 20.0 * TIME)
    for first in 40 + 100 * np.arange(rows):
        samples[first : first + FLAT_SAMPLES] = 1.0
    assert bool(found(samples)) is (rows >= FLAT_ROWS)


@pytest.mark.parametrize("noise", [0.0, 1e-3, 5e-3, 0.01, 0.02])
def test_crests_of_a_sweep_are_no_flat_tops(noise: float) -> None:
    """Many of them are equally high, and a few samples are at each."""
    sweep = np.sin(2.0 * np.pi * (9.0 + 0.3 * TIME) * TIME)
    assert found(sweep + noise * np.random.default_rng(3).normal(size=len(TIME))) == {}


@pytest.mark.parametrize(("share", "flat"), [(0.7, False), (1.4, True)])
def test_magnitudes_pile_up_at_a_limit(share: float, flat: bool) -> None:
    """`PILE` times more are at it than within the same distance below."""
    samples = 0.5 * np.sin(2 * np.pi * 20.0 * TIME)
    samples[40:600:20] = 1.0
    below = round(28 / (share * PILE))
    samples[700 : 700 + 20 * below : 20] = 1.0 - 1.5 * FLAT_SHARE
    assert bool(found(samples)) is flat


def test_rests_plateaus_and_slow_swings_are_no_flat_tops() -> None:
    rest = np.where(TIME < 4.0, 1.0 - np.exp(-5.0 * TIME), np.exp(-5.0 * (TIME - 4.0)))
    noise = np.random.default_rng(4).normal(0.0, 3e-4, len(TIME))
    for samples in (np.sign(np.sin(TIME)), np.floor(TIME), np.sin(TIME), rest, np.round(rest, 3), np.minimum(TIME, 1.0) + noise):
        assert found(samples) == {}
        assert plateaus(Channel(name="motor", samples=samples)) == 0


def test_an_error_at_a_limit_needs_three_tops_of_three_samples() -> None:
    """Samples within half a per cent of the largest are at the limit; the rest of a record is as it is."""
    wave = 0.3 * np.sin(2.0 * np.pi * 0.7 * TIME)
    for tops, length, held in ((3, 3, True), (2, 3, False), (5, 2, False)):
        samples, at = wave.copy(), []
        for top in range(tops):
            rows = np.arange(200 + 700 * top, 200 + 700 * top + length)
            samples[rows] = 1.0 - 0.002 * (rows % 2) * (top > 0)
            at += rows.tolist()
        error = clipped(samples, 1.0, 400.0)
        assert bool(error) is held
        assert not held or np.flatnonzero(error[0]).tolist() == at
