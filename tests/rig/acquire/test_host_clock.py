"""The host's clock decides on the rate: an instrument whose counter and clock are wrong together is refused or reported."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import h5py
import msgspec
import numpy as np
import pytest

from isorig.rig.acquire import preflight
from isorig.rig.acquire.policy import RATE_ESTIMATES, RATE_REFUSED, RATE_REPORTED, RATE_SECONDS

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "drivers"))

from far import DataqFar, FramedFar, scan_bytes
from ramps import Watcher, acquire, plan_of, ramp_instrument
from test_sessions_attacked import plan, session, wait_for

from isorig.drivers.block import Block
from isorig.drivers.errors import InstrumentError
from isorig.rig.acquire.measure_run import PaceCheck
from isorig.rig.acquire.pace import Pace
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.recover import working
from isorig.rig.errors import PlanError
from isorig.rig.files.recording import read


def arrivals(rate: float, seconds: float, seed: int, *, stated: float = 1000.0, rows: int = 50) -> Pace:
    """Blocks of an instrument with that rate; each is up to 4 ms late, and some much more."""
    random = np.random.default_rng(seed)
    ticks = np.arange(rows, rate * seconds, rows)
    late = random.uniform(0.0, 4e-3, len(ticks)) + random.exponential(0.05, len(ticks)) * (random.random(len(ticks)) < 0.2)
    pace = Pace(stated)
    for part in np.array_split(np.arange(len(ticks)), 7):
        pace.add(ticks[part], 12345.0 + ticks[part] / rate + late[part])
    return pace


@pytest.mark.parametrize("limit", [RATE_REPORTED, RATE_REFUSED])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_deviation_above_the_limit_is_certain_after_a_minute_and_one_below_it_is_not(
    limit: float, sign: float, seed: int
) -> None:
    above = arrivals(1000.0 * (1.0 + sign * 1.2 * limit), 60.0, seed).drift()
    below = arrivals(1000.0 * (1.0 + sign * 0.95 * limit), 60.0, seed).drift()
    assert above is not None
    assert below is not None
    assert above.beyond(limit)
    assert not below.beyond(limit)
    assert above.ppm == pytest.approx(sign * 1.2e6 * limit, abs=150.0)


@pytest.mark.parametrize("seed", range(5))
def test_ten_seconds_show_half_a_percent_and_a_silence_is_no_deviation(seed: int) -> None:
    found = arrivals(995.0, 10.0, seed).drift()
    assert found is not None
    assert found.beyond(RATE_REPORTED)
    assert not found.beyond(RATE_REFUSED)
    # Nothing arrives for two seconds, then all that was held at once.
    ticks = np.arange(50, 10_000, 50)
    times = np.maximum(ticks / 1000.0, np.where((ticks > 3000) & (ticks <= 5000), 5.0, 0.0))
    pace = Pace(1000.0)
    pace.add(ticks, times)
    silent = pace.drift()
    assert silent is not None
    assert abs(silent.ppm) < 100.0


def test_too_little_is_not_judged() -> None:
    pace = Pace(1000.0)
    assert pace.drift() is None
    pace.add(np.arange(50, 350, 50), np.arange(6) * 0.05)
    assert pace.drift() is None
    assert arrivals(500.0, 0.3, 0).drift() is None


def test_a_check_estimates_the_rate_now_and_then_however_often_it_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    estimated: list[float] = []

    def wrong(blocks: list[Block], rate: float, *, certain: bool) -> float | None:
        estimated.append(blocks[-1].host_time)
        return None if blocks[-1].host_time >= 3.0 else 2.0 * rate

    monkeypatch.setattr(preflight, "_wrong_rate", wrong)
    seen = preflight.CheckedRate(1000, 1000.0)

    def after(tick: int, host_time: float) -> bool:
        seen.blocks.append(Block(first_tick=tick - 50, samples=np.zeros((50, 1)), host_time=host_time))
        return any(seen.known() for _ in range(3))

    assert not seen.known()
    assert not after(999, 1.0)
    assert estimated == []
    assert not after(1000, 2.0)
    assert not after(1050, 2.0 + 0.99 * RATE_ESTIMATES)
    assert estimated == [2.0]
    assert not after(1100, 2.0 + 1.01 * RATE_ESTIMATES)
    assert after(2000, 3.0)
    assert len(estimated) == 3
    # A rate that stays wrong is observed for as long as certainty takes, from the first block on.
    monkeypatch.setattr(preflight, "_wrong_rate", lambda blocks, rate, *, certain: 2.0 * rate)
    assert not after(2100, 1.0 + 0.99 * RATE_SECONDS)
    assert after(2150, 1.0 + 1.01 * RATE_SECONDS)


@pytest.mark.parametrize("speed", [0.5, 0.88, 2.0])
def test_a_framed_stream_whose_counter_and_clock_are_wrong_is_not_started(tmp_path: Path, speed: float) -> None:
    with (
        FramedFar(frames=10**9, speed=speed, virtual=False) as far,
        pytest.raises(PlanError, match=r"run 'a' was not started: the instrument's sample rate is \d+.* Hz by the host's clock"),
    ):
        acquire(plan(4.0), far.port, tmp_path / "c.h5", Watcher().operator)
    assert list(tmp_path.iterdir()) == []


def scans(seconds: float) -> Plan:
    made = plan_of(
        {"id": "a", "seconds": seconds, "excitation": "other"}, rate=2000.0, instrument={"kind": "di1100", "full_scale": 10.0}
    )
    return msgspec.structs.replace(made, channels={name: made.channels[name] for name in ("head", "motor")})


@pytest.mark.parametrize("clock", [0.8, 1.2])
def test_a_scan_rate_that_is_wrong_is_not_started(tmp_path: Path, clock: float) -> None:
    with DataqFar(clock=clock) as far, pytest.raises(PlanError, match="Hz by the host's clock, not 2000 Hz"):
        acquire(scans(4.0), far.port, tmp_path / "c.h5", Watcher().operator)


def test_scans_that_nothing_marks_are_not_started(tmp_path: Path) -> None:
    wire = DataqFar(stream=lambda first, last: scan_bytes(first, last, digital=0))
    with wire as far, pytest.raises(PlanError, match="which of the samples belong to which input after a lost byte; leave the"):
        acquire(scans(4.0), far.port, tmp_path / "c.h5", Watcher().operator)


@pytest.mark.parametrize("clock", [0.5, 1.25])
def test_a_forced_run_with_a_wrong_rate_is_reported_and_stored(tmp_path: Path, clock: float) -> None:
    watcher = Watcher()
    with FramedFar(frames=10**9, speed=clock, virtual=False) as far:
        acquire(plan(2.0), far.port, tmp_path / "c.h5", watcher.operator, force=True)
    verdict = watcher.runs[0].verdict
    assert not verdict.good
    assert any(sentence.startswith("Its clock deviates from the host's by ") for sentence in verdict.advice)
    with h5py.File(tmp_path / "c.h5") as file:
        about = dict(file["runs/a"].attrs)
    assert about["clock_drift_ppm"] == pytest.approx(1e6 * (clock - 1.0), abs=2e4)


class Slowing(FramedFar):
    """Right in its first run, which is the pre-run check, and 10 % slow from then on."""

    def obey(self, word: str, words: list[str]) -> None:
        self.speed = 0.9 if word == "START" and self.stopped else self.speed
        super().obey(word, words)


def test_a_rate_that_becomes_wrong_ends_the_run_and_keeps_its_data(tmp_path: Path) -> None:
    with Slowing(frames=10**9, speed=1.0) as far:
        with pytest.raises(InstrumentError, match=r"Hz by the host's clock, not 1000 Hz \(-\d.*\), so the run was ended"):
            acquire(plan(60.0, excitation="other"), far.port, tmp_path / "c.h5", Watcher().operator)
        wait_for(lambda: not far.running)
    run = read(tmp_path / "c.h5").runs[0]
    assert 900 <= len(run) < 20_000
    np.testing.assert_array_equal(run.channels["head"].samples, np.arange(len(run)))


def test_a_right_rate_is_not_mentioned(tmp_path: Path) -> None:
    watcher = Watcher()
    with FramedFar(frames=10**9, speed=1.0) as far:
        acquire(plan(2.0, excitation="other"), far.port, tmp_path / "c.h5", watcher.operator)
    assert not any("clock" in sentence for sentence in watcher.runs[0].verdict.advice)


def test_a_simulated_instrument_may_run_faster_than_real_time(tmp_path: Path) -> None:
    watcher = Watcher()
    with ramp_instrument(speed=8.0) as (port, _):
        acquire(plan_of({"id": "a", "seconds": 8.0, "excitation": "other"}), port, tmp_path / "c.h5", watcher.operator)
    assert not any("clock" in sentence for sentence in watcher.runs[0].verdict.advice)


def test_recovery_reports_a_wrong_rate(tmp_path: Path) -> None:
    with FramedFar(frames=10**9, speed=0.5) as far:
        process = session(tmp_path, far.port)
        wait_for(lambda: far.sent > 30)
        process.kill()
        process.communicate()
    with working(tmp_path / "c.h5.partial") as (_, found):
        assert "by the host's clock its sample rate deviates by -" in found[0].text


def busy(rate: float, seconds: float, seed: int, *, worst: float) -> Pace:
    """Arrivals at a host that is busy for most of the time: it then reads late, up to the worst, and all that waited at once."""
    random = np.random.default_rng(seed)
    ticks = np.arange(50, rate * seconds, 50)
    times, at = ticks / rate, 0.0
    while at < seconds:
        stall, pause = random.uniform(0.0, worst), random.exponential(0.05)
        times = np.where((times >= at) & (times < at + stall), at + stall, times)
        at += stall + pause
    pace = Pace(1000.0)
    pace.add(ticks, 12345.0 + times)
    return pace


@pytest.mark.parametrize("seed", range(20))
def test_ten_seconds_on_a_busy_host_refuse_no_right_rate(seed: int) -> None:
    found = busy(1000.0, RATE_SECONDS, seed, worst=0.5).drift()
    assert found is None or not found.beyond(RATE_REFUSED)
    # Late from the middle on, or later and later over two seconds.
    ticks = np.arange(50, 10_000, 50)
    late = {"step": 0.4 * (ticks > 5000), "growing": np.clip(ticks - 5000 - 100 * seed, 0, 2000) * 2e-4}
    for name, delays in late.items():
        pace = Pace(1000.0)
        pace.add(ticks, ticks / 1000.0 + delays + np.random.default_rng(seed).uniform(0.0, 4e-3, len(ticks)))
        drift = pace.drift()
        assert drift is not None, name
        assert not drift.beyond(RATE_REFUSED), name


@pytest.mark.parametrize("clock", [0.5, 0.88, 1.2, 2.0])
@pytest.mark.parametrize("seed", range(5))
def test_ten_seconds_on_a_busy_host_refuse_a_wrong_rate(clock: float, seed: int) -> None:
    found = busy(1000.0 * clock, RATE_SECONDS, seed, worst=0.1).drift()
    assert found is not None
    assert found.beyond(RATE_REFUSED)
    assert found.ppm == pytest.approx(1e6 * (clock - 1.0), abs=2e4)


@pytest.mark.parametrize(("clock", "refused"), [(1.0, False), (0.985, False), (0.96, True), (1.04, True)])
def test_a_running_stream_is_judged_after_ten_seconds(clock: float, refused: bool) -> None:
    check = PaceCheck("it", 1000.0)

    def until(seconds: float) -> None:
        for tick in range(0, round(1000.0 * clock * seconds), 50):
            check.add(Block(first_tick=tick, samples=np.zeros((50, 1)), host_time=(tick + 50) / (1000.0 * clock)))

    until(RATE_SECONDS - 0.1)
    check = PaceCheck("it", 1000.0)
    if refused:
        with pytest.raises(InstrumentError, match="by the host's clock, not 1000 Hz"):
            until(RATE_SECONDS + 0.2)
    else:
        until(3.0 * RATE_SECONDS)


def test_a_rate_that_becomes_wrong_after_an_hour_is_noticed_within_twenty_seconds() -> None:
    check = PaceCheck("it", 1000.0)

    def pass_on(first: int, last: int, rate: float) -> None:
        for tick in range(first, last, 50):
            time_then = min(tick + 50, 3_600_000) / 1000.0 + max(tick + 50 - 3_600_000, 0) / rate
            check.add(Block(first_tick=tick, samples=np.zeros((50, 1)), host_time=time_then))

    pass_on(0, 3_600_000, 1000.0)
    with pytest.raises(InstrumentError, match="so the run was ended"):
        pass_on(3_600_000, 3_620_000, 900.0)


class Late(FramedFar):
    """Right in the long run, but later and later in the first second and a half, up to half a second."""

    def work(self) -> None:
        self.speed = 0.7 if time.monotonic() - self._began < 1.5 else 1.0
        super().work()


def test_a_host_that_is_late_during_the_check_does_not_refuse_a_right_instrument(tmp_path: Path) -> None:
    watcher = Watcher()
    with Late(frames=10**9, speed=1.0) as far:
        acquire(plan(2.0, excitation="other"), far.port, tmp_path / "c.h5", watcher.operator)
        assert far.stopped == 2
    assert len(read(tmp_path / "c.h5").runs[0]) >= 2000
