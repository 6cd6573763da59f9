"""Records that are no continuous signal: commands of few levels, and signals rounded to counts."""

from __future__ import annotations

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
#: Samples of a long record that are looked at first.
SOME = 20_000


def is_command(values: FloatArray) -> bool:
    """Whether a record is a command with levels: it takes fewer than `LEVELS` values, or holds each one and then jumps."""
    if _has_few_levels(values):
        return True
    changes = np.diff(values) != 0.0
    jumps = changes & ~np.append(changes[1:], False)
    count = int(np.count_nonzero(changes))
    return 0 < count <= min(len(values) / DWELL, int(np.count_nonzero(jumps)) / JUMPS)


def _has_few_levels(values: FloatArray) -> bool:
    some = values[:: max(1, len(values) // SOME)]
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
