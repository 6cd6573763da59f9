"""What an instrument can do: stream blocks, hand out records, play a drive. A driver is a class with these methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from drivers.block import Block, FloatArray, Input, Record, Status


class Instrument(Protocol):
    """Anything at the far end of a wire."""

    @property
    def identity(self) -> str:
        """What it says it is."""
        ...

    def close(self) -> None:
        """Let go of the wire; may be called twice."""
        ...


class Stream(Instrument, Protocol):
    """An instrument that streams samples of all its inputs.

    The order of calls is prepare, start, read as often as possible, stop, read until None.
    """

    @property
    def inputs(self) -> Sequence[Input]:
        """Its inputs in the order of a block's columns; final after `prepare`."""
        ...

    def prepare(self, *, sample_rate: float, channels: Sequence[int]) -> float:
        """Set the rate (Hz) and the inputs to scan; returns the rate that it really has."""
        ...

    def start(self) -> None:
        """Begin to stream; the first sample has tick 0."""
        ...

    def read(self, timeout: float) -> Block | None:
        """The next block, or None where none came within `timeout` seconds.

        Raises
        ------
        ConnectionLostError
            Where the far end is gone.
        ProtocolError, InstrumentError
            Where what it says cannot be, or it reports a fault that ends the stream.
        """
        ...

    def stop(self) -> int | None:
        """End the stream; the number of ticks that the instrument counted, None where it does not count.

        What was still on its way is handed out by `read` until it returns None.
        """
        ...


@runtime_checkable
class Exciter(Protocol):
    """An instrument that also plays the drive, and may set up the rig by itself."""

    def set_gain(self, gain: float) -> None:
        """Drive gain of the next run."""
        ...

    def set_configuration(self, name: str) -> bool:
        """Lock or unlock the rig; False where that is the operator's work."""
        ...

    def load_drive(self, drive: FloatArray) -> bool:
        """Load the drive at gain 1, one value per tick from tick 0 on; False where it plays none."""
        ...


class Records(Instrument, Protocol):
    """An instrument that measures by itself and hands out finished records."""

    def status(self) -> Status:
        """What it says of its inputs now; GOOD where it cannot tell."""
        ...

    def measure(self, timeout: float) -> None:
        """Take one measurement and wait until it is done.

        Raises
        ------
        InstrumentError
            Where it reports a fault, or is not done within `timeout` seconds.
        """
        ...

    def records(self) -> tuple[Record, ...]:
        """The records of the last measurement."""
        ...
