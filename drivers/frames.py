"""The framed serial protocol: how samples travel so that nothing is lost without being counted.

All numbers are little-endian. The instrument sends frames; a frame is a header, a payload and a checksum::

    offset size type
    0      4    bytes  magic "ISOR"
    4      1    u8     kind: 0 text, 1 samples of int16, 2 samples of int32
    5      1    u8     columns: inputs (1 in a text)
    6      2    u16    rows: samples per input (bytes of a text)
    8      4    u32    sequence: counts frames of samples, wraps
    12     4    u32    tick: count of the first sample in the frame, wraps
    16     4    u32    time: the instrument's clock at the first sample, microseconds, wraps
    20     4    f32    gain of the drive during the frame
    24     4    u32    status: 1 overload of an input, 2 samples lost inside the instrument, 4 fault
    28     4    u32    checksum of bytes 0 to 27
    32     n           payload: rows of columns, interleaved
    32+n   4    u32    checksum of the payload

The checksum is CRC-32 as in Ethernet and zlib. The host sends commands, lines of ASCII ended by LF; each is answered by a
frame of text that begins with the command's word. A command that cannot be done is answered `ERR word why`. The host repeats a
command that stays without an answer, so every command may come twice::

    ID?             ID isorig-framed/1 <name>
    INPUTS?         INPUTS <count> <int16|int32> <unit> <unit per count> <full scale in unit>
    RATE <Hz>       RATE <the rate it has, Hz>
    GAIN <g>        GAIN <g>
    CONF <name>     CONF <name> where the rig switches by itself, CONF manual where the operator has to
    DRIVE <n>       then n float32 (the head's acceleration at gain 1, m/s^2) and their checksum; DRIVE <n>, or DRIVE none
    START           START <tick of the first sample>; while running the same answer again
    STOP            COUNT <samples taken since START>
    COUNT?          COUNT <samples taken since START>

A microcontroller needs one buffer, one CRC and two counters. It counts a sample when its converter takes it, sent or not:
what it could not send is then seen as a step of the tick, and STOP tells what was lost after the last frame.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np

from isorig.drivers.block import Raw

MAGIC = b"ISOR"
TEXT, INT16, INT32 = 0, 1, 2
_HEADER = struct.Struct("<4sBBHIIIfI")
_CHECK = struct.Struct("<I")
HEADER_SIZE = _HEADER.size + _CHECK.size
#: Bytes of a frame's samples and of its text at most: a header that tells of more is not sound, so that nobody waits for it.
LARGEST, LONGEST = 1 << 20, 512
_TYPES: dict[int, np.dtype[Any]] = {INT16: np.dtype("<i2"), INT32: np.dtype("<i4")}
_KINDS = {"int16": INT16, "int32": INT32}


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One frame as it was sent; `payload` is text as bytes, or the samples' bytes."""

    kind: int
    columns: int
    rows: int
    sequence: int
    tick: int
    time_us: int
    gain: float
    status: int
    payload: bytes

    @property
    def text(self) -> str:
        """A text frame's text."""
        return self.payload.decode("ascii", "replace")

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of its samples."""
        return _TYPES[self.kind]

    @property
    def samples(self) -> Raw:
        """The samples, shape (rows, columns)."""
        return np.frombuffer(self.payload, _TYPES[self.kind]).reshape(self.rows, self.columns)


def encode_text(text: str) -> bytes:
    """A text answer as a frame."""
    payload = text.encode("ascii")
    return _frame(TEXT, 1, len(payload), 0, 0, 0, 0.0, 0, payload)


def encode_samples(samples: Raw, *, sequence: int, tick: int, time_us: int, gain: float = 0.0, status: int = 0) -> bytes:
    """Samples of int16 or int32, shape (rows, columns), as a frame; the counters are wrapped here."""
    kind = _KINDS[samples.dtype.name]
    rows, columns = samples.shape
    payload = np.ascontiguousarray(samples, _TYPES[kind]).tobytes()
    return _frame(kind, columns, rows, sequence % 2**32, tick % 2**32, time_us % 2**32, gain, status, payload)


def _frame(*fields: object) -> bytes:
    *numbers, payload = fields
    assert isinstance(payload, bytes)
    header = _HEADER.pack(MAGIC, *numbers)
    return b"".join((header, _CHECK.pack(crc32(header)), payload, _CHECK.pack(crc32(payload))))


class Decoder:
    """Finds the frames in a stream of bytes, and steps over everything that is none.

    Attributes
    ----------
    skipped
        Bytes that belonged to no sound frame.
    damaged
        Frames whose header was sound and whose payload was not.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.skipped = 0
        self.damaged = 0

    def feed(self, data: bytes) -> list[Frame]:
        """The sound frames that end in `data`."""
        self._buffer += data
        frames: list[Frame] = []
        at = 0
        while True:
            start = self._buffer.find(MAGIC, at)
            if start < 0:
                # The buffer may end in the beginning of a magic.
                start = len(self._buffer) - next((k for k in (3, 2, 1) if self._buffer.endswith(MAGIC[:k])), 0)
                self.skipped += max(start - at, 0)
                at = max(start, at)
                break
            self.skipped += start - at
            at = start
            size = self._size(at)
            if size is None or len(self._buffer) - at < size:
                break
            frame = self._frame(at, size) if size else None
            if frame is None:
                self.skipped += 1
                at += 1
            else:
                frames.append(frame)
                at += size
        del self._buffer[:at]
        return frames

    def give_up(self) -> list[Frame]:
        """Stop waiting for the rest of a frame that will not come; the sound frames behind its beginning."""
        if len(self._buffer) < len(MAGIC):
            return []
        self.skipped += 1
        del self._buffer[:1]
        return self.feed(b"")

    def forget(self) -> None:
        """Drop the beginning of a frame whose rest will not come."""
        self._buffer.clear()

    def _size(self, at: int) -> int | None:
        # Bytes of the frame that begins here; 0 where its header is not sound, None where the header is not whole yet.
        if len(self._buffer) - at < HEADER_SIZE:
            return None
        header = bytes(self._buffer[at : at + _HEADER.size])
        (check,) = _CHECK.unpack_from(self._buffer, at + _HEADER.size)
        _, kind, columns, rows, *_ = _HEADER.unpack(header)
        if check != crc32(header) or kind not in (TEXT, INT16, INT32) or columns == 0:
            return 0
        width = 1 if kind == TEXT else _TYPES[kind].itemsize
        payload = int(rows) * int(columns) * width
        return 0 if payload > (LONGEST if kind == TEXT else LARGEST) else HEADER_SIZE + payload + _CHECK.size

    def _frame(self, at: int, size: int) -> Frame | None:
        payload = bytes(self._buffer[at + HEADER_SIZE : at + size - _CHECK.size])
        (check,) = _CHECK.unpack_from(self._buffer, at + size - _CHECK.size)
        if check != crc32(payload):
            self.damaged += 1
            return None
        _, kind, columns, rows, sequence, tick, time_us, gain, status = _HEADER.unpack_from(self._buffer, at)
        return Frame(
            kind=kind, columns=columns, rows=rows, sequence=sequence, tick=tick, time_us=time_us, gain=gain,
            status=status, payload=payload,
        )  # fmt: skip
