"""The session's part of the screen: which requests of the operator are allowed, and their execution.

The screen itself is another process. It receives the state of the session and passes on the pressed buttons; only this module
decides whether a request is allowed.
"""

import threading
from collections.abc import Callable
from pathlib import Path

import msgspec

from isorig.rig.acquire.live import EquationsReport, LiveState
from isorig.rig.acquire.notes import MOST, add_note, notes_in, separate_notes
from isorig.rig.acquire.rig_operator import Decision, MeasuredRun, Operator
from isorig.rig.errors import OutputError
from isorig.rig.view.messages import Judgement, PageRequest, Planned, RequestKind, SessionState

#: Seconds between two checks for the operator's answer, so that Ctrl-C is handled meanwhile.
LISTEN = 0.2
#: Seconds within which a session reports a measured run; it may do so from another thread.
TOLD = 5.0


class SessionControl:
    """Decides, with the operator, what a session with these runs does next; notes are saved next to its recording.

    If it `asks`, the session waits for the operator when an action may be needed: before the first run, when the configuration
    changes, and after a run that was stopped or has a fault.
    """

    def __init__(self, planned: tuple[Planned, ...], output: Path, *, asks: bool) -> None:
        self.planned = {item.id: item for item in planned}
        self.output, self._asks = output, asks
        #: Called with the state of the session at each change; they must not block.
        self.listeners: list[Callable[[SessionState], None]] = []
        self._changed = threading.Condition()
        self._again = ""
        self._answers: list[RequestKind] = []
        self._stop = False
        self._set_up = ""
        # The started run, until it is reported as measured.
        self._begun = ""
        self._standing = SessionState(notes=tuple(dict.fromkeys([*notes_in(output), *separate_notes(output)])))

    @property
    def standing(self) -> SessionState:
        """State of the session."""
        return self._standing

    def operator(self, other: Operator) -> Operator:
        """An operator for a session: forwards everything to `other`, and asks here."""

        def watch(live: LiveState) -> None:
            self._watch(live)
            other.watch(live)

        def taken(item: MeasuredRun) -> None:
            self._taken(item)
            other.taken(item)

        # Confirming a run includes that the rig is locked or unlocked for it.
        return Operator(lock=lambda configuration: None, watch=watch, taken=taken, decide=self.decide, stopped=self.stopped)

    def equations(self, report: EquationsReport) -> None:
        """Show what the equations of motion tell of the current run."""
        with self._changed:
            self._change(equations=report)

    def decide(self, name: str) -> Decision:
        """Decides on the next run."""
        self._settle()
        # Runs of this session are repeated on request only, also once it is resumed.
        if name != self._again and name in self._standing.judged:
            return "skip"
        if self._again:
            if name != self._again:
                return "end"
            self._again = ""
        elif self._asks and self._must_ask(name) and self._wait("asks", name, self._question(name)) == "again":
            return "end"
        self._set_up = self.planned[name].configuration
        with self._changed:
            self._stop, self._begun = False, name
            now = self._standing
            # A repetition replaces the earlier result.
            fresh = {
                "judged": {key: value for key, value in now.judged.items() if key != name},
                "stopped": tuple(key for key in now.stopped if key != name), "seconds": 0.0, "overloads": 0, "damaged": 0,
                "equations": None,
            }  # fmt: skip
            self._change(phase="checks", run=name, may=("note",), text="", **fresh)
        return "take"

    def stopped(self) -> bool:
        """Whether the current run is to end now."""
        return self._stop

    def again(self) -> str:
        """The run to be repeated, if the session has ended for that; otherwise empty.

        If the operator is asked, this waits at the end of the plan until the session is finished or a run is to be repeated.
        """
        self._settle()
        if not self._again and self._asks and self._standing.last:
            text = f"All runs of the plan are measured. Finish the session, or repeat {self._standing.last}."
            self._wait("finishes", self._standing.last, text)
        return self._again

    def ask(self, request: PageRequest) -> bool:
        """Execute a request if the session allows it now; returns whether it was allowed."""
        if request.do == "note":
            return self._note(request.text)
        with self._changed:
            now = self._standing
            if request.do not in now.may or request.run != now.run:
                return False
            text = now.text
            if request.do == "stop":
                self._stop, text = True, f"{now.run} is being stopped."
            elif request.do == "again":
                self._again = now.run if now.phase == "measures" else self._standing.last
                text = f"{self._again} will be repeated."
            self._change(text=text, may=tuple(item for item in now.may if item != request.do))
            if now.phase in ("asks", "finishes"):
                self._answers.append(request.do)
                self._changed.notify_all()
            return True

    def over(self, text: str) -> None:
        """Declare the session over."""
        with self._changed:
            self._change(phase="over", may=(), text=text)

    def _settle(self) -> None:
        with self._changed:
            self._changed.wait_for(lambda: not self._begun, TOLD)
            self._begun = ""

    def _must_ask(self, name: str) -> bool:
        last = self._standing.judged.get(self._standing.last)
        return last is None or not last.good or self.planned[name].configuration != self._set_up

    def _question(self, name: str) -> str:
        run = self.planned[name]
        same = run.configuration == self._set_up
        begin = "Start" if same else f"Bring the rig into the configuration {run.configuration!r}, then start"
        otherwise = f", or repeat {self._standing.last}." if self._standing.last else "."
        return f"{begin} {name} (gain {run.gain:g}, {run.seconds:g} s){otherwise}"

    def _wait(self, phase: str, name: str, question: str) -> RequestKind:
        with self._changed:
            self._answers.clear()
            may: tuple[RequestKind, ...] = ("next", "again", "note") if self._standing.last else ("next", "note")
            self._change(phase=phase, run=name, may=may, text=question)
            while not self._answers:
                self._changed.wait(LISTEN)
            return self._answers[0]

    def _watch(self, live: LiveState) -> None:
        with self._changed:
            if live.run != self._begun:
                return  # a late message about a run that is over
            may = self._standing.may
            if self._standing.phase != "measures":
                may = ("stop", "again", "note")
            counts = {"seconds": live.seconds, "overloads": live.overloads, "damaged": live.damaged}
            self._change(phase="measures", run=live.run, may=may, **counts)

    def _taken(self, item: MeasuredRun) -> None:
        with self._changed:
            self._begun = ""
            self._changed.notify_all()
            judged = {**self._standing.judged, item.id: Judgement(good=item.verdict.good, advice=item.verdict.advice)}
            stopped = (*self._standing.stopped, item.id) if self._stop else self._standing.stopped
            self._change(phase="checks", last=item.id, judged=judged, stopped=stopped, may=("note",))

    def _note(self, text: str) -> bool:
        with self._changed:
            now = self._standing
            if "note" not in now.may or not text.strip() or len(now.notes) >= MOST:
                return False
        try:
            # Outside of the lock: the session does not wait for the disk.
            note = add_note(self.output, now.last if now.phase == "asks" else now.run, text)
        except OutputError:
            return False
        with self._changed:
            self._change(notes=(*self._standing.notes, note))
        return True

    def _change(self, **changed: object) -> None:
        self._standing = msgspec.structs.replace(self._standing, **changed)
        for listener in self.listeners:
            listener(self._standing)
