"""The runs that a session will measure, according to a plan or a recording."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from isorig.analysis.campaign import BROAD, Run
from isorig.rig.acquire.plan import Plan


class Planned(msgspec.Struct, frozen=True, kw_only=True):
    """A run: configuration, gain, duration in seconds, and whether its drive is broad-band."""

    id: str
    configuration: str
    gain: float
    seconds: float
    broad: bool


def planned_by(plan: Plan) -> tuple[Planned, ...]:
    """The runs of a plan in order, each repeat with its own name."""
    rate = plan.instrument.sample_rate
    return tuple(
        Planned(
            id=name, configuration=run.configuration, gain=run.gain, seconds=run.ticks(rate) / rate, broad=run.excitation in BROAD
        )
        for run in plan.runs
        for name in run.ids()
    )


def planned_as(runs: Iterable[Run]) -> tuple[Planned, ...]:
    """Runs of a recording, as if they were planned."""
    return tuple(
        Planned(
            id=run.id, configuration=run.configuration, gain=run.gain, broad=run.excitation in BROAD,
            seconds=(len(run) + sum(gap.count for gap in run.gaps)) / run.sample_rate,
        )
        for run in runs
    )  # fmt: skip
