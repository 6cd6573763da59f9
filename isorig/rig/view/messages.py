"""Messages between session, screen and page: JSON with fixed fields, anything else is rejected."""

from collections.abc import Iterable
from typing import Literal

import msgspec

from isorig.analysis.campaign import BROAD, Run
from isorig.rig.acquire.live import EquationsReport
from isorig.rig.acquire.notes import Note
from isorig.rig.acquire.plan import Plan, RunPlan

#: The requests of an operator.
RequestKind = Literal["stop", "again", "next", "note"]


class Message(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Any message."""


class Planned(msgspec.Struct, frozen=True, kw_only=True):
    """A run: configuration, gain, duration in seconds, and whether its drive is broad-band."""

    id: str
    configuration: str
    gain: float
    seconds: float
    broad: bool


class SessionBegin(Message, frozen=True):
    """The subject of a session's screen: the recording, and the runs of the plan."""

    output: str
    planned: tuple[Planned, ...]


class PageRequest(Message, frozen=True, tag="asked", tag_field="say"):
    """A pressed button: the request, the run that the page showed, and the text of a note."""

    do: RequestKind
    run: str
    text: str = ""


class FrameDrawn(Message, frozen=True, tag="drawn", tag_field="say"):
    """The page has drawn a frame: its number, and how many values it contained."""

    frame: int
    values: int


class Judgement(Message, frozen=True):
    """Result of the post-run check: whether the run is worth keeping, and advice."""

    good: bool
    advice: tuple[str, ...]


class SessionState(Message, frozen=True):
    """State of a session."""

    #: "begins", "asks" (it waits for the operator before a run), "checks" (pre-run check), "measures", "finishes" (all runs are
    #: measured and it waits for the operator), or "over".
    phase: Literal["begins", "asks", "checks", "measures", "finishes", "over"] = "begins"
    run: str = ""  #: The current or next run; the last one when all are measured.
    last: str = ""  #: The run measured last.
    may: tuple[RequestKind, ...] = ()  #: The requests that are allowed now.
    text: str = ""  #: What it waits for, or why it is over.
    judged: dict[str, Judgement] = {}  #: Result of the post-run check of each run.
    stopped: tuple[str, ...] = ()  #: Runs that the operator stopped.
    seconds: float = 0.0  #: Duration of the current run so far, seconds.
    #: Blocks of the current run with an overload, frames damaged in transmission.
    overloads: int = 0
    damaged: int = 0
    notes: tuple[Note, ...] = ()
    #: What the equations of motion tell of the current or last run; None before the first message.
    equations: EquationsReport | None = None


def planned_by(plan: Plan) -> tuple[Planned, ...]:
    """The runs of a plan in order, each repeat with its own name."""
    rate = plan.instrument.sample_rate
    return tuple(_planned(name, run, run.ticks(rate) / rate) for run in plan.runs for name in run.ids())


def planned_as(runs: Iterable[Run]) -> tuple[Planned, ...]:
    """Runs of a recording, as if they were planned."""
    return tuple(_planned(run.id, run, (len(run) + sum(gap.count for gap in run.gaps)) / run.sample_rate) for run in runs)


def _planned(name: str, run: Run | RunPlan, seconds: float) -> Planned:
    broad = run.excitation in BROAD
    return Planned(id=name, configuration=run.configuration, gain=run.gain, seconds=seconds, broad=broad)
