"""Sources of the screen's samples: a running session, or a recording played back at its own pace."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from isorig.analysis.campaign import Campaign, Channel, Run, Samples
from isorig.rig.acquire.recorder import working_file
from isorig.rig.acquire.recover import follow
from isorig.rig.errors import RecordingError
from isorig.rig.files.recording import open_recording

#: Seconds between two readings.
EVERY = 0.4


@dataclass(frozen=True, kw_only=True)
class Reading:
    """The data measured so far, the last run growing, and the ids of complete runs; valid until the next reading is requested."""

    campaign: Campaign
    whole: frozenset[str]


def watched(output: Path, over: Callable[[], bool], every: float = EVERY) -> Iterator[Reading]:
    """The data written by a session, and by an earlier part of it, read every `every` seconds until it is `over`.

    The writer is not delayed.
    """
    read = 0
    while True:
        ended = over()
        if output.exists() and (stamp := output.stat().st_mtime_ns) != read:
            read = stamp
            with suppress(RecordingError), open_recording(output) as campaign:
                yield Reading(campaign=campaign, whole=frozenset(run.id for run in campaign.runs))
        with suppress(RecordingError):
            if working_file(output).exists():
                for campaign, finished in follow(output, every=every, patience=math.inf):
                    ids = [run.id for run in campaign.runs]
                    yield Reading(campaign=campaign, whole=frozenset(ids if finished else ids[:-1]))
                read = output.stat().st_mtime_ns
        if ended:
            return
        time.sleep(every)


def replayed(recording: Path, speed: float, every: float = EVERY) -> Iterator[Reading]:
    """A recording as it grew, at `speed` times real time, without the pauses between its runs."""
    with open_recording(recording) as campaign:
        done: list[Run] = []
        for run in campaign.runs:
            began = time.monotonic()
            while (n := int((time.monotonic() - began) * speed * run.sample_rate)) < len(run):
                if n > 0:
                    runs = (*done, beginning_of(run, n))
                    yield Reading(campaign=replace(campaign, runs=runs), whole=frozenset(item.id for item in done))
                time.sleep(every)
            done.append(run)
            yield Reading(campaign=replace(campaign, runs=tuple(done)), whole=frozenset(item.id for item in done))


class _First:
    """The first `n` samples of a sequence."""

    def __init__(self, samples: Samples, n: int) -> None:
        self._samples = samples
        self.shape = (n,)

    def __getitem__(self, key: slice, /) -> NDArray[Any]:
        return self._samples[slice(*key.indices(self.shape[0]))]


def beginning_of(run: Run, n: int) -> Run:
    """The first `n` samples of a run, with the gaps between them."""

    def cut(channel: Channel) -> Channel:
        return replace(channel, samples=_First(channel.samples, n))

    gaps, lost = [], 0
    for gap in run.gaps:
        if gap.first_tick - lost < n:
            gaps.append(gap)
        lost += gap.count
    return replace(run, channels={name: cut(channel) for name, channel in run.channels.items()}, gaps=tuple(gaps))
