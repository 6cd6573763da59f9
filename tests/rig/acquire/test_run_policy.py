"""The thresholds of the checks, each just below and just above its value; those of a run are in `test_check.py`."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from isorig.analysis.campaign import Channel, Run
from isorig.analysis.simulate.excitation import random
from isorig.analysis.spectra.welch import estimate
from isorig.drivers.block import Block
from isorig.rig.acquire.incoherence import driven_bins, incoherence
from isorig.rig.acquire.live import advice
from isorig.rig.acquire.pace import ClockDrift
from isorig.rig.acquire.plan import plan_of
from isorig.rig.acquire.preflight import _channel, _response, _wrong_rate, check_record
from isorig.rig.acquire.recover import Recovered
from isorig.rig.acquire.run_check import _coherence, check_run
from isorig.rig.wire_bonder.description import wire_bonder

WAVE = np.random.default_rng(1).normal(size=1000)


def run(**channels: np.ndarray) -> Run:
    """A run at 1000 Hz."""
    return Run(
        id="a", configuration="unlocked", sample_rate=1000.0, gain=1.0,
        channels={name: Channel(name=name, samples=values) for name, values in channels.items()},
    )  # fmt: skip


@pytest.mark.parametrize(("share", "said"), [(0.029, "3 %"), (0.031, ""), (0.799, ""), (0.801, "80 %")])
def test_a_channel_uses_three_to_eighty_percent_of_its_range(share: float, said: str) -> None:
    sentences = advice({"motor": 10.0 * share}, {"motor": 10.0})
    assert bool(sentences) is bool(said)
    assert said in "".join(sentences)


@pytest.mark.parametrize(("peak", "clipped"), [(0.9985, False), (0.9995, True)])
def test_a_value_at_the_end_of_the_range_is_clipped(peak: float, clipped: bool) -> None:
    values = 8.0 * peak * WAVE / np.abs(WAVE).max()
    assert ("exceeds its input's range" in "".join(_channel("motor", values, 8.0))) is clipped


@pytest.mark.parametrize(("factor", "responds"), [(1.19, False), (1.21, True)])
def test_a_channel_responds_that_increases_by_a_fifth(factor: float, responds: bool) -> None:
    resting = np.arange(2000) < 1000
    values = {"table": np.concatenate([WAVE, 3.0 * WAVE]), "motor": np.concatenate([WAVE, factor * WAVE])}
    assert ("motor does not respond" in "".join(_response(values, resting))) is not responds


@pytest.mark.parametrize(("rate", "kept"), [(991.0, True), (989.0, False), (1009.0, True), (1011.0, False)])
def test_the_rate_of_a_record_may_be_a_percent_off(rate: float, kept: bool) -> None:
    plan = plan_of({"instrument": {"kind": "framed", "port": "p", "sample_rate": rate}, "channels": {}})
    assert (check_record(run(head=WAVE), plan) == []) is kept


@pytest.mark.parametrize(("ppm", "reported"), [(1990.0, False), (2010.0, True), (-2010.0, True)])
def test_a_rate_is_reported_from_two_thousandths_on(ppm: float, reported: bool) -> None:
    measured = Recovered(
        id="a", finished=True, begun=True, run=run(head=WAVE), stored=1000, lost=0, planned=1000, overloads=0, planned_gain=1.0,
        drift=ClockDrift(ppm=ppm, std=1.0),
    )  # fmt: skip
    assert any("clock deviates" in text for text in check_run(measured, rig=wire_bonder()).advice) is reported


@pytest.mark.parametrize(("rate", "wrong"), [(760.0, False), (740.0, True), (1240.0, False), (1260.0, True)])
def test_few_blocks_show_a_rate_that_is_a_quarter_off(rate: float, wrong: bool) -> None:
    blocks = [Block(first_tick=200 * k, samples=np.zeros((200, 1)), host_time=200 * (k + 1) / rate) for k in range(3)]
    assert (_wrong_rate(blocks, 1000.0) is not None) is wrong


def in_band(seed: int) -> np.ndarray:
    """A minute of noise from 1 to 200 Hz, rms 1, with the noise of a good sensor."""
    signal = random(samples=60_000, sample_rate=1000.0, rms=1.0, band=(1.0, 200.0), seed=seed)
    return signal + np.random.default_rng(seed).normal(0.0, 1e-4, len(signal))


def reason(motion: np.ndarray, other: np.ndarray, *, level: float = 1.0, repeat: bool = False) -> str:
    """Why a motion is incoherent with its drive, by another run: a repeat, or one at another level of the drive."""
    first, second = run(head=in_band(1), x=motion), run(head=level * in_band(1 if repeat else 2), x=other)
    first, second = replace(first, band=(1.0, 200.0)), replace(second, id="b", band=(1.0, 200.0))
    spectra = estimate([first], references=["head"], resolution=0.5)
    return incoherence(first, spectra, "x", "head", others=[second]).kind


@pytest.mark.parametrize(("ratio", "kind"), [(0.25, "nonlinear"), (0.35, "undecided"), (0.65, "undecided"), (0.75, "noise")])
def test_what_two_runs_with_one_drive_do_not_share_is_noise(ratio: float, kind: str) -> None:
    disturbance = 2.0 * in_band(3)
    motion = in_band(1) + disturbance
    # Half the power of the difference is the share that is not repeated.
    assert reason(motion, motion + np.sqrt(2.0 * ratio) * 2.0 * in_band(4), repeat=True) == kind


@pytest.mark.parametrize(("level", "kind"), [(1.1, "undecided"), (1.3, "nonlinear"), (0.7, "nonlinear")])
def test_another_level_of_the_drive_differs_by_a_fifth(level: float, kind: str) -> None:
    assert reason(in_band(1) + 2.0 * in_band(3), 3.0 * level * in_band(2) + 2.0 * in_band(4), level=level) == kind


@pytest.mark.parametrize(("gain", "kind"), [(1.3, "undecided"), (1.6, "nonlinear")])
def test_transfer_functions_differ_by_more_than_chance(gain: float, kind: str) -> None:
    """With twice as much disturbance as signal and 40 averages, a gain that is 45 % larger doubles the mean square."""
    assert reason(in_band(1) + 2.0 * in_band(3), 1.5 * (gain * in_band(2) + 2.0 * in_band(4)), level=1.5) == kind


@pytest.mark.parametrize(("share", "kept"), [(0.009, False), (0.011, True)])
def test_a_frequency_is_driven_from_a_hundredth_of_the_largest_power_on(share: float, kept: bool) -> None:
    frequency = np.linspace(0.0, 500.0, 501)
    density = np.where(frequency < 100.0, 1.0, share)
    spectra = SimpleNamespace(frequency=frequency, resolution=1.0, density=lambda name: density)
    assert driven_bins(run(head=WAVE), spectra, "head")[200] == kept  # type: ignore[arg-type]


@pytest.mark.parametrize(("bins", "known"), [(19, False), (20, True)])
def test_a_coherence_needs_a_resolved_band(bins: int, known: bool) -> None:
    measured = replace(run(head=in_band(1), x=in_band(1)), band=(10.0, 10.0 + 0.5 * (bins - 1)))
    spectra = estimate([measured], references=["head"], resolution=0.5)
    assert bool(_coherence(measured, spectra, "head")) is known
