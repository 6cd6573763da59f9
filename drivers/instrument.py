"""What an instrument can do: stream blocks, hand out records, play a drive. A driver is a class with these methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from isorig.drivers.block import Block, FloatArray, Input, Record, Status


class Values(Protocol):
    """Values that may be made as they are asked for: an array is one, and so is a long drive that never is in memory whole."""

    def __len__(self) -> int:
        """How many."""
        ...

    def __getitem__(self, part: slice, /) -> FloatArray:
        """Consecutive ones."""
        ...


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

    def load_drive(self, drive: Values) -> bool:
        """Load the drive at gain 1, one value per tick from tick 0 on and rest behind it; False where it plays none."""
        ...


@runtime_checkable
class Rejoining(Protocol):
    """A stream that can be taken up again where its wire was away for a while."""

    def rejoin(self) -> None:
        """Open the wire again and go on with the run; samples that were taken meanwhile show as a step of the tick.

        Raises
        ------
        ConnectionLostError
            Where the wire is still away.
        InstrumentError
            Where the instrument has begun anew meanwhile.
        """
        ...


@runtime_checkable
class Counting(Protocol):
    """A stream that tells while it is measured how many ticks it has taken."""

    def count(self) -> int | None:
        """Ticks taken since the start; None where what it tells cannot be."""
        ...


@runtime_checkable
class Holding(Protocol):
    """A stream that hands its samples out late, because it sees losses only from what comes behind."""

    @property
    def held(self) -> int:
        """Ticks that have come and are still held."""
        ...


@runtime_checkable
class Unnumbered(Protocol):
    """A stream without numbers, so that a loss too short for this machine's clock is not seen."""

    @property
    def unseen(self) -> float:
        """Seconds of loss that nothing would show."""
        ...


@runtime_checkable
class Noticing(Protocol):
    """An instrument whose driver tells what was odd on the wire."""

    @property
    def noticed(self) -> Sequence[str]:
        """What was odd since the last start, each in a clause."""
        ...


@runtime_checkable
class Sourcing(Protocol):
    """An instrument that plays by itself what is set on its panel, at a level that is set from here."""

    def set_source(self, level: float) -> None:
        """Set the level (V, peak) and switch the source on; closing the instrument switches it off.

        Raises
        ------
        SettingError
            Where it cannot have that level, or does not answer with it.
        """
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
