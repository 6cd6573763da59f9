"""A gain that changes within a run is a sweep of levels."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Gap, Run
from isorig.analysis.isolation.ratio import isolation_ratio, stuck_share
from isorig.analysis.spectra.gain_levels import SHORTEST, STEP, by_level, changes, runs_by_level
from isorig.rig.model.prediction import predicted
from isorig.rig.virtual.levels import BEGIN, HEAD_PER_GAIN
from isorig.rig.wire_bonder.description import wire_bonder
from isorig.rig.wire_bonder.isolation import compared_isolation
from isorig.rig.wire_bonder.session import VirtualRun, head_of

RATE = 256.0


def run_with(gain: FloatArray, **more: object) -> Run:
    channels = {
        "head": Channel(name="head", samples=np.arange(len(gain), dtype=np.float64)),
        "gain": Channel(name="gain", samples=gain, quantity="gain", unit="1"),
    }
    return Run(id="s", configuration="unlocked", sample_rate=RATE, gain=float(np.median(gain)), channels=channels, **more)  # type: ignore[arg-type]


def test_a_steady_gain_is_left_alone() -> None:
    noisy = 70.0 * (1.0 + 0.01 * np.random.default_rng(0).normal(size=5000))
    run = run_with(noisy)
    assert not changes(run)
    assert list(runs_by_level(run)) == [run]
    bare = replace(run, channels={"head": run.channels["head"]})
    assert list(runs_by_level(bare)) == [bare]


@given(st.lists(st.sampled_from([0.0, 7.0, 20.0, 35.0, 70.0, 200.0]), min_size=2, max_size=6), st.integers(0, 3))
def test_stretches_are_the_samples_of_their_level(gains: list[float], odd: int) -> None:
    lengths = [int(RATE * (3 + (k + odd) % 3)) for k in range(len(gains))]
    gain = np.concatenate([np.full(n, g) for n, g in zip(lengths, gains, strict=True)])
    run = run_with(gain)
    parts = list(runs_by_level(run))
    if not changes(run):
        assert parts == [run]
        return
    for part in parts:
        streamed = part.read("gain")
        assert np.all(np.abs(np.log(streamed / part.gain)) <= 0.5 * np.log(STEP) * (1 + 1e-9))
        # Samples follow one another as in the run, and none is taken twice.
        assert np.all(np.diff(part.read("head")) == 1.0)
        assert part.duration >= SHORTEST
    taken = np.concatenate([part.read("head") for part in parts]) if parts else np.zeros(0)
    assert len(np.unique(taken)) == len(taken) == int((gain > 0.0).sum())


def test_times_and_gaps_go_with_the_stretches() -> None:
    from datetime import UTC, datetime

    gain = np.repeat([7.0, 70.0], int(10 * RATE))
    began = datetime(2011, 11, 7, tzinfo=UTC)
    run = run_with(gain, started=began, gaps=(Gap(first_tick=100, count=50), Gap(first_tick=int(15 * RATE), count=3)))
    low, high = runs_by_level(run)
    assert low.gaps == (Gap(first_tick=100, count=50),)
    # 50 ticks before it are missing, so tick 15 s is sample 15 s - 50.
    assert high.gaps == (Gap(first_tick=int(15 * RATE) - 50 - int(10 * RATE), count=3),)
    assert high.started == began + timedelta(seconds=10.0)


@pytest.fixture(scope="module")
def swept() -> Campaign:
    """One run each way, in which the dial was turned from 70 to 7 half way."""
    rig, seconds, rate = wire_bonder(), 60.0, 512.0
    runs = []
    for k, configuration in enumerate(("unlocked", "locked")):
        take = VirtualRun(
            id=configuration, configuration=configuration, gain=70.0, seconds=seconds, start=100.0 * k, band=(0.5, 20.0)
        )
        head = head_of(take, rate, 5)
        gain = np.repeat([70.0, 7.0], len(head) // 2)
        head = head * gain / 70.0
        assert head.std() > 0.1 * HEAD_PER_GAIN
        channels = {
            "head": Channel(name="head", samples=head),
            "gain": Channel(name="gain", samples=gain, quantity="gain", unit="1"),
        }
        runs.append(
            Run(
                id=configuration, configuration=configuration, sample_rate=rate, gain=70.0, channels=channels,
                excitation="random", started=BEGIN + timedelta(seconds=take.start), band=take.band,
            )
        )  # fmt: skip
    return predicted(rig, Campaign(runs=tuple(runs), source="swept"))


def test_a_sweep_shows_the_ratio_of_each_level(swept: Campaign) -> None:
    rig = wire_bonder()
    parts = by_level(swept)
    assert len(parts.runs) == 4
    found = isolation_ratio(parts)
    high, low = found.pieces
    assert high.gain > 3.0 * low.gain
    f = low.unlocked.frequency
    kept = (f > 12.0) & (f < 15.0)
    # Held at the low gain, sliding at the high one: told apart, where one average over the run would mix them.
    assert np.median(low.ratio[kept]) == pytest.approx(1.0, abs=0.05)
    assert np.median(high.ratio[kept]) < 0.7
    stuck = [stuck_share(rig, next(r for r in parts.select(configuration="unlocked", gain=p.gain))) for p in (high, low)]
    assert stuck[0] < 0.6
    assert stuck[1] > 0.9


def test_rig_isolation_says_that_it_is_a_sweep(swept: Campaign) -> None:
    found = compared_isolation(swept, [])
    assert found.swept == ("unlocked", "locked")
    assert len(found.measured.pieces) == 2
