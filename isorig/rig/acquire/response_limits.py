"""Limits of the rig's response: predicted by simulation before a session, and watched during each run."""

from collections.abc import Iterable

import numpy as np

from isorig.analysis.errors import ModelError
from isorig.analysis.proposals.limits import largest_of, simulated_peaks
from isorig.analysis.simulate import Excitation
from isorig.drivers.block import Block
from isorig.drivers.errors import InstrumentError
from isorig.drivers.instrument import Stream
from isorig.rig.acquire.drive import drive_of
from isorig.rig.acquire.plan import Plan, RunPlan
from isorig.rig.acquire.policy import CERTAIN
from isorig.rig.errors import PlanError

#: Seconds simulated at once, and seconds before them in which the vibration builds up: a natural frequency of 1 Hz with a damping
#: ratio of 5 % reaches 96 % of its level in 10 s.
PART, BUILD_UP = 60.0, 10.0


def check_responses(plan: Plan, runs: Iterable[tuple[RunPlan, int]]) -> None:
    """Simulate runs, each with the index of its repeat, and compare the rig's response with the limits of the plan and the rig.

    The rig has the values of its description or of the plan, so a prediction refuses a run only if it exceeds `CERTAIN` times a
    limit. Nothing is simulated without a limit for strokes, channels or force. Raises PlanError if a run would certainly exceed a
    limit.
    """
    model = plan.nominal(friction="friction_force" in plan.rig)
    try:
        limits = plan.limits.within(model.limits)
    except ModelError as error:
        raise PlanError(str(error)) from None
    if not (limits.stroke or limits.channels or limits.force is not None):
        return
    rate = plan.instrument.sample_rate
    part, before = round(PART * rate), round(BUILD_UP * rate)
    for run, repeat in runs:
        if not run.played:
            continue
        drive = drive_of(*plan.original(run, repeat), rate)
        pieces = [run.gain * drive[max(start - before, 0) : start + part] for start in range(0, len(drive), part)]
        excitations = [
            Excitation.prepare(piece, rate, others=[np.zeros(len(piece))] * len(model.more_drives)) for piece in pieces
        ]
        found = largest_of([simulated_peaks([model], one, run.configuration, 0.0) for one in excitations]).beyond(limits, CERTAIN)
        if found:
            raise PlanError(
                f"run {run.ids()[repeat]!r} was not started: by simulation {found}; lower its gain, correct the rig's values, or "
                "start with --force"
            )


class Guard:
    """Ends a run whose records exceed `limits.channels`."""

    def __init__(self, plan: Plan, instrument: Stream) -> None:
        self._watched = [
            (name, channel, instrument.inputs[channel.input], plan.limits.channels[name])
            for name, channel in plan.channels.items()
            if name in plan.limits.channels
        ]

    def check(self, block: Block) -> None:
        """Compare a block with the limits. Raises InstrumentError if a value exceeds its limit; whoever ends the run stops the
        drive."""
        for name, channel, source, most in self._watched:
            raw = block.samples[:, channel.input]
            reached = np.abs(source.physical(raw) / channel.sensitivity).max(initial=0.0)
            if reached > most:
                raise InstrumentError(
                    f"{name} reached {reached:.3g} {channel.unit} and limits.channels allows {most:.3g}, so the run was ended, "
                    "the drive stopped; lower its gain"
                )
