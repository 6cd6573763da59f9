"""Instruments of lines: what the plan describes is sent, read, counted and refused."""

from __future__ import annotations

from contextlib import AbstractContextManager, closing
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from campaign import SHORT, read
from contract import Case, Served, Situation, far_served
from far import CsvFar, Far, PrologixFar, within
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st

from isorig.drivers.block import Block, Status
from isorig.drivers.errors import ConnectionLostError, DriverError, ProtocolError, SettingError
from isorig.drivers.lines import HOPELESS, LinesInstrument, LinesSettings

VALUES = [{"unit": "V"}, {"unit": "N"}]
COUNTED = {
    "fields": [{"what": "count", "wrap": 65536}, {"what": "clock", "unit": "ms"}, *VALUES],
    "start": ["go"],
    "stop": ["halt"],
}


def plan(**changed: object) -> LinesSettings:
    return msgspec.convert({**COUNTED, **changed}, LinesSettings)


def run(far: Far, settings: LinesSettings, lines: int, rate: float = 100.0) -> tuple[list[Block], LinesInstrument]:
    """All blocks of a run."""
    with far, closing(LinesInstrument(far.port, settings, waits=SHORT)) as instrument:
        assert instrument.prepare(sample_rate=rate, channels=[0, 1]) == rate
        instrument.start()
        blocks = read(instrument, lines)
        assert instrument.stop() is None
        return blocks + read(instrument, 10**9, 0.1), instrument


def places(blocks: list[Block]) -> tuple[np.ndarray, np.ndarray]:
    """The ticks that lines were given, and their own."""
    samples = np.concatenate([block.samples for block in blocks])
    np.testing.assert_array_equal(samples[:, 1], 3 * samples[:, 0])
    return np.concatenate([np.arange(block.first_tick, block.end_tick) for block in blocks]), samples[:, 0]


def gaps(blocks: list[Block]) -> list[tuple[int, int]]:
    return [(a.end_tick, b.first_tick - a.end_tick) for a, b in pairwise(blocks) if b.first_tick != a.end_tick]


def lost(*ticks: int) -> object:
    return lambda tick, line: b"" if tick in ticks else line + b"\n"


def test_a_counted_stream_is_started_read_and_stopped() -> None:
    far = CsvFar()
    blocks, instrument = run(far, plan(arm=["*RST", "CONF"]), 300)
    given_ticks, own = places(blocks)
    np.testing.assert_array_equal(given_ticks, own)
    assert len(own) >= 300
    assert far.told[:3] == ["*RST", "CONF", "go"]
    assert far.told[-1] == "halt"
    assert [(i.unit, i.dtype) for i in instrument.inputs] == [("V", "float64"), ("N", "float64")]
    assert all(block.status == Status.NUMBERED for block in blocks)
    assert blocks[-1].device_time == pytest.approx(blocks[-1].first_tick / 100.0)


@pytest.mark.parametrize("fields", [COUNTED["fields"], [{"what": "skip"}, {"what": "clock", "unit": "ms"}, *VALUES]])
def test_lost_lines_are_counted_by_a_count_and_by_a_clock(fields: list[dict[str, object]]) -> None:
    blocks, _ = run(CsvFar(spoil=lost(100, *range(150, 157))), plan(fields=fields), 300)
    given_ticks, own = places(blocks)
    np.testing.assert_array_equal(given_ticks, own)
    assert gaps(blocks) == [(100, 1), (150, 7)]


def test_lost_lines_without_count_and_clock_are_shown_by_the_hosts_clock() -> None:
    fields = [{"what": "skip"}, {"what": "skip"}, *VALUES]
    far = CsvFar(spoil=lost(*range(250, 310)), speed=1.0)
    with far, closing(LinesInstrument(far.port, plan(fields=fields), waits=SHORT)) as instrument:
        instrument.prepare(sample_rate=100.0, channels=[0])
        instrument.start()
        blocks = read(instrument, 300, 3.5)
        instrument.stop()
        blocks += read(instrument, 10**9, 0.1)
    given_ticks, own = places(blocks)
    assert np.abs(given_ticks - own).max() <= 2
    ((place, count),) = gaps(blocks)
    assert (place, count) == (pytest.approx(250, abs=2), pytest.approx(60, abs=2))
    assert any(block.status & Status.CLOCKED for block in blocks)


def test_a_device_that_always_sends_is_read_from_its_next_line_on() -> None:
    blocks, _ = run(CsvFar(free=True), plan(start=[], stop=[]), 200)
    given_ticks, own = places(blocks)
    np.testing.assert_array_equal(given_ticks, own - own[0])


@pytest.mark.parametrize("adapter", [False, True])
def test_a_meter_that_is_asked_for_each_line(adapter: bool) -> None:
    polled = plan(start=[], stop=[], read="READ?", fields=VALUES)
    ticks = iter(range(10**6))

    def answer(command: str) -> bytes:
        tick = next(ticks)
        return b"%d,%d\n" % (tick, 3 * tick)

    far: Far = PrologixFar({"READ?": answer}) if adapter else CsvFar(asked="READ?", columns=lambda t: [f"{t}", f"{3 * t}"])
    with far, closing(LinesInstrument(f"GPIB::11@{far.port}" if adapter else far.port, polled, waits=SHORT)) as instrument:
        instrument.prepare(sample_rate=50.0, channels=[0])
        instrument.start()
        blocks = read(instrument, 30, 0.5)
        instrument.stop()
    _, own = places(blocks)
    np.testing.assert_array_equal(own, np.arange(len(own)))
    # Asked at the plan's rate: the host's clock is the axis.
    passed, ticks_passed = blocks[-1].host_time - blocks[0].host_time, blocks[-1].end_tick - blocks[0].end_tick
    assert ticks_passed / passed == pytest.approx(50.0, rel=0.2)


@pytest.mark.parametrize("line", [b"", b"1", b"1,2,3,4,5", b"a,b,c,d", b"nan,1,1,1", b"1,1,inf,1", b"1,1,0x10,1", b"\xff" * 9])
def test_a_damaged_line_is_a_lost_sample(line: bytes) -> None:
    blocks, instrument = run(CsvFar(spoil=lambda tick, good: (line if tick == 100 else good) + b"\n"), plan(), 200)
    given_ticks, own = places(blocks)
    np.testing.assert_array_equal(given_ticks, own)
    assert gaps(blocks) == [(100, 1)]
    assert instrument.damaged == (1 if line else 0)


@pytest.mark.parametrize(("count", "text"), [(HOPELESS, "right"), (HOPELESS + 1, "refused")])
def test_lines_that_are_never_scans_are_refused(count: int, text: str) -> None:
    far = CsvFar(spoil=lambda tick, line: (b"hello" if 50 <= tick < 50 + count else line) + b"\n")
    if text == "right":
        blocks, _ = run(far, plan(), 200)
        assert gaps(blocks) == [(50, count)]
        return
    with pytest.raises(ProtocolError, match="sends lines that are not the 4 fields of the plan"):
        run(far, plan(), 200)


def test_a_line_without_an_end_is_refused_soon() -> None:
    far = CsvFar(spoil=lambda tick, line: b"1234567890" * 100 if tick >= 50 else line + b"\n")
    with within(5.0), pytest.raises(ProtocolError, match="sends lines that are not"):
        run(far, plan(), 10**6)


def test_an_overload_is_recorded_at_full_scale_and_reported() -> None:
    fields = [{"what": "count"}, {"what": "skip"}, {"unit": "V", "full_scale": 10.0}, {"unit": "V", "full_scale": 5.0}]
    far = CsvFar(columns=lambda t: [f"{t}", "0", "OL" if t == 30 else f"{t}", "9.9E37" if t == 30 else f"{3 * t}"])
    blocks, _ = run(far, plan(fields=fields, overload=["OL", "9.9E37"]), 100)
    (odd,) = [block for block in blocks if block.status & Status.OVERLOAD]
    assert (odd.first_tick, odd.samples.tolist()) == (30, [[10.0, 5.0]])


def test_comments_and_other_separators() -> None:
    far = CsvFar(spoil=lambda tick, line: b"# note\n" * (tick == 5) + line.replace(b",", b";  ") + b"\r\n")
    blocks, instrument = run(far, plan(separator=";"), 100)
    np.testing.assert_array_equal(*places(blocks))
    assert instrument.damaged == 0


def test_replies_to_commands_are_checked() -> None:
    class Answering(CsvFar):
        def hear(self, data: bytes) -> None:
            super().hear(data)
            if not self.running:
                self.say(b"OK\n")

    def prepare(far: Far, reply: str) -> None:
        with far, closing(LinesInstrument(far.port, plan(arm=["RANGE 10"], reply=reply), waits=SHORT)) as instrument:
            instrument.prepare(sample_rate=100.0, channels=[0])

    prepare(Answering(), "OK")
    with pytest.raises(ConnectionLostError, match="did not send a line"):
        prepare(CsvFar(), "OK")
    with pytest.raises(ProtocolError, match="answered RANGE 10 with 'OK', not 'DONE'"):
        prepare(Answering(), "DONE")


def test_a_clock_that_is_too_coarse_to_count_is_refused() -> None:
    fields = [{"what": "skip"}, {"what": "clock", "unit": "ms"}, *VALUES]
    with CsvFar() as far, closing(LinesInstrument(far.port, plan(fields=fields), waits=SHORT)) as instrument:
        assert instrument.prepare(sample_rate=250.0, channels=[0]) == 250.0
        with pytest.raises(SettingError, match="only up to 250 Hz"):
            instrument.prepare(sample_rate=251.0, channels=[0])
        with pytest.raises(SettingError, match="there is no input 2"):
            instrument.prepare(sample_rate=100.0, channels=[2])


def test_lines_unasked_need_a_line_of_bytes() -> None:
    with PrologixFar({}) as far, pytest.raises(SettingError, match="give the command that asks for a line"):
        LinesInstrument(f"GPIB::11@{far.port}", plan(), waits=SHORT)


@pytest.mark.parametrize(("changed", "says"), [
    ({"fields": []}, "has 0 values in 0 fields"), ({"fields": [{"what": "count"}]}, "0 values in 1 fields"),
    ({"fields": [{"what": "count"}, {"what": "count"}, {}]}, "2 fields of count"),
    ({"fields": [{"what": "clock"}, {}]}, "a clock counts in s, ms, us"), ({"fields": [{"wrap": 255}]}, "give 256 or more"),
    ({"fields": [{"full_scale": -1.0}]}, "full_scale is -1"), ({"overload": ["OL"]}, "needs the full_scale"),
    ({"baud_rate": 0}, "baud_rate is 0"), ({"separator": ";;"}, "give one character"), ({"arm": ["ü"]}, "cannot be sent"),
    ({"read": "x" * 201}, "up to 200"), ({"start": ["a\nb"]}, "printable"), ({"stop": ["x"] * 33}, "give 32 at most"),
])  # fmt: skip
def test_a_table_that_cannot_be_is_refused(changed: dict[str, object], says: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=says):
        plan(**changed)


def test_a_lost_line_that_returns_continues_with_the_count() -> None:
    with CsvFar() as far, closing(LinesInstrument(far.port, plan(), waits=SHORT)) as instrument:
        instrument.prepare(sample_rate=100.0, channels=[0])
        instrument.start()
        blocks = read(instrument, 100)
        instrument.rejoin()
        blocks += read(instrument, 300)
        instrument.stop()
    given_ticks, own = places(blocks)
    np.testing.assert_array_equal(given_ticks, own)


@examples(max_examples=60, deadline=None)
@given(data=st.lists(st.binary(max_size=300), max_size=8), fields=st.sampled_from([COUNTED["fields"], VALUES]))
def test_no_bytes_make_anything_but_numbers_or_a_refusal(data: list[bytes], fields: list[dict[str, object]]) -> None:
    instrument = LinesInstrument.__new__(LinesInstrument)

    class Wire:
        name = "here"

    settings = plan(fields=fields)
    instrument.__dict__["_link"] = Wire()
    for name, value in vars(_opened(settings)).items():
        instrument.__dict__.setdefault(name, value)
    instrument._reset()
    try:
        for raw in data:
            for line in raw.split(b"\n"):
                instrument._accept(line, 0.0)
    except DriverError as refusal:
        assert "\n" not in str(refusal)  # noqa: PT017
    for block in instrument._ready:
        assert np.isfinite(block.samples).all()


def _opened(settings: LinesSettings) -> LinesInstrument:
    with CsvFar() as far, closing(LinesInstrument(far.port, settings, waits=SHORT)) as instrument:
        return instrument


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


CASES = (Case(kind="lines", serve=serve_lines, rate=100.0, lose=(200, 50)),)
