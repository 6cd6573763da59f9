"""The recording format, version 1: reader, writer, validator. All values SI.

Required attributes are checked when a file is opened, samples when they are read. Unknown attributes, datasets and groups are
ignored.
"""

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

import h5py
import msgspec
import numpy as np
from msgspec.structs import asdict
from numpy.typing import NDArray

from isorig.analysis.campaign import SI_UNIT, Campaign, Channel, Gap, Measured, Quantity, Run, Samples, Spectrum, given_campaign
from isorig.analysis.given import all_of_type, given_mapping, given_path
from isorig.analysis.views import shows
from isorig.rig.errors import OutputError, RecordingError
from isorig.rig.files.hdf import opened
from isorig.rig.files.inputs import import_first
from isorig.rig.files.output import reason, replaced, reserve

FORMAT, VERSION = "rig-recording", 1
UNITS = frozenset(SI_UNIT.values())
#: Parts of a run that are not channels; "gain" is one, although no sensor recorded it.
RESERVED = ("gaps", "timing", "spectra")
GAIN = "gain"
#: Rows of a chunk, and of the blocks for reading and writing.
ROWS = 1 << 16
#: Written files can be read by HDF5 1.10 (2016) and newer.
LIBVER = ("v110", "v110")
#: The wire bonder's channels.
SENSORS = ("head", "motor", "table", "heatblock")
#: Maximum length of a gap in ticks: a day at 100 kHz is 2**33.
LOST_MOST = 1 << 40
#: Largest magnitude of a value in its SI unit: sums of squares of such values are finite.
VALUE_MOST = 1e100
#: Maximum sizes of a recording's parts.
RUNS_MOST, CHANNELS_MOST, SPECTRA_MOST = 2000, 256, 1000
#: Optional attributes of a channel that describe its sensor.
SENSOR = ("sensor", "place", "direction", "serial_number", "calibrated")
#: Allowed values of attributes, with their unit, as a message states them; all others are text.
ALLOWED = {
    "sample_rate": (" Hz", "positive and finite"), "gain": ("", "a number"), "use": ("", '"fit" or "holdout"'),
    "started": ("", "ISO 8601 with an offset from UTC, e.g. +00:00"), "band": ("", "[low, high] in Hz with low < high"),
    "period": ("", "a whole number of samples above 1"), "usable_to": (" Hz", "above zero and at most half the sample rate"),
    "quantity": ("", f"one of {', '.join(get_args(Quantity))}"), "unit": ("", f"one of {', '.join(sorted(UNITS))}, in SI"),
    "scale": ("", "a number other than zero"), "offset": ("", "a number"), "range": ("", "positive"),
    "averages": ("", "a number"),
}  # fmt: skip
Positive = Annotated[float, msgspec.Meta(gt=0.0)]
T = TypeVar("T", bound=msgspec.Struct)


class RunAttributes(msgspec.Struct, frozen=True, kw_only=True):
    """The attributes of a run."""

    configuration: str
    sample_rate: Positive
    gain: float
    excitation: str = "other"
    use: Literal["fit", "holdout"] = "fit"
    started: datetime | None = None
    band: tuple[float, float] | None = None
    period: Annotated[float, msgspec.Meta(ge=2, multiple_of=1)] | None = None
    repeat_of: str | None = None
    usable_to: Positive | None = None

    def __post_init__(self) -> None:
        if self.started is not None and self.started.tzinfo is None:
            raise ValueError("started")
        if self.band is not None and not 0.0 <= self.band[0] < self.band[1]:
            raise ValueError("band")
        if self.usable_to is not None and self.usable_to > self.sample_rate / 2.0:
            raise ValueError("usable_to")


class ChannelAttributes(msgspec.Struct, frozen=True, kw_only=True):
    """The attributes of a channel, without those of its sensor."""

    quantity: Quantity = "acceleration"
    unit: str = "m/s^2"
    scale: float = 1.0
    offset: float = 0.0
    full_scale: Positive | None = msgspec.field(default=None, name="range")

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise ValueError("unit")
        if self.scale == 0.0:
            raise ValueError("scale")


class SpectrumAttributes(msgspec.Struct, frozen=True, kw_only=True):
    """The attributes of a spectrum."""

    response: str
    kind: str = "transfer_function"
    reference: str = ""
    unit: str = "1"
    averages: float = 1.0
    window: str = ""


class Stored:
    """Raw samples on disk: read by slice, with a check of each slice; their values are raw * `scale` + `offset`."""

    def __init__(self, dataset: h5py.Dataset, where: str, *, scale: float = 1.0, offset: float = 0.0) -> None:
        self._dataset, self._where = dataset, where
        self._scale, self._offset = abs(scale), abs(offset)

    @property
    def shape(self) -> tuple[int, ...]:
        """(n,)."""
        return tuple(self._dataset.shape)

    def __getitem__(self, key: slice, /) -> NDArray[Any]:
        """The samples of a slice. Raises RecordingError if they cannot be read, are not finite, or their values are too large to
        compute with."""
        try:
            raw = np.asarray(self._dataset[key])
        except (OSError, RuntimeError, MemoryError) as error:
            raise RecordingError(f"{self._where} cannot be read ({reason(error)}); copy the file again from its source") from None
        if raw.dtype.kind == "f" and not np.isfinite(raw).all():
            at = int(np.flatnonzero(~np.isfinite(raw))[0])
            raise RecordingError(
                f"{self._where} holds {raw[at]} at sample {at + (key.start or 0)}; "
                "recordings contain finite numbers only, so cut the run or measure it again"
            )
        if raw.dtype.kind in "iuf" and raw.size:
            size = max(abs(float(raw.min())), abs(float(raw.max()))) * self._scale + self._offset
            if not size <= VALUE_MOST:
                raise RecordingError(
                    f"{self._where} holds values of up to {size:.3g} with scale {self._scale:g}; at most {VALUE_MOST:g} is "
                    "read, so correct its scale and offset"
                )
        return raw


@contextmanager
def open_recording(path: str | Path) -> Iterator[Campaign]:
    """The campaign in a file; its channels are read from disk on demand.

    Raises
    ------
    RecordingError
        In one sentence, naming the run, the channel, the value found and what to do.

    Examples
    --------
    >>> import isorig as iso
    >>> with iso.open_recording("campaign.h5") as campaign:
    ...     first = campaign.runs[0].channel("table").read(0, 100)
    >>> first.shape
    (100,)
    """
    path = given_path(path, "the recording")
    with opened(path) as file:
        try:
            campaign = _campaign(file, path)
        except RecordingError:
            raise
        except (OSError, RuntimeError, KeyError, TypeError, ValueError) as error:
            raise RecordingError(f"{path} is damaged ({reason(error)}); copy it again from its source") from None
        yield campaign


def read(path: str | Path) -> Campaign:
    """The campaign in a file, loaded into memory and checked sample by sample.

    Raises
    ------
    RecordingError
        As for `open_recording`.

    Examples
    --------
    >>> import isorig as iso
    >>> [(run.id, run.configuration, run.gain) for run in iso.read("campaign.h5").runs]
    [('u70', 'unlocked', 70.0), ('u7', 'unlocked', 7.0), ('l70', 'locked', 70.0), ('l7', 'locked', 7.0)]
    """
    with open_recording(path) as campaign:
        return replace(campaign, runs=tuple(_loaded(run) for run in campaign.runs))


# Functions that take a campaign take the path of its recording, too.
shows(str, "campaign")(read)
shows(Path, "campaign")(read)


def _loaded(run: Run) -> Run:
    channels = {name: replace(channel, samples=channel.samples[:]) for name, channel in run.channels.items()}
    return replace(run, channels=channels)


def _campaign(file: h5py.File, path: Path) -> Campaign:
    where = str(path)
    found = _plain(file.attrs.get("format"), f"{where}: the attribute format")
    if found != FORMAT:
        raise RecordingError(f"{where} has format {found!r}, not {FORMAT!r}; {import_first(path)}")
    version = file.attrs.get("format_version")
    if not isinstance(version, int | np.integer) or int(version) != VERSION:
        raise RecordingError(f"{where} has format_version {version!r}, but this program reads {VERSION}; convert the file")
    if not isinstance(file.get("runs"), h5py.Group) or not len(file["runs"]):
        raise RecordingError(f"{where} contains no runs; record or import at least one")
    if len(file["runs"]) > RUNS_MOST:
        raise RecordingError(f"{where} contains {len(file['runs'])} runs; at most {RUNS_MOST} are read, so split it")
    runs = [_run(group, name, where) for name, group in file["runs"].items()]
    if all(run.started is not None for run in runs):
        runs.sort(key=lambda run: run.started or datetime.max)
    known, description = _known(file, where)
    return Campaign(runs=tuple(runs), known=known, description=description, source=where)


def _known(file: h5py.File, where: str) -> tuple[Mapping[str, float], str | None]:
    if not isinstance(file.get("rig"), h5py.Group):
        return {}, None
    known: dict[str, float] = {}
    description = None
    for key, value in file["rig"].attrs.items():
        if key == "description":
            description = _plain(value, f"{where}: rig attribute 'description'", lines=True)
            if not isinstance(description, str):
                raise RecordingError(f"{where}: rig attribute 'description' is {description!r}, not text; write it again")
        elif isinstance(value, int | float | np.number):
            if not math.isfinite(float(value)) or (key.endswith("_mass") and float(value) <= 0.0):
                raise RecordingError(f"{where}: rig attribute {key!r} is {value}; give a finite value, a mass above zero")
            known[key] = float(value)
    return known, description


def _run(group: Any, name: str, where: str) -> Run:
    here = f"{where}: run {name!r}"
    if not isinstance(group, h5py.Group):
        raise RecordingError(f"{here} is not a group; a run is a group with channels")
    if len(group) > CHANNELS_MOST:
        raise RecordingError(f"{here} contains {len(group)} channels; at most {CHANNELS_MOST} are read, so split it")
    unprintable = next((key for key in (name, *group) if not key.isprintable()), None)
    if unprintable is not None:
        raise RecordingError(f"{where} contains {unprintable!r}, a name that cannot be displayed; rename it")
    about = _attributes(group, RunAttributes, here)
    channels = _channels(group, here)
    lengths = {key: len(channel) for key, channel in channels.items()}
    if len(set(lengths.values())) > 1:
        text = ", ".join(f"{key} {n}" for key, n in lengths.items())
        raise RecordingError(f"{here} has channels of unequal length ({text}); cut them to one length")
    if min(lengths.values()) == 0:
        raise RecordingError(f"{here} has no samples; measure it again or remove it")
    stated = asdict(about) | {"period": None if about.period is None else int(about.period)}
    gaps = _gaps(group, here, min(lengths.values()))
    return Run(id=name, channels=channels, gaps=gaps, spectra=_spectra(group, here), **stated)


def _channels(group: h5py.Group, here: str) -> dict[str, Channel]:
    items = dict(group.items())
    for key, item in items.items():
        if item is None:
            raise RecordingError(f"{here}: {key!r} links to data that are not in the file; copy it again with its data")
        if key in SENSORS and not isinstance(item, h5py.Dataset):
            raise RecordingError(f"{here}: {key!r} is a group; a channel is a dataset of numbers, so write it again")
    channels = {
        key: _channel(item, key, here) for key, item in items.items() if key not in RESERVED and isinstance(item, h5py.Dataset)
    }
    if not channels.keys() - {GAIN}:
        raise RecordingError(f"{here} has no channel; a run needs at least one")
    return channels


def _channel(dataset: h5py.Dataset, name: str, where: str) -> Channel:
    here = f"{where}, channel {name!r}"
    if dataset.ndim != 1:
        raise RecordingError(f"{here} has {dataset.ndim} dimensions; a channel has one, so store it flat")
    if dataset.dtype.kind not in "iuf":
        raise RecordingError(f"{here} contains {dataset.dtype} values; a channel contains numbers, so convert it")
    usual = {"quantity": "gain", "unit": "1"} if name == GAIN else {}
    about = _attributes(dataset, ChannelAttributes, here, usual)
    sensor = {key: str(_plain(dataset.attrs[key], f"{here}: {key}")) for key in SENSOR if key in dataset.attrs}
    samples = Stored(dataset, here, scale=about.scale, offset=about.offset)
    return Channel(name=name, samples=samples, about=sensor, **asdict(about))


def _attributes(item: Any, kind: type[T], here: str, usual: Mapping[str, str] | None = None) -> T:
    # The attributes of an object, checked by their types; `usual` are those that it need not have.
    held = item.attrs
    given = {key: _plain(held[key], f"{here}: {key}") for key in kind.__struct_encode_fields__ if key in held}
    if isinstance(started := given.get("started"), str):
        with suppress(ValueError):
            given["started"] = datetime.fromisoformat(started)
    try:
        return msgspec.convert({**(usual or {}), **given}, kind)
    except msgspec.ValidationError as error:
        # The type names the attribute as a path or field, a check that follows it as its whole text.
        found = re.search(r"\$\.(\w+)|field `(\w+)`|^(\w+)$", str(error))
        key = next(filter(None, found.groups())) if found else ""
        if key not in given:
            raise RecordingError(f"{here} lacks the attribute {key!r}, which is needed; add it") from None
        unit, allowed = ALLOWED.get(key, ("", "text"))
        value = f"{given[key]:g}" if isinstance(given[key], float) else str(given[key]) if key == "started" else repr(given[key])
        raise RecordingError(f"{here} has {key} {value}{unit}; it is {allowed}, so correct it") from None


def _plain(value: Any, what: str, *, lines: bool = False) -> Any:
    # An attribute as a plain value: text that can be displayed, and numbers that are finite.
    if isinstance(value, bytes):
        try:
            value = value.decode()
        except UnicodeDecodeError:
            raise RecordingError(f"{what} is not UTF-8 text; write it again") from None
    if isinstance(value, str) and not (lines or value.isprintable()):
        # It would reach the terminal as it is.
        raise RecordingError(f"{what} is {reason(ValueError(repr(value)))}, which cannot be displayed; write it again")
    if isinstance(value, np.ndarray | np.generic):
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            raise RecordingError(f"{what} is {value}; it must be finite, so correct it")
        return value.tolist()
    return value


def _gaps(group: h5py.Group, where: str, stored: int) -> tuple[Gap, ...]:
    if "gaps" not in group:
        return ()
    table = group["gaps"]
    if not isinstance(table, h5py.Dataset) or table.dtype.names is None or {"first_tick", "count"} - set(table.dtype.names):
        raise RecordingError(f"{where} has gaps without the columns first_tick and count; write the table again")
    if table.ndim != 1 or len(table) > stored + 1:
        raise RecordingError(f"{where} has {table.size} gaps but {stored} samples; a gap is between two samples, so correct it")
    rows = table[:]
    gaps = tuple(Gap(first_tick=int(row["first_tick"]), count=int(row["count"])) for row in rows)
    lost = end = 0
    for gap in sorted(gaps, key=lambda gap: gap.first_tick):
        if not end <= gap.first_tick <= stored + lost or not 0 < gap.count <= LOST_MOST:
            raise RecordingError(
                f"{where} has a gap of {gap.count} ticks from tick {gap.first_tick}: it is empty, inside another gap or beyond "
                f"the end at {stored + lost} ticks; correct the table"
            )
        lost, end = lost + gap.count, gap.first_tick + gap.count
    return gaps


def _spectra(group: h5py.Group, where: str) -> tuple[Spectrum, ...]:
    if not isinstance(group.get("spectra"), h5py.Group):
        return ()
    if len(group["spectra"]) > SPECTRA_MOST:
        raise RecordingError(f"{where} contains {len(group['spectra'])} spectra; at most {SPECTRA_MOST} are read, so split it")
    return tuple(_spectrum(item, name, f"{where}, spectrum {name!r}") for name, item in group["spectra"].items())


def _spectrum(group: Any, name: str, here: str) -> Spectrum:
    if not isinstance(group, h5py.Group) or not all(isinstance(group.get(k), h5py.Dataset) for k in ("frequency", "values")):
        raise RecordingError(f"{here} lacks the datasets frequency and values; a spectrum needs both, so write it again")
    frequency, values = np.asarray(group["frequency"][()]), np.asarray(group["values"][()])
    if frequency.dtype.kind not in "iuf" or values.dtype.kind not in "iufc":
        raise RecordingError(
            f"{here} contains {frequency.dtype} and {values.dtype} values; a spectrum contains numbers, so convert them"
        )
    if frequency.ndim != 1 or frequency.shape != values.shape:
        raise RecordingError(f"{here} has {values.shape} values at {frequency.shape} frequencies; make them equally long")
    if not (np.isfinite(frequency).all() and np.isfinite(values).all()):
        raise RecordingError(f"{here} contains values that are not finite; measure it again or remove it")
    if (np.diff(frequency) <= 0.0).any():
        raise RecordingError(f"{here} has frequencies that are not ascending; sort them")
    about = _attributes(group, SpectrumAttributes, here)
    values = values.astype(np.complex128 if values.dtype.kind == "c" else np.float64)
    stated = asdict(about) | {"averages": int(about.averages)}
    return Spectrum(name=name, frequency=frequency.astype(np.float64), values=values, **stated)


@dataclass(frozen=True, kw_only=True)
class Extra:
    """Data of a run in addition to the format: attributes of the run and of its channels, and tables with their attributes, by
    name.

    A table whose name has a slash is within a group.
    """

    attributes: Mapping[str, float | str] = field(default_factory=dict)
    channels: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    tables: Mapping[str, Samples] = field(default_factory=dict)
    about: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)


def write(path: str | Path, campaign: Measured, extras: Mapping[str, Extra] | None = None) -> None:
    """Write a campaign as a recording atomically, with additional data of its runs (by id).

    Samples are copied to the file block by block. Everything in the file has a checksum.

    Raises
    ------
    ArgumentError
        An argument is of another type.
    RecordingError
        The campaign contains something that a reader would reject.
    OutputError
        The file cannot be written.

    Examples
    --------
    >>> import isorig as iso
    >>> campaign = iso.read("campaign.h5")
    >>> iso.write("unlocked.h5", iso.Campaign(runs=campaign.select(configuration="unlocked"), known=campaign.known))
    >>> len(iso.read("unlocked.h5").runs)
    2
    """
    path, campaign = given_path(path, "the recording"), given_campaign(campaign)
    if extras is not None:
        by_id = "a mapping of the ids of runs to their additional data; leave it out"
        all_of_type(given_mapping(extras, "the argument extras", by_id).values(), Extra, "the argument extras", by_id)
    ids = [run.id for run in campaign.runs]
    for run in campaign.runs:
        if ids.count(run.id) > 1:
            raise RecordingError(f"{ids.count(run.id)} runs have the name {run.id!r}; give each its own")
        for what, name in (("run", run.id), *(("channel", name) for name in run.channels)):
            if not name or "/" in name or name in (".", ".."):
                raise RecordingError(f"a {what} has the name {name!r}; give it a name without a slash")
    with replaced(path) as temporary:
        try:
            # Format bounds: files of HDF5 1.10 (2016) have checksums on all metadata.
            with h5py.File(temporary, "w", libver=LIBVER):
                pass
            reserve(temporary, _room(campaign, extras or {}))
            with h5py.File(temporary, "r+", libver=LIBVER) as file:
                _write(file, campaign, extras or {})
        except OSError as error:
            raise OutputError(f"{path} could not be written ({reason(error)}); choose another place with -o") from None
        # Each chunk is read once; the library would keep up to 8 MiB for each dataset.
        with h5py.File(temporary, "r", rdcc_nbytes=0) as file:
            for run in _campaign(file, path).runs:
                for channel in run.channels.values():
                    for start in range(0, len(channel), ROWS):
                        channel.samples[start : start + ROWS]


def _room(campaign: Campaign, extras: Mapping[str, Extra]) -> int:
    # Whole chunks of samples, and metadata; unused space is released when the file is closed.
    stored: list[Samples] = [table for extra in extras.values() for table in extra.tables.values()]
    stored += [channel.samples for run in campaign.runs for channel in run.channels.values()]
    stored += [values for run in campaign.runs for s in run.spectra for values in (s.frequency, s.values)]
    size = sum(_rounded(samples.shape[0]) * np.asarray(samples[:1]).dtype.itemsize for samples in stored)
    size += sum(len(run.gaps) for run in campaign.runs) * 16
    return size + size // 64 + 4096 * len(stored) + (1 << 16)


def _rounded(rows: int) -> int:
    return rows if rows <= ROWS else -(-rows // ROWS) * ROWS


def _write(file: h5py.File, campaign: Campaign, extras: Mapping[str, Extra]) -> None:
    _set_attributes(file, {"format": FORMAT, "format_version": VERSION})
    _set_attributes(file.create_group("rig"), dict(campaign.known) | {"description": campaign.description})
    for run in campaign.runs:
        extra = extras.get(run.id, Extra())
        group = file.create_group(f"runs/{run.id}")
        _set_attributes(group, {**_stated(run, RunAttributes), **extra.attributes})
        for channel in run.channels.values():
            about = {**_stated(channel, ChannelAttributes), **channel.about, **extra.channels.get(channel.name, {})}
            # A constant gain is the same number repeated.
            _set_attributes(store(group, channel.name, channel.samples, compressed=channel.quantity == "gain"), about)
        if run.gaps:
            store(group, "gaps", np.array([(g.first_tick, g.count) for g in run.gaps], [("first_tick", "i8"), ("count", "i8")]))
        for name, table in extra.tables.items():
            _set_attributes(store(group, name, table), extra.about.get(name, {}))
        for spectrum in run.spectra:
            inside = group.create_group(f"spectra/{spectrum.name}")
            store(inside, "frequency", spectrum.frequency)
            store(inside, "values", spectrum.values)
            _set_attributes(inside, _stated(spectrum, SpectrumAttributes))


def _stated(item: object, kind: type[msgspec.Struct]) -> dict[str, Any]:
    return {key: getattr(item, name) for key, name in zip(kind.__struct_encode_fields__, kind.__struct_fields__, strict=True)}


def _set_attributes(item: Any, attributes: Mapping[str, Any]) -> None:
    # Text of fixed length: HDF5 stores text of variable length outside of the checksums.
    for key, given in attributes.items():
        value = given.isoformat() if isinstance(given, datetime) else given
        if isinstance(value, str):
            encoded = value.encode()
            item.attrs.create(key, encoded, dtype=h5py.string_dtype("utf-8", max(len(encoded), 1)))
        elif value is not None:
            item.attrs[key] = value


def store(group: h5py.Group, name: str, samples: Samples, *, compressed: bool = False) -> h5py.Dataset:
    """Write a dataset with checksums, block by block."""
    n, first = samples.shape[0], np.asarray(samples[:1])
    chunk = min(max(n, 1), ROWS)
    how = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if compressed else {}
    dataset = group.create_dataset(name, (n,), first.dtype, chunks=(chunk,), fletcher32=True, **how)
    for start in range(0, n, chunk):
        dataset[start : start + chunk] = samples[start : start + chunk]
    return dataset
