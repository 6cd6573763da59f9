"""Levels of the drive: splits a run whose gain changes into one for each gain, and groups runs of one stated gain by their drive.

The streamed gain, recorded with the samples, gives the level. A steady gain is not split. Intervals whose gains round to the same
level of a geometric grid share it, so that locked and unlocked sweeps of one dial have the same gains.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import timedelta
from itertools import pairwise

import numpy as np

from isorig.analysis.campaign import Campaign, Gap, Run
from isorig.analysis.spectra.overload import blocks, channel_std

GAIN = "gain"
#: Ratio of adjacent levels, a sixth of a decade.
STEP = 10.0 ** (1.0 / 6.0)
#: A gain within this share of its median is steady: it allows for noise and rounding of a dial.
STEADY = 0.05
#: Minimum duration of an interval, s.
SHORTEST = 2.0
#: Ratio of drive levels from which runs with the same stated gain, band and excitation were driven differently. Chosen: the rms
#: of a noise run varies by a few per cent, and levels that are meant to differ do so by a half or more.
APART = 1.25
#: Level for a gain of zero.
SILENT = np.iinfo(np.int64).min


def by_level(campaign: Campaign) -> Campaign:
    """The campaign with every run whose gain changes split into one run for each interval of a level.

    An interval starts during a motion, so it is for transfer functions and ratios, not for simulations from rest.
    """
    return replace(campaign, runs=tuple(part for run in campaign.runs for part in runs_by_level(run)))


def changes(run: Run) -> bool:
    """Whether the streamed gain differs from its median by more than `STEADY`, for more than that share of the run."""
    if GAIN not in run.channels:
        return False
    middle = abs(run.gain)
    away = sum(int((np.abs(np.abs(part) - middle) > STEADY * middle).sum()) for part in blocks(run.channels[GAIN]))
    return away > STEADY * len(run)


def runs_by_level(run: Run) -> Iterator[Run]:
    """The run itself if its gain is steady, otherwise its intervals by level; those shorter than `SHORTEST` are omitted.

    The gain of an interval is its level's, an integer power of `STEP`: within a twelfth of a decade of the streamed gain.
    """
    if not changes(run):
        yield run
        return
    size = np.abs(run.read(GAIN))
    level, driven = np.full(len(size), SILENT), size > 0.0
    level[driven] = np.round(np.log(size[driven]) / np.log(STEP)).astype(np.int64)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(level)) + 1, [len(level)]])
    count = 0
    for start, stop in pairwise(edges):
        if (stop - start) / run.sample_rate < SHORTEST or level[start] == SILENT:
            continue
        count += 1
        yield _part(run, int(start), int(stop), float(STEP ** level[start]), count)


def by_drive(runs: Sequence[Run], drive: str) -> list[list[Run]]:
    """Runs of one stated gain, grouped by the rms of their drive, the highest level first.

    Only runs with the same excitation and band are separated, and only if adjacent levels differ by `APART` or more.
    """
    if len(runs) == 1:
        return [list(runs)]
    kinds = {(run.excitation, run.band) for run in runs}
    levels = {run.id: level_of(run, drive) for run in runs}
    if len(kinds) > 1 or min(levels.values(), default=0.0) <= 0.0:
        return [list(runs)]
    groups: list[list[Run]] = []
    for run in sorted(runs, key=lambda run: -levels[run.id]):
        if groups and levels[groups[-1][-1].id] < APART * levels[run.id]:
            groups[-1].append(run)
        else:
            groups.append([run])
    return [[run for run in runs if any(run is one for one in group)] for group in groups]


def level_of(run: Run, drive: str) -> float:
    """Standard deviation of a run's drive channel, in its unit."""
    return channel_std(run.channel(drive))


def _part(run: Run, start: int, stop: int, gain: float, count: int) -> Run:
    channels = {name: replace(channel, samples=np.asarray(channel.samples[start:stop])) for name, channel in run.channels.items()}
    began = None if run.started is None else run.started + timedelta(seconds=start / run.sample_rate)
    # Gaps count ticks, and the stored samples skip the missing ticks.
    missing = sum(gap.count for gap in run.gaps if gap.first_tick < start)
    gaps = tuple(
        Gap(first_tick=gap.first_tick - start - missing, count=gap.count)
        for gap in run.gaps
        if start + missing <= gap.first_tick < stop + missing
    )
    return replace(run, id=f"{run.id}-{count}", gain=gain, channels=channels, started=began, gaps=gaps, period=None, spectra=())
