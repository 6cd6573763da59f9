"""Whatever goes wrong on the wire: stored + gaps is what the device counted, and every stored sample is in its place."""

from __future__ import annotations

from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ramps import CHANNELS, Watcher, acquire, plan_of, ramp_instrument, ticks_of

from isorig.drivers.errors import ConnectionLostError
from isorig.drivers.simulated.commanded import Faults
from isorig.drivers.simulated.framed import SimulatedFramed
from isorig.rig.acquire.policy import SessionWaits
from isorig.rig.files.recording import read

injected: Counter[str] = Counter()
often = st.floats(0.02, 0.35)


# The last frame of a run may be the one that was lost, and a wire that was cut stays cut.
acquire = partial(acquire, waits=SessionWaits(silence=1.0, reconnection=1.0))


@settings(max_examples=15, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    drop=often, duplicate=often, corrupt=often, overload=often, seed=st.integers(0, 2**16),
    first_tick=st.sampled_from([0, 2**32 - 1000, 2**31 - 500, 2**32 - 1]), rows=st.integers(1, 5),
    ppm=st.sampled_from([0.0, -200.0, 5000.0]),
)  # fmt: skip
def test_nothing_is_lost_without_being_counted(
    tmp_path_factory: pytest.TempPathFactory, drop: float, duplicate: float, corrupt: float, overload: float, seed: int,
    first_tick: int, rows: int, ppm: float,
) -> None:  # fmt: skip
    faults = Faults(
        drop=drop, duplicate=duplicate, corrupt=corrupt, overload=overload, stall=0.0005, first_tick=first_tick, ppm=ppm,
        seed=seed,
    )  # fmt: skip
    watcher = Watcher()
    output = tmp_path_factory.mktemp("faults") / "campaign.h5"
    with ramp_instrument(faults, rows=rows) as (port, instrument):
        acquire(plan_of({"id": "a", "seconds": 5.0}), port, output, watcher.operator, force=True)
        injected.update(instrument.random_faults.happened)
        injected.update({"wrap": int(first_tick + 5120 >= 2**32), "slow clock": int(ppm != 0.0)})
        counted = instrument.sent
    run = read(output).runs[0]
    tally = watcher.runs[0].tally
    assert tally.stored + tally.lost == counted
    assert not any("It ended at" in advice for advice in watcher.runs[0].verdict.advice)
    assert len(run) + sum(gap.count for gap in run.gaps) == counted
    stored = ticks_of(run)
    for k, name in enumerate(CHANNELS):
        np.testing.assert_array_equal(run.channels[name].samples, stored * 4 + k)


def test_that_was_ten_thousand_faults() -> None:
    if not injected:
        pytest.skip("runs after the property test only")
    assert injected.total() >= 10_000
    assert all(injected[kind] > 0 for kind in ("drop", "duplicate", "corrupt", "stall", "overload", "wrap", "slow clock"))


def test_an_overload_is_reported(tmp_path: Path) -> None:
    watcher = Watcher()
    with ramp_instrument(Faults(overload=1.0)) as (port, _):
        acquire(plan_of({"id": "a"}), port, tmp_path / "c.h5", watcher.operator, force=True)
    assert watcher.runs[0].tally.overloads == 64
    assert not watcher.runs[0].verdict.good


@settings(max_examples=6, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(drop=often, seed=st.integers(0, 99), after=st.floats(0.5, 4.5))
def test_what_was_measured_before_a_wire_was_cut_is_all_there(
    tmp_path_factory: pytest.TempPathFactory, drop: float, seed: int, after: float
) -> None:
    output = tmp_path_factory.mktemp("cut") / "campaign.h5"
    faults = Faults(drop=drop, unplug_after=after, seed=seed)
    with ramp_instrument(faults, rows=16, speed=8.0) as (port, instrument):
        with pytest.raises(ConnectionLostError):
            acquire(plan_of({"id": "a", "seconds": 5.0}), port, output, Watcher().operator, force=True)
        counted = instrument.sent
    run = read(output).runs[0]
    stored = ticks_of(run)
    np.testing.assert_array_equal(run.channels["table"].samples, stored * 4 + 2)
    # What it counted beyond the last sample that arrived was dropped, or in the wire when that was cut.
    known = len(run) + sum(gap.count for gap in run.gaps)
    assert known == stored[-1] + 1 <= counted
    assert counted - known <= 0.25 * 8 * 1024


def test_a_gain_that_somebody_turned_is_seen_and_said(tmp_path: Path) -> None:
    watcher = Watcher()
    with ramp_instrument(Faults(turn_after=2.0)) as (port, _):
        acquire(plan_of({"id": "a"}), port, tmp_path / "c.h5", watcher.operator, force=True)
    assert any(
        sentence.startswith("The gain changed from 70 to 77 during the run") for sentence in watcher.runs[0].verdict.advice
    )
    gains = read(tmp_path / "c.h5").runs[0].read("gain")
    np.testing.assert_allclose(gains[:2048], 70.0)
    np.testing.assert_allclose(gains[2048:], 77.0, rtol=1e-6)
    with ramp_instrument(Faults(turn_after=0.0)) as (port, _):
        acquire(plan_of({"id": "a"}), port, tmp_path / "d.h5", watcher.operator, force=True)
    assert any(sentence.startswith("The gain was 77 but the plan has 70") for sentence in watcher.runs[1].verdict.advice)


def test_an_instrument_that_falls_silent_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame_due = SimulatedFramed._frame_due
    monkeypatch.setattr(SimulatedFramed, "_frame_due", lambda self: self.sent < 1024 and frame_due(self))
    watcher, plan = Watcher(), plan_of({"id": "a"})
    with ramp_instrument() as (port, _):
        acquire(plan, port, tmp_path / "c.h5", watcher.operator, force=True)
    assert "It ended at 1024 of 4096 samples; check the instrument and repeat the run." in watcher.runs[0].verdict.advice
    monkeypatch.undo()
    with ramp_instrument() as (port, _):
        acquire(plan, port, tmp_path / "c.h5", watcher.operator, force=True, resume=True)
    assert len(read(tmp_path / "c.h5").runs[0]) == 4096
