"""A gain that changes within a run: the run taken for what it is, a sweep of levels, one run for each.

The gain that was streamed beside the samples tells the level. A steady gain is left alone. Stretches whose gains round to the
same level of a geometric grid share one, so that locked and unlocked sweeps of one dial meet at the same gains.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from itertools import pairwise

import numpy as np

from isorig.analysis.campaign import Campaign, Channel, FloatArray, Gap, IntArray, Run

GAIN = "gain"
#: Two levels beside each other differ by this factor, a sixth of a decade.
STEP = 10.0 ** (1.0 / 6.0)
#: A gain that stays within this share of its median is steady: a dial's noise and rounding.
STEADY = 0.05
#: A stretch shorter than this shows no transfer function, s.
SHORTEST = 2.0
#: Samples that are looked at in one go: a run may be longer than memory.
PART = 1 << 20
#: The level of a gain of zero.
SILENT = np.iinfo(np.int64).min


def by_level(campaign: Campaign) -> Campaign:
    """The campaign with every run whose gain changes cut into one run for each stretch of a level.

    A stretch begins in the middle of a motion, so it serves transfer functions and ratios, not simulations from rest.
    """
    return replace(campaign, runs=tuple(part for run in campaign.runs for part in stretches(run)))


def changes(run: Run) -> bool:
    """Whether the streamed gain leaves the run's gain, its median, by more than `STEADY`, for more than that share of the run."""
    if GAIN not in run.channels:
        return False
    gain, middle = run.channels[GAIN], abs(run.gain)
    parts = (gain.read(start, start + PART) for start in range(0, len(run), PART))
    away = sum(int((np.abs(np.abs(part) - middle) > STEADY * middle).sum()) for part in parts)
    return away > STEADY * len(run)


def stretches(run: Run) -> Iterator[Run]:
    """The run itself where its gain is steady, else its stretches by level; those shorter than `SHORTEST` are left out.

    A stretch's gain is its level's, a whole power of `STEP`: within a twelfth of a decade of what was streamed.
    """
    if not changes(run):
        yield run
        return
    level = _levels(run.read(GAIN))
    edges = np.concatenate([[0], np.flatnonzero(np.diff(level)) + 1, [len(level)]])
    count = 0
    for start, stop in pairwise(edges):
        if (stop - start) / run.sample_rate < SHORTEST or level[start] == SILENT:
            continue
        count += 1
        yield _part(run, int(start), int(stop), float(STEP ** level[start]), count)


def _levels(gain: FloatArray) -> IntArray:
    size = np.abs(gain)
    found = np.full(len(size), SILENT)
    loud = size > 0.0
    found[loud] = np.round(np.log(size[loud]) / np.log(STEP)).astype(np.int64)
    return found


def _part(run: Run, start: int, stop: int, gain: float, count: int) -> Run:
    channels = {
        name: Channel(
            name=name, samples=np.asarray(channel.samples[start:stop]), quantity=channel.quantity, unit=channel.unit,
            scale=channel.scale, offset=channel.offset, full_scale=channel.full_scale,
        )
        for name, channel in run.channels.items()
    }  # fmt: skip
    began = None if run.started is None else run.started + timedelta(seconds=start / run.sample_rate)
    # Gaps count ticks, and the stored samples skip the ticks that are missing.
    missing = sum(gap.count for gap in run.gaps if gap.first_tick < start)
    gaps = tuple(
        Gap(first_tick=gap.first_tick - start - missing, count=gap.count)
        for gap in run.gaps
        if start + missing <= gap.first_tick < stop + missing
    )
    return replace(run, id=f"{run.id}-{count}", gain=gain, channels=channels, started=began, gaps=gaps, period=None, spectra=())
