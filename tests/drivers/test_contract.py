"""What every driver keeps to, in one class: loss is counted, status reported, the drive stopped, the rate held against the host's
clock, and every wait ended. The test of each kind states its far end in `CASES`."""

from __future__ import annotations

import time
import tomllib
from contextlib import AbstractContextManager, suppress
from itertools import pairwise

import numpy as np
import pytest
from campaign import SHORT, read
from contract import Served, Situation, stated
from far import within

from isorig.drivers.block import Block, Status
from isorig.drivers.errors import DriverError
from isorig.drivers.instrument import Exciter, Sourcing, Stream
from isorig.drivers.kinds import RecordsKind, kinds
from isorig.rig.acquire.instruments import opened, opened_analyzer
from isorig.rig.acquire.plan import Plan, plan_of

#: Seconds that any call to an instrument that says nothing may take, with the patience that is set here.
LONGEST = 8.0


CASES = stated()
STREAMS = [name for name in CASES if not isinstance(kinds()[name], RecordsKind)]


def plan(kind: str) -> Plan:
    """The example of a kind as a plan."""
    return plan_of(tomllib.loads(f'[instrument]\nkind = "{kind}"\nport = "-"\n{kinds()[kind].example}'))


def streaming(kind: str, served: Served) -> AbstractContextManager[Stream]:
    return opened(plan(kind), served.port, SHORT)


def begin(instrument: Stream, kind: str) -> None:
    """A run with a drive, where the instrument plays one."""
    instrument.prepare(sample_rate=CASES[kind].rate, channels=[0, 1])
    if isinstance(instrument, Exciter):
        instrument.set_gain(1.0)
        instrument.load_drive(np.full(50_000, 10.0))
    instrument.start()


def measured(kind: str, situation: Situation, ticks: int) -> list[Block]:
    """The blocks of a run."""
    with CASES[kind].serve(situation) as served, streaming(kind, served) as instrument:
        begin(instrument, kind)
        blocks = read(instrument, ticks, 3.0)
        instrument.stop()
        return blocks + read(instrument, 10**9, 0.1)


def test_every_kind_keeps_to_the_contract() -> None:
    assert set(CASES) == set(kinds())


class TestContract:
    """One instrument after the other, at a far end that shares no code with its driver."""

    @pytest.mark.parametrize("kind", STREAMS)
    def test_lost_samples_are_counted_at_their_place(self, kind: str) -> None:
        case = CASES[kind]
        place, count = case.lose
        blocks = measured(kind, Situation(lose=case.lose), 2 * place + count)
        gaps = [(a.end_tick, b.first_tick - a.end_tick) for a, b in pairwise(blocks) if b.first_tick != a.end_tick]
        large = [gap for gap in gaps if gap[1] > case.within]
        assert len(large) == 1
        assert large[0] == (pytest.approx(place, abs=case.within), pytest.approx(count, abs=case.within))

    @pytest.mark.parametrize("kind", STREAMS)
    def test_nothing_lost_is_no_gap(self, kind: str) -> None:
        blocks = measured(kind, Situation(), 600)
        assert all(b.first_tick == a.end_tick for a, b in pairwise(blocks))
        assert blocks[0].first_tick == 0
        assert not any(block.status & (Status.DISAGREES | Status.CLOCKED | Status.OVERLOAD) for block in blocks)

    @pytest.mark.parametrize("kind", [name for name in STREAMS if CASES[name].reports])
    def test_an_overload_is_reported_with_its_samples(self, kind: str) -> None:
        blocks = measured(kind, Situation(overload_at=300), 800)
        flagged = [block.end_tick for block in blocks if block.status & Status.OVERLOAD]
        assert flagged
        assert min(flagged) > 300
        assert not any(block.status & Status.OVERLOAD for block in blocks if block.end_tick <= 300)

    @pytest.mark.parametrize("kind", sorted(set(CASES) - set(STREAMS)))
    def test_an_overload_of_an_analyzer_is_reported(self, kind: str) -> None:
        with CASES[kind].serve(Situation(overload_at=0)) as served, opened_analyzer(plan(kind), served.port, SHORT) as instrument:
            instrument.measure(0.5)
            assert instrument.status() == (Status.OVERLOAD if CASES[kind].reports else Status.GOOD)

    @pytest.mark.parametrize("clock", [0.5, 1.0])
    @pytest.mark.parametrize("kind", STREAMS)
    def test_the_rate_agrees_with_the_hosts_clock(self, kind: str, clock: float) -> None:
        case = CASES[kind]
        blocks = measured(kind, Situation(clock=clock), round(case.rate * case.speed))
        first, last = blocks[0], blocks[-1]
        rate = (last.end_tick - first.end_tick) / (last.host_time - first.host_time)
        assert rate / (case.rate * case.speed) == pytest.approx(clock, rel=0.25)

    @pytest.mark.parametrize("kind", CASES)
    def test_the_drive_is_off_after_any_end(self, kind: str) -> None:
        def drive_and_fail(served: Served) -> None:
            if kind in STREAMS:
                with streaming(kind, served) as stream:
                    begin(stream, kind)
                    read(stream, 100, 3.0)
                    assert served.driving() or not isinstance(stream, Exciter)
                    raise RuntimeError("interrupted")
            with opened_analyzer(plan(kind), served.port, SHORT) as records:
                assert isinstance(records, Sourcing)
                records.set_source(0.5)
                assert served.driving()
                raise RuntimeError("interrupted")

        with CASES[kind].serve(Situation()) as served:
            with pytest.raises(RuntimeError, match="interrupted"):
                drive_and_fail(served)
            end = time.monotonic() + LONGEST
            while served.driving() and time.monotonic() < end:
                time.sleep(0.01)
            assert not served.driving()

    @pytest.mark.parametrize("kind", CASES)
    def test_an_instrument_that_says_nothing_is_refused_or_gives_nothing_soon(self, kind: str) -> None:
        with CASES[kind].serve(Situation(silent=True)) as served, within(LONGEST), suppress(DriverError):
            if kind in STREAMS:
                with streaming(kind, served) as stream:
                    begin(stream, kind)
                    assert stream.read(0.1) is None
            else:
                with opened_analyzer(plan(kind), served.port, SHORT) as records:
                    records.measure(0.1)
                    pytest.fail("nothing was measured")

    @pytest.mark.parametrize("kind", STREAMS)
    def test_an_instrument_that_falls_silent_keeps_no_read_waiting(self, kind: str) -> None:
        with CASES[kind].serve(Situation(mute_after=200)) as served, streaming(kind, served) as instrument:
            begin(instrument, kind)
            read(instrument, 10**6, 0.5)
            with within(1.0):
                assert instrument.read(0.05) is None
            with within(LONGEST), suppress(DriverError):
                instrument.stop()

    @pytest.mark.parametrize("kind", CASES)
    def test_an_unplugged_instrument_ends_every_call_in_a_sentence(self, kind: str) -> None:
        with CASES[kind].serve(Situation()) as served, within(LONGEST), pytest.raises(DriverError) as refusal:
            _unplugged(kind, served)
        assert "\n" not in str(refusal.value)


def _unplugged(kind: str, served: Served) -> None:
    if kind not in STREAMS:
        with opened_analyzer(plan(kind), served.port, SHORT) as records:
            served.unplug()
            records.measure(0.5)
            return
    with streaming(kind, served) as stream:
        begin(stream, kind)
        read(stream, 100, 3.0)
        served.unplug()
        end = time.monotonic() + LONGEST
        while time.monotonic() < end:
            stream.read(0.05)
