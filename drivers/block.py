"""What instruments hand out: blocks of a stream, and finished records."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Raw = NDArray[Any]
FloatArray = NDArray[np.float64]


class Status(IntFlag):
    """What is to be told of a block, or a record, beside its samples.

    The first three are the instrument's own words, the others the driver's. DISAGREES: counter, sequence and clock did not agree,
    and the block stands where most of them, or this machine's clock, put it. CLOCKED: this machine's clock alone told how many
    samples were lost before it. RESYNCED: bytes were lost before it, and the stream was aligned anew. UNSURE: its bytes could be
    aligned otherwise, and nothing in them tells.
    """

    GOOD = 0
    OVERLOAD = 1
    LOST = 2
    FAULT = 4
    DISAGREES = 8
    CLOCKED = 16
    RESYNCED = 32
    UNSURE = 64


@dataclass(frozen=True, kw_only=True)
class Input:
    """One input of an instrument: physical value in `unit` = raw * per_count + offset, up to `full_scale`."""

    unit: str
    per_count: float
    full_scale: float | None
    dtype: Literal["int16", "int32", "float32", "float64"]
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Block:
    """Consecutive samples of all inputs.

    Parameters
    ----------
    first_tick
        The instrument's own count at the first sample, 0 at the start, never wrapping.
    samples
        Raw values, shape (n, inputs).
    host_time
        Seconds of the host's monotonic clock when the last sample had arrived.
    device_time
        Seconds of the instrument's clock at the first sample; None where it has none.
    gain
        Drive gain that the instrument streams; None where it does not.
    status
        What the instrument says of these samples.
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
class Record:
    """A finished record that an instrument measured by itself.

    Parameters
    ----------
    kind
        "time" or "spectrum".
    x
        Seconds or Hz, shape (n,).
    values
        Values in `unit`, shape (n,), real or complex.
    unit
        Unit of the values as the instrument or the plan says.
    source
        The instrument's own name for it: a display, a trace.
    averages
        Averages taken; None where the instrument does not tell.
    window
        Window of a spectrum; None where unknown.
    status
        What the instrument says of it.
    """

    kind: Literal["time", "spectrum"]
    x: FloatArray
    values: NDArray[Any]
    unit: str
    source: str
    averages: int | None = None
    window: str | None = None
    status: Status = Status.GOOD
