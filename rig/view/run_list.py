"""The runs that a session is going to take, as far as a plan or a recording says."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from isorig.analysis.campaign import BROAD, Run
from isorig.rig.acquire.plan import Plan


class Planned(msgspec.Struct, frozen=True, kw_only=True):
    """A run: how the rig is set up, for how many seconds, and whether its drive has power over a band."""

    id: str
    configuration: str
    gain: float
    seconds: float
    broad: bool


def planned_by(plan: Plan) -> tuple[Planned, ...]:
    """The runs of a plan in order, each repeat by its own name."""
    rate = plan.instrument.sample_rate
    return tuple(
        Planned(
            id=name, configuration=run.configuration, gain=run.gain, seconds=run.ticks(rate) / rate, broad=run.excitation in BROAD
        )
        for run in plan.runs
        for name in run.ids()
    )


def planned_as(runs: Iterable[Run]) -> tuple[Planned, ...]:
    """Runs that were taken, as if a plan had asked for them."""
    return tuple(
        Planned(
            id=run.id, configuration=run.configuration, gain=run.gain, broad=run.excitation in BROAD,
            seconds=(len(run) + sum(gap.count for gap in run.gaps)) / run.sample_rate,
        )
        for run in runs
    )  # fmt: skip
