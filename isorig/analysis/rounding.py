"""Records that are no continuous signal, commands of few levels and signals rounded to counts, and the white noise of one."""

from math import sqrt

import numpy as np

from isorig.analysis.campaign import FloatArray

#: Number of values that a record takes below which it is a command with levels, which is exact, and no signal rounded to counts.
#: Chosen: steps and square waves have two to five levels, and a motion of fewer counts than this shows nothing but rounding.
LEVELS = 8
#: Samples for which a command with more levels holds each one on average, at least, and the share of its changes after which
#: the record does not change again at once. Chosen: a converter's record holds its counts for a few samples, and one that is zero
#: outside a hit changes in successive samples.
DWELL, JUMPS = 20.0, 0.9
#: Number of different steps, as a share of all steps of a record, above which it is not rounded visibly.
STEPS_PER_SAMPLE = 0.25
#: Share of the largest step by which two steps of the same number of counts may differ, as text has a few digits only.
SAME = 1e-6
#: Noise of a record as a multiple of its rounding up to which it is nothing else. Chosen: other noise of the same size makes the
#: steps irregular, and both together have 1.4 times the standard deviation of each.
IS_ROUNDING = 1.3
#: Samples of a long record from which the step of its counts is determined, and those whose values are counted first.
SOME, FIRST = 20_000, 256

#: Median magnitude of a normal variable with zero mean over its standard deviation.
MEDIAN_MAGNITUDE = 0.6745


def deviation_by_median(values: FloatArray, differences: int = 0) -> float:
    """Standard deviation of the white noise of a record that is mostly noise, or whose differences of an order up to 2 are.

    From the median magnitude, to which a motion in a minority of the samples does not matter; 0 without any.
    """
    steps = np.abs(np.diff(values, differences))
    return (
        float(np.median(steps, overwrite_input=True)) / (MEDIAN_MAGNITUDE * sqrt((1, 2, 6)[differences])) if len(steps) else 0.0
    )


def is_command(values: FloatArray) -> bool:
    """Whether a record is a command with levels: it takes fewer than `LEVELS` values, or holds each one and then jumps."""
    if _has_few_levels(values):
        return True
    changes = np.diff(values) != 0.0
    jumps = changes & ~np.append(changes[1:], False)
    count = int(np.count_nonzero(changes))
    return 0 < count <= min(len(values) / DWELL, int(np.count_nonzero(jumps)) / JUMPS)


def _has_few_levels(values: FloatArray) -> bool:
    some = values[:: max(1, len(values) // FIRST)]
    return len(np.unique(some)) < LEVELS and len(np.unique(values)) < LEVELS


def rounding(values: FloatArray) -> float:
    """Standard deviation of the rounding of a record to counts; 0 if it is not rounded visibly, or has a few levels only.

    A step q of the counts rounds with a standard deviation of q / sqrt(12).
    """
    if _has_few_levels(values):
        return 0.0
    steps = np.abs(np.diff(values[:: max(1, len(values) // SOME)]))
    rounded = np.round(steps / (SAME * steps.max()))
    sizes = np.unique(rounded)
    if len(sizes) > STEPS_PER_SAMPLE * len(steps):
        return 0.0
    return float(steps[np.argmax(rounded == sizes[sizes > 0.0][0])]) / sqrt(12.0)


def is_rounded(values: FloatArray, level: float) -> bool:
    """Whether the noise of a record, shape (n,), with this standard deviation is its rounding to counts."""
    return 0.0 < level <= IS_ROUNDING * rounding(values)


def sensor_noise(values: FloatArray, level: float, generator: np.random.Generator) -> FloatArray:
    """Further noise for a record, shape (n,), as that which it contains.

    White with the standard deviation `level`, unless it is the rounding of a motion slower than a count per sample: that makes
    steps, and at rest no noise at all. It is then the rounding of the same motion with the steps in the middle between those
    recorded.
    """
    white = generator.normal(0.0, level, len(values))
    if not is_rounded(values, level):
        return white
    step = rounding(values) * sqrt(12.0)
    change = np.diff(values)
    at = np.flatnonzero(change)
    motion = np.interp(np.arange(len(values)), at + 0.5, values[at] + 0.5 * change[at])
    motion = np.clip(motion, values - 0.5 * step, values + 0.5 * step)
    # Between these steps lies half a count, three times the power of rounding.
    other = (values[0] + step * (np.floor((motion - values[0]) / step) + 0.5) - values) / sqrt(3.0)
    fast = np.abs(np.convolve(change, [0.5, 0.5])) > step
    return np.asarray(np.where(fast, white, other))
