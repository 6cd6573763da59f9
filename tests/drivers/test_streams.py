"""Streams that are not of our making: the DI-1100's dialogue and loss against a clock, the MTi-600 on CAN."""

from __future__ import annotations

from contextlib import AbstractContextManager
from itertools import pairwise
from pathlib import Path

import can
import cantools
import numpy as np
import pytest
from campaign import SHORT
from contract import Case, Served, Situation, far_served
from far import DataqFar, SlcanFar, scan_bytes
from hypothesis import given, settings
from hypothesis import strategies as st

from isorig.drivers.arrivals import Arrivals
from isorig.drivers.block import Block, Status
from isorig.drivers.dataq import DataqInstrument, DataqSettings
from isorig.drivers.errors import ProtocolError, SettingError
from isorig.drivers.mti600 import FrameGroup, MtiInstrument, MtiSettings
from isorig.drivers.mti600_messages import GROUP_COUNTER, PER_COUNT
from isorig.drivers.simulated.commanded import Faults, Simulation
from isorig.drivers.simulated.served import served
from isorig.drivers.simulated.streams import SimulatedDataq, SimulatedSlcan, groups, slcan

TEN = DataqSettings(full_scale=10.0)


def counts(samples: int, rate: float, inputs: int = 4) -> np.ndarray:
    return (np.arange(samples)[:, None] * 16 * np.arange(1, inputs + 1) % 30000).astype(np.int16) & ~15


def collect(instrument: object, ticks: int) -> list[Block]:
    blocks: list[Block] = []
    for _ in range(5000):
        block = instrument.read(0.05)  # type: ignore[attr-defined]
        if block is not None:
            blocks.append(block)
            if block.end_tick >= ticks:
                break
    return blocks


def test_di1100_dialogue_and_samples() -> None:
    peer = SimulatedDataq(counts, Simulation(seconds=3.0, speed=4.0))
    with served(peer) as port:
        instrument = DataqInstrument(port, TEN)
        assert instrument.prepare(sample_rate=2000.0, channels=[0, 3]) == 2000.0
        instrument.start()
        blocks = collect(instrument, 6000)
        assert instrument.stop() is None
        instrument.close()
    assert peer.heard == [
        "stop", "encode 0", "slist 0 0", "slist 1 1", "slist 2 2", "slist 3 3", "srate 30000", "dec 1", "deca 1", "ps 0",
        "start", "stop",
    ]  # fmt: skip
    samples = np.concatenate([block.samples for block in blocks])
    np.testing.assert_array_equal(samples[:6000], counts(6000, 2000.0))


class Echo:
    """Sends back what it hears, as a DI-1100 that does not scan."""

    unplugged = False

    def step(self, data: bytes) -> bytes:
        return data


def test_di1100_finds_its_echo_behind_what_was_on_its_way() -> None:
    with served(Echo()) as port:
        instrument = DataqInstrument(port, TEN)
        instrument._port.write(b"stop\r\x12\x0d\xff\x00")
        instrument._command("dec 1")
        instrument.close()
    with served(Chatty()) as port, pytest.raises(ProtocolError, match="is it a DI-1100"):
        DataqInstrument(port, TEN)


class Chatty:
    """Something else, with much to say."""

    unplugged = False

    def step(self, data: bytes) -> bytes:
        return b"hello\r" * 60 if data else b""


def test_di1100_masks_its_digital_inputs_and_refuses_a_rate_it_has_not() -> None:
    def ones(samples: int, rate: float) -> np.ndarray:
        return np.full((samples, 2), 48, np.int16)

    with served(SimulatedDataq(ones, Simulation(seconds=1.0))) as port:
        instrument = DataqInstrument(port, TEN)
        with pytest.raises(SettingError, match="916 Hz or more"):
            instrument.prepare(sample_rate=100.0, channels=[0])
        instrument.prepare(sample_rate=1000.0, channels=[0, 1])
        instrument.start()
        block = collect(instrument, 10)[0]
        instrument.stop()
        instrument.close()
    assert (block.samples[0] == [48, 48]).all()


def arrive(
    rate: float, *, clock: float, gone: int, when: float, seconds: float, jitter: float, seed: int
) -> tuple[list[tuple[int, int]], int]:
    """Blocks on their way through a host that reads late now and then: where loss was told, and the samples that came."""
    random = np.random.default_rng(seed)
    told, place, came, now = [], 0, 0, 0.0

    def handed(count: int, missing: int) -> None:
        nonlocal place
        if missing:
            told.append((place, missing))
        place += count

    arrivals = Arrivals[int](rate, handed)
    while now < seconds:
        now += 0.01 * (1.0 + 3.0 * random.random() * (random.random() < 0.3))
        taken = int(now * rate * clock)
        taken -= min(max(0, taken - int(when * rate * clock)), gone)
        if taken > came:
            arrivals.add(taken - came, taken - came, now + abs(random.normal(0.0, jitter)))
            came = taken
    arrivals.finish()
    assert place == came
    return told, came


@settings(max_examples=30, deadline=None)
@given(
    ppm=st.floats(-300.0, 300.0), gone=st.integers(100, 5000), when=st.floats(1.0, 11.0), seed=st.integers(0, 99),
    jitter=st.floats(0.0, 1e-3),
)  # fmt: skip
def test_losses_are_located_and_distinguished_from_clock_drift(
    ppm: float, gone: int, when: float, seed: int, jitter: float
) -> None:
    rate = 1000.0
    told, _ = arrive(rate, clock=1.0 + 1e-6 * ppm, gone=gone, when=when, seconds=12.0 + gone / rate, jitter=jitter, seed=seed)
    assert abs(sum(missing for _, missing in told) - gone) <= 10
    assert all(abs(place - when * rate) <= 60 for place, _ in told)


@pytest.mark.parametrize("clock", [0.97, 0.999, 1.0, 1.001, 1.03])
def test_without_loss_a_clock_that_runs_otherwise_is_never_loss(clock: float) -> None:
    for seed in range(4):
        told, _ = arrive(2000.0, clock=clock, gone=0, when=1.0, seconds=60.0, jitter=1e-3, seed=seed)
        assert told == []


@pytest.mark.parametrize("late", [0.02, 0.035, 0.06, 0.1, 0.2])
def test_a_loss_with_a_late_arrival_before_it_is_told_once(late: float) -> None:
    handed: list[tuple[int, int]] = []
    arrivals = Arrivals[int](2000.0, lambda count, missing: handed.append((count, missing)))
    told, place = [], 0
    items = [(20, 0.01 * k) for k in range(1, 100)] + [(19, 0.9995), (1, 1.0 + late)]
    items += [(20, 1.26 + 0.01 * k) for k in range(100)]
    for count, now in items:
        arrivals.add(count, count, now)
    arrivals.finish()
    for count, missing in handed:
        if missing:
            told.append((place, missing))
        place += count
    assert told == [(pytest.approx(2000, abs=1), pytest.approx(500, abs=1))]


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 60), counter=st.integers(0, 65535))
def test_decoded_groups_agree_with_cantools(seed: int, count: int, counter: int) -> None:
    random = np.random.default_rng(seed)
    samples = random.integers(-(2**15), 2**15, (count, 3), dtype=np.int16)
    frames = [frame for group in groups(samples, rate=100.0, counter=counter) for frame in group]
    database = cantools.database.load_file(Path(__file__).with_name("mti600.dbc"))
    told = [(identifier, database.decode_message(identifier, data)) for identifier, data in frames]
    found: list[FrameGroup] = []
    for identifier, data in frames:
        if identifier == GROUP_COUNTER:
            found.append(FrameGroup(int.from_bytes(data, "big")))
        found[-1].add(identifier, data)
    assert [group.counter for group in found] == [values["Counter"] for identifier, values in told if identifier == 6]
    expected = [[values[f"Acc{axis}"] for axis in "XYZ"] for identifier, values in told if identifier == 0x34]
    np.testing.assert_array_equal(np.array([group.acceleration for group in found]) * PER_COUNT, expected)
    seconds = [values["Time"] for identifier, values in told if identifier == 5]
    np.testing.assert_allclose([1e-6 * group.micros for group in found], seconds, rtol=1e-12)
    clipped = [bool(int(values["Flags"]) & 0x700) for identifier, values in told if identifier == 0x11]
    assert [group.clipped for group in found] == clipped


def ramp(samples: int, rate: float) -> np.ndarray:
    ticks = np.arange(samples)
    return np.stack([ticks % 30000, ticks // 30000, ticks % 7], axis=1).astype(np.int16)


def placed(blocks: list[Block]) -> tuple[np.ndarray, np.ndarray]:
    """The tick that each sample was given, and the one that it tells itself."""
    samples = np.concatenate([block.samples for block in blocks]).astype(int)
    return np.concatenate([np.arange(b.first_tick, b.end_tick) for b in blocks]), samples[:, 0] + 30000 * samples[:, 1]


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), counter=st.sampled_from([0, 65500, 65535]), drop=st.floats(0.0, 0.5),
    duplicate=st.floats(0.0, 0.3), burst=st.integers(1, 12),
)  # fmt: skip
def test_whatever_frames_are_lost_on_a_bus_no_sample_is_out_of_place(
    seed: int, counter: int, drop: float, duplicate: float, burst: int
) -> None:
    random = np.random.default_rng(seed)
    frames = [frame for group in groups(ramp(300, 100.0), rate=100.0, counter=counter) for frame in group]
    with can.Bus(interface="virtual", channel="lossy") as sender:
        instrument = MtiInstrument("lossy", MtiSettings(bus="virtual"), SHORT)
        instrument.start()
        left = 0
        for identifier, data in frames:
            left = burst if random.random() < drop / burst else left - 1
            for _ in range(0 if left > 0 else 1 + int(random.random() < duplicate)):
                sender.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        blocks = list(iter(lambda: instrument.read(0.0), None))
        instrument.close()
    if blocks:
        given_ticks, own = placed(blocks)
        np.testing.assert_array_equal(given_ticks, own - own[0])
        if drop == 0.0:
            assert len(own) >= 299 - 16


def test_a_group_on_the_wire_of_an_adapter() -> None:
    (group,) = groups(np.array([[256, -1, 2]], np.int16), rate=100.0, first=3, counter=65533)
    assert b"".join(map(slcan, group)) == b"t00620000\rt005400007530\rt03460100FFFF0002\rt011400000000\r"


def test_mti_over_slcan_places_every_sample_by_its_counter() -> None:
    faults = Faults(first_tick=65500, drop=0.05, duplicate=0.05, seed=3)
    peer = SimulatedSlcan(ramp, Simulation(seconds=8.0, speed=3.0, faults=faults))
    with served(peer) as port:
        instrument = MtiInstrument(port, MtiSettings(), SHORT)
        instrument.start()
        blocks = collect(instrument, 2000)
        instrument.stop()
        instrument.close()
    assert [command for command in peer.heard if command][:4] == ["C", "S5", "O", "O"]
    given_ticks, own = placed(blocks)
    assert len(own) > 1200
    np.testing.assert_array_equal(given_ticks, own - own[0])


def test_mti_over_slcan_survives_hurt_bytes() -> None:
    peer = SimulatedSlcan(ramp, Simulation(seconds=8.0, speed=3.0, faults=Faults(corrupt=0.05, seed=1)))
    with served(peer) as port:
        instrument = MtiInstrument(port, MtiSettings(), SHORT)
        instrument.start()
        blocks = collect(instrument, 2000)
        instrument.stop()
        instrument.close()
    given_ticks, own = placed(blocks)
    assert instrument.damaged > 20
    # Nothing guards the digits of a value there; what is out of place are samples of the wrong value.
    assert np.mean(own - np.median(own - given_ticks) != given_ticks) < 0.05


@pytest.mark.parametrize("make", [SimulatedDataq, SimulatedSlcan])
def test_a_fault_that_an_instrument_cannot_have_is_refused(make: type) -> None:
    with pytest.raises(SettingError, match=r"has no fault 'turn_after'; it has .*drop"):
        make(counts, Simulation(faults=Faults(turn_after=1.0)))


def test_di1100_loss_is_counted_over_a_wire() -> None:
    peer = SimulatedDataq(counts, Simulation(seconds=3.0, faults=Faults(drop=0.3, seed=1)))
    with served(peer) as port:
        instrument = DataqInstrument(port, TEN)
        instrument.prepare(sample_rate=2000.0, channels=[0])
        instrument.start()
        blocks = collect(instrument, 13_000)
        instrument.stop()
        instrument.close()
    gaps = [after.first_tick - before.end_tick for before, after in pairwise(blocks)]
    # One loss of half a second, which a clock tells within ten milliseconds.
    assert peer.dropped == 1000
    assert [gap for gap in gaps if gap] == [pytest.approx(1000, abs=20)]


def test_mti_on_the_virtual_bus_reports_clipping_and_internal_loss() -> None:
    samples = np.zeros((20, 3), np.int16)
    samples[3, 1] = 32767
    with can.Bus(interface="virtual", channel="rig-test") as sender:
        instrument = MtiInstrument("rig-test", MtiSettings(bus="virtual"), SHORT)
        instrument.start()
        sender.send(can.Message(arbitration_id=1, data=b"\x01", is_extended_id=False))
        for group in groups(samples, rate=100.0):
            for identifier, data in group:
                sender.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        block = instrument.read(0.5)
        assert block is not None
        assert block.status == Status.OVERLOAD | Status.LOST
        assert block.first_tick == 0
        assert len(block.samples) == 16
        instrument.close()


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


CASES = (
    Case(kind="di1100", serve=serve_dataq, rate=2000.0, speed=1.0, lose=(2000, 500), within=60, reports=False),
    Case(kind="mti600", serve=serve_mti, rate=100.0, speed=2.0, lose=(100, 50), within=1),
)
