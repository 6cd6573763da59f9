"""Channels whose instrument has a clock of its own: the difference is found; sound and drifting rigs have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from small_rigs import chain, guessed, played, with_law

from isorig.analysis import laws
from isorig.analysis.campaign import Campaign, Run
from isorig.analysis.fitting.plausible import doubts_of_records
from isorig.analysis.spectra.clocks import QUARTZ, clock_errors


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


@pytest.mark.parametrize("law", [None, laws.Cubic(cubic_stiffness=3e9), laws.Drift(drift_rate=5e-3)])
def test_other_rigs_have_one_clock(law: laws.SpringLaw | None) -> None:
    campaign = played(chain() if law is None else with_law(chain(), "l1", law), seed=9, longer=2.0)
    assert clock_errors(campaign, chain().drive.channel) == {}


def test_a_wrong_clock_is_the_first_doubt(sound: Campaign) -> None:
    (doubt,) = doubts_of_records(guessed(chain(), 8), with_clock(sound, "a1", 2e-3))
    assert (doubt.kind, doubt.parameter) == ("clock", "sensors.a1")
    rate = sound.runs[0].sample_rate
    assert f"the sample rate of 'a1' is {rate / doubt.ratio:.6g} Hz instead of {rate:.6g} Hz" in doubt.text
