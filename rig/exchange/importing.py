"""Converts files of other programs to a campaign, according to a mapping."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from isorig.analysis.campaign import Campaign, Channel, Gap, IntArray, Run, Samples
from isorig.analysis.model.built_in import wire_bonder
from isorig.rig.errors import PlanError, RecordingError
from isorig.rig.exchange.clock import column_rate
from isorig.rig.exchange.mapping import ChannelMap, Mapping, RunMap, read_mapping
from isorig.rig.exchange.reading import read_foreign
from isorig.rig.exchange.table import Column, ForeignTable
from isorig.rig.exchange.units import UNITS, known_unit, unit
from isorig.rig.files.recording import Extra, write
from isorig.rig.files.rigfile import read_description

#: Attributes of a sensor in a mapping.
SENSOR = ("sensor", "place", "direction")


def import_campaign(mapping_path: Path, output: Path, *, data: Path | None = None) -> Campaign:
    """Read the files named in a mapping and write them as one recording, atomically.

    Parameters
    ----------
    mapping_path
        The mapping.
    output
        The recording to write.
    data
        The folder of the files; that of the mapping if None.

    Raises
    ------
    PlanError, RecordingError
        In one sentence: the file, run, channel or key, what was found, what to do.

    Examples
    --------
    >>> from pathlib import Path
    >>> import isorig as iso
    >>> lines = ["time,shaker,motor"] + [f"{k / 256},{k % 7},{k % 5}" for k in range(1024)]
    >>> _ = Path("bench.csv").write_text("\\n".join(lines))
    >>> _ = Path("mapping.toml").write_text('''
    ... [[runs]]
    ... id = "a"
    ... file = "bench.csv"
    ... configuration = "unlocked"
    ... gain = 1.0
    ... time = "time"
    ... [channels.head]
    ... source = "shaker"
    ... unit = "m/s^2"
    ... [channels.motor]
    ... source = "motor"
    ... unit = "g"
    ... ''')
    >>> run = iso.import_campaign(Path("mapping.toml"), Path("imported.h5")).runs[0]
    >>> run.sample_rate, float(run.read("motor").max())
    (256.0, 39.2266)
    """
    mapping = read_mapping(mapping_path)
    folder = data if data is not None else mapping_path.parent
    model, description = wire_bonder(), None
    if mapping.description is not None:
        model, description = read_description(mapping_path.parent / mapping.description)
    for wanted in mapping.runs:
        if wanted.configuration not in model.configurations:
            raise PlanError(
                f"{mapping_path}: run {wanted.id!r} has the configuration {wanted.configuration!r}; {model.name} has "
                f"{', '.join(model.configurations)}, so correct it"
                + ("" if mapping.description else ", or give the rig's own description with description = FILE.toml")
            )
    tables: dict[str, ForeignTable] = {}
    runs = []
    for wanted in mapping.runs:
        if wanted.file not in tables:
            tables[wanted.file] = read_foreign(folder / wanted.file)
        runs.append(_run(wanted, mapping, tables[wanted.file]))
    campaign = Campaign(runs=tuple(runs), known=mapping.rig, description=description, source=str(output))
    # The format allows additional attributes.
    attributes = {
        name: {key: value for key in SENSOR if (value := getattr(channel, key))} for name, channel in mapping.channels.items()
    }  # fmt: skip
    write(output, campaign, {run.id: Extra(channels=attributes) for run in runs})
    return campaign


def _run(wanted: RunMap, mapping: Mapping, table: ForeignTable) -> Run:
    here = f"{table.path}, run {wanted.id!r}"
    sources = {
        name: wanted.sources.get(name, channel.source) for name, channel in mapping.channels.items()
        if not wanted.channels or name in wanted.channels
    }  # fmt: skip
    columns = {name: _column(table, source, f"{here}: channel {name!r}") for name, source in sources.items()}
    lengths = {name: len(column.values) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        text = ", ".join(f"{name} {n}" for name, n in lengths.items())
        raise RecordingError(
            f"{here} has columns of unequal length ({text}); map columns with a common sampling, each group as a run with "
            "its own channels = [...]"
        )
    total = next(iter(lengths.values()))
    first, last = wanted.samples or (0, total)
    if last > total:
        raise PlanError(f"{here} requests samples up to {last}, but its columns have {total}; correct samples")
    lost = np.unique(np.concatenate([np.empty(0, np.int64), *(c.lost for c in columns.values() if c.lost is not None)]))
    lost = lost[(lost >= first) & (lost < last)]
    kept = np.setdiff1d(np.arange(first, last), lost, assume_unique=True) if len(lost) else slice(first, last)
    return Run(
        id=wanted.id, configuration=wanted.configuration, sample_rate=_rate(wanted, columns, table, here), gain=wanted.gain,
        channels={
            name: channel_of(name, mapping.channels[name], column, kept, f"{here}: channels.{name}")
            for name, column in columns.items()
        },
        excitation=wanted.excitation, started=wanted.started, band=wanted.band, period=wanted.period, use=wanted.use,
        gaps=_gaps(lost - first), spectra=table.spectra,
    )  # fmt: skip


def _gaps(lost: IntArray) -> tuple[Gap, ...]:
    # Successive lost samples are one gap.
    rows = np.split(lost, np.flatnonzero(np.diff(lost) > 1) + 1)
    return tuple(Gap(first_tick=int(row[0]), count=len(row)) for row in rows if len(row))


def _column(table: ForeignTable, name: str, here: str) -> Column:
    if name not in table.columns:
        why = next((f" ({remark})" for remark in table.remarks if repr(name) in remark), "")
        raise PlanError(
            f"{here} refers to column {name!r}, which is absent{why}; the file has {', '.join(table.columns) or 'no records'}"
        )
    return table.columns[name]


def channel_of(name: str, wanted: ChannelMap, column: Column, kept: IntArray | slice, here: str) -> Channel:
    """A channel in SI: the file's values are kept as raw samples, and the mapping becomes scale and offset.

    Raises
    ------
    PlanError
        The file gives another unit of the same quantity than the mapping.
    RecordingError
        A value is not finite.
    """
    meant = unit(wanted.unit, here)
    said = known_unit(column.unit)
    if said is not None and wanted.sensitivity == 1.0 and said != known_unit(wanted.unit):
        other = UNITS[said]
        if other.quantity == meant.quantity and other.factor != meant.factor:
            raise PlanError(
                f"{here} has unit {wanted.unit!r}, but the file gives {said!r}, {other.factor / meant.factor:.6g} times as much; "
                f"write unit = {said!r}, and if the file is wrong also sensitivity = {other.factor / meant.factor:.6g}"
            )
    values = column.values[kept]
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        at = int(np.flatnonzero(~np.isfinite(values))[0])
        row = int(np.arange(len(column.values))[kept][at])
        raise RecordingError(
            f"{here}: column {wanted.source!r} contains {values[at]} at sample {row}; recordings have finite values only, so cut "
            "the run with samples = [first, last + 1] or correct the file"
        )
    # The format stores numbers; logical values become 0 and 1.
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
        column = _column(table, wanted.time, here)
        if len(column.values) != len(next(iter(columns.values())).values):
            raise PlanError(
                f"{here}: column {wanted.time!r} has {len(column.values)} values but the channels have "
                f"{len(next(iter(columns.values())).values)}; give sample_rate, or the time column of these channels"
            )
        return column_rate(wanted.time, column, f"{here}: column {wanted.time!r}", wanted.time_unit)
    rates = {column.sample_rate for column in columns.values()}
    rate = rates.pop() if len(rates) == 1 else None
    if rate is None:
        raise PlanError(f"{here} has no common sample rate; give sample_rate in Hz, or time = the time column")
    return rate
