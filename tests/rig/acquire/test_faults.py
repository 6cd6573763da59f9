"""Whatever goes wrong on the wire: stored + gaps is what the device counted, and every stored sample is in its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ramps import CHANNELS, Watcher, plan_of, ramp_instrument, ticks_of

from drivers.simulated.framed import Faults
from rig.acquire import take
from rig.acquire.session import acquire
from rig.recording import read

injected: list[int] = []
often = st.floats(0.0, 0.3)


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    # The last frame of a run may be the one that was lost.
    monkeypatch.setattr(take, "SILENCE", 0.4)


@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    drop=often, duplicate=often, corrupt=often, overload=often, seed=st.integers(0, 2**16),
    first_tick=st.sampled_from([0, 2**32 - 1000, 2**31 - 500, 2**32 - 1]), rows=st.integers(1, 9),
)  # fmt: skip
def test_nothing_is_lost_without_being_counted(
    tmp_path_factory: pytest.TempPathFactory, drop: float, duplicate: float, corrupt: float, overload: float, seed: int,
    first_tick: int, rows: int,
) -> None:  # fmt: skip
    faults = Faults(
        drop=drop, duplicate=duplicate, corrupt=corrupt, overload=overload, stall=0.0005, first_tick=first_tick, seed=seed
    )  # fmt: skip
    watcher = Watcher()
    output = tmp_path_factory.mktemp("faults") / "campaign.h5"
    with ramp_instrument(faults, rows=rows) as (port, instrument):
        acquire(plan_of({"id": "a", "seconds": 5.0}), port, output, watcher.operator, force=True)
        injected.append(instrument.count.faults)
        counted = instrument.count.ticks
    run = read(output).runs[0]
    tally = watcher.runs[0].tally
    assert tally.stored + tally.lost == counted == 5120
    assert len(run) + sum(gap.count for gap in run.gaps) == counted
    stored = ticks_of(run)
    for k, name in enumerate(CHANNELS):
        np.testing.assert_array_equal(run.channels[name].samples, stored * 4 + k)


def test_that_was_ten_thousand_faults() -> None:
    if not injected:
        pytest.skip("runs after the property test only")
    assert sum(injected) >= 10_000


def test_an_overload_is_told(tmp_path: Path) -> None:
    watcher = Watcher()
    with ramp_instrument(Faults(overload=1.0)) as (port, _):
        acquire(plan_of({"id": "a"}), port, tmp_path / "c.h5", watcher.operator, force=True)
    assert watcher.runs[0].tally.overloads == 64
    assert not watcher.runs[0].verdict.good
