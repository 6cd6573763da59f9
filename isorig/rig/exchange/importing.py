"""Converts files of other programs to a campaign, according to a mapping."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from hashlib import blake2b
from pathlib import Path

import msgspec
import numpy as np

from isorig.analysis.campaign import SI_UNIT, Campaign, Channel, FloatArray, Gap, IntArray, Run, Samples, once
from isorig.analysis.fitting.linear_spectra import SHORTEST
from isorig.analysis.fitting.repeats import same_drive
from isorig.analysis.given import given_path
from isorig.analysis.model.rig_model import Drive, RigModel
from isorig.analysis.spectra.overload import extremes
from isorig.analysis.spectra.quality import clipped_or_dead, fault_sentences
from isorig.analysis.spectra.stated_drives import wrong_bands, wrong_excitations
from isorig.analysis.spectra.zero_errors import zero_errors
from isorig.analysis.units import KGF
from isorig.analysis.wording import did_you_mean
from isorig.rig.errors import PlanError, RecordingError
from isorig.rig.exchange.clock import (
    BREAK,
    LOST_MOST,
    RATE_AGREES,
    TIME_UNITS,
    column_rate,
    finer_unit,
    is_clock,
    is_time,
    run_numbers,
    sample_counter,
    says_time,
    seconds_per,
    time_unit,
)
from isorig.rig.exchange.mapping import ChannelMap, Mapping, RunMap, read_mapping
from isorig.rig.exchange.reading import read_foreign
from isorig.rig.exchange.table import Column, ForeignTable
from isorig.rig.exchange.units import UNITS, known_unit, unit
from isorig.rig.files.recording import write
from isorig.rig.files.rigfile import read_description, references_of, rig_of
from isorig.rig.frf.transfer import faults_in, levels_in_words
from isorig.rig.wire_bonder.description import wire_bonder

#: An acceleration in m/s^2 that no rig keeps up: more than gravity, which some sensors transmit, with some calibration error.
STEADY = 1.1 * KGF
#: What instruments return instead of infinity; a value that is no number is larger (SCPI 1999, volume 1, 7.2.1).
SCPI_INFINITY = 9.9e37
#: The same largest value in several samples, farther from all others than this multiple of their range, stands for lost samples.
PLACEHOLDER = 10.0
#: Fewest samples per second of a vibration; a clock in ms that is read as s gives fewer up to a true rate of 1000. Chosen.
SLOWEST = 1.0
#: Attributes of a sensor in a mapping.
SENSOR = ("sensor", "place", "direction")


def import_campaign(mapping_path: str | Path, output: str | Path, *, data: str | Path | None = None) -> Campaign:
    """Read the files named in a mapping and write them as one recording, atomically.

    If every run is `free` and no column is the description's drive, a drive of zero is recorded.

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
    ArgumentError
        An argument is of another type.
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
    mapping_path, output = given_path(mapping_path, "the mapping"), given_path(output, "the recording")
    mapping = read_mapping(mapping_path)
    folder = mapping_path.parent if data is None else given_path(data, "the folder of the files")
    model, description = wire_bonder(), None
    absent: tuple[Drive, ...] = ()
    if mapping.description is not None:
        model, description = read_description(mapping_path.parent / mapping.description)
        if all(run.excitation == "free" for run in mapping.runs):
            absent = tuple(drive for drive in model.drives if drive.channel not in mapping.channels)
        _has_channels(mapping, model, [drive.channel for drive in absent], str(mapping_path))
    if len(model.configurations) == 1:
        (only,) = model.configurations
        named = tuple(msgspec.structs.replace(run, configuration=run.configuration or only) for run in mapping.runs)
        mapping = msgspec.structs.replace(mapping, runs=named)
    for wanted in mapping.runs:
        if wanted.configuration not in model.configurations:
            has = f"has the configuration {wanted.configuration!r}" if wanted.configuration else "states no configuration"
            raise PlanError(
                f"{mapping_path}: run {wanted.id!r} {has}; {model.name} has "
                f"{', '.join(model.configurations)}, so correct it{did_you_mean(wanted.configuration, model.configurations)}"
                + ("" if mapping.description else ", or give the rig's own description with description = FILE.toml")
            )
    # A file with several runs is read once.
    table_in = cache(read_foreign)
    runs = tuple(_with_zero(_run(wanted, mapping, lambda name: table_in(folder / name)), absent) for wanted in mapping.runs)
    campaign = Campaign(runs=runs, known=mapping.rig, description=description, source=str(output))
    campaign = repeats(campaign, model.drive_channels)
    write(output, campaign)
    return campaign


def _has_channels(mapping: Mapping, model: RigModel, zero: Sequence[str], here: str) -> None:
    absent = next((name for name in model.channels if name not in mapping.channels and name not in zero), None)
    if absent is not None:
        own = ", ".join(mapping.channels)
        driving = absent in model.drive_channels
        last = 'write excitation = "free" in every run if nothing drove the rig' if driving else "remove it from the description"
        raise PlanError(
            f"{here} has no channel {absent!r}{did_you_mean(absent, mapping.channels)}, which the description "
            f"{mapping.description} names; the mapping has {own}, so rename one of them, add the channel, or {last}"
        )


def _with_zero(run: Run, drives: Sequence[Drive]) -> Run:
    # The run with a record of zero for each of these drives.
    zero = {
        drive.channel: Channel(
            name=drive.channel, samples=np.zeros(len(run), np.uint8), quantity=drive.quantity, unit=SI_UNIT[drive.quantity]
        )
        for drive in drives
    }
    return replace(run, channels={**run.channels, **zero})


def _run(wanted: RunMap, mapping: Mapping, table_in: Callable[[str], ForeignTable]) -> Run:
    table = table_in(wanted.file)
    here = f"{table.path}, run {wanted.id!r}"
    sources = {
        name: wanted.sources.get(name, channel.source) for name, channel in mapping.channels.items()
        if not wanted.channels or name in wanted.channels
    }  # fmt: skip
    tables = {name: table_in(wanted.files[name]) if name in wanted.files else table for name in sources}
    for name, source in sources.items():
        other = next(one for one, column in sources.items() if column == source and tables[one] is tables[name])
        if other != name:
            raise PlanError(
                f"{here} gives column {source!r} to the channels {other!r} and {name!r}, but a column is the record of one "
                "channel; correct the source of one of them, or remove it"
            )
    columns = {name: _column(tables[name], source, f"{here}: channel {name!r}") for name, source in sources.items()}
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
    # A run begins with the first row in which every channel has a value.
    first += int(np.argmin(np.append(lost == first + np.arange(len(lost)), False)))
    lost = lost[lost >= first]
    kept = np.setdiff1d(np.arange(first, last), lost, assume_unique=True) if len(lost) else slice(first, last)
    rate = _common_rate(wanted, columns, tables, (first, last), here)
    if wanted.band is not None and wanted.band[0] >= rate / 2.0:
        # The coarsest unit of time in which the band is recorded.
        finer = next((u for u in ("ms", "us", "ns") if rate / TIME_UNITS[u] > 2.0 * wanted.band[1]), "")
        written = f" (if the times are in {finer}, write time_unit = {finer!r})" if finer and wanted.time else ""
        raise PlanError(
            f"{here} has a band from {wanted.band[0]:g} Hz, but {rate:g} samples per second contain at most {rate / 2.0:g} Hz; "
            f"correct the sample rate, time_unit or band{written}"
        )
    if rate < SLOWEST and wanted.time and not wanted.time_unit:
        raise PlanError(
            f"{here} has {rate:g} samples per second by its time column {wanted.time!r} in s; if the times are in ms, write "
            "time_unit = 'ms', otherwise time_unit = 's'"
        )
    return Run(
        id=wanted.id, configuration=wanted.configuration, sample_rate=rate, gain=wanted.gain,
        channels={
            name: channel_of(name, mapping.channels[name], column, kept, f"{here}: channels.{name}")
            for name, column in columns.items()
        },
        excitation=wanted.excitation, started=wanted.started, band=wanted.band, period=_period(wanted, rate, here),
        use=wanted.use, repeat_of=wanted.repeat_of, usable_to=wanted.usable_to, gaps=_gaps(lost - first), spectra=table.spectra,
    )  # fmt: skip


def _period(wanted: RunMap, rate: float, here: str) -> int | None:
    # All frequencies of a periodic drive are multiples of the inverse of its period.
    period = wanted.period
    if period is None:
        return None
    if not (period >= 2.0 and period.is_integer()):
        what = "which is not a whole number of samples, 2 or more"
    elif wanted.band is not None and rate / period > wanted.band[1]:
        what = f"samples that repeat {rate / period:g} times per second, above the band up to {wanted.band[1]:g} Hz"
    else:
        return int(period)
    samples = round(period * rate) if 0.0 < period < np.inf else 0
    seconds = f": if it is {period:g} s, write period = {samples}" if samples >= 2 else ""
    raise PlanError(f"{here} has period = {period:g}, {what}; give the period of the drive in samples{seconds}")


def _gaps(lost: IntArray) -> tuple[Gap, ...]:
    # Successive lost samples are one gap.
    rows = np.split(lost, np.flatnonzero(np.diff(lost) > 1) + 1)
    return tuple(Gap(first_tick=int(row[0]), count=len(row)) for row in rows if len(row))


def _column(table: ForeignTable, name: str, here: str) -> Column:
    if name not in table.columns:
        why = next((f" ({remark})" for remark in table.remarks if repr(name) in remark), "")
        raise PlanError(
            f"{here} refers to column {name!r}, which is absent{why or did_you_mean(name, table.columns)}; the file has "
            f"{', '.join(table.columns) or 'no records'}"
        )
    return table.columns[name]


def channel_of(name: str, wanted: ChannelMap, column: Column, kept: IntArray | slice, here: str) -> Channel:
    """A channel in SI: the file's values are kept as raw samples, and the mapping becomes scale and offset. Raises PlanError if
    the file gives another unit of the same quantity than the mapping; RecordingError if a value is not finite."""
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
    # Instruments write this number for infinity (SCPI).
    if values.dtype.kind == "f" and not (good := np.abs(values) < SCPI_INFINITY).all():
        at = int(np.flatnonzero(~good)[0])
        row = int(np.arange(len(column.values))[kept][at])
        raise RecordingError(
            f"{here}: column {wanted.source!r} contains {values[at]} at sample {row}; recordings have finite values only, so cut "
            "the run with samples = [first, last + 1] or correct the file"
        )
    # The format stores numbers; logical values become 0 and 1.
    samples: Samples = np.ascontiguousarray(values.astype(np.uint8) if values.dtype.kind == "b" else values)
    return Channel(
        name=name, samples=samples, quantity=wanted.quantity or meant.quantity, unit=SI_UNIT[meant.quantity],
        scale=meant.factor / wanted.sensitivity, offset=meant.factor * wanted.offset,
        full_scale=None if wanted.range is None else meant.factor * wanted.range,
        about={key: value for key in SENSOR if (value := getattr(wanted, key))},
    )  # fmt: skip


@dataclass(frozen=True)
class _Rate:
    # A sample rate, its source (a value of `rate_from`), words for it, and its time column if the mapping does not name it.
    hertz: float
    source: str
    words: str
    unused: str = ""


def _common_rate(
    wanted: RunMap, columns: dict[str, Column], tables: dict[str, ForeignTable], part: tuple[int, int], here: str
) -> float:
    # The sample rate of a run, which each of its files has. Their clocks begin together.
    files: dict[Path, tuple[float, float | None]] = {}
    several = len({table.path for table in tables.values()}) > 1
    for table in {table.path: table for table in tables.values()}.values():
        own = {name: column for name, column in columns.items() if tables[name] is table}
        clock = table.columns.get(wanted.time or "")
        timed = msgspec.structs.replace(wanted, time=None) if several and clock is None else wanted
        rate = _rate(timed, own, table, part, f"{here}: {table.path.name}" if several else here)
        unit_of_time = "" if clock is None else wanted.time_unit or time_unit(wanted.time or "", clock)
        begin = None if clock is None else float(clock.values[part[0]]) * (seconds_per(unit_of_time) or 1.0)
        files[table.path] = rate, begin
    (first, (rate, begin)), *rest = files.items()
    for path, (other, later) in rest:
        if abs(other / rate - 1.0) > RATE_AGREES:
            raise PlanError(
                f"{here}: {first.name} has {rate:.6g} Hz, but {path.name} has {other:.6g} Hz; import them as two runs, or "
                "correct the wrong rate"
            )
        if begin is not None and later is not None and abs(later - begin) * rate > BREAK:
            raise PlanError(
                f"{here}: {first.name} begins at {begin:.6g} s, but {path.name} at {later:.6g} s; cut them to the same time, or "
                "import them as two runs"
            )
    return rate


def _rate(wanted: RunMap, columns: dict[str, Column], table: ForeignTable, part: tuple[int, int], here: str) -> float:
    found = _rates(wanted, columns, table, part, here)
    if wanted.rate_from is None and all(rate.unused for rate in found):
        hint = f" = {found[0].unused!r}" if found else " = the time column"
        raise PlanError(f"{here} has no common sample rate; give sample_rate in Hz, or time{hint}")
    chosen = [rate for rate in found if wanted.rate_from in (None, rate.source)]
    if not chosen:
        have = ", ".join(dict.fromkeys(rate.source for rate in found)) or "none"
        raise PlanError(f"{here} has rate_from {wanted.rate_from!r}, but no such sample rate; there are: {have}")
    other = next((rate for rate in chosen if abs(rate.hertz / chosen[0].hertz - 1.0) > RATE_AGREES), None)
    if other is not None:
        rates = {rate.source: rate.hertz for rate in (chosen[0], other)}
        finer = finer_unit(rates.pop("time"), *rates.values()) if "time" in rates else ""
        if finer:
            raise PlanError(
                f"{here} has {chosen[0].words}, but {other.words}: its times look like {finer}, so write time_unit = {finer!r}"
            )
        raise PlanError(
            f"{here} has {chosen[0].words}, but {other.words}; correct the wrong one, or state which is right with rate_from = "
            f"{chosen[0].source!r} or {other.source!r}"
        )
    return chosen[0].hertz


def _rates(wanted: RunMap, columns: dict[str, Column], table: ForeignTable, part: tuple[int, int], here: str) -> list[_Rate]:
    # All sample rates that the mapping, time columns of the same length in this part and the file's header give.
    found = []
    if wanted.time is not None:
        column = _column(table, wanted.time, here)
        length = len(next(iter(columns.values())).values)
        if len(column.values) != length:
            raise PlanError(
                f"{here}: column {wanted.time!r} has {len(column.values)} values but the channels have {length}; give "
                "sample_rate, or the time column of these channels"
            )
        hertz = column_rate(wanted.time, _cut(column, part), f"{here}: column {wanted.time!r}", wanted.time_unit, part[0])
        found.append(_Rate(hertz, "time", f"{hertz:.6g} Hz by its time column {wanted.time!r}"))
    if wanted.sample_rate is not None:
        found.insert(0, _Rate(wanted.sample_rate, "mapping", f"sample_rate = {wanted.sample_rate:.6g} Hz in the mapping"))
    rates = {column.sample_rate for column in columns.values() if column.sample_rate is not None}
    if len(rates) == 1 and all(column.sample_rate is not None for column in columns.values()):
        hertz = rates.pop()
        found.append(_Rate(hertz, "file", f"{hertz:.6g} Hz by the file itself"))
    for name, column in _unused(columns, table).items():
        found += _unnamed_rate(wanted, name, _cut(column, part), part[0], here)
    return found


def _cut(column: Column, part: tuple[int, int]) -> Column:
    return replace(column, values=column.values[slice(*part)])


def _unused(columns: dict[str, Column], table: ForeignTable) -> dict[str, Column]:
    # The columns next to the channels that are none of them.
    sources = [channel for channel in table.columns if any(table.columns[channel] is used for used in columns.values())]
    length = len(next(iter(columns.values())).values)
    found = {}
    for name, column in table.columns.items():
        around = re.split(r"[./][^./]*$", name)[0] if re.search(r"[./]", name) else ""
        near = any(source.startswith(around) for source in sources)
        if name not in sources and near and len(column.values) == length:
            found[name] = column
    return found


def _unnamed_rate(wanted: RunMap, name: str, column: Column, first: int, here: str) -> list[_Rate]:
    # The rate of a clock that the mapping does not name. A counter or a clock that shows that samples are missing is refused,
    # unless the mapping states which rate is right.
    if wanted.rate_from is None and not says_time(name, column):
        words, faults = sample_counter(column, first) or ("", "")
        if faults:
            raise RecordingError(
                f"{here}: column {name!r} {words}, but {faults}; if it is no counter, state which sample rate is right with "
                "rate_from"
            )
    if wanted.rate_from is None and len(at := first + run_numbers(name.rpartition("/")[2], column)):
        raise RecordingError(
            f"{here}: column {name!r} numbers {len(at) + 1} runs; import each with its samples, the first [{first}, {at[0]}], or "
            "state which sample rate is right with rate_from if they are one"
        )
    if wanted.time is not None:
        return []
    if wanted.rate_from is None and is_clock(name, column, named=False):
        try:
            column_rate(name, column, f"{here}: column {name!r}", wanted.time_unit, first)
        except RecordingError as error:
            raise RecordingError(f"{error}; if it is no time column, give sample_rate and rate_from = 'mapping'") from None
    if not is_time(name, column):
        return []
    hertz = column_rate(name, column, name, wanted.time_unit)
    return [_Rate(hertz, "time", f"{hertz:.6g} Hz by the time column {name!r} of the file", name)]


def shortcomings(campaign: Campaign) -> list[str]:
    """What records show to be wrong, in sentences: short runs, copies, several levels at one gain, and faulty channels."""
    drive = references_of(campaign)[0]
    found = [*fault_sentences(faults_in(campaign, drive, clipped_or_dead)), *levels_in_words(campaign, drive)]
    means = zero_errors(campaign)
    for at, run in enumerate(campaign.runs):
        original = next((other.id for other in campaign.runs[:at] if _is_copy(other, run)), None)
        if original is not None:
            found.append(
                f"Run {run.id!r} has exactly the samples of run {original!r}: it is a copy and not a repeat, so correct its file "
                "or remove it."
            )
        recorded: dict[bytes, str] = {}
        for name, channel in run.sensors.items():
            low, high = extremes(channel)
            if low < high and (first := recorded.setdefault(_digest(channel), name)) != name:
                found.append(
                    f"Run {run.id!r} has exactly the same samples in the channels {first!r} and {name!r}, but the noise of two "
                    "sensors differs: correct the source of one of them, or the file."
                )
            least = max(low, -high)
            value, count = _placeholder(channel.read())
            if count > 1:
                found.append(
                    f"Run {run.id!r} has the value {value:.6g} {channel.unit} in {count} samples of channel {name!r}, far from "
                    "all others: if it stands for lost samples, leave their cells empty in the file."
                )
            if channel.quantity == "acceleration" and least > STEADY:
                means.pop(name, None)
                found.append(
                    f"Run {run.id!r} has never less than {least:.3g} {channel.unit} in channel {name!r}, more than gravity all "
                    "the time: check the unit, the sensitivity and the sensor's zero, or correct it by offset in the mapping."
                )
        begin = f"Run {run.id!r} has {len(run)} samples, {run.duration:.3g} s"
        if run.band is not None and run.duration * run.band[1] < 1.0:
            found.append(
                f"{begin}, less than one period of the highest frequency in its band, {run.band[1]:g} Hz: check the sample rate, "
                "time_unit and band."
            )
        elif len(run) < SHORTEST:
            found.append(f"{begin}, but fits need at least {SHORTEST}: record longer runs.")
    return [*found, *means.values(), *wrong_bands(campaign, drive), *wrong_excitations(campaign, drive)]


def other_quantities(campaign: Campaign) -> list[str]:
    """A sentence for each channel that is recorded as another quantity than that of the description."""
    model, run = rig_of(campaign), campaign.runs[0]
    return [
        f"Channel {name!r} is recorded in {run.channels[name].unit}, but the description has it as {quantity} "
        f"({SI_UNIT[quantity]}): correct the unit in the mapping, or the quantity in the description."
        for name, quantity in model.quantities.items()
        if name in run.channels and run.channels[name].quantity != quantity
    ]


def _placeholder(values: FloatArray) -> tuple[float, int]:
    # The largest value of a record, and in how many samples it has it if all others are far from it. Pulses have two values only.
    largest = float(values[np.argmax(np.abs(values))])
    others = values[values != largest]
    few = 0 < len(values) - len(others) <= LOST_MOST * len(values)
    far = few and np.abs(others - largest).min() > PLACEHOLDER * np.ptp(others) > 0.0
    return largest, len(values) - len(others) if far else 0


def _is_copy(one: Run, other: Run) -> bool:
    # Whether two runs have the same samples in every channel: noise differs between two measurements.
    if one.channels.keys() != other.channels.keys() or len(one) != len(other):
        return False
    return all(_digest(one.channels[name]) == _digest(other.channels[name]) for name in one.channels)


@once
def _digest(channel: Channel) -> bytes:
    # Of the values: records are read once, with however many they are compared.
    return blake2b(channel.read().tobytes()).digest()


def repeats(campaign: Campaign, references: Sequence[str]) -> Campaign:
    """The same campaign with `repeat_of` of every run that has the drive of an earlier one, to `SAME_DRIVE`, and is no copy.

    Runs that have a `repeat_of` keep it; `references` are the channels that drive.
    """
    runs: list[Run] = []
    for run in campaign.runs:
        first = next((other.id for other in runs if other.repeat_of is None and _same_drive(other, run, references)), None)
        runs.append(run if run.repeat_of is not None or first is None else replace(run, repeat_of=first))
    return replace(campaign, runs=tuple(runs))


def _same_drive(one: Run, other: Run, references: Sequence[str]) -> bool:
    if one.configuration != other.configuration or one.sample_rate != other.sample_rate or len(one) != len(other):
        return False
    if not all(name in run.channels for run in (one, other) for name in references):
        return False
    return (
        bool(references) and all(same_drive(one.read(name), other.read(name)) for name in references) and not _is_copy(one, other)
    )
