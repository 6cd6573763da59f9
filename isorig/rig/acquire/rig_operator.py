"""The person at the rig as a session sees it: asked before each run, informed of its course and its result."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

from isorig.rig.acquire.display_thread import DisplayThread
from isorig.rig.acquire.live import LiveState
from isorig.rig.acquire.pace import ClockDrift
from isorig.rig.acquire.recorder import Tally
from isorig.rig.acquire.run_check import Verdict


@dataclass(frozen=True, kw_only=True)
class MeasuredRun:
    """A measured run: its sample counts, its post-run check, and the drift of its clock."""

    id: str
    tally: Tally
    verdict: Verdict
    drift: ClockDrift | None = None


#: Decision on the next run: measure it, skip it, or end the session before it.
Decision = Literal["take", "skip", "end"]


@dataclass(frozen=True, kw_only=True)
class Operator:
    """The person at the rig, or a substitute."""

    lock: Callable[[str], None]  #: Asks to bring the rig into a configuration; returns when it is done.
    watch: Callable[[LiveState], None]  #: Receives the live state of a run.
    taken: Callable[[MeasuredRun], None]  #: Receives each measured run.
    decide: Callable[[str], Decision] = lambda name: "take"  #: Asked before each run, by its name, for the decision.
    stopped: Callable[[], bool] = lambda: False  #: Polled during a run; True ends the run, which then counts as incomplete.
    answered: Callable[[], bool] = lambda: False  #: Polled during a run; True ends the run, which then counts as complete.


def decoupled_operator(operator: Operator, display: DisplayThread) -> Operator:
    """The same operator, called from another thread, with all calls completed before a question is asked."""

    def lock(configuration: str) -> None:
        display.settle()
        operator.lock(configuration)

    def decide(name: str) -> Decision:
        display.settle()
        return operator.decide(name)

    return replace(
        operator, lock=lock, decide=decide, watch=lambda live: display.latest(lambda: operator.watch(live)),
        taken=lambda item: display.each(lambda: operator.taken(item)),
    )  # fmt: skip
