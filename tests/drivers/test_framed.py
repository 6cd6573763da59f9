"""The framed protocol: what is decoded, whatever happens to the bytes."""

from __future__ import annotations

import math
from contextlib import AbstractContextManager, closing
from zlib import crc32

import numpy as np
import pytest
from contract import Case, Served, Situation, far_served
from far import FramedFar
from far import frame as frame_of
from hypothesis import given, settings
from hypothesis import strategies as st

from isorig.drivers.errors import ProtocolError
from isorig.drivers.framed import FramedInstrument, FramedSettings
from isorig.drivers.frames import MAGIC, Decoder, encode_samples, encode_text
from isorig.drivers.order import wrapped
from isorig.drivers.simulated.commanded import Simulation
from isorig.drivers.simulated.framed import SimulatedFramed
from isorig.drivers.simulated.served import PtyWire, served


def frames(count: int, rows: int, columns: int, seed: int) -> tuple[list[bytes], list[np.ndarray]]:
    random = np.random.default_rng(seed)
    samples = [random.integers(-(2**31), 2**31, (rows, columns), dtype=np.int32) for _ in range(count)]
    return [encode_samples(s, sequence=k, tick=k * rows, time_us=k) for k, s in enumerate(samples)], samples


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), cut=st.integers(1, 400), junk=st.binary(max_size=60), rows=st.integers(1, 40))
def test_frames_come_out_whatever_the_cuts_and_the_noise_between(seed: int, cut: int, junk: bytes, rows: int) -> None:
    wires, samples = frames(12, rows, 3, seed)
    stream = b"".join(junk + wire for wire in wires)
    decoder = Decoder()
    found = [frame for at in range(0, len(stream), cut) for frame in decoder.feed(stream[at : at + cut])]
    assert [frame.sequence for frame in found] == list(range(12))
    for frame, sample in zip(found, samples, strict=True):
        np.testing.assert_array_equal(frame.samples, sample)
    assert decoder.damaged == 0


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_costs_one_frame_and_never_gives_a_wrong_sample(seed: int, place: float, bit: int) -> None:
    wires, samples = frames(6, 16, 2, seed)
    stream = bytearray(b"".join(wires))
    at = int(place * len(stream))
    stream[at] ^= 1 << bit
    decoder = Decoder()
    found = decoder.feed(bytes(stream)) + decoder.give_up()
    hurt = at // len(wires[0])
    assert [frame.sequence for frame in found] == [k for k in range(6) if k != hurt]
    for frame in found:
        np.testing.assert_array_equal(frame.samples, samples[frame.sequence])


def test_a_magic_inside_the_samples_is_no_frame() -> None:
    tricky = np.frombuffer(MAGIC * 30, "<i4").reshape(10, 3)
    decoder = Decoder()
    found = decoder.feed(encode_samples(tricky, sequence=0, tick=0, time_us=0) + encode_text("ID x"))
    assert [frame.kind for frame in found] == [2, 0]
    assert found[1].text == "ID x"


@pytest.mark.parametrize("near", [0, 2**31, 2**32 - 5, 2**40 + 17])
@pytest.mark.parametrize("step", [0, 1, 70000, -3, 2**31 - 1])
def test_a_counter_that_wraps_goes_on(near: int, step: int) -> None:
    assert wrapped((near + step) % 2**32, near, 2**32) == near + step


def test_the_bytes_of_a_frame_are_those_of_the_description() -> None:
    wire = encode_samples(np.array([[1, -2]], np.int16), sequence=3, tick=4, time_us=5, gain=1.5, status=1)
    assert wire.hex() == (
        "49534f52" "01" "02" "0100" "03000000" "04000000" "05000000" "0000c03f" "01000000" "7951bf86" "0100feff" "c79bc53e"
    )  # fmt: skip


class Tapped(PtyWire):
    """A wire that keeps what went over it."""

    def __init__(self) -> None:
        super().__init__()
        self.heard, self.said = b"", b""

    def read(self, timeout: float) -> bytes:
        data = super().read(timeout)
        self.heard += data
        return data

    def write(self, data: bytes, timeout: float) -> int:
        taken = super().write(data, timeout)
        self.said += data[:taken]
        return taken


class Three:
    identity = "three samples"
    inputs = (1, "V", 1e-3, 10.0)

    def play(self, drive: np.ndarray, *, sample_rate: float, gain: float, configuration: str) -> np.ndarray:
        assert drive.tolist() == [0.5, -1.0, 0.0]
        return np.array([[1], [2], [3]], np.int32)


def test_the_dialogue_byte_by_byte() -> None:
    wire = Tapped()
    far = SimulatedFramed(Three(), Simulation(speed=math.inf), rows=2)
    with served(far, wire) as port, closing(FramedInstrument(port, FramedSettings())) as instrument:
        assert instrument.identity == "three samples"
        assert instrument.prepare(sample_rate=1000.0, channels=[0]) == 1000.0
        assert instrument.set_configuration("locked")
        instrument.set_gain(2.5)
        assert instrument.load_drive(np.array([0.5, -1.0, 0.0]))
        instrument.start()
        blocks = [instrument.read(5.0), instrument.read(5.0)]
        assert instrument.stop() == 3
    drive = bytes.fromhex("0000003f 000080bf 00000000")
    loaded = b"DRIVE 3\n" + drive + crc32(drive).to_bytes(4, "little")
    assert wire.heard == b"STOP\nID?\nINPUTS?\nRATE 1000\nCONF locked\nGAIN 2.5\n" + loaded + b"START\nSTOP\n"
    told = ("COUNT 0", "ID isorig-framed/1 three samples", "INPUTS 1 int32 V 0.001 10", "RATE 1000", "CONF locked", "GAIN 2.5",
            "DRIVE 3", "START 0")  # fmt: skip
    samples = [
        encode_samples(np.array(part, np.int32)[:, None], sequence=k, tick=2 * k, time_us=2000 * k, gain=2.5)
        for k, part in enumerate(([1, 2], [3]))
    ]
    assert wire.said == b"".join(map(encode_text, told)) + b"".join(samples) + encode_text("COUNT 3")
    assert [block.samples.ravel().tolist() for block in blocks if block is not None] == [[1, 2], [3]]


def test_another_version_of_the_protocol_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Newer:
        unplugged = False

        def step(self, data: bytes) -> bytes:
            return encode_text("COUNT 0") + encode_text("ID isorig-framed/2 x") if data else b""

    with served(Newer()) as port, pytest.raises(ProtocolError, match="isorig-framed/2"):
        FramedInstrument(port, FramedSettings())


def serve_framed(situation: Situation) -> AbstractContextManager[Served]:
    def spoil(fields: dict) -> bytes:
        status = int(situation.overloaded(fields["tick"]))
        return b"" if situation.lost(fields["tick"]) else frame_of(**(fields | {"status": status}))

    frames = 10**6 if situation.mute_after is None else situation.mute_after // 50
    far = FramedFar(spoil=spoil, frames=frames, speed=10.0 * situation.clock)
    return far_served(far, situation, lambda: far.running)


CASES = (Case(kind="framed", serve=serve_framed, rate=1000.0),)
