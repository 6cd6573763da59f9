"""Columns of time: which column is one, in which unit, and the sample rate that it gives."""

from __future__ import annotations

import re

import numpy as np

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.rig.errors import PlanError, RecordingError
from isorig.rig.exchange.table import Column

#: Seconds in a unit of time, as programs write it; small letters.
TIME_UNITS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds", "millisekunden"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes", "minuten"), 60.0),
    **dict.fromkeys(("h", "hour", "hours", "stunde", "stunden"), 3600.0),
}  # fmt: skip
_WORD = r"t|time|zeit|temps|tiempo|tempo|sec|secs|seconds?|sek|x_?value|timestamp|time_?stamp|zeitstempel|elapsed[ _]?time|clock"
_NAME = re.compile(rf"(?:.*[./])?(?:{_WORD})(?:[ _]*(?P<unit>s|sec|seconds|ms|us|µs|ns|min|h))?(?:\[\d+\])?", re.IGNORECASE)
#: A time column may stray so many samples from an even grid.
JITTER = 0.1
#: A clock that is rounded to steps strays up to half a step; a little more for the line through its readings.
ROUNDED = 0.51
#: Readings that a clock's step is worked out from, and how close to whole steps they all must be.
READINGS, WHOLE = 20_000, 1e-3
#: Rounding shows in at least so many differences that are not the usual one; fewer are lost samples.
UNUSUAL = 3


def seconds_per(unit: str) -> float | None:
    """Seconds in one of that unit of time; None where it is none."""
    return TIME_UNITS.get(unit.strip().strip("[]()").strip().lower())


def time_unit(name: str, column: Column) -> str:
    """The unit of a column of time: as the file says it, else as its name does, else seconds."""
    if column.unit:
        return column.unit
    found = _NAME.fullmatch(name)
    return (found["unit"] if found else None) or "s"


def is_time(name: str, column: Column) -> bool:
    """Whether a column is an evenly ascending clock: by its name or its unit, and by its values."""
    if (_NAME.fullmatch(name) is None and seconds_per(column.unit) is None) or column.values.dtype.kind not in "iuf":
        return False
    factor = seconds_per(time_unit(name, column))
    if factor is None:
        return False
    try:
        even_rate(np.asarray(column.values, dtype=np.float64), "", factor)
    except RecordingError:
        return False
    return True


def column_rate(name: str, column: Column, here: str, unit: str = "") -> float:
    """The sample rate that a column of time gives, Hz.

    Parameters
    ----------
    name, column
        The column.
    here
        Where it stands, for refusals.
    unit
        Its unit of time; what the file says where empty.

    Raises
    ------
    PlanError
        Where its unit is none of time.
    RecordingError
        Where it is not even.
    """
    said = unit or time_unit(name, column)
    factor = seconds_per(said)
    if factor is None:
        raise PlanError(f"{here} is in {said!r}, which is no unit of time; give time_unit as s, ms, us, ns, min or h")
    return even_rate(np.asarray(column.values, dtype=np.float64), here, factor)


def even_rate(time: FloatArray, here: str, factor: float = 1.0) -> float:
    """The rate of an evenly spaced clock, Hz: the slope of the line through its readings.

    A clock that is rounded, to milliseconds say, may stray from that line by half its step; the rate is then the whole number
    of samples a second, where one agrees with all its readings.

    Parameters
    ----------
    time
        Readings, shape (n,), NaN where one is missing.
    here
        Where they stand, for refusals.
    factor
        Seconds in one of their unit.

    Raises
    ------
    RecordingError
        Where the clock does not ascend, or strays.
    """
    index = np.flatnonzero(np.isfinite(time)).astype(np.int64)
    readings = time[index]
    if len(readings) < 2 or not readings[-1] > readings[0]:
        told = f"goes from {readings[0] * factor:g} to {readings[-1] * factor:g} s" if len(readings) else "has no value"
        raise RecordingError(f"{here} {told}; it must ascend, so give sample_rate instead")
    quantum, seconds = _quantum(readings) * factor, (readings - readings[0]) * factor
    centred, around = index - index.mean(), seconds - seconds.mean()
    period = float(centred @ around / (centred @ centred))
    stray = np.abs(around - period * centred)
    if _lost(index, readings):
        quantum = 0.0
    worst = int(np.argmax(stray))
    if not period > 0.0 or stray[worst] > max(JITTER * period, ROUNDED * quantum):
        raise RecordingError(
            f"{here} strays {stray[worst] / abs(period or 1.0):.2g} samples from an even grid at sample {index[worst]}; "
            "split the run where samples are missing, or resample it evenly"
        )
    rate = 1.0 / period
    whole = max(round(rate), 1)
    return float(whole) if abs(1.0 / whole - period) * (centred[-1] - centred[0]) <= quantum else rate


def _quantum(readings: FloatArray) -> float:
    # The largest power of ten that all readings are whole multiples of: the step that a printed clock is rounded to.
    some = readings[:: max(1, len(readings) // READINGS)]
    for power in range(3, -10, -1):
        steps = some * 10.0**-power
        if float(np.abs(steps - np.round(steps)).max()) < WHOLE and np.ptp(np.round(steps)) >= 2.0:
            return float(10.0**power)
    return 0.0


def _lost(index: IntArray, readings: FloatArray) -> bool:
    # One or two odd differences among equal ones are lost samples; a rounded clock has many.
    differences = np.round(np.diff(readings) / np.diff(index), 12)
    values, counts = np.unique(differences, return_counts=True)
    return len(values) > 1 and len(differences) - int(counts.max()) < UNUSUAL
