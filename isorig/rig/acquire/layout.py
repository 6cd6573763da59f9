"""Content of the blocks of a working file: the plan's runs and channels, start and end of runs, and samples."""

import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from isorig.drivers.block import Input
from isorig.rig.acquire.plan import Plan

FORMAT, VERSION = "rig-working", 1
#: For each block from the instrument: its first tick, its arrival time, its status.
TIMING = np.dtype([("tick", "<i8"), ("host_time", "<f8"), ("device_time", "<f8"), ("gain", "<f8"), ("status", "<i4")])
#: First tick, rows, and number of blocks from the instrument.
SAMPLES = struct.Struct("<QII")
#: Number of the logger; its rows follow, float64: arrival by the host's clock in s, and values.
LOG = struct.Struct("<Q")
Rate = Annotated[float, msgspec.Meta(gt=0.0)]


class BlockKind(IntEnum):
    """Kinds of blocks."""

    LAYOUT = 1
    BEGIN = 2
    SAMPLES = 3
    END = 4
    LOG = 5


class RunLayout(msgspec.Struct, frozen=True, kw_only=True):
    """A planned run; `planned` is its length in ticks."""

    id: str
    configuration: str
    gain: float
    excitation: str
    use: Literal["fit", "holdout"]
    planned: int
    band: tuple[float, float] | None = None
    repeat_of: str | None = None


class ChannelLayout(msgspec.Struct, frozen=True, kw_only=True):
    """A channel: its raw type, its conversion to physical values, and the description of its sensor."""

    input: int
    dtype: Literal["int16", "int32", "float32", "float64"]
    quantity: str
    unit: str
    scale: float
    offset: float
    full_scale: float | None = None
    description: dict[str, str] = {}

    @property
    def stored(self) -> np.dtype[Any]:
        """Data type of its samples in the file."""
        return np.dtype(self.dtype).newbyteorder("<")


class LogLayout(msgspec.Struct, frozen=True, kw_only=True):
    """A logger that runs along: its rate in Hz, and the unit of each channel."""

    sample_rate: float
    units: dict[str, str]


class Layout(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that a session will write, known before its first sample.

    `real_time` is False for a simulated instrument that may run faster: its rate is not compared with the host's clock.
    """

    sample_rate: Rate
    known: dict[str, float | str]
    runs: list[RunLayout]
    channels: Annotated[dict[str, ChannelLayout], msgspec.Meta(min_length=1)]
    usable_to: float | None = None
    real_time: bool = True
    logs: dict[str, LogLayout] = {}
    format: Literal["rig-working"] = "rig-working"
    version: Literal[1] = 1

    @property
    def row(self) -> int:
        """Bytes of one sample of all channels."""
        return sum(channel.stored.itemsize for channel in self.channels.values())


class RunBegin(msgspec.Struct, frozen=True, kw_only=True):
    """Start of a run, with a copy of the layout: one of the two suffices to read the file."""

    started_ns: Annotated[int, msgspec.Meta(ge=0, lt=1 << 62)]
    period: int | None
    sample_rate: Rate
    layout: Layout


class RunEnd(msgspec.Struct, frozen=True, kw_only=True):
    """End of a run: whether it was complete, and the ticks that the instrument counted."""

    whole: bool
    counted: int


def layout_of(plan: Plan, inputs: Sequence[Input], *, real_time: bool) -> Layout:
    """The layout of a plan's session with an instrument with these inputs."""
    rate = plan.instrument.sample_rate
    channels = {}
    for name, about in plan.channels.items():
        source = inputs[about.input]
        channels[name] = ChannelLayout(
            input=about.input, dtype=source.dtype, quantity=about.quantity, unit=about.unit,
            scale=source.per_count / about.sensitivity, offset=source.offset / about.sensitivity,
            full_scale=None if source.full_scale is None else abs(source.full_scale / about.sensitivity),
            description=about.description,
        )  # fmt: skip
    runs = [
        RunLayout(
            id=name, configuration=run.configuration, gain=run.gain, excitation=run.recorded_as, use=run.use,
            planned=run.ticks(rate), band=None if run.excitation == "moves" else run.band, repeat_of=run.repeat_of,
        )
        for run in plan.runs
        for name in run.ids()
    ]  # fmt: skip
    return Layout(
        sample_rate=rate, known=dict(plan.rig), runs=runs, channels=channels, usable_to=plan.instrument.usable_to,
        real_time=real_time,
        logs={
            name: LogLayout(
                sample_rate=logger.sample_rate, units={key: channel.unit for key, channel in logger.channels.items()}
            )
            for name, logger in plan.loggers.items()
        },
    )  # fmt: skip


def pack(layout: Layout, first_tick: int, timing: Sequence[tuple[float, ...]], samples: NDArray[Any]) -> bytes:
    """The content of a block of samples; `timing` as rows of `TIMING`, `samples` of all inputs, shape (n, inputs)."""
    parts = [SAMPLES.pack(first_tick, len(samples), len(timing)), np.array(timing, TIMING).tobytes()]
    parts += [samples[:, channel.input].astype(channel.stored).tobytes() for channel in layout.channels.values()]
    return b"".join(parts)


def samples_of(layout: Layout, content: bytes) -> tuple[int, int, NDArray[Any]] | None:
    """First tick, number of samples, and timing of a block of samples; None if they contradict the content's length."""
    if len(content) < SAMPLES.size:
        return None
    first, rows, blocks = SAMPLES.unpack_from(content)
    whole = SAMPLES.size + blocks * TIMING.itemsize + rows * layout.row == len(content)
    return (first, rows, np.frombuffer(content, TIMING, blocks, SAMPLES.size)) if whole and rows > 0 and first < 1 << 62 else None


def pack_log(number: int, rows: NDArray[np.float64]) -> bytes:
    """The content of a block of a logger's rows, shape (n, 1 + channels)."""
    return LOG.pack(number) + np.ascontiguousarray(rows, "<f8").tobytes()


def log_of(layout: Layout, content: bytes) -> tuple[str, NDArray[np.float64]] | None:
    """The logger and its rows; None if the content contradicts the layout."""
    if len(content) < LOG.size:
        return None
    (number,), names, stored = LOG.unpack_from(content), list(layout.logs), content[LOG.size :]
    width = 1 + len(layout.logs[names[number]].units) if number < len(names) else 0
    if not width or len(stored) % (8 * width):
        return None
    rows = np.frombuffer(stored, "<f8").reshape(-1, width)
    return (names[number], rows) if np.isfinite(rows).all() else None
