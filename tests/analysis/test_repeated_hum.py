"""Hum differs between repeated runs by its phase only: it is no disturbance, but a cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_rigs import Take, played, stage

from isorig.analysis.campaign import Campaign
from isorig.analysis.fitting.repeats import disturbance, with_disturbance
from isorig.analysis.fitting.trials import prepare

#: Amplitude of what differs between the runs, as a share of the rms of the record, and the Hz of hum and of a turning fan.
SHARE, MAINS, FAN = 0.1, 50.0, 37.0


def repeated_with(frequency: float) -> Campaign:
    """The same drive twice, with a sine of another phase in the acceleration of each run."""
    campaign = played(stage(), seed=3, takes=(Take(3.0, 1), Take(3.0, 1)))
    runs = []
    for k, run in enumerate(campaign.runs):
        channel = run.channel("a")
        samples = channel.read()
        turn = 2.0 * np.pi * frequency * np.arange(len(samples)) / run.sample_rate + 1.9 * k
        changed = replace(channel, samples=samples + np.sqrt(2.0) * SHARE * samples.std() * np.sin(turn))
        runs.append(replace(run, channels={**run.channels, "a": changed}, repeat_of="r0" if k else None))
    return Campaign(runs=tuple(runs), source="repeated")


@pytest.mark.parametrize(("frequency", "differs"), [(MAINS, False), (FAN, True)])
def test_hum_of_another_phase_is_no_disturbance(frequency: float, differs: bool) -> None:
    trials = prepare(repeated_with(frequency), stage())
    (of_stage, of_acceleration), _ = disturbance(stage(), trials)
    assert of_stage < 0.01
    assert bool(of_acceleration > 0.5 * SHARE) is differs
    assert (with_disturbance(stage(), trials)[0].disturbance is not None) is differs
