"""Data returned by instruments: blocks of a stream, and finished records."""

from dataclasses import dataclass
from enum import IntFlag
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Raw = NDArray[Any]
FloatArray = NDArray[np.float64]


class Status(IntFlag):
    """Flags of a block or a record.

    The first three are reported by the instrument, the others are set by the driver. DISAGREES: counter, sequence number and
    clock did not agree, and the block was placed by the majority or by the host's clock. CLOCKED: only the host's clock showed
    how many samples were lost before it. RESYNCED: bytes were lost before it, and the stream was realigned. UNSURE: its bytes
    also fit another alignment. NUMBERED: the samples are numbered, so that no loss is undetected.
    """

    GOOD = 0
    OVERLOAD = 1
    LOST = 2
    FAULT = 4
    DISAGREES = 8
    CLOCKED = 16
    RESYNCED = 32
    UNSURE = 64
    NUMBERED = 128


@dataclass(frozen=True, kw_only=True)
class Input:
    """One input of an instrument: physical value in `unit` = raw * per_count + offset, up to `full_scale`.

    An input that `counts` adds up events, e.g. pulses of a tachometer: its value may rest, and does not follow the drive.
    """

    unit: str
    per_count: float
    full_scale: float | None
    dtype: Literal["int16", "int32", "float32", "float64"]
    offset: float = 0.0
    counts: bool = False

    def physical(self, raw: Raw) -> FloatArray:
        """Raw values in the input's unit."""
        return np.asarray(raw * self.per_count + self.offset, np.float64)


@dataclass(frozen=True, kw_only=True)
class Block:
    """Consecutive samples of all inputs.

    Parameters
    ----------
    first_tick
        The instrument's sample count at the first sample, 0 at the start, without wrapping.
    samples
        Raw values, shape (n, inputs).
    host_time
        Time of the host's monotonic clock when the last sample had arrived, seconds.
    device_time
        Time of the instrument's clock at the first sample, seconds; None if it has none.
    gain
        Drive gain streamed by the instrument; None if it streams none.
    status
        Status that the instrument reports for these samples.
    """

    first_tick: int
    samples: Raw
    host_time: float
    device_time: float | None = None
    gain: float | None = None
    status: Status = Status.GOOD

    @property
    def end_tick(self) -> int:
        """The tick after the last sample."""
        return self.first_tick + len(self.samples)


@dataclass(frozen=True, kw_only=True)
class InstrumentRecord:
    """A finished record, measured by the instrument."""

    x: FloatArray  #: Seconds or Hz, shape (n,).
    values: NDArray[Any]  #: Values, shape (n,), real or complex.
    averages: int | None = None  #: Number of averages; None if the instrument does not report it.
    status: Status = Status.GOOD  #: Status that the instrument reports for it.
