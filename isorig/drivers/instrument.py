"""Interfaces of instruments: streaming blocks, returning records, playing a drive. A driver is a class with these methods."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from isorig.drivers.block import Block, FloatArray, Input, InstrumentRecord, Status


class Values(Protocol):
    """A sequence of values that may be computed on demand: an array, or a long drive that is never completely in memory."""

    def __len__(self) -> int:
        """Number of values."""

    def __getitem__(self, part: slice, /) -> FloatArray:
        """A slice of the values."""


class Instrument(Protocol):
    """Any instrument."""

    @property
    def identity(self) -> str:
        """The identification that the instrument reports."""

    def close(self) -> None:
        """Close the port; may be called twice."""


def in_real_time(instrument: Instrument) -> bool:
    """Whether an instrument measures in real time; a simulated one, whose name begins with `virtual`, may run faster."""
    return not instrument.identity.startswith("virtual ")


class Stream(Instrument, Protocol):
    """An instrument that streams samples of all its inputs.

    The order of calls is prepare, start, read as often as possible, stop, read until None.
    """

    @property
    def inputs(self) -> Sequence[Input]:
        """Its inputs in the order of a block's columns; final after `prepare`."""

    def prepare(self, *, sample_rate: float, channels: Sequence[int]) -> float:
        """Set the rate (Hz) and the inputs to scan; returns the actual rate."""

    def start(self) -> None:
        """Start streaming; the first sample has tick 0."""

    def read(self, timeout: float) -> Block | None:
        """The next block, or None if none arrives within `timeout` seconds.

        Raises
        ------
        ConnectionLostError
            The instrument is gone.
        ProtocolError, InstrumentError
            The data are invalid, or the instrument reports a fault that ends the stream.
        """

    def stop(self) -> int | None:
        """Stop the stream; returns the number of ticks that the instrument counted, None if it does not count.

        Data still in transit are returned by `read` until it returns None.
        """


@runtime_checkable
class Exciter(Protocol):
    """An instrument that also plays the drive, and may lock and unlock the rig."""

    def set_gain(self, gain: float) -> None:
        """Set the drive gain of the next run."""

    def set_configuration(self, name: str) -> bool:
        """Lock or unlock the rig; False if the operator has to do it."""

    def load_drive(self, drive: Values) -> bool:
        """Load the drive at gain 1, one value per tick from tick 0 on, then 0; False if the instrument has no drive output."""


@runtime_checkable
class Rejoining(Protocol):
    """A stream that can continue after a temporary loss of the connection."""

    def rejoin(self) -> None:
        """Reopen the connection and continue the run; samples acquired meanwhile show as a step of the tick.

        Raises ConnectionLostError if the connection is still not available, InstrumentError if the instrument was restarted in
        the meantime.
        """


@runtime_checkable
class Counting(Protocol):
    """A stream that reports during the measurement how many ticks it has counted."""

    def count(self) -> int | None:
        """Ticks counted since the start; None if the reported number is impossible."""


@runtime_checkable
class Holding(Protocol):
    """A stream that returns its samples late, because it detects losses only from later samples."""

    @property
    def held(self) -> int:
        """Ticks received but still held."""


@runtime_checkable
class Noticing(Protocol):
    """An instrument whose driver reports anomalies of the data stream."""

    @property
    def noticed(self) -> Sequence[str]:
        """Anomalies since the last start, one clause each."""


@runtime_checkable
class Describing(Protocol):
    """An instrument that reads the memories of its sensors (TEDS)."""

    def memory(self, place: int) -> bytes | None:
        """The memory of the sensor at an input, lowest bit first, without checksums; None if there is none."""

    def force_sensitivity(self, place: int) -> float | None:
        """V per N by the memory of a force sensor at an input, as the vendor's library reads it; None if it does not."""


@runtime_checkable
class Sourcing(Protocol):
    """An instrument with a source that is configured on its panel; only the level is set by the driver."""

    def set_source(self, level: float) -> None:
        """Set the level (V, peak) and switch the source on; closing the instrument switches it off.

        Raises SettingError if the source cannot have that level, or answers with another.
        """


class Records(Instrument, Protocol):
    """An instrument that measures on its own and returns finished records."""

    def status(self) -> Status:
        """Present status of its inputs; GOOD if it cannot report it."""

    def measure(self, timeout: float) -> None:
        """Start one measurement and wait until it is finished.

        Raises
        ------
        InstrumentError
            The instrument reports a fault, or does not finish within `timeout` seconds.
        """

    def records(self) -> tuple[InstrumentRecord, ...]:
        """The records of the last measurement."""
