"""When samples were taken: clocks with their unit and sample rate, counters of the samples, and empty cells."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.rig.errors import PlanError, RecordingError
from isorig.rig.exchange.table import Column
from isorig.rig.files.recording import VALUE_MOST

if TYPE_CHECKING:
    import pandas as pd

#: Seconds per unit of time, as written by programs; lower case.
TIME_UNITS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "millisecond", "milliseconds", "millisekunden"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "micros", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes", "minuten"), 60.0),
    **dict.fromkeys(("h", "hour", "hours", "stunde", "stunden"), 3600.0),
    **dict.fromkeys(("d", "day", "days", "tage"), 86400.0),
}
_WORD = (
    r"t|time|zeit|temps|tiempo|tempo|secs?|seconds?|sek|x_?value|x[ _-]axis|time_?stamp|zeitstempel|elapsed(?:[ _]?time)?|clock"
)
_NAME = re.compile(
    rf"(?:.*[./])?(?:(?:{_WORD})(?:[ _]*(?:in[ _]+)?(?P<unit>s|sec|seconds|ms|us|µs|ns|min|h))?"
    r"|(?P<alone>(?:milli|micro)s(?:econds)?))(?:[ _]*\d+)?(?:\[\d+\]|\s+-\s.*)?",
    re.IGNORECASE,
)
#: A time of day, with or without its date, its hours and its time zone.
CLOCK = re.compile(
    r"(?:(?P<date>\d{4}[-/.]\d\d?[-/.]\d\d?|\d\d?[./-]\d\d?[./-]\d{2,4}|\d\d?[- ][a-z]{3}[- ]\d{2,4}),?[ T])?"
    r"(?:(?P<h>\d\d?):(?P<m>\d\d)(?::(?P<s>\d\d(?:[.,:]\d+)?))?|(?P<m2>\d\d?):(?P<s2>\d\d[.,]\d+))"
    r"(?: ?(?P<half>[AP]M)|Z| ?UTC| ?GMT| ?[+-]\d\d:?\d\d)?",
    re.IGNORECASE,
)
#: Times since 1970 in units of one second, from 2001 to 2128: by their size a clock without a unit is known to be one of these.
EPOCH = (1e9, 5e9)
#: Days since 1900 (spreadsheets) and since the year 0 (MATLAB), from 2000 to 2100, and the largest interval of a clock in days:
#: as seconds it would be that of a rate above 1 MHz, which no logger that starts at such a number has.
DAYS, DAYS_STEP = ((36526, 73051), (730486, 767011)), 1e-6
#: Names of columns with a part of a date that is no number of seconds.
CALENDAR = ("year", "month", "jahr", "monat", "date", "datum")
#: Names of columns that number the runs of a file.
RUN_WORDS = re.compile(
    r"(run|trial|test|rep|repetition|experiment|measurement|versuch|lauf|messung)([ _-]?(no|nr|id|index|number))?\.?"
)
#: Allowed deviation of a time column from an even grid, in samples.
JITTER = 0.1
#: Share by which a rate that is meant to be whole differs from it, because a program wrote its clock with few digits.
CLOCK_ROUNDING = 1e-8
#: A clock rounded to steps deviates by up to half a step; plus a margin for the fitted line, whose slope a few steps bend.
ROUNDED = 0.55
#: Number of readings used to determine a clock's step, and tolerance for whole steps.
READINGS, WHOLE = 20_000, 1e-3
#: Minimum number of unusual differences that indicates rounding; fewer are lost samples.
UNUSUAL = 3
#: A lost or repeated row changes an interval by a whole one: it is unusual if it differs from the usual one by this share.
BREAK = 0.5
#: Intervals that are unusual in more than this share of the rows are the clock's own. Chosen.
BREAKS_MOST = 0.01
#: A break differs by more than this factor from this many intervals before and after it, but for a few that are breaks, too:
#: steps of a rounded clock have many neighbours of their size. At a decimal step of ten usual intervals, every tenth interval is
#: large, five of fifty.
CLEAR, BESIDE, FEW = 2.0, 50, 4
#: Different intervals, to 1 % of the usual one, of a clock that is known by its values alone: those of rounding.
ALIKE = 3
#: Share of its range that a clock may be set back by repeated rows; a sawtooth returns to its start. Chosen.
BACK = 0.1
#: Fewest numbers after which a counter starts again: four bits. Shorter cycles are also those of commands in steps.
CYCLE_LEAST = 16
#: Bits of the counters of microcontrollers and converters, which begin again at zero after their largest number.
COUNTER_BITS = (16, 24, 32)
#: The largest whole number up to which a float has every one.
WHOLE_MOST = 2**53
#: Sample rates that differ by less than this share are one rate: headers round it, and clocks are accurate to 1e-4.
RATE_AGREES = 5e-3
#: Share of a column's cells that may be lost samples; with more it is not a record.
LOST_MOST = 0.1


def seconds_of(column: pd.Series[str]) -> FloatArray:
    """Seconds since the first reading of a clock in words; without a date it may pass midnight, without hours the full hour."""
    import pandas as pd

    parts = column.str.extract(rf"^(?:{CLOCK.pattern})$", flags=re.IGNORECASE)
    minutes, own = parts["m"].fillna(parts["m2"]), parts["s"].fillna(parts["s2"]).str.replace(r"[,:]", ".", regex=True)
    hours = pd.to_numeric(parts["h"], errors="coerce")
    half = parts["half"].str.upper()
    hours = hours.where(half.isna(), hours % 12 + 12 * (half == "PM"))
    seconds = np.zeros(len(column))
    for part, size in ((hours, 3600.0), (minutes, 60.0), (own, 1.0)):
        seconds += pd.to_numeric(part, errors="coerce").fillna(0.0).to_numpy(np.float64) * size
    seconds = np.asarray(pd.Series(seconds).where(column.notna()).ffill(), dtype=np.float64)
    if parts["date"].notna().any():
        # The day or the month is first: where both are possible, the one with which the dates are closer together.
        dates = parts["date"].str.replace(r"^(\d{4})[./]", r"\1-", regex=True).dropna()
        orders = ("." in dates.iloc[0], "." not in dates.iloc[0])
        read = [pd.to_datetime(parts["date"], dayfirst=first, errors="coerce", format="mixed").ffill() for first in orders]
        days = min(read, key=lambda dates: (dates.isna().any(), dates.max() - dates.min()))
        seconds = seconds + (days - days.iloc[0]).dt.days.to_numpy(np.float64) * 86400.0
    else:
        whole = 86400.0 if parts["h"].notna().any() else 3600.0
        seconds = seconds + whole * np.concatenate([[0.0], np.cumsum(np.diff(seconds) < -0.5 * whole)])
    seconds[column.isna()] = np.nan
    return np.asarray(seconds - seconds[0])


def clock_of(texts: NDArray[Any]) -> FloatArray | None:
    """Seconds since the first of many texts that are times of day or dates, shape (n,); None if they are not."""
    import pandas as pd

    if len(texts) < BESIDE or texts.ndim != 1 or not CLOCK.fullmatch(str(texts[0])):
        return None
    column = pd.Series(texts.astype(str))
    return seconds_of(column) if column.str.fullmatch(CLOCK).all() else None


def seconds_per(unit: str) -> float | None:
    """Seconds per unit of time; None if it is not a unit of time."""
    return TIME_UNITS.get(unit.strip().strip("[]()").strip().lower())


def time_unit(name: str, column: Column) -> str:
    """The unit of a time column: given by the file, by its name, or by the size of a time since 1970; otherwise seconds."""
    if seconds_per(column.unit):
        return column.unit
    found = _NAME.fullmatch(name)
    largest = np.nanmax(column.values, initial=0.0)
    size = next((unit for unit in ("ms", "us", "ns") if EPOCH[0] <= largest * TIME_UNITS[unit] < EPOCH[1]), "s")
    if any(first <= largest < last for first, last in DAYS) and len(column.values) > 1:
        intervals = np.abs(np.diff(np.asarray(column.values, dtype=np.float64)))
        size = "d" if np.nanmedian(intervals) < DAYS_STEP else size
    return (found["unit"] or found["alone"] if found else None) or size


def finer_unit(rate: float, true: float) -> str:
    """The unit of time of a clock with the rate `true` that gave `rate` (Hz), because it was read as seconds; "" for none."""
    return next((u for u in ("ms", "us", "ns") if abs(rate / TIME_UNITS[u] / true - 1.0) < RATE_AGREES), "")


def names_time(name: str) -> bool:
    """Whether a name is that of a time."""
    return _NAME.fullmatch(name) is not None


def says_time(name: str, column: Column) -> bool:
    """Whether a column's name or unit is that of a time."""
    return column.values.dtype.kind in "iuf" and (names_time(name) or seconds_per(column.unit) is not None)


def is_time(name: str, column: Column) -> bool:
    """Whether a column is an evenly ascending clock: by its name or its unit, and by its values."""
    return says_time(name, column) and is_even(name, column)


def is_uneven_time(name: str, column: Column) -> bool:
    """Whether a column is a clock that is not even: it ascends, and its name, its unit or almost all of its intervals say so."""
    values = unwrapped(column).values
    if values.dtype.kind not in "iuf" or len(values) < BESIDE or not np.isfinite(values).all():
        return False
    intervals = np.diff(values.astype(np.float64))
    usual = float(np.median(intervals))
    if not usual > 0.0 or -intervals.min() > BACK * float(np.ptp(values)) or is_even(name, column):
        return False
    if says_time(name, column):
        return bool(np.mean(intervals > 0.0) > 1.0 - BREAKS_MOST)
    at = breaks(intervals)
    return len(at) > 0 and len(np.unique(np.round(np.delete(intervals, at) / usual, 2))) <= ALIKE


def rises_evenly(column: Column) -> bool:
    """Whether a column may be a clock by its values alone: they rise evenly, at most a few rows are missing, and not all are
    whole numbers, whose unit nothing says. If the file states a rate, they rise at that rate."""
    values = column.values
    if values.dtype.kind != "f" or len(values) < BESIDE or column.whole:
        return False
    if column.sample_rate is not None:
        return is_even("", column) and abs(column_rate("", column, "") / column.sample_rate - 1.0) < RATE_AGREES
    return is_even("", column) or is_uneven_time("", column)


def is_clock(name: str, column: Column, named: bool = True) -> bool:
    """Whether a column is a clock, even or not, that may start again; without `named` it needs no name or unit of a time."""
    if not says_time(name, column):
        return not named and is_uneven_time(name, column)
    return is_time(name, column) or is_uneven_time(name, column) or len(restarts(column)) > 0


def unwrapped(column: Column) -> Column:
    """The column as if its counter had more bits, if it is one of `COUNTER_BITS` that begins again after its largest number.

    It is none if it begins again at its first reading: then it is the clock of several runs.
    """
    values = column.values
    if values.dtype.kind not in "iuf" or len(values) < BESIDE or not np.isfinite(values).all():
        return column
    readings = values.astype(np.float64)
    steps = np.diff(readings)
    falls = np.flatnonzero(steps < 0.0)
    if not len(falls) or not column.whole or np.array_equal(readings[falls + 1], np.full(len(falls), readings[0])):
        return column
    usual, extent = float(np.median(steps)), float(np.ptp(readings))
    for cycle in (2.0**bits for bits in COUNTER_BITS):
        if extent < cycle and bool((np.abs(steps[falls] + cycle - usual) < BREAK * usual).all()):
            return replace(column, values=readings + cycle * np.append(0.0, np.cumsum(steps < 0.0)))
    return column


def restarts(column: Column) -> IntArray:
    """The rows at which a clock falls by more than a repeated row, to start again, as in a file with several runs."""
    readings = np.asarray(unwrapped(column).values, dtype=np.float64)
    finite = readings[np.isfinite(readings)]
    back = BACK * float(np.ptp(finite)) if len(finite) else 0.0
    with np.errstate(over="ignore", invalid="ignore"):  # of damaged readings
        steps = np.diff(readings, prepend=readings[:1], append=readings[-1:])
    # A single reading that is wrong rises as far before or after.
    at = np.flatnonzero((-steps > back) & (np.roll(steps, 1) < back) & (np.roll(steps, -1) < back))
    return at if len(at) <= BREAKS_MOST * len(readings) else at[:0]


def run_numbers(name: str, column: Column) -> IntArray:
    """The rows at which a column that numbers the runs of a file changes; empty if it is no such column."""
    values = column.values
    at = np.flatnonzero(values[1:] != values[:-1]) + 1
    own = RUN_WORDS.fullmatch(name.lower()) and values.dtype.kind in "iuf" and len(np.unique(values)) == len(at) + 1
    return at if own and column.whole and len(at) <= BREAKS_MOST * len(values) else at[:0]


def breaks(intervals: FloatArray) -> IntArray:
    """Indices of the few intervals of a clock that are unusual: rows are missing there, or repeated; empty if it has many.

    `intervals` has shape (n,).
    """
    usual = float(np.median(intervals))
    off = np.abs(intervals - usual)
    unusual = np.flatnonzero(off > BREAK * usual)
    if not usual > 0.0 or len(unusual) > max(BREAKS_MOST * len(intervals), 1):
        return unusual[:0]
    sides = {k: (off[max(k - BESIDE, 0) : k], off[k + 1 : k + 1 + BESIDE]) for k in unusual}
    clear = [
        k for k, both in sides.items()
        if all(len(side) <= FEW or off[k] > CLEAR * float(np.partition(side, -FEW - 1)[-FEW - 1]) for side in both)
    ]  # fmt: skip
    return np.array(clear, dtype=np.int64)


def is_even(name: str, column: Column) -> bool:
    """Whether the values of a column ascend evenly, as those of a clock."""
    try:
        column_rate(name, column, "")
    except (PlanError, RecordingError):
        return False
    return True


def column_rate(name: str, column: Column, here: str, unit: str = "", first: int = 0) -> float:
    """Sample rate from a time column in `unit`, that of the file if empty, Hz.

    Messages name its place `here`, and count rows from the `first` of the file. Raises PlanError if the unit is not one of time;
    RecordingError if the column is not even.
    """
    said = unit or time_unit(name, column)
    factor = seconds_per(said)
    if factor is None:
        raise PlanError(f"{here} is in {said!r}, which is not a unit of time; give time_unit as s, ms, us, ns, min, h or d")
    values = unwrapped(column).values
    if values.dtype.kind in "iu":
        # Nanoseconds since 1970 have more digits than a float.
        values = values.astype(np.int64) - np.int64(values[0])
    if len(at := first + restarts(column)):
        others = f" (and in {len(at) - 1} more rows)" if len(at) > 1 else ""
        raise RecordingError(
            f"{here} starts again in row {at[0] + 1}{others}: import its runs, the first with samples = [{first}, {at[0]}]"
        )
    return even_rate(np.asarray(values, dtype=np.float64), here, factor, first)


def even_rate(time: FloatArray, here: str, factor: float = 1.0, first: int = 0) -> float:
    """Rate of an evenly spaced clock, Hz: from the slope of a line through its readings, shape (n,), NaN for missing ones.

    A rounded clock, for example in milliseconds, may deviate from that line by half a step; the rate is then the integer rate in
    Hz that agrees with all readings, if there is one. A unit of the readings has `factor` seconds; messages name their place
    `here`, and count rows from the `first` of the file. Raises RecordingError if the clock does not ascend, or is not even.
    """
    index = np.flatnonzero(np.isfinite(time)).astype(np.int64)
    readings = time[index]
    low, high = (float(readings.min()) * factor, float(readings.max()) * factor) if len(readings) else (0.0, 0.0)
    if max(-low, high) > VALUE_MOST:
        raise RecordingError(f"{here} goes from {low:g} to {high:g} s; correct it, or give sample_rate instead")
    if len(readings) < 2 or not (readings[-1] - readings[0]) * factor > 1.0 / VALUE_MOST:
        text = f"goes from {readings[0] * factor:g} to {readings[-1] * factor:g} s" if len(readings) else "has no value"
        raise RecordingError(f"{here} {text}; it must ascend, so give sample_rate instead")
    quantum, seconds = _quantum(readings) * factor, (readings - readings[0]) * factor
    centred, around = index - index.mean(), seconds - seconds.mean()
    period = float(centred @ around / (centred @ centred))
    # A clock that is rounded downwards is half a step late on average, or less if its steps are few.
    off = around - period * centred
    stray = np.abs(off - (off.max() + off.min()) / 2.0)
    if _lost(index, readings):
        quantum = 0.0
    worst = int(np.argmax(stray))
    if not period > 0.0 or stray[worst] > max(JITTER * period, ROUNDED * quantum):
        _blame_breaks(index, readings, here, first)
        raise RecordingError(
            f"{here} deviates by {stray[worst] / abs(period or 1.0):.2g} samples from an even grid at sample "
            f"{first + index[worst]}; split the run where rows are missing or repeated, or resample it evenly"
        )
    rate = 1.0 / period
    whole = max(round(rate), 1)
    allowed = max(quantum, CLOCK_ROUNDING * (seconds[-1] - seconds[0]))
    return float(whole) if abs(1.0 / whole - period) * (centred[-1] - centred[0]) <= allowed else rate


def _blame_breaks(index: IntArray, readings: FloatArray, here: str, first: int) -> None:
    intervals = np.diff(readings) / np.diff(index)
    at = breaks(intervals)
    if len(at):
        others = f" (so in {len(at)} places)" if len(at) > 1 else ""
        raise RecordingError(
            f"{here} differs by {intervals[at[0]]:.4g} {_between(index[at[0]], index[at[0] + 1], first)} of its values, "
            f"elsewhere by {np.median(intervals):.4g} from row to row{others}: "
            f"{_in_parts(index[at + 1], int(index[-1]) + 1, first)}"
        )


def _between(row: int, after: int, first: int) -> str:
    # Rows are counted from 1 in words, from 0 in `samples`.
    return f"from row {first + row + 1} to row {first + after + 1}"


def _in_parts(begins: IntArray, end: int, first: int) -> str:
    # What to do with rows that have breaks: `begins` are the rows after these.
    edges = np.concatenate([[0], begins, [end]]) + first
    longest = int(np.argmax(np.diff(edges)))
    return (
        "rows are missing or repeated there; correct the file, or import its parts as runs, the longest with samples = "
        f"[{edges[longest]}, {edges[longest + 1]}]"
    )


def sample_counter(column: Column, first: int = 0) -> tuple[str, str] | None:
    """What a column counts, in words after its name, and where rows are missing or repeated (empty if nowhere), with what to do.

    None if it does not count them: by whole numbers that rise by one from almost every row to the next, and may start again after
    their largest one. Rows are counted from the `first` of the file.
    """
    values = np.asarray(column.values)
    if values.dtype.kind not in "iuf" or len(values) < BESIDE or column.sensitivity != 1.0:
        return None
    if not (np.isfinite(values).all() and np.abs(values).max() < WHOLE_MOST and column.whole):
        return None
    numbers = values.astype(np.int64)
    steps, again = np.diff(numbers), ""
    if (steps < 0).any():
        largest = int(numbers.max())
        cycle = largest - int(numbers.min()) + 1
        if cycle < CYCLE_LEAST:
            return None
        steps, again = np.where(steps < 0, steps + cycle, steps), f", and again after {largest}"
    at = np.flatnonzero(steps != 1)
    if len(at) > BREAKS_MOST * len(steps):
        return None
    words = f"counts the samples from {numbers[0]} to {numbers[-1]}{again}"
    if not len(at):
        return words, ""
    skipped = steps[at] - 1
    what = f"skips {skipped[0]} numbers" if skipped[0] > 0 else "does not rise"
    others = f" (so in {len(at)} places, {skipped[skipped > 0].sum()} numbers in all)" if len(at) > 1 else ""
    return words, f"it {what} {_between(at[0], at[0] + 1, first)}{others}: {_in_parts(at + 1, len(numbers), first)}"


def _quantum(readings: FloatArray) -> float:
    # The rounding step of a printed clock, or of one in single precision. With few digits it is largest at the end.
    with np.errstate(over="ignore"):  # a damaged reading may exceed single precision
        short = readings.astype(np.float32)
    single = float(np.spacing(np.abs(short).max())) if np.array_equal(short, readings) else 0.0
    return max(_decimal(readings), _decimal(readings[-BESIDE:]), single)


def _decimal(readings: FloatArray) -> float:
    # The largest power of ten of which all readings are multiples.
    some = readings[:: max(1, len(readings) // READINGS)]
    for power in range(3, -10, -1):
        steps = some * 10.0**-power
        if float(np.abs(steps - np.round(steps)).max()) < WHOLE and np.ptp(np.round(steps)) >= 2.0:
            return float(10.0**power)
    return 0.0


def _lost(index: IntArray, readings: FloatArray) -> bool:
    # One or two different intervals among equal ones are lost samples; a rounded clock has many.
    differences = np.round(np.diff(readings) / np.diff(index), 12)
    values, counts = np.unique(differences, return_counts=True)
    return len(values) > 1 and len(differences) - int(counts.max()) < UNUSUAL


def completed(columns: Mapping[str, Column]) -> tuple[dict[str, Column], list[str]]:
    """Columns of equal length with an interpretation of their empty cells (NaN), and sentences about them.

    Empty cells at the end mean a shorter column; a value in every k-th cell only means a record with 1/k of the rate; a few empty
    cells are lost samples, listed in `Column.lost`.
    """
    columns, remarks = _one_clock(columns)
    # The clock's, if there is one.
    rates = [column_rate(name, column, "") for name, column in columns.items() if is_time(name, column)]
    rate = rates[0] if len(rates) == 1 else None
    found: dict[str, Column] = {}
    for name, column in columns.items():
        there = np.flatnonzero(~np.isnan(column.values))
        n = len(column.values)
        if len(there) == n:
            found[name] = column
        elif len(there) < 2:
            if not re.fullmatch(r"|column\d+|Unnamed.*", name):
                remarks.append(f"column {name!r} is empty and is left out")
        elif len(there) == n - there[0] and there[0] > 0:
            # Late first value: the rows before it are lost samples of this column.
            found[name] = replace(column, lost=np.flatnonzero(np.isnan(column.values)))
            remarks.append(f"column {name!r} has no value in its first {there[0]} rows")
        elif len(steps := np.unique(np.diff(there))) == 1:
            every = int(steps[0])
            kept = column.values[there]
            own = None if rate is None else rate / every
            found[name] = replace(column, values=kept, sample_rate=column.sample_rate or own)
            remarks.append(
                f"column {name!r} has {len(kept)} values of {n}" + (f", one in every {every} rows" if every > 1 else "")
                + ": it is treated as a separate record"
            )  # fmt: skip
        else:
            values = column.values[: there[-1] + 1]
            lost = np.flatnonzero(np.isnan(values))
            if len(lost) > LOST_MOST * len(values):
                remarks.append(f"column {name!r} has no value in {len(lost)} of {len(values)} rows and is left out")
                continue
            short = len(values) < n
            found[name] = replace(column, values=values, lost=lost, sample_rate=column.sample_rate or (rate if short else None))
            remarks.append(f"column {name!r} has no value in {len(lost)} of {len(values)} rows: they are stored as gaps")
    return found, remarks


def _one_clock(columns: Mapping[str, Column]) -> tuple[Mapping[str, Column], list[str]]:
    # The columns with one clock in place of its parts (hours, minutes, seconds, milliseconds), each a whole number below one unit
    # of the next larger part, but for the smallest part; and a sentence about it.
    sizes = {name: seconds_per(name) or (names_time(name) and seconds_per(column.unit)) for name, column in columns.items()}
    numbers = (name for name, column in columns.items() if column.values.dtype.kind in "iuf")
    parts = sorted(((size, name) for name in numbers if (size := sizes[name])), reverse=True)
    if len(parts) < 2 or any(len(columns[name].values) != len(columns[parts[0][1]].values) for _, name in parts):
        return columns, []
    for (large, name), (small, below) in itertools.pairwise(parts):
        values = columns[below].values
        if small == large or not columns[name].whole or not (values >= 0.0).all() or values.max() * small >= large:
            return columns, []
    values = np.sum([size * columns[name].values.astype(np.float64) for size, name in parts], axis=0)
    clock = Column(values=values, unit="s")
    if not is_even("", clock):
        return columns, []
    called = next((name for _, name in parts if names_time(name)), "time")
    gone = [name for _, name in parts] + [name for name in columns if name.lower() in CALENDAR]
    kept = {name: column for name, column in columns.items() if name not in gone}
    return {called: clock, **kept}, [f"columns {', '.join(map(repr, gone))} are one clock, read as {called!r}"]
