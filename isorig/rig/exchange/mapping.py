"""The mapping file: which column of which file is which channel, in which unit, from which sensor."""

import math
from datetime import datetime
from pathlib import Path
from typing import Literal

import msgspec

from isorig.analysis.campaign import Quantity
from isorig.analysis.wording import did_you_mean
from isorig.rig.errors import PlanError
from isorig.rig.exchange.clock import seconds_per
from isorig.rig.exchange.units import unit
from isorig.rig.files.recording import GAIN, RESERVED
from isorig.rig.files.tomlfile import read_toml


class MappingPart(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Any part of a mapping."""


class ChannelMap(MappingPart, frozen=True):
    """The source of a channel: physical value = column / sensitivity + offset, in `unit`, then converted to SI."""

    source: str  #: The column's name in the files.
    unit: str  #: Unit of the physical value: m/s^2, g, mm, N, V ...
    sensitivity: float = 1.0  #: Column's unit per unit of the channel, e.g. 0.2 V per m/s^2; 1 for physical values.
    offset: float = 0.0  #: Added after the sensitivity, in `unit`.
    #: The measured quantity, if the unit does not determine it (a position in volts, for example).
    quantity: Quantity | None = None
    range: float | None = None  #: Full scale, in `unit`; larger values are clipped.
    #: Information for readers of the recording.
    sensor: str = ""
    place: str = ""
    direction: str = ""


class RunMap(MappingPart, frozen=True):
    """A run: its file, configuration and gain, and the part of the file; what has no comment is as in the recording format."""

    id: str
    file: str  #: Name of the file relative to the mapping, or to the folder given to the command.
    gain: float
    configuration: str = ""  #: By default the only one of the rig.
    sample_rate: float | None = None  #: Hz; by default from the file or from its time column.
    time: str | None = None  #: Name of the time column.
    time_unit: str = ""  #: Unit of that column: s, ms, us, ns, min, h or d; by default from the file, otherwise seconds.
    channels: tuple[str, ...] = ()  #: The channels of this run; by default all.
    excitation: Literal["random", "multisine", "sweep", "moves", "free", "other"] = "other"
    started: datetime | None = None
    band: tuple[float, float] | None = None
    period: float | None = None
    use: Literal["fit", "holdout"] = "fit"
    repeat_of: str | None = None
    #: Which of several sample rates that contradict each other is right: `sample_rate` of the mapping, the time column, or the
    #: rate in the file's header; without it the run is refused.
    rate_from: Literal["mapping", "time", "file"] | None = None
    usable_to: float | None = None
    samples: tuple[int, int] | None = None  #: First and last + 1 sample of the part; by default the whole file.
    sources: dict[str, str] = {}  #: Other columns for channels of this run, by channel name.
    #: Other files for channels of this run, by channel name; their samples are simultaneous with those of `file`.
    files: dict[str, str] = {}


class Mapping(MappingPart, frozen=True):
    """A mapping. `rig` contains known values (SI); `description` is the file with another rig's description."""

    channels: dict[str, ChannelMap]
    runs: tuple[RunMap, ...]
    rig: dict[str, float] = {}
    description: str | None = None


def read_mapping(path: Path) -> Mapping:
    """Read and validate a mapping. Raises PlanError, a sentence with the key and what is allowed, if it is invalid."""
    mapping = read_toml(path, Mapping, "a mapping", hint=", or let rig import --draft propose one")
    _check(mapping, str(path))
    return mapping


def _check(mapping: Mapping, where: str) -> None:
    if not mapping.channels:
        raise PlanError(f"{where}: there are no channels; name at least one as [channels.<name>]")
    if not mapping.runs:
        raise PlanError(f"{where}: there are no runs; add at least one as [[runs]]")
    for name, channel in mapping.channels.items():
        _check_channel(name, channel, f"{where}: channels.{name}")
    ids = [run.id for run in mapping.runs]
    for run in mapping.runs:
        here = f"{where}: run {run.id!r}"
        if ids.count(run.id) > 1:
            raise PlanError(f"{here} occurs {ids.count(run.id)} times; give each run its own id")
        for said, name in [
            *((f"gives a source for {name!r}, which is not a channel", name) for name in sorted(run.sources)),
            *((f"gives a file for {name!r}, which is not a channel", name) for name in sorted(run.files)),
            *((f"has the channel {name!r}, which does not exist", name) for name in run.channels),
        ]:
            if name not in mapping.channels:
                meant = did_you_mean(name, mapping.channels)
                raise PlanError(f"{here} {said}{meant}; allowed are {', '.join(mapping.channels)}")
        earlier = ids[: ids.index(run.id)]
        if run.repeat_of is not None and run.repeat_of not in earlier:
            raise PlanError(
                f"{here} has repeat_of {run.repeat_of!r}{did_you_mean(run.repeat_of, earlier)}; give the id of a run before it "
                f"({', '.join(earlier) or 'there is none'})"
            )
        _check_run(run, here)


def _check_channel(name: str, channel: ChannelMap, here: str) -> None:
    if not name.isidentifier() or name in RESERVED:
        raise PlanError(f"{here} is not a valid name; use letters, digits and underscores, and none of {', '.join(RESERVED)}")
    if not math.isfinite(channel.sensitivity) or channel.sensitivity == 0.0:
        raise PlanError(f"{here}.sensitivity is {channel.sensitivity:g}; give a finite number other than zero")
    if not math.isfinite(channel.offset):
        raise PlanError(f"{here}.offset is {channel.offset:g}; give a finite number")
    if channel.range is not None and not 0.0 < channel.range < math.inf:
        raise PlanError(f"{here}.range is {channel.range:g}; a full scale is positive and finite")
    meant = unit(channel.unit, here)
    measured = channel.quantity or meant.quantity
    if name == GAIN and measured != GAIN:
        raise PlanError(f"{here} measures {measured}; this name is reserved for the streamed gain, in 1 or %, so choose another")


def _check_run(run: RunMap, here: str) -> None:
    if not run.gain > 0.0 and run.excitation != "free":
        raise PlanError(f"{here} has gain {run.gain:g}, but is driven; give the amplifier's setting, or 1 if it has none")
    if run.time_unit and seconds_per(run.time_unit) is None:
        raise PlanError(f"{here} has time_unit {run.time_unit!r}; give s, ms, us, ns, min, h or d")
    if run.samples is not None and not 0 <= run.samples[0] < run.samples[1]:
        raise PlanError(f"{here} has samples {list(run.samples)}; give [first, last + 1] with first < last, starting at 0")
    if run.started is not None and run.started.tzinfo is None:
        raise PlanError(f"{here} has started without an offset from UTC; add one, e.g. +00:00")
