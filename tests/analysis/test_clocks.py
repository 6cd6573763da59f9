"""Channels whose instrument has a clock of its own: the difference is found; sound and drifting rigs have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from small_rigs import chain, guessed, played, with_law

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Channel, ComplexArray, Run
from isorig.analysis.fitting.plausible import doubts_of_records
from isorig.analysis.spectra import clocks
from isorig.analysis.spectra.clocks import DRIVEN, QUARTZ, SEGMENTS, clock_errors


def with_clock(campaign: Campaign, name: str, error: float) -> Campaign:
    """The campaign with a channel whose samples are further apart by this share."""

    def other(run: Run) -> Run:
        ticks = np.arange(len(run), dtype=float)
        samples = CubicSpline(ticks, run.read(name))(np.minimum(ticks * (1.0 + error), ticks[-1]))
        return replace(run, channels={**run.channels, name: replace(run.channels[name], samples=samples, scale=1.0, offset=0.0)})

    return replace(campaign, runs=tuple(map(other, campaign.runs)))


@pytest.fixture(scope="module")
def sound() -> Campaign:
    return played(chain(), seed=8, longer=2.0)


@pytest.mark.parametrize("error", [-2e-3, 1e-3, 5e-3])
def test_the_difference_of_two_clocks(error: float, sound: Campaign) -> None:
    found = clock_errors(with_clock(sound, "a1", error), chain().drive.channel)
    assert found == {"a1": pytest.approx(error, rel=0.15)}


@pytest.mark.parametrize(("share", "told"), [(0.5, False), (5.0, True)])
def test_boundary_of_quartz_clocks(share: float, told: bool, sound: Campaign) -> None:
    assert bool(clock_errors(with_clock(sound, "a1", share * QUARTZ), chain().drive.channel)) is told


@pytest.mark.parametrize(("std", "read"), [(0.099 * QUARTZ, ["low"]), (0.101 * QUARTZ, ["low", "high"])])
def test_a_run_that_excludes_a_difference_ends_the_search(
    std: float, read: list[str], sound: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    # An interval of six standard errors around 0.4 of what quartz clocks have, in the run of the lowest gain.
    asked: list[str] = []

    def change(run: Run, name: str, of_drive: ComplexArray, length: int) -> tuple[float, float, float]:
        asked.append(run.id)
        return 0.4 * QUARTZ, std, 0.0

    run = sound.runs[0]
    run = replace(run, channels={name: run.channels[name] for name in (chain().drive.channel, "a1")})
    monkeypatch.setattr(clocks, "_change", change)
    campaign = Campaign(runs=(replace(run, id="high", gain=5.0), replace(run, id="low", gain=-2.0)))
    assert clock_errors(campaign, chain().drive.channel) == {}
    assert asked == read


@pytest.mark.parametrize("law", [None, laws.Cubic(cubic_stiffness=3e9), laws.Drift(drift_rate=5e-3)])
def test_other_rigs_have_one_clock(law: laws.SpringLaw | None) -> None:
    campaign = played(chain() if law is None else with_law(chain(), "l1", law), seed=9, longer=2.0)
    assert clock_errors(campaign, chain().drive.channel) == {}


def test_a_wrong_clock_is_the_first_doubt(sound: Campaign) -> None:
    (doubt,) = doubts_of_records(guessed(chain(), 8), with_clock(sound, "a1", 2e-3))
    assert (doubt.kind, doubt.parameter) == ("clock", "sensors.a1")
    rate = sound.runs[0].sample_rate
    assert f"the sample rate of 'a1' is {rate / doubt.ratio:.6g} Hz instead of {rate:.6g} Hz" in doubt.text


def with_harmonics() -> Campaign:
    """One run of 8 s with a sine of 4 Hz as its drive, whose response has the harmonics of friction beside a spring."""
    phase = 8.0 * np.pi * np.arange(8000) / 1000.0
    drive = np.sin(phase) + np.random.default_rng(2).normal(0.0, 1e-4, len(phase))
    return of_one_run(drive, 2.0 * np.sin(phase) + np.tanh(3.0 * np.cos(phase)), 1000.0)


def of_one_run(drive: np.ndarray, response: np.ndarray, rate: float) -> Campaign:
    channels = {
        "d": Channel(name="d", unit="m", quantity="displacement", samples=drive),
        "r": Channel(name="r", unit="N", quantity="force", samples=response),
    }
    run = Run(id="r1", configuration="base", gain=1.0, excitation="other", sample_rate=rate, channels=channels)
    return Campaign(runs=(run,), known={})


def test_the_harmonics_of_a_sine_are_no_clock() -> None:
    assert clock_errors(with_harmonics(), "d") == {}


@pytest.mark.parametrize(("share", "told"), [(0.3, False), (3.0, True)])
def test_boundary_of_what_a_drive_contains(share: float, told: bool) -> None:
    # Noise beside a line of a thousand times its rms: its power in a bin is this share of the smallest one that counts.
    rate, draw, n = 1000.0, np.random.default_rng(5), 64000
    noise, ticks = draw.normal(0.0, 1.0, n), np.arange(n, dtype=float)
    length = 1 << int(np.log2(n // SEGMENTS))
    window = np.hanning(length)
    line = np.sqrt(4.0 * float(np.sum(window**2)) / (share * DRIVEN)) / float(np.sum(window))
    drive = noise + line * np.sin(2.0 * np.pi * 100.0 * ticks / rate)
    response = CubicSpline(ticks, noise)(np.minimum(ticks * 1.0003, ticks[-1]))
    assert bool(clock_errors(of_one_run(drive, response, rate), "d")) is told
