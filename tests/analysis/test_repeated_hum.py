"""What repeated runs do not share: hum of another phase is no disturbance, but a cause; a fan is one, in every run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_rigs import Take, played, stage

from isorig.analysis.campaign import Campaign
from isorig.analysis.fitting.division import begun
from isorig.analysis.fitting.preparation import prepare
from isorig.analysis.fitting.repeats import disturbance, with_disturbance

#: Amplitude of what differs between the runs, as a share of the rms of the record, and the Hz of hum and of a turning fan.
SHARE, MAINS, FAN = 0.1, 50.0, 37.0


def repeated_with(frequency: float, *further: Take) -> Campaign:
    """The same drive twice, and further runs, with a sine of another phase in the acceleration of each run."""
    campaign = played(stage(), seed=3, takes=(Take(3.0, 1), Take(3.0, 1), *further))
    runs = []
    for k, run in enumerate(campaign.runs):
        channel = run.channel("a")
        samples = channel.read()
        turn = 2.0 * np.pi * frequency * np.arange(len(samples)) / run.sample_rate + 1.9 * k
        changed = replace(channel, samples=samples + np.sqrt(2.0) * SHARE * samples.std() * np.sin(turn))
        runs.append(replace(run, channels={**run.channels, "a": changed}, repeat_of="r0" if k == 1 else None))
    return Campaign(runs=tuple(runs), source="repeated")


@pytest.mark.parametrize(("frequency", "differs"), [(MAINS, False), (FAN, True)])
def test_hum_of_another_phase_is_no_disturbance(frequency: float, differs: bool) -> None:
    trials = prepare(repeated_with(frequency), stage())
    (of_stage, of_acceleration), _ = disturbance(stage(), trials)
    assert of_stage < 0.01
    assert bool(of_acceleration > 0.5 * SHARE) is differs
    assert (with_disturbance(stage(), trials)[0].disturbance is not None) is differs


def test_a_run_that_is_judged_without_the_repeated_ones_has_their_disturbance() -> None:
    """As at the beginnings of some runs: what a fan adds there is not due to the rig."""
    trials = with_disturbance(stage(), prepare(repeated_with(FAN, Take(3.0, 2)), stage()))
    of_stage, of_acceleration = disturbance(stage(), [begun(trials[2])])[0]
    assert of_stage < 0.01
    assert of_acceleration == pytest.approx(SHARE, rel=0.3)
