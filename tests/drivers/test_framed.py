"""The framed protocol: what is decoded, whatever happens to the bytes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.frames import MAGIC, Decoder, encode_samples, encode_text, unwrap


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
    assert decoder.skipped == 12 * len(junk)


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
    assert unwrap((near + step) % 2**32, near) == near + step


def test_the_bytes_of_a_frame_are_those_of_the_description() -> None:
    wire = encode_samples(np.array([[1, -2]], np.int16), sequence=3, tick=4, time_us=5, gain=1.5, status=1)
    assert wire.hex() == (
        "49534f52" "01" "02" "0100" "03000000" "04000000" "05000000" "0000c03f" "01000000" "7951bf86" "0100feff" "c79bc53e"
    )  # fmt: skip
