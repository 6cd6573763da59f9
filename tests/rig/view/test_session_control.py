"""What the operator may ask of a session, and what becomes of it: real sessions with an instrument on a pseudo-terminal."""

from __future__ import annotations

import shutil
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pages import until

from isorig.rig.acquire.notes import Note, add_note, notes_in, reopen_notes, separate_notes, settle_notes
from isorig.rig.acquire.plan import Plan
from isorig.rig.acquire.rig_operator import Operator
from isorig.rig.acquire.session import acquire
from isorig.rig.acquire.terminal import Terminal
from isorig.rig.files.recording import read
from isorig.rig.view.messages import PageRequest, SessionState, planned_by
from isorig.rig.view.process import viewed
from isorig.rig.view.session_control import SessionControl

sys.path.insert(0, str(Path(__file__).parents[1] / "acquire"))
from ramps import Watcher, plan_of, ramp_instrument

RUNS = (
    {"id": "a", "seconds": 3.0}, {"id": "b", "seconds": 2.0}, {"id": "c", "seconds": 2.0, "configuration": "locked"},
)  # fmt: skip


class Session:
    """A session in a thread, its control, and all runs that it took, in order."""

    def __init__(self, folder: Path, plan: Plan, port: str, *, asks: bool) -> None:
        self.output, self.watcher = folder / "c.h5", Watcher()
        self.control = SessionControl(planned_by(plan), self.output, asks=asks)
        self.stood: list[SessionState] = []
        self.control.listeners.append(self.stood.append)
        self._plan, self._port = plan, port
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        operator = self.control.operator(self.watcher.operator)
        acquire(self._plan, self._port, self.output, operator, force=True)
        while name := self.control.again():
            acquire(self._plan, self._port, self.output, operator, resume=True, again={name}, force=True)
        settle_notes(self.output)
        self.control.over("ended")

    def waits(self, phase: str, run: str) -> SessionState:
        """Until the session stands so."""
        until(lambda: (self.control.standing.phase, self.control.standing.run) == (phase, run))
        return self.control.standing

    def press(self, do: str, run: str, text: str = "") -> bool:
        """Press a button."""
        return self.control.ask(PageRequest(do=do, run=run, text=text))  # type: ignore[arg-type]

    def taken(self) -> list[str]:
        """Runs in the order in which they were taken."""
        return [item.id for item in self.watcher.runs]


def session(tmp_path: Path, act: Callable[[Session], Any], *, asks: bool = True, speed: float = 4.0) -> Session:
    with ramp_instrument(speed=speed) as (port, instrument):
        going = Session(tmp_path, plan_of(*RUNS), port, asks=asks)
        act(going)
        going.thread.join(60.0)
        assert not going.thread.is_alive()
        assert not instrument.running
    return going


def test_runs_are_stopped_and_repeated_and_none_starts_unrequested(tmp_path: Path) -> None:
    def act(going: Session) -> None:
        first = going.waits("asks", "a")
        assert first.may == ("next", "note")
        assert "configuration 'unlocked'" in first.text
        # What is not on the page's screen is not done.
        assert not any([going.press("next", "c"), going.press("next", ""), going.press("stop", "a"), going.press("again", "a")])
        assert going.press("next", "a")
        going.waits("measures", "a")
        assert not going.press("next", "a")
        assert not going.press("next", "b")
        assert not going.press("stop", "b")
        assert going.press("stop", "a")
        assert not going.press("stop", "a")
        # A run that was stopped is not sound: the session asks.
        stopped = going.waits("asks", "b")
        assert (stopped.stopped, stopped.may) == (("a",), ("next", "again", "note"))
        assert going.press("again", "b")
        going.waits("measures", "a")
        # It is sound now and the next has the same configuration: nothing is asked.
        going.waits("measures", "b")
        assert "configuration 'locked'" in going.waits("asks", "c").text
        assert going.press("next", "c")
        assert "repeat c" in going.waits("finishes", "c").text
        assert going.press("again", "c")
        going.waits("measures", "c")
        going.waits("finishes", "c")
        assert going.press("next", "c")

    going = session(tmp_path, act)
    assert going.taken() == ["a", "a", "b", "c", "c"]
    lengths = {run.id: len(run) for run in read(going.output).runs}
    assert lengths == {"a": 3 * 1024, "b": 2 * 1024, "c": 2 * 1024}
    assert going.watcher.runs[0].tally.stored < 3 * 1024


def test_going_on_leaves_a_stopped_run_as_it_is(tmp_path: Path) -> None:
    def act(going: Session) -> None:
        going.waits("asks", "a")
        going.press("next", "a")
        going.waits("measures", "a")
        going.press("stop", "a")
        going.waits("asks", "b")
        going.press("next", "b")
        going.waits("asks", "c")
        # To take b again the session ends a part; it does not come back to a.
        going.press("again", "c")
        going.waits("measures", "b")
        going.waits("asks", "c")
        going.press("next", "c")
        going.waits("finishes", "c")
        going.press("next", "c")

    going = session(tmp_path, act)
    assert going.taken() == ["a", "b", "b", "c"]
    lengths = {run.id: len(run) for run in read(going.output).runs}
    assert 0 < lengths["a"] < 3 * 1024


def test_a_session_that_asks_nothing_goes_on_by_itself(tmp_path: Path) -> None:
    def act(going: Session) -> None:
        going.waits("measures", "a")
        assert going.press("again", "a")
        assert not going.press("again", "a")

    going = session(tmp_path, act, asks=False)
    assert going.taken() == ["a", "a", "b", "c"]
    assert {standing.phase for standing in going.stood} == {"checks", "measures", "over"}
    assert all("next" not in standing.may for standing in going.stood)


def test_notes_are_kept_in_the_recording(tmp_path: Path) -> None:
    def act(going: Session) -> None:
        going.waits("measures", "a")
        assert going.press("note", "a", "the table was touched\n\x1b[31m")
        assert not going.press("note", "a", "   ")
        # It is safe before the session ends.
        assert [note.text for note in separate_notes(going.output)] == ["the table was touched  [31m"]
        going.press("again", "a")
        going.waits("measures", "b")
        assert going.press("note", "b", "µ" * 1000)

    going = session(tmp_path, act, asks=False)
    kept = notes_in(going.output)
    assert [(note.run, len(note.text)) for note in kept] == [("a", 27), ("b", 500)]
    assert tuple(kept) == going.control.standing.notes
    assert read(going.output).runs  # what it adds is nothing to other readers
    # A bit that flips in a note is noticed, as in what was measured.
    damaged = bytearray(going.output.read_bytes())
    assert damaged.count(b"the table was touched") == 1
    damaged[damaged.index(b"the table was touched")] ^= 1
    going.output.write_bytes(damaged)
    assert notes_in(going.output) == []


@settings(max_examples=60, deadline=None)
@given(
    wishes=st.lists(
        st.tuples(st.sampled_from(["stop", "again", "next", "note"]), st.sampled_from(["a", "b", "c", "", "x"])), max_size=30
    ),
    asks=st.booleans(),
)  # fmt: skip
def test_no_wish_starts_what_the_plan_does_not_say(tmp_path_factory: pytest.TempPathFactory, wishes: Any, asks: bool) -> None:
    control = SessionControl(planned_by(plan_of(*RUNS)), tmp_path_factory.getbasetemp() / "none.h5", asks=asks)
    for do, run in wishes:
        # The session has not begun: it waits for nobody, no run lasts, and a note needs one of these.
        assert not control.ask(PageRequest(do=do, run=run, text="x"))
    assert not control.stopped()
    assert control.standing == SessionState()


def test_a_second_screen_shows_what_the_terminal_shows(tmp_path: Path) -> None:
    heard: list[str] = []
    plan = plan_of(RUNS[1])
    control = SessionControl(planned_by(plan), tmp_path / "c.h5", asks=False)
    beside = Operator(lock=heard.append, watch=lambda live: heard.append(live.run), taken=lambda item: heard.append(item.id))
    with ramp_instrument(speed=8.0) as (port, _):
        acquire(plan, port, tmp_path / "c.h5", control.operator(beside), force=True)
    assert set(heard) == {"b"}
    assert len(heard) >= 3


def test_notes_outlive_a_session_that_goes_on_and_one_that_was_recovered(tmp_path: Path) -> None:
    output = tmp_path / "c.h5"
    with ramp_instrument(speed=8.0) as (port, _):
        acquire(plan_of(RUNS[0]), port, output, Watcher().operator, force=True)
        first = add_note(output, "a", "first")
        settle_notes(output)
        assert separate_notes(output) == []
        # A session that goes on writes the recording anew.
        reopen_notes(output)
        reopen_notes(output)
        acquire(plan_of(*RUNS[:2]), port, output, Watcher().operator, resume=True, force=True)
    assert notes_in(output) == []
    second = add_note(output, "b", "second")
    with output.with_name("c.h5.notes").open("ab") as file:
        file.write(b'{"time": "2026", "run": "b", "te')  # killed while it was written
    third = add_note(output, "b", "third")
    other = tmp_path / "saved.h5"
    shutil.copy(output, other)
    settle_notes(other, session=output)
    assert notes_in(other) == [first, second, third]
    assert separate_notes(output) == [first, second, third]
    left = output.with_name("c.h5.partial")
    left.touch()
    settle_notes(output)  # a session measures, or was killed: its recording will be written anew
    assert notes_in(output) == []
    left.unlink()
    settle_notes(output)
    settle_notes(output)
    assert notes_in(output) == [first, second, third]
    assert not output.with_name("c.h5.notes").exists()
    assert [run.id for run in read(output).runs] == ["a", "b"]
    assert isinstance(first, Note)


def test_late_requests_have_no_effect(tmp_path: Path) -> None:
    # A session may tell of levels and of runs from another thread, behind what it is doing.
    plan, watcher = plan_of(*RUNS), Watcher()
    with ramp_instrument(speed=8.0) as (port, _):
        acquire(plan, port, tmp_path / "c.h5", watcher.operator, force=True)
    control = SessionControl(planned_by(plan), tmp_path / "d.h5", asks=True)
    operator = control.operator(Watcher().operator)
    levels = {live.run: live for live in watcher.seen}
    decided: list[str] = []
    session = threading.Thread(target=lambda: decided.extend(control.decide(name) for name in ("a", "b", "c")), daemon=True)
    session.start()
    until(lambda: control.standing.phase == "asks")
    operator.watch(levels["a"])
    assert control.standing.phase == "asks"
    control.ask(PageRequest(do="next", run="a"))
    until(lambda: control.standing.phase == "checks")
    time.sleep(0.3)
    assert control.standing.run == "a"  # it is not on to the next before this one has been told of
    operator.watch(levels["a"])
    assert control.standing.phase == "measures"
    operator.taken(watcher.runs[0])
    until(lambda: (control.standing.phase, control.standing.run) == ("checks", "b"))
    operator.watch(levels["a"])
    assert (control.standing.phase, control.standing.may) == ("checks", ("note",))
    operator.taken(watcher.runs[1])
    until(lambda: control.standing.phase == "asks")
    operator.watch(levels["b"])
    assert (control.standing.phase, control.standing.run) == ("asks", "c")
    control.ask(PageRequest(do="next", run="c"))
    session.join(10.0)
    assert decided == ["take"] * 3


def test_a_slow_disk_for_notes_delays_no_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun, go_on = threading.Event(), threading.Event()

    def slow(*given: Any) -> Note:
        begun.set()
        assert go_on.wait(30.0)
        return add_note(*given)

    monkeypatch.setattr("isorig.rig.view.session_control.add_note", slow)

    def act(going: Session) -> None:
        going.waits("measures", "a")
        noting = threading.Thread(target=going.press, args=("note", "a", "slow"), daemon=True)
        noting.start()
        assert begun.wait(30.0)
        before = going.control.standing.seconds
        # The session tells of its levels meanwhile.
        until(lambda: going.control.standing.seconds > before)
        assert noting.is_alive()
        go_on.set()
        noting.join(30.0)

    going = session(tmp_path, act, asks=False, speed=1.0)
    assert [note.text for note in going.control.standing.notes] == ["slow"]


def test_a_suspended_terminal_delays_no_page(tmp_path: Path) -> None:
    plan, output, going = plan_of({"id": "a", "seconds": 2.0}, {"id": "b", "seconds": 2.0}), tmp_path / "c.h5", threading.Event()
    stands = replace(Watcher().operator, watch=lambda live: going.wait())
    stood: list[SessionState] = []
    with (
        ramp_instrument(speed=4.0) as (port, _),
        viewed(plan, output, stands, Terminal(json=False), asks=False) as (control, operator),
    ):
        control.listeners.append(stood.append)
        try:
            acquire(plan, port, output, operator, force=True)
        finally:
            going.set()
    assert {standing.run for standing in stood if standing.phase == "measures"} == {"a", "b"}
    assert set(stood[-1].judged) == {"a", "b"}
