"""What every driver keeps to, in one class: loss is counted, status reported, the drive stopped, the rate held against the host's
clock, and every wait ended. A kind of instrument is added with its far end in `CASES`."""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
import sound_device
from campaign import SHORT, read
from far import CsvFar, DataqFar, Far, FramedFar, LinesFar, SlcanFar, frame, scan_bytes, within
from ni_device import Device, chassis

from isorig.drivers.block import Block, Status
from isorig.drivers.errors import DriverError
from isorig.drivers.instrument import Exciter, Sourcing, Stream
from isorig.drivers.kinds import RecordsKind, kinds
from isorig.rig.acquire.instruments import opened, opened_analyzer
from isorig.rig.acquire.plan import Plan, plan_of

#: Seconds that any call to an instrument that says nothing may take, with the patience that is set here.
LONGEST = 8.0


@dataclass(frozen=True, kw_only=True)
class Situation:
    """What happens at the far end: a loss, an overload from a tick on, its true rate over the nominal one, silence."""

    lose: tuple[int, int] | None = None
    overload_at: int | None = None
    clock: float = 1.0
    silent: bool = False
    mute_after: int | None = None

    def lost(self, tick: int) -> bool:
        """Whether a tick is lost."""
        return self.lose is not None and self.lose[0] <= tick < sum(self.lose)

    def overloaded(self, tick: int) -> bool:
        """Whether an input is overloaded."""
        return self.overload_at is not None and tick >= self.overload_at


@dataclass
class Served:
    """A far end that is served: the port, whether it drives the rig, and its end."""

    port: str
    driving: Callable[[], bool] = lambda: False
    unplug: Callable[[], None] = lambda: None


@dataclass(frozen=True, kw_only=True)
class Case:
    """A kind of instrument with its far end.

    Parameters
    ----------
    serve
        Serves the far end in a situation.
    rate, speed
        Hz, signal seconds per second.
    lose, within
        A loss that is tried, and the ticks by which its place and count may be wrong.
    reports
        Whether it can report an overload; if not, its page says so.
    """

    serve: Callable[[Situation], AbstractContextManager[Served]]
    rate: float
    speed: float = 10.0
    lose: tuple[int, int] = (500, 100)
    within: int = 0
    reports: bool = True


@contextmanager
def far_served(far: Far, situation: Situation, driving: Callable[[], bool] = lambda: False) -> Iterator[Served]:
    """A far end at a pseudo-terminal; a silent one takes everything and says nothing."""
    if situation.silent:
        far = Far()
    with far:
        yield Served(far.port, driving, far.unplug)


def serve_framed(situation: Situation) -> AbstractContextManager[Served]:
    def spoil(fields: dict) -> bytes:
        status = int(situation.overloaded(fields["tick"]))
        return b"" if situation.lost(fields["tick"]) else frame(**(fields | {"status": status}))

    frames = 10**6 if situation.mute_after is None else situation.mute_after // 50
    far = FramedFar(spoil=spoil, frames=frames, speed=10.0 * situation.clock)
    return far_served(far, situation, lambda: far.running)


def serve_dataq(situation: Situation) -> AbstractContextManager[Served]:
    def stream(first: int, last: int) -> bytes:
        return b"".join(scan_bytes(tick, tick + 1) for tick in range(first, last) if not situation.lost(tick))

    far = DataqFar(stream=stream, rate=2000.0, clock=situation.clock, scans=situation.mute_after or 10**9)
    return far_served(far, situation, lambda: far.scanning)


def serve_mti(situation: Situation) -> AbstractContextManager[Served]:
    def spoil(tick: int, frames: list[bytes]) -> bytes:
        status = b"t011400000100\r" if situation.overloaded(tick) else frames[3]
        return b"" if situation.lost(tick) else b"".join([*frames[:3], status])

    return far_served(
        SlcanFar(spoil=spoil, rate=100.0, speed=2.0 * situation.clock, groups=situation.mute_after or 10**9), situation
    )  # fmt: skip


def serve_lines(situation: Situation) -> AbstractContextManager[Served]:
    def columns(tick: int) -> list[str]:
        value = "OL" if situation.overloaded(tick) else str(tick)
        return [str(tick % 65536), str(10 * tick), value, "0", "0", "0"]

    def spoil(tick: int, line: bytes) -> bytes:
        return b"" if situation.lost(tick) else line + b"\n"

    far = CsvFar(
        columns=columns, spoil=spoil, speed=10.0 * situation.clock, lines=situation.mute_after or 10**9
    )  # fmt: skip
    return far_served(far, situation, lambda: far.running)


@contextmanager
def serve_ni(situation: Situation) -> Iterator[Served]:
    # A loss is a host that is late: as long as it takes to overwrite the buffer.
    device = Device(
        clock=situation.clock, silent=situation.silent, overload_from=situation.overload_at, lost=situation.lose,
        mute_after=situation.mute_after,
    )  # fmt: skip

    def unplug() -> None:
        device.gone_after = 0

    with chassis(device):
        yield Served("cDAQ1", lambda: device.level != 0.0, unplug)


@contextmanager
def serve_sound(situation: Situation) -> Iterator[Served]:
    # The driver begins to count half a second after the start, when samples come regularly.
    late = 4000
    device = sound_device.Device(
        clock=situation.clock, silent=situation.silent,
        lost=None if situation.lose is None else (situation.lose[0] + late, situation.lose[1]),
        mute_after=None if situation.mute_after is None else situation.mute_after + 3 * late,
    )  # fmt: skip
    with sound_device.card(device):
        yield Served("card", lambda: device.level != 0, device.gone.set)


@contextmanager
def serve_sr785(situation: Situation) -> Iterator[Served]:
    answers = {
        "*ESR?": b"0\n", "INPS?": b"1\n" if situation.overload_at is not None else b"0\n", "DSPS?": b"1\n", "NAVG?": b"10\n",
        "STYP?": b"2\n", "NAMP?": b"500,mVpk\n", "SRCO?": b"1\n",
    }  # fmt: skip
    far = LinesFar({} if situation.silent else answers)
    with far:
        yield Served(far.port, lambda: _last(far, "SRCO ") == "SRCO 1", far.unplug)


@contextmanager
def serve_hp35670a(situation: Situation) -> Iterator[Served]:
    answers = {"*STB?": b"+32\n", "SYST:ERR?": b'+0,"No Error"\n', "SOUR:VOLT?": b"0.5\n", "OUTP?": b"1\n"}
    far = LinesFar({} if situation.silent else answers)
    with far:
        yield Served(far.port, lambda: _last(far, "OUTP O") == "OUTP ON", far.unplug)


def _last(far: LinesFar, begin: str) -> str:
    return next((line for line in reversed(far.lines) if line.startswith(begin)), "")


CASES = {
    "framed": Case(serve=serve_framed, rate=1000.0),
    "di1100": Case(serve=serve_dataq, rate=2000.0, speed=1.0, lose=(2000, 500), within=60, reports=False),
    "mti600": Case(serve=serve_mti, rate=100.0, speed=2.0, lose=(100, 50), within=1),
    "lines": Case(serve=serve_lines, rate=100.0, lose=(200, 50)),
    "nidaqmx": Case(serve=serve_ni, rate=2048.0),
    "sound": Case(serve=serve_sound, rate=8000.0, speed=1.0, lose=(8000, 4000), within=1600, reports=False),
    "sr785": Case(serve=serve_sr785, rate=256.0),
    "35670a": Case(serve=serve_hp35670a, rate=256.0, reports=False),
}
STREAMS = [name for name in CASES if name not in ("sr785", "35670a")]


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
    assert {name for name in CASES if isinstance(kinds()[name], RecordsKind)} == set(CASES) - set(STREAMS)


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
            end = time.monotonic() + 2.0
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
