"""Far ends of our own that go wrong: each attack ends in a refusal of one sentence, or in losses counted at their place."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from itertools import pairwise

import numpy as np
import pytest
from campaign import ATTEMPTS, SHORT, read, run
from far import DataqFar, Far, FramedFar, LinesFar, SlcanFar, frame, scan_bytes, scan_number, text_frame, within
from hypothesis import given, settings
from hypothesis import strategies as st

from isorig.drivers import mti600
from isorig.drivers.alignment import Alignment
from isorig.drivers.block import Block, Status
from isorig.drivers.dataq import DataqInstrument, DataqSettings
from isorig.drivers.errors import ConnectionLostError, DriverError, InstrumentError, ProtocolError, SettingError
from isorig.drivers.framed import FramedInstrument, FramedSettings
from isorig.drivers.hp35670a import Hp35670aInstrument
from isorig.drivers.mti600 import MtiInstrument, MtiSettings
from isorig.drivers.port import Port
from isorig.drivers.sr785 import Sr785Instrument
from isorig.drivers.waits import Waits

# Ports


@pytest.mark.parametrize(
    "name", ["socket://", "socket://:4000", "socket://here", "socket://h:x", "spy:///dev/ttyS0?file=x", "", "a\nb"]
)
def test_a_port_that_is_none_is_refused(name: str) -> None:
    for kind, own in ((FramedInstrument, FramedSettings()), (MtiInstrument, MtiSettings())):
        with pytest.raises(SettingError, match=r"is not a port; .*socket://127\.0\.0\.1:4000"):
            kind(name, own)


def test_a_far_end_that_takes_nothing_ends_a_write() -> None:
    class Deaf(Far):
        def _serve(self) -> None:
            self.over.wait()

    with (
        Deaf() as far,
        closing(Port(far.port, baud_rate=9600, waits=Waits(sending=0.3))) as wire,
        within(3.0),
        pytest.raises(ConnectionLostError) as refusal,
    ):
        wire.write(bytes(1 << 20))
    assert "has accepted no data" in str(refusal.value)


# The framed stream


def streamed(far: FramedFar, ticks: int = 1500) -> tuple[list[Block], int | None, list[str]]:
    """All that a run of an instrument gives."""
    with far, closing(FramedInstrument(far.port, FramedSettings(), SHORT)) as instrument:
        instrument.prepare(sample_rate=1000.0, channels=[0, 1])
        instrument.start()
        blocks = read(instrument, ticks)
        counted = instrument.stop()
        return blocks + read(instrument, 10**9, 0.1), counted, list(instrument.noticed)


def places(blocks: list[Block]) -> tuple[np.ndarray, np.ndarray]:
    """The ticks that samples were given, and their own."""
    own = np.concatenate([block.samples[:, 0] for block in blocks])
    return np.concatenate([np.arange(block.first_tick, block.end_tick) for block in blocks]), own


@pytest.mark.parametrize("change", [
    {"tick": -500}, {"tick": -123}, {"tick": 333}, {"tick": 2**31}, {"clock": -10**7}, {"clock": 10**7}, {"sequence": -10},
    {"sequence": 77},
])  # fmt: skip
def test_one_deviating_indicator_is_outvoted_and_reported(change: dict[str, int]) -> None:
    def spoil(fields: dict) -> bytes:
        late = fields["tick"] >= 500
        return frame(**(fields | {key: fields[key] + by for key, by in change.items() if late}))

    blocks, _, noticed = streamed(FramedFar(spoil=spoil))
    given, own = places(blocks)
    np.testing.assert_array_equal(given, own)
    assert len(given) == 1500
    if "sequence" not in change or change["sequence"] < 0:
        assert len(noticed) == 1
        assert noticed[0].startswith("at tick 500 ")
        assert [block.first_tick for block in blocks if block.status & Status.DISAGREES] == [500]


class Turning(FramedFar):
    """Right after the answer to START, in real time, a frame of the run before arrives; another arrives before the answer."""

    def __init__(self, **more: object) -> None:
        super().__init__(frames=20, speed=1.0, **more)  # type: ignore[arg-type]
        self.begun = 0

    def obey(self, word: str, words: list[str]) -> None:
        self.begun += word == "START"
        if word == "START" and self.begun > 1:
            self.say(self.older(250))
        super().obey(word, words)
        if word == "START" and self.begun > 1:
            self.say(self.older(300))

    def older(self, tick: int) -> bytes:
        samples = np.full((self.rows, 2), 77, "<i4")
        samples[:, 1] = 77 * 3 + 1
        return frame(
            samples.tobytes(), kind=2, columns=2, rows=self.rows, sequence=tick // self.rows, tick=tick, clock=1000 * tick,
            gain=1.0, status=0,
        )  # fmt: skip


@pytest.mark.parametrize("lost", [(), (0,), (0, 1)])
def test_frames_of_an_earlier_run_are_not_part_of_the_next(lost: tuple[int, ...]) -> None:
    def spoil(fields: dict) -> bytes:
        return b"" if fields["sequence"] in lost else frame(**fields)

    with Turning(spoil=spoil) as far, closing(FramedInstrument(far.port, FramedSettings(), SHORT)) as instrument:
        instrument.prepare(sample_rate=1000.0, channels=[0, 1])
        instrument.start()
        read(instrument, 200)
        instrument.stop()
        instrument.start()
        blocks = read(instrument, 900)
        instrument.stop()
        assert list(instrument.noticed) == []
    given, own = places(blocks)
    np.testing.assert_array_equal(given, own)
    np.testing.assert_array_equal(given[:100], 50 * len(lost) + np.arange(100))


@pytest.mark.parametrize(("change", "said"), [({"tick": -500}, "tick"), ({"clock": -500_000}, "clock"), ({"sequence": -7}, "")])
def test_after_a_silence_two_indicators_that_agree_outvote_the_third(change: dict[str, int], said: str) -> None:
    # Twenty frames are lost at once, as when a connection was lost for a second; one indicator has changed meanwhile.
    def spoil(fields: dict) -> bytes:
        if 500 <= fields["tick"] < 1500:
            return b""
        late = fields["tick"] >= 1500
        return frame(**(fields | {key: fields[key] + by for key, by in change.items() if late}))

    blocks, _, noticed = streamed(FramedFar(spoil=spoil, frames=50), ticks=2500)
    given, own = places(blocks)
    np.testing.assert_array_equal(given, own)
    assert given[-1] == 2499
    assert len(noticed) == bool(said)


def test_a_counter_that_stands_still_is_outvoted() -> None:
    blocks, _, noticed = streamed(FramedFar(spoil=lambda fields: frame(**(fields | {"tick": min(fields["tick"], 500)}))))
    given, own = places(blocks)
    np.testing.assert_array_equal(given, own)
    assert len(given) == 1500
    assert len(noticed) == 19


def test_an_instrument_that_restarts_during_a_run_is_refused() -> None:
    def spoil(fields: dict) -> bytes:
        if fields["tick"] < 500:
            return frame(**fields)
        return frame(
            **(fields | {"tick": fields["tick"] - 500, "sequence": fields["sequence"] - 10, "clock": fields["clock"] - 500_000})
        )

    with pytest.raises(InstrumentError, match="it was restarted or is defective"):
        streamed(FramedFar(spoil=spoil))


def test_counter_and_clock_that_jump_a_day_together_are_refused() -> None:
    def spoil(fields: dict) -> bytes:
        day = 86_400_000 if fields["tick"] >= 500 else 0
        return frame(**(fields | {"tick": fields["tick"] + day, "clock": fields["clock"] + 1000 * day}))

    with pytest.raises(InstrumentError, match="nor the host's shows how many were lost"):
        streamed(FramedFar(spoil=spoil))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"columns": 1, "rows": 100}, "announced 2 inputs of int32 but sends 1 of int32"),
        ({"kind": 1, "rows": 100}, "sends 2 of int16"),
    ],
)
def test_columns_that_change_are_refused(change: dict[str, int], says: str) -> None:
    with pytest.raises(InstrumentError, match=says):
        streamed(FramedFar(spoil=lambda fields: frame(**(fields | (change if fields["tick"] >= 500 else {})))))


def test_empty_frames_are_stepped_over_and_status_words_are_handed_on() -> None:
    def spoil(fields: dict) -> bytes:
        empty = frame(**(fields | {"rows": 0, "payload": b""}))
        return empty + frame(**(fields | {"status": 6 if fields["tick"] == 500 else 0, "sequence": fields["sequence"]}))

    blocks, _, _ = streamed(FramedFar(spoil=spoil))
    given, own = places(blocks)
    np.testing.assert_array_equal(given, own)
    assert (
        next(block.status for block in blocks if block.first_tick == 500) & (Status.LOST | Status.FAULT)
        == Status.LOST | Status.FAULT
    )


def begin(far: FramedFar) -> None:
    """All commands up to the start of a run."""
    with closing(FramedInstrument(far.port, FramedSettings(), SHORT)) as instrument:
        instrument.prepare(sample_rate=1000.0, channels=[0, 1])
        instrument.set_gain(-7.5)
        instrument.set_configuration("locked")
        instrument.load_drive(np.zeros(3))
        instrument.start()


@pytest.mark.parametrize("word", ["ID", "INPUTS", "RATE", "GAIN", "CONF", "DRIVE", "START", "COUNT"])
@pytest.mark.parametrize(
    "told", ["", "nan", "-1", "1e999", "9" * 25, "0x10", "1_0", "ü", "a b c d e f", "2 int64 V 1 1", "isorig-framed/9"]
)
def test_a_bad_answer_is_refused_in_a_sentence(word: str, told: str) -> None:
    far = FramedFar(
        answer=lambda asked: (
            text_frame(f"{word} {told}".encode()) if asked == word or (asked, word) == ("STOP", "COUNT") else None
        )
    )
    with far, within(5.0), pytest.raises(DriverError) as refusal:
        begin(far)
    assert "\n" not in str(refusal.value)


def test_a_header_that_announces_a_huge_frame_causes_no_delay() -> None:
    def spoil(fields: dict) -> bytes:
        huge = frame(**(fields | {"columns": 255, "rows": 65535, "payload": b""}))
        return (huge if fields["tick"] == 500 else b"") + frame(**fields)

    with within(4.0):
        blocks, _, _ = streamed(FramedFar(spoil=spoil))
    assert sum(len(block.samples) for block in blocks) == 1500


def test_a_count_that_cannot_be_is_not_believed() -> None:
    far = FramedFar(
        answer=lambda word: text_frame(b"COUNT 2147485138") if word == "STOP" and far.running is False and far.sent else None
    )
    blocks, counted, noticed = streamed(far)
    assert counted is None
    assert "which is impossible" in noticed[-1]
    assert sum(len(block.samples) for block in blocks) == 1500


def test_a_count_below_the_received_samples_is_reported() -> None:
    far = FramedFar(frames=3, answer=lambda word: text_frame(b"COUNT 100") if word == "STOP" and far.sent else None)
    with far, closing(FramedInstrument(far.port, FramedSettings(), SHORT)) as instrument:
        instrument.prepare(sample_rate=far.rate, channels=[0, 1])
        instrument.start()
        end = time.monotonic() + 5.0
        while far.sent < far.frames and time.monotonic() < end:
            time.sleep(0.01)
        assert instrument.stop() == 100
        assert not instrument.noticed
        assert sum(len(block.samples) for block in read(instrument, 150)) == 150
        assert list(instrument.noticed) == [
            "it reports 100 samples after 150 had arrived, which is impossible; the number of samples lost at the end is unknown"
        ]


# The DI-1100


def scanned(far: DataqFar, **settings: object) -> tuple[list[Block], float]:
    """All that a run of a DI-1100 gives until its last scan, and the loss that it would not see, in scans."""
    plan = DataqSettings(full_scale=10.0, **settings)  # type: ignore[arg-type]
    with far, closing(DataqInstrument(far.port, plan, waits=SHORT)) as instrument:
        instrument.prepare(sample_rate=far.rate, channels=[0, far.inputs - 1])
        instrument.start()
        blocks, ended, block = [], False, None
        while not ended or block is not None:
            ended = far.ended
            block = instrument.read(0.05)
            blocks += [] if block is None else [block]
        instrument.stop()
        return blocks + read(instrument, 10**9, 0.05), instrument._arrivals.unseen * far.rate


def off(blocks: list[Block]) -> np.ndarray:
    """How far each scan stands from its place; scans that were never sent fail."""
    given = np.concatenate([np.arange(block.first_tick, block.end_tick) for block in blocks])
    own = scan_number(np.concatenate([block.samples for block in blocks]), given)
    assert (own >= 0).all()
    return own - given


def once(at: int, change: object) -> object:
    """A stream that is changed where a scan is."""
    done: list[int] = []

    def stream(first: int, last: int) -> bytes:
        data = bytearray(scan_bytes(first, last))
        if not done and first <= at < last:
            done.append(at)
            place = 4 * (at - first)
            change(data, place)  # type: ignore[operator]
        return bytes(data)

    return stream


@pytest.mark.parametrize(
    ("change", "lost"),
    [
        (lambda data, at: data.__delitem__(at + 1), 1), (lambda data, at: data.__delitem__(slice(at + 2, at + 4)), 1),
        (lambda data, at: data.insert(at + 1, data[at + 1]), 0),
    ],
    ids=["a byte lost", "a word lost", "a byte doubled"],
)  # fmt: skip
def test_di1100_is_realigned_and_later_samples_are_in_place(change: object, lost: int) -> None:
    far = DataqFar(stream=once(1000, change), rate=4000.0, scans=3000)  # type: ignore[arg-type]
    blocks, _ = scanned(far)
    assert (off(blocks) == 0).all()
    gaps = [(before.end_tick, after.first_tick - before.end_tick) for before, after in pairwise(blocks)]
    ((place, count),) = [gap for gap in gaps if gap[1]]
    assert 980 <= place <= 1000
    assert place <= 1000 + lost <= place + count
    assert count <= 40
    assert sum(bool(block.status & Status.RESYNCED) for block in blocks) == 1


def zeros_until(scan: int, digital: int) -> Callable[[int, int], bytes]:
    """Inputs at 0 V until a scan, and values that say their scan from then on; at scan 1000 a byte is lost."""
    lost: list[int] = []

    def stream(first: int, last: int) -> bytes:
        data = bytearray(scan_bytes(first, last, digital=digital))
        for k in range(first, min(scan, last)):
            data[4 * (k - first) : 4 * (k - first) + 4] = bytes((digital, 0, 0, 0))
        if not lost and first <= 1000 < last:
            lost.append(1000)
            del data[4 * (1000 - first) + 1]
        return bytes(data)

    return stream


@pytest.mark.parametrize("digital", [1, 2, 3])
def test_di1100_marked_by_its_digital_inputs_keeps_its_channels_at_0_v(digital: int) -> None:
    blocks, _ = scanned(DataqFar(stream=zeros_until(2000, digital), rate=4000.0, scans=4000))
    given = np.concatenate([np.arange(block.first_tick, block.end_tick) for block in blocks])
    samples = np.concatenate([block.samples for block in blocks])
    late = given >= 2100
    np.testing.assert_array_equal(scan_number(samples[late], given[late]), given[late])
    assert not samples[given < 1900].any()
    assert sum(bool(block.status & Status.RESYNCED) for block in blocks) == 1
    assert not any(block.status & Status.UNSURE for block in blocks)


def test_di1100_without_a_mark_ends_the_run_at_a_loss() -> None:
    with pytest.raises(ProtocolError, match="lost bytes, and nothing shows to which input those after them belong; leave the"):
        scanned(DataqFar(stream=zeros_until(2000, 0), rate=4000.0, scans=4000))


@pytest.mark.parametrize(
    "change", [lambda data, at: data.__delitem__(at + 1), lambda data, at: data.__delitem__(slice(at, at + 2))]
)
def test_di1100_of_sixteen_bits_is_aligned_by_its_digital_inputs(change: object) -> None:
    random = np.random.default_rng(3)
    words = random.integers(-32768, 32768, (6000, 2), np.int16) & ~np.int16(3)
    words[:, 0] |= 3

    spoilt: list[int] = []

    def stream(first: int, last: int) -> bytes:
        data = bytearray(words[first:last].astype("<i2").tobytes())
        if not spoilt and first <= 1000 < last:
            spoilt.append(1000)
            change(data, 4 * (1000 - first))  # type: ignore[operator]
        return bytes(data)

    blocks, _ = scanned(DataqFar(stream=stream, rate=4000.0, scans=4000), bits=16)
    for block in blocks:
        np.testing.assert_array_equal(block.samples & ~3, words[block.first_tick : block.end_tick] & ~3)
    # The far end sends ten scans or more at a time.
    assert blocks[-1].end_tick > 3990
    assert sum(len(block.samples) for block in blocks) >= 3900


def test_di1100_noise_is_no_measurement() -> None:
    random = np.random.default_rng(0)
    far = DataqFar(stream=lambda first, last: random.integers(0, 256, 4 * (last - first), np.uint8).tobytes(), scans=4000)
    with pytest.raises(ProtocolError, match="sends bytes that are not scans of 2 inputs"):
        scanned(far)


def test_di1100_whole_scans_lost_are_counted_in_their_place_and_a_slow_clock_is_none() -> None:
    lost: list[range] = []

    def stream(first: int, last: int) -> bytes:
        # On a busy host it sends many scans at a time, so that more or fewer than 500 are lost.
        if not 3000 <= first < 3500:
            return scan_bytes(first, last)
        lost.append(range(first, last))
        return b""

    blocks, unseen = scanned(DataqFar(stream=stream, clock=0.97, scans=6200))
    assert np.abs(off(blocks)).max() <= unseen
    gaps = [(before.end_tick, after.first_tick - before.end_tick) for before, after in pairwise(blocks)]
    ((place, count),) = [gap for gap in gaps if gap[1] > 5]
    # What the arrivals on a busy host do not show is stated.
    assert place == pytest.approx(lost[0].start, abs=max(60.0, unseen))
    assert count == pytest.approx(sum(map(len, lost)), abs=max(60.0, unseen))
    assert any(block.status & Status.CLOCKED for block in blocks)


def test_di1100_a_counter_at_the_digital_inputs_counts_losses_to_the_scan() -> None:
    # Steps of 40 scans: 15 scans lost here, and 70 there, are far less than this machine's clock could tell.
    lost = {700: 15, 1500: 70}
    steps = np.arange(20_000) // 40 % 4

    def stream(first: int, last: int) -> bytes:
        words = np.frombuffer(scan_bytes(first, last, digital=0), "<u2").reshape(-1, 2).copy()
        words[:, 0] |= steps[first:last].astype(np.uint16)
        kept = ~np.any([(np.arange(first, last) >= at) & (np.arange(first, last) < at + n) for at, n in lost.items()], axis=0)
        return words[kept].tobytes()

    blocks, _ = scanned(DataqFar(stream=stream, scans=3000), counter=50.0)
    wrong = off(blocks)
    assert wrong[-1] == 0
    # Behind a loss a scan may stand wrong until the counter's next step, 40 scans.
    assert (wrong != 0).sum() <= 80


def test_di1100_that_does_not_stop_is_refused() -> None:
    class Deaf(DataqFar):
        def hear(self, data: bytes) -> None:
            self._began = self._began or time.monotonic()
            self.scanning = True

    with Deaf() as far, within(4.0), pytest.raises(ProtocolError, match="keeps sending after the stop command"):
        DataqInstrument(far.port, DataqSettings(full_scale=10.0), waits=SHORT)


# The MTi-600


@pytest.mark.parametrize("back", [50, 100, 300])
def test_mti_counter_that_is_reset_is_outvoted_by_its_clock(back: int) -> None:
    far = SlcanFar(group=lambda tick: (tick - back * (tick >= 300), round(1e6 * tick / 400.0)), groups=900)
    with far, closing(MtiInstrument(far.port, MtiSettings(), SHORT)) as instrument:
        instrument.prepare(sample_rate=400.0, channels=[0])
        instrument.start()
        blocks = read(instrument, 880)
        instrument.stop()
        blocks += read(instrument, 10**9, 0.1)
        noticed = instrument.noticed
    given, own = places(blocks)
    np.testing.assert_array_equal(given, own - own[0])
    assert len(given) >= 850
    assert len(noticed) == 1


def test_mti_garbage_without_an_end_is_thrown_away() -> None:
    far = SlcanFar(spoil=lambda tick, frames: b"t0340" * 20_000 if tick == 100 else b"".join(frames), groups=400)
    with far, closing(MtiInstrument(far.port, MtiSettings(), SHORT)) as instrument:
        instrument.prepare(sample_rate=400.0, channels=[0])
        instrument.start()
        blocks = read(instrument, 380)
        assert len(instrument._bus._buffer) <= mti600.LONGEST
    given, own = places(blocks)
    np.testing.assert_array_equal(given, own - own[0])
    assert instrument.damaged >= 1


# The analyzers

SR785 = {
    "*ESR?": b"0\n", "INPS?": b"0\n", "DSPS?": b"1\n", "NAVG?": b"10\n", "DSPN?": b"4\n",
    "DBIN?": lambda c: c[-1:].encode() + b"\n", "DSPB?": np.float32([1, 2, 3, 4]).tobytes(), "DSPY?": b"3\n",
}  # fmt: skip
HP = {
    "*STB?": b"+32\n", "SYST:ERR?": b'+0,"No Error"\n',
    "CALC1:X:DATA?": b"#216" + np.array([0, 1, 2, 3], ">f4").tobytes() + b"\n",
    "CALC1:DATA?": b"#216" + np.array([1, 2, 3, 4], ">f4").tobytes() + b"\n",
}  # fmt: skip


def analyzed(kind: type, answers: dict) -> object:
    """A measurement of an analyzer with one display."""
    trace = "0" if kind is Sr785Instrument else "XTIM:VOLT 1"
    with LinesFar(answers) as far, closing(kind(far.port, [trace], SHORT)) as instrument:
        instrument.measure(0.5)
        (record,) = instrument.records()
        return record


def test_our_analyzers_are_right_where_nothing_is_wrong() -> None:
    for kind, answers in ((Sr785Instrument, SR785), (Hp35670aInstrument, HP)):
        record = analyzed(kind, dict(answers))
        assert record.values.tolist() == [1.0, 2.0, 3.0, 4.0]  # type: ignore[attr-defined]
        assert record.x.tolist() == [0.0, 1.0, 2.0, 3.0]  # type: ignore[attr-defined]


def bad_answers() -> Iterator[object]:
    """Every question of both, answered with what it must not be."""
    for kind, answers in ((Sr785Instrument, SR785), (Hp35670aInstrument, HP)):
        for word in answers:
            for told in (b"", b"\n", b"garbage\n", b"nan\n", b"1" * 3000, b"-1\n", b"\xff\xfe\n", b"#9999999999"):
                yield pytest.param(kind, answers, word, told, id=f"{word} {told[:8]!r}")


@pytest.mark.parametrize(("kind", "answers", "word", "told"), list(bad_answers()))
def test_a_bad_answer_of_an_analyzer_is_refused_in_a_sentence(kind: type, answers: dict, word: str, told: bytes) -> None:
    with within(4.0):
        try:
            record = analyzed(kind, {**answers, word: told})
        except DriverError as refusal:
            assert "\n" not in str(refusal)  # noqa: PT017
        else:
            # An event register of all bits, or an overload, is an answer.
            assert word in ("INPS?", "*STB?", "SYST:ERR?", "DSPY?")
            assert record.values.tolist() == [1.0, 2.0, 3.0, 4.0]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "spoil", [lambda d: d[:5] + d[6:], lambda d: d[:-1], lambda d: d[: len(d) // 2], lambda d: d + bytes(1 << 24)]
)
def test_a_dump_that_is_not_whole_is_refused_soon(spoil: object) -> None:
    for kind, answers, word in ((Sr785Instrument, SR785, "DSPB?"), (Hp35670aInstrument, HP, "CALC1:DATA?")):
        with within(6.0), pytest.raises(DriverError):
            analyzed(kind, {**answers, word: spoil(answers[word])})  # type: ignore[operator]


def test_a_dump_that_comes_otherwise_the_second_time_is_refused() -> None:
    for kind, answers, word in ((Sr785Instrument, SR785, "DSPB?"), (Hp35670aInstrument, HP, "CALC1:DATA?")):
        data = answers[word]
        turns = iter([data, data[:-3] + b"\x01" + data[-2:]])
        with pytest.raises(ProtocolError, match="two different"):
            analyzed(kind, {**answers, word: lambda command: next(turns)})  # noqa: B023


def test_the_level_of_a_source_is_set_and_read_back() -> None:
    level = {"SR785": b"500,mVpk\n", "HP": b"0.5\n"}
    sr = {**SR785, "STYP?": b"2\n", "NAMP?": level["SR785"], "SRCO?": b"1\n"}
    hp = {**HP, "SOUR:VOLT?": level["HP"], "OUTP?": b"1\n"}
    for kind, answers, said in (
        (Sr785Instrument, sr, ["NAMP 500 mVpk", "SRCO 1", "SRCO 0"]),
        (Hp35670aInstrument, hp, ["SOUR:VOLT 0.5 VPK", "OUTP ON", "OUTP OFF"]),
    ):
        with LinesFar(answers) as far:
            with closing(kind(far.port, ["0"], SHORT)) as instrument:
                instrument.set_source(0.5)
                with pytest.raises(SettingError, match=r"was set to 0\.25 V and answers"):
                    instrument.set_source(0.25)
            time.sleep(0.1)
            assert [line for line in far.lines if line in said] == [said[0], said[1], said[1], said[2]]


# By chance


@pytest.mark.parametrize("driver", ATTEMPTS)
def test_some_faults_by_chance(driver: str) -> None:
    outcome = run(driver, 12 if driver in ("sr785", "35670a") else 6, seed=5)
    assert outcome.bad == []


@pytest.mark.study
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("driver", ATTEMPTS)
def test_five_hundred_faults_by_chance(driver: str) -> None:
    outcome = run(driver, 500, seed=100)
    print(driver, dict(outcome.counts))
    assert outcome.bad == []


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), inputs=st.integers(2, 4), lost=st.booleans())
def test_no_scan_is_ever_put_together_from_two(seed: int, inputs: int, lost: bool) -> None:
    draw = np.random.default_rng(seed)
    data = bytearray(scan_bytes(0, 2000, inputs))
    third = len(data) // 3 - 600
    for part in (2, 1, 0):
        place, size = part * third + int(draw.integers(third - 60)), int(draw.integers(1, 30))
        # Whole scans that are lost, at one place or in two losses side by side, leave no trace here; the clock tells of them.
        size += size % (2 * inputs) == 0
        data[place : place + lost * size] = b"" if lost else draw.integers(0, 256, size, np.uint8).tobytes()
    alignment, found, at = Alignment(inputs, 12, "here"), [], 0
    while at < len(data):
        step = int(draw.integers(1, 400))
        found += alignment.feed(bytes(data[at : at + step]), 0.0)
        at += step
    found += alignment.finish()
    scans = np.concatenate([stretch.scans for stretch in found]) & ~3
    numbers = scans[:, 0].astype(np.int64) // 16 % 4096
    assert (np.diff(numbers) > 0).all()
    own = (numbers[:, None] + 1365 * np.arange(inputs)) % 4096
    np.testing.assert_array_equal(scans.astype(np.int64) // 16 % 4096, own)
    assert numbers[-1] == 1999
    assert len(numbers) > 1500
