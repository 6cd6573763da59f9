"""Hum of one wiring is in several channels: one cause, named where there is most of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from small_rigs import chain, guessed, played

from isorig.analysis.campaign import Campaign
from isorig.analysis.diagnose.diagnosis import diagnose
from isorig.analysis.diagnose.observe import mains
from isorig.analysis.fitting.preparation import prepare

SEED = 5
#: Hz, and the hum in each channel as a share of its rms.
MAINS, SHARES = 50.0, {"a0": 0.03, "a1": 0.08, "a2": 0.05}


def humming() -> Campaign:
    """A chain of three masses whose three records have hum of another phase in each run."""
    campaign = played(chain(), seed=SEED, longer=1.5)
    draw = np.random.default_rng(SEED)
    runs = []
    for run in campaign.runs:
        channels = dict(run.channels)
        for name, share in SHARES.items():
            samples = channels[name].read()
            turn = 2.0 * np.pi * (MAINS * np.arange(len(samples)) / run.sample_rate + draw.uniform())
            channels[name] = replace(channels[name], samples=samples + np.sqrt(2.0) * share * samples.std() * np.sin(turn))
        runs.append(replace(run, channels=channels))
    return Campaign(runs=tuple(runs), source="hum")


def test_the_channel_with_most_hum_comes_first() -> None:
    found = mains(chain(), prepare(humming(), chain()))
    assert list(found) == ["a1", "a2", "a0"]
    assert np.allclose(list(found.values()), MAINS, atol=0.01)


def test_one_cause_takes_it_out_of_all() -> None:
    found = diagnose(humming(), guessed(chain(), SEED))
    assert [(step.cause, step.location) for step in found.steps] == [("mains_hum", "a1")]
    assert found.verdict == "explained"
