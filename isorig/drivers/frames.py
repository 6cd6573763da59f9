"""The framed serial protocol: transmission of samples in which every loss is detected.

All numbers are little-endian. The instrument sends frames; a frame is a header, a payload and a checksum::

    offset size type
    0      4    bytes  magic "ISOR"
    4      1    u8     kind: 0 text, 1 samples of int16, 2 samples of int32
    5      1    u8     columns: inputs (1 in a text)
    6      2    u16    rows: samples per input (bytes of a text)
    8      4    u32    sequence: number of the sample frame, wraps
    12     4    u32    tick: number of the first sample in the frame, wraps
    16     4    u32    time: the instrument's clock at the first sample, microseconds, wraps
    20     4    f32    gain of the drive during the frame
    24     4    u32    status bits: 1 overload of an input, 2 samples lost inside the instrument, 4 fault
    28     4    u32    checksum of bytes 0 to 27
    32     n           payload: rows of columns, interleaved
    32+n   4    u32    checksum of the payload

The checksum is CRC-32 as in Ethernet and zlib. The host sends commands, ASCII lines ended by LF; the answer to each is a text
frame that starts with the command's word, and the answer to START precedes the first frame of its run. If a command cannot be
executed, the answer is `ERR word reason`. The host repeats a
command that is not answered, so every command may arrive twice::

    ID?             ID isorig-framed/1 <name>
    INPUTS?         INPUTS <count> <int16|int32> <unit> <unit per count> <full scale in unit>
    RATE <Hz>       RATE <actual rate, Hz>
    GAIN <g>        GAIN <g>
    CONF <name>     CONF <name> if the rig locks and unlocks automatically, CONF manual if the operator does
    DRIVE <n>       then n float32 (the head's acceleration at gain 1, m/s^2) and their checksum; DRIVE <n>, or DRIVE none
    START           START <tick of the first sample>; while running the same answer again
    STOP            COUNT <samples taken since START>
    COUNT?          COUNT <samples taken since START>

A microcontroller needs one buffer, one CRC and two counters. It counts every sample that its converter acquires, sent or not: a
sample that was not sent then shows as a step of the tick, and STOP shows losses after the last frame.
"""

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
#: Maximum size of a frame's samples and text in bytes: a header that states more is treated as damaged, so no one waits for it.
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
        """The text of a text frame."""
        return self.payload.decode("ascii", "replace")

    @property
    def dtype(self) -> np.dtype[Any]:
        """Data type of the samples."""
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
    """Finds the frames in a stream of bytes, and skips everything else.

    `damaged` is the number of frames with a valid header and an invalid payload.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.damaged = 0

    def feed(self, data: bytes) -> list[Frame]:
        """The valid frames completed by `data`."""
        self._buffer += data
        frames: list[Frame] = []
        at = 0
        while (start := self._buffer.find(MAGIC, at)) >= 0:
            at = start
            size = self._size(at)
            if size is None or len(self._buffer) - at < size:
                break
            frame = self._frame(at, size) if size else None
            frames += [] if frame is None else [frame]
            at += 1 if frame is None else size
        else:
            # The buffer may end with the first bytes of a magic.
            at = max(at, len(self._buffer) - next((k for k in (3, 2, 1) if self._buffer.endswith(MAGIC[:k])), 0))
        del self._buffer[:at]
        return frames

    def give_up(self) -> list[Frame]:
        """Stop waiting for the rest of an incomplete frame; returns the valid frames after its start."""
        if len(self._buffer) < len(MAGIC):
            return []
        del self._buffer[:1]
        return self.feed(b"")

    def forget(self) -> None:
        """Discard the start of an incomplete frame."""
        self._buffer.clear()

    def _size(self, at: int) -> int | None:
        # Size of the frame that starts here in bytes; 0 if its header is invalid, None if the header is incomplete.
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
