"""The recording format, version 1: reader, writer, validator. All values SI; see docs/recording.md."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, get_args

import h5py
import numpy as np

from analysis.measured import Campaign, Channel, Gap, Quantity, Run
from rig.errors import OutputError, RecordingError
from rig.output import replaced

FORMAT, VERSION = "rig-recording", 1
UNITS = frozenset({"m/s^2", "m/s", "m", "N", "V", "A", "1"})
NOT_CHANNELS = frozenset({"gain", "gaps", "spectra", "timing"})


@contextmanager
def open_recording(path: str | Path) -> Iterator[Campaign]:
    """The campaign in a file, its channels read from disk as they are asked for.

    Raises
    ------
    RecordingError
        In one sentence, naming the run, the channel, the value found and what to do.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f"{path} does not exist; give the path of a recording")
    if path.is_dir():
        raise RecordingError(f"{path} is a folder, not a recording; give the path of a file")
    try:
        file = h5py.File(path, "r")
    except PermissionError:
        raise RecordingError(f"{path} may not be read by this user; change its permissions") from None
    except OSError as error:
        raise RecordingError(_not_hdf5(path, error)) from None
    with file:
        try:
            yield _campaign(file, path)
        except (OSError, RuntimeError) as error:
            raise RecordingError(f"{path} is damaged ({str(error).splitlines()[0]}); copy it again from its source") from None


def _not_hdf5(path: Path, error: OSError) -> str:
    if path.stat().st_size == 0:
        return f"{path} is empty; record or copy it again"
    if "truncated" in str(error):
        return f"{path} is cut short ({path.stat().st_size} bytes); copy it again from its source"
    return f"{path} is not an HDF5 file; give a recording, or import the file first"


def read(path: str | Path) -> Campaign:
    """The campaign in a file, loaded into memory and checked sample by sample."""
    with open_recording(path) as campaign:
        runs = tuple(_loaded(run, str(path)) for run in campaign.runs)
        return Campaign(runs=runs, known=campaign.known, description=campaign.description, source=campaign.source)


def _loaded(run: Run, source: str) -> Run:
    channels = {}
    for name, channel in run.channels.items():
        raw = np.asarray(channel.samples[:])
        if raw.dtype.kind == "f" and not np.isfinite(raw).all():
            at = int(np.flatnonzero(~np.isfinite(raw))[0])
            raise RecordingError(
                f"{source}: run {run.id!r}, channel {name!r} holds {raw[at]} at sample {at}; "
                "recordings hold finite numbers only, so cut the run or measure it again"
            )
        channels[name] = Channel(
            name=name, samples=raw, quantity=channel.quantity, unit=channel.unit, scale=channel.scale,
            offset=channel.offset, full_scale=channel.full_scale,
        )  # fmt: skip
    return Run(
        id=run.id, configuration=run.configuration, sample_rate=run.sample_rate, gain=run.gain, channels=channels,
        excitation=run.excitation, started=run.started, band=run.band, period=run.period, use=run.use, gaps=run.gaps,
    )  # fmt: skip


def _campaign(file: h5py.File, path: Path) -> Campaign:
    where = str(path)
    found = _text(file.attrs.get("format"), f"{where}: the attribute format")
    if found != FORMAT:
        raise RecordingError(f"{where} has format {found!r}, not {FORMAT!r}; give a recording, or import the file first")
    version = file.attrs.get("format_version")
    if not isinstance(version, int | np.integer) or int(version) != VERSION:
        raise RecordingError(f"{where} has format_version {version!r}, but this program reads {VERSION}; convert the file")
    if not isinstance(file.get("runs"), h5py.Group) or not len(file["runs"]):
        raise RecordingError(f"{where} holds no runs; record or import at least one")
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
            description = _text(value, f"{where}: rig attribute 'description'")
        elif isinstance(value, int | float | np.number):
            if not math.isfinite(float(value)) or (key.endswith("_mass") and float(value) <= 0.0):
                raise RecordingError(f"{where}: rig attribute {key!r} is {value}; give a finite value, a mass above zero")
            known[key] = float(value)
    return known, description


def _run(group: Any, name: str, where: str) -> Run:
    here = f"{where}: run {name!r}"
    if not isinstance(group, h5py.Group):
        raise RecordingError(f"{here} is not a group; a run is a group with channels")
    attrs = group.attrs
    for key in ("configuration", "sample_rate", "gain"):
        if key not in attrs:
            raise RecordingError(f"{here} lacks the attribute {key!r}; every run needs it, so add it")
    rate = _number(attrs["sample_rate"], f"{here}: sample_rate")
    if rate <= 0.0:
        raise RecordingError(f"{here} has sample_rate {rate:g} Hz; it must be positive and finite, so correct it")
    channels = {
        key: _channel(item, key, here)
        for key, item in group.items()
        if key not in NOT_CHANNELS and isinstance(item, h5py.Dataset)
    }
    if not channels:
        raise RecordingError(f"{here} has no channel; a run needs at least one")
    lengths = {key: len(channel) for key, channel in channels.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{key} {n}" for key, n in lengths.items())
        raise RecordingError(f"{here} has channels of unequal length ({told}); cut them to one length")
    if min(lengths.values()) == 0:
        raise RecordingError(f"{here} has no samples; measure it again or remove it")
    use = _text(attrs.get("use", "fit"), f"{here}: use")
    if use not in ("fit", "holdout"):
        raise RecordingError(f'{here} has use {use!r}; it is "fit" or "holdout", so correct it')
    return Run(
        id=name, configuration=_text(attrs["configuration"], f"{here}: configuration"), sample_rate=rate,
        gain=_number(attrs["gain"], f"{here}: gain"), channels=channels,
        excitation=_text(attrs.get("excitation", "other"), f"{here}: excitation"), started=_started(attrs, here),
        band=_band(attrs, here), period=_period(attrs, here), use="holdout" if use == "holdout" else "fit",
        gaps=_gaps(group, here),
    )  # fmt: skip


def _channel(dataset: h5py.Dataset, name: str, where: str) -> Channel:
    here = f"{where}, channel {name!r}"
    if dataset.ndim != 1:
        raise RecordingError(f"{here} has {dataset.ndim} dimensions; a channel has one, so store it flat")
    if dataset.dtype.kind not in "iuf":
        raise RecordingError(f"{here} holds {dataset.dtype} values; a channel holds numbers, so convert it")
    quantity = _text(dataset.attrs.get("quantity", "acceleration"), f"{here}: quantity")
    if quantity not in get_args(Quantity):
        raise RecordingError(f"{here} has quantity {quantity!r}; allowed are {', '.join(get_args(Quantity))}, so correct it")
    unit = _text(dataset.attrs.get("unit", "m/s^2"), f"{here}: unit")
    if unit not in UNITS:
        raise RecordingError(f"{here} has unit {unit!r}; allowed are {', '.join(sorted(UNITS))}, so convert it to SI")
    scale = _number(dataset.attrs.get("scale", 1.0), f"{here}: scale")
    if scale == 0.0:
        raise RecordingError(f"{here} has scale 0, which makes every value the same; give the sensor's scale")
    full = dataset.attrs.get("range")
    return Channel(
        name=name, samples=dataset, quantity=quantity, unit=unit, scale=scale,  # type: ignore[arg-type]
        offset=_number(dataset.attrs.get("offset", 0.0), f"{here}: offset"),
        full_scale=None if full is None else _number(full, f"{here}: range"),
    )  # fmt: skip


def _number(value: Any, what: str) -> float:
    if isinstance(value, bool | str | bytes) or np.ndim(value) != 0 or not isinstance(value, int | float | np.number):
        raise RecordingError(f"{what} is {value!r}, not a number; correct it")
    number = float(value)
    if not math.isfinite(number):
        raise RecordingError(f"{what} is {number}; it must be finite, so correct it")
    return number


def _text(value: Any, what: str) -> str:
    if isinstance(value, bytes):
        try:
            value = value.decode()
        except UnicodeDecodeError:
            raise RecordingError(f"{what} is not UTF-8 text; write it anew") from None
    if not isinstance(value, str):
        raise RecordingError(f"{what} is {'missing' if value is None else repr(value)}, not text; write it anew")
    return value


def _started(attrs: Any, where: str) -> datetime | None:
    if "started" not in attrs:
        return None
    text = _text(attrs["started"], f"{where}: started")
    try:
        started = datetime.fromisoformat(text)
    except ValueError:
        raise RecordingError(f"{where} has started {text!r}; it is ISO 8601 with an offset, so correct it") from None
    if started.tzinfo is None:
        raise RecordingError(f"{where} has started {text!r} without an offset from UTC; add one, e.g. +00:00")
    return started


def _band(attrs: Any, where: str) -> tuple[float, float] | None:
    if "band" not in attrs:
        return None
    values = np.asarray(attrs["band"])
    if values.shape != (2,) or values.dtype.kind not in "iuf" or not (0.0 <= values[0] < values[1] < math.inf):
        raise RecordingError(f"{where} has band {attrs['band']!r}; it is [low, high] in Hz with low < high, so correct it")
    return float(values[0]), float(values[1])


def _period(attrs: Any, where: str) -> int | None:
    if "period" not in attrs:
        return None
    period = _number(attrs["period"], f"{where}: period")
    if period < 2 or period != round(period):
        raise RecordingError(f"{where} has period {period:g}; it is a whole number of samples above 1, so correct it")
    return int(period)


def _gaps(group: h5py.Group, where: str) -> tuple[Gap, ...]:
    if "gaps" not in group:
        return ()
    table = group["gaps"]
    if not isinstance(table, h5py.Dataset) or table.dtype.names is None or {"first_tick", "count"} - set(table.dtype.names):
        raise RecordingError(f"{where} has gaps without the columns first_tick and count; write the table anew")
    return tuple(Gap(first_tick=int(row["first_tick"]), count=int(row["count"])) for row in table[:])


def write(path: str | Path, campaign: Campaign) -> None:
    """Write a campaign as a recording, whole or not at all.

    Raises
    ------
    OutputError
        Where the place cannot be written.
    """
    with replaced(path) as temporary:
        try:
            with h5py.File(temporary, "w") as file:
                _write(file, campaign)
        except OSError as error:
            raise OutputError(f"{path} could not be written ({error}); choose another place") from None


def _write(file: h5py.File, campaign: Campaign) -> None:
    file.attrs["format"], file.attrs["format_version"] = FORMAT, VERSION
    known = file.create_group("rig")
    known.attrs.update(campaign.known)
    if campaign.description is not None:
        known.attrs["description"] = campaign.description
    for run in campaign.runs:
        group = file.create_group(f"runs/{run.id}")
        group.attrs.update(
            configuration=run.configuration, sample_rate=run.sample_rate, gain=run.gain,
            excitation=run.excitation, use=run.use,
        )  # fmt: skip
        if run.started is not None:
            group.attrs["started"] = run.started.isoformat()
        if run.band is not None:
            group.attrs["band"] = run.band
        if run.period is not None:
            group.attrs["period"] = run.period
        for channel in run.channels.values():
            dataset = group.create_dataset(channel.name, data=np.asarray(channel.samples[:]), fletcher32=True, chunks=True)
            dataset.attrs.update(quantity=channel.quantity, unit=channel.unit, scale=channel.scale, offset=channel.offset)
            if channel.full_scale is not None:
                dataset.attrs["range"] = channel.full_scale
        if run.gaps:
            table = np.array([(g.first_tick, g.count) for g in run.gaps], dtype=[("first_tick", "i8"), ("count", "i8")])
            group.create_dataset("gaps", data=table)
