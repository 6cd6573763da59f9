"""Frames at their bounds, built here from the description by hand: sizes, wraps, and what is skipped or counted as damaged."""

from __future__ import annotations

import struct
from zlib import crc32

import numpy as np
import pytest

from isorig.drivers.frames import Decoder, encode_samples, encode_text


def built(kind: int, columns: int, rows: int, payload: bytes, *, numbers: tuple[int, int, int] = (0, 0, 0)) -> bytes:
    """A frame according to the table: little-endian, with both checksums."""
    header = b"ISOR" + struct.pack("<BBHIIIfI", kind, columns, rows, *numbers, 0.0, 0)
    return header + struct.pack("<I", crc32(header)) + payload + struct.pack("<I", crc32(payload))


def test_a_text_frame_is_one_column_of_bytes_without_numbers() -> None:
    assert encode_text("RATE 400") == built(0, 1, 8, b"RATE 400")


def test_counters_wrap_at_32_bits() -> None:
    sent = encode_samples(np.array([[7]], np.int32), sequence=2**32 + 3, tick=2**33 + 4, time_us=2**32 - 1)
    assert sent == built(2, 1, 1, struct.pack("<i", 7), numbers=(3, 4, 2**32 - 1))
    last = 2**33 - 1
    sent = encode_samples(np.array([[7]], np.int32), sequence=last, tick=last, time_us=last)
    assert sent == built(2, 1, 1, struct.pack("<i", 7), numbers=(2**32 - 1,) * 3)


@pytest.mark.parametrize(
    ("kind", "columns", "rows", "width", "valid"),
    [
        (0, 1, 512, 1, True),  # a text of 512 bytes
        (0, 1, 513, 1, False),
        (1, 16, 32768, 2, True),  # samples of 1 MiB
        (1, 17, 32768, 2, False),
        (2, 8, 32768, 4, True),
        (2, 9, 32768, 4, False),
        (3, 1, 1, 2, False),  # no such kind
        (1, 0, 1, 2, False),  # no input
        (1, 255, 1, 2, True),
    ],
)
def test_frames_of_an_allowed_kind_and_size_are_valid(kind: int, columns: int, rows: int, width: int, valid: bool) -> None:
    """A header that states more is skipped at once: the frame after it is not kept waiting."""
    decoder = Decoder()
    wire = built(kind, columns, rows, bytes(rows * columns * width))
    after = encode_text("ID x")
    found = decoder.feed(wire[:36] + after) if not valid else decoder.feed(wire + after)
    assert [frame.kind for frame in found] == ([kind, 0] if valid else [0])
    assert decoder.damaged == 0


def test_damaged_frames_are_counted() -> None:
    decoder = Decoder()
    assert decoder.damaged == 0
    whole = built(1, 1, 2, b"\1\0\2\0")
    broken = whole[:-1] + bytes([whole[-1] ^ 1])
    (frame,) = decoder.feed(b"junk" + broken + whole)
    np.testing.assert_array_equal(frame.samples, [[1], [2]])
    assert decoder.damaged == 1


@pytest.mark.parametrize("kept", [1, 2, 3])
def test_the_first_bytes_of_a_frame_are_kept_until_the_rest_arrives(kept: int) -> None:
    decoder = Decoder()
    wire = encode_text("ID x")
    assert decoder.feed(b"xyz" + wire[:kept]) == []
    assert [frame.text for frame in decoder.feed(wire[kept:])] == ["ID x"]


def test_an_incomplete_frame_is_given_up_or_forgotten() -> None:
    wire = encode_text("ID x")
    decoder = Decoder()
    assert decoder.give_up() == []
    assert decoder.feed(wire[:35]) == []
    decoder.forget()
    assert [frame.text for frame in decoder.feed(wire)] == ["ID x"]
    # A header that never gets its payload: what came in its place is found.
    assert decoder.feed(built(1, 1, 400, b"")[:36] + wire) == []
    assert [frame.text for frame in decoder.give_up()] == ["ID x"]
    # Fewer bytes than a magic are no frame to give up.
    assert decoder.feed(b"ISO") == []
    assert decoder.give_up() == []
    assert decoder.feed(wire[3:])[0].text == "ID x"
    assert decoder.feed(wire[:4]) == []
    decoder.give_up()
    assert decoder.feed(wire)[0].text == "ID x"


def test_what_is_no_frame_is_not_kept() -> None:
    decoder = Decoder()
    assert decoder.feed(b"x" * 10_000) == []
    assert decoder.give_up() == []
    assert len(decoder._buffer) == 0
    decoder.feed(b"xxxISO")  # may be the start of one
    assert bytes(decoder._buffer) == b"ISO"


def test_a_frame_that_was_given_up_does_not_go_on() -> None:
    decoder, sent = Decoder(), built(0, 1, 2, b"ok")
    decoder.feed(sent[:4])
    assert decoder.give_up() == []
    assert decoder.feed(sent[4:]) == []
    assert [frame.payload for frame in decoder.feed(sent)] == [b"ok"]
