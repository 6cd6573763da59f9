"""From foreign files and a mapping to a campaign."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from analysis.measured import Campaign, Channel, FloatArray, Run, Samples
from rig.errors import PlanError, RecordingError
from rig.exchange.mapping import ChannelMap, Mapping, RunMap, read_mapping
from rig.exchange.reading import read_foreign
from rig.exchange.table import Column, ForeignTable
from rig.exchange.units import unit
from rig.output import replaced
from rig.recording import write
from rig.rigfile import read_description

#: A time column may stray so many samples from an even grid.
JITTER = 0.1


def import_campaign(mapping_path: Path, output: Path, *, data: Path | None = None) -> Campaign:
    """Read the files that a mapping names and write them as one recording, whole or not at all.

    Parameters
    ----------
    mapping_path
        The mapping.
    output
        The recording to write.
    data
        The folder of the files; the mapping's own where None.

    Raises
    ------
    PlanError, RecordingError
        In one sentence: which file, run, channel or key, what was found, what to do.
    """
    mapping = read_mapping(mapping_path)
    folder = data if data is not None else mapping_path.parent
    tables: dict[str, ForeignTable] = {}
    runs = []
    for wanted in mapping.runs:
        if wanted.file not in tables:
            tables[wanted.file] = read_foreign(folder / wanted.file)
        runs.append(_run(wanted, mapping, tables[wanted.file]))
    description = None if mapping.description is None else read_description(mapping_path.parent / mapping.description)[1]
    campaign = Campaign(runs=tuple(runs), known=mapping.rig, description=description, source=str(output))
    with replaced(output) as temporary:
        write(temporary, campaign)
        _note_sensors(temporary, mapping)
    return campaign


def _run(wanted: RunMap, mapping: Mapping, table: ForeignTable) -> Run:
    here = f"{table.path}, run {wanted.id!r}"
    sources = {name: wanted.sources.get(name, channel.source) for name, channel in mapping.channels.items()}
    columns = {name: _column(table, source, f"{here}: channel {name!r}") for name, source in sources.items()}
    lengths = {name: len(column.values) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise RecordingError(f"{here} has columns of unequal length ({told}); map columns that were sampled together")
    total = next(iter(lengths.values()))
    first, last = wanted.samples or (0, total)
    if last > total:
        raise PlanError(f"{here} wants samples up to {last}, but its columns have {total}; correct samples")
    return Run(
        id=wanted.id, configuration=wanted.configuration, sample_rate=_rate(wanted, columns, table, here), gain=wanted.gain,
        channels={
            name: channel_of(name, mapping.channels[name], column, first, last, f"{here}: channels.{name}")
            for name, column in columns.items()
        },
        excitation=wanted.excitation, started=wanted.started, band=wanted.band, period=wanted.period, use=wanted.use,
        spectra=table.spectra,
    )  # fmt: skip


def _column(table: ForeignTable, name: str, here: str) -> Column:
    if name not in table.columns:
        raise PlanError(f"{here} comes from column {name!r}, which is not there; the file has {', '.join(table.columns)}")
    return table.columns[name]


def channel_of(name: str, wanted: ChannelMap, column: Column, first: int, last: int, here: str) -> Channel:
    """A channel in SI: the file's own values are kept as raw samples, and the mapping becomes scale and offset."""
    meant = unit(wanted.unit, here)
    values = column.values[first:last]
    # The format keeps numbers; a file's logical values are 0 and 1.
    samples: Samples = np.ascontiguousarray(values.astype(np.uint8) if values.dtype.kind == "b" else values)
    return Channel(
        name=name, samples=samples, quantity=wanted.quantity or meant.quantity, unit=meant.si,
        scale=meant.factor / wanted.sensitivity, offset=meant.factor * wanted.offset,
        full_scale=None if wanted.range is None else meant.factor * wanted.range,
    )  # fmt: skip


def _rate(wanted: RunMap, columns: dict[str, Column], table: ForeignTable, here: str) -> float:
    if wanted.sample_rate is not None:
        return wanted.sample_rate
    if wanted.time is not None:
        return even_rate(
            np.asarray(_column(table, wanted.time, here).values, dtype=np.float64), f"{here}: column {wanted.time!r}"
        )
    rates = {column.sample_rate for column in columns.values()}
    rate = rates.pop() if len(rates) == 1 else None
    if rate is None:
        raise PlanError(f"{here} says no common sample rate; give sample_rate in Hz, or time = the column that holds seconds")
    return rate


def even_rate(time: FloatArray, here: str) -> float:
    """The rate of an evenly spaced column of seconds, Hz."""
    span = float(time[-1] - time[0]) if len(time) > 1 else 0.0
    if not 0.0 < span < np.inf:
        raise RecordingError(f"{here} goes from {time[0]:g} to {time[-1]:g} s; it must ascend, so give sample_rate instead")
    rate = (len(time) - 1) / span
    stray = np.abs((time - time[0]) * rate - np.arange(len(time)))
    worst = int(np.argmax(stray))
    if not stray[worst] <= JITTER:
        raise RecordingError(
            f"{here} strays {stray[worst]:.2g} samples from an even grid at sample {worst}; "
            "split the run where samples are missing, or resample it evenly"
        )
    return rate


def _note_sensors(path: Path, mapping: Mapping) -> None:
    # The format lets a writer add attributes of its own.
    with h5py.File(path, "a") as file:
        for run in file["runs"].values():
            for name, channel in mapping.channels.items():
                for key in ("sensor", "place", "direction"):
                    if getattr(channel, key):
                        run[name].attrs[key] = getattr(channel, key)
