"""Time columns: detection, unit, and sample rate."""

from __future__ import annotations

import re

import numpy as np

from isorig.analysis.campaign import FloatArray, IntArray
from isorig.rig.errors import PlanError, RecordingError
from isorig.rig.exchange.table import Column
from isorig.rig.files.recording import VALUE_MOST

#: Seconds per unit of time, as written by programs; lower case.
TIME_UNITS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds", "millisekunden"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes", "minuten"), 60.0),
    **dict.fromkeys(("h", "hour", "hours", "stunde", "stunden"), 3600.0),
}
_WORD = r"t|time|zeit|temps|tiempo|tempo|sec|secs|seconds?|sek|x_?value|timestamp|time_?stamp|zeitstempel|elapsed[ _]?time|clock"
_NAME = re.compile(rf"(?:.*[./])?(?:{_WORD})(?:[ _]*(?P<unit>s|sec|seconds|ms|us|µs|ns|min|h))?(?:\[\d+\])?", re.IGNORECASE)
#: Allowed deviation of a time column from an even grid, in samples.
JITTER = 0.1
#: Share by which a rate that is meant to be whole differs from it, because a program wrote its clock with few digits.
CLOCK_ROUNDING = 1e-8
#: A clock rounded to steps deviates by up to half a step; plus a margin for the fitted line.
ROUNDED = 0.51
#: Number of readings used to determine a clock's step, and tolerance for whole steps.
READINGS, WHOLE = 20_000, 1e-3
#: Minimum number of unusual differences that indicates rounding; fewer are lost samples.
UNUSUAL = 3


def seconds_per(unit: str) -> float | None:
    """Seconds per unit of time; None if it is not a unit of time."""
    return TIME_UNITS.get(unit.strip().strip("[]()").strip().lower())


def time_unit(name: str, column: Column) -> str:
    """The unit of a time column: given by the file, otherwise by its name, otherwise seconds."""
    if column.unit:
        return column.unit
    found = _NAME.fullmatch(name)
    return (found["unit"] if found else None) or "s"


def is_time(name: str, column: Column) -> bool:
    """Whether a column is an evenly ascending clock: by its name or its unit, and by its values."""
    if (_NAME.fullmatch(name) is None and seconds_per(column.unit) is None) or column.values.dtype.kind not in "iuf":
        return False
    try:
        column_rate(name, column, "")
    except (PlanError, RecordingError):
        return False
    return True


def column_rate(name: str, column: Column, here: str, unit: str = "") -> float:
    """Sample rate from a time column, Hz.

    Parameters
    ----------
    name, column
        The column.
    here
        Its location, for error messages.
    unit
        Its unit of time; the file's if empty.

    Raises
    ------
    PlanError
        Its unit is not a unit of time.
    RecordingError
        It is not even.
    """
    said = unit or time_unit(name, column)
    factor = seconds_per(said)
    if factor is None:
        raise PlanError(f"{here} is in {said!r}, which is not a unit of time; give time_unit as s, ms, us, ns, min or h")
    return even_rate(np.asarray(column.values, dtype=np.float64), here, factor)


def even_rate(time: FloatArray, here: str, factor: float = 1.0) -> float:
    """Rate of an evenly spaced clock, Hz: from the slope of a line through its readings.

    A rounded clock, for example in milliseconds, may deviate from that line by half a step; the rate is then the integer rate in
    Hz that agrees with all readings, if there is one.

    Parameters
    ----------
    time
        Readings, shape (n,), NaN for missing ones.
    here
        Their location, for error messages.
    factor
        Seconds per unit of the readings.

    Raises
    ------
    RecordingError
        The clock does not ascend, or is not even.
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
    stray = np.abs(around - period * centred)
    if _lost(index, readings):
        quantum = 0.0
    worst = int(np.argmax(stray))
    if not period > 0.0 or stray[worst] > max(JITTER * period, ROUNDED * quantum):
        raise RecordingError(
            f"{here} deviates by {stray[worst] / abs(period or 1.0):.2g} samples from an even grid at sample {index[worst]}; "
            "split the run where samples are missing, or resample it evenly"
        )
    rate = 1.0 / period
    whole = max(round(rate), 1)
    allowed = max(quantum, CLOCK_ROUNDING * (seconds[-1] - seconds[0]))
    return float(whole) if abs(1.0 / whole - period) * (centred[-1] - centred[0]) <= allowed else rate


def _quantum(readings: FloatArray) -> float:
    # The largest power of ten of which all readings are multiples: the rounding step of a printed clock.
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
