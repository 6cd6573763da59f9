"""The screen cannot slow the wire: pages that stand still, a screen that stands still or is killed, a session that is killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import psutil
import pytest
from pages import Socket, until
from plans import plan_text

from isorig.rig.acquire.session import acquire
from isorig.rig.cli import main
from isorig.rig.files.recording import read
from isorig.rig.view.messages import planned_by
from isorig.rig.view.process import session_screen
from isorig.rig.view.session_control import SessionControl
from isorig.rig.virtual.demo import virtual_instrument

sys.path.insert(0, str(Path(__file__).parents[1] / "acquire"))
from ramps import Watcher, plan_of, ramp_instrument

RATE, INPUTS = 51200.0, 8
RIG = (sys.executable, "-m", "isorig")
#: What the recording process may use of a core while the screen is open.
SHARE = 0.10


def wide_plan(seconds: float) -> Any:
    plan = plan_of({"id": "a", "seconds": seconds}, rate=RATE)
    one = plan.channels["head"]
    names = ["head", *(f"c{k}" for k in range(1, INPUTS))]
    return msgspec.structs.replace(plan, channels={name: msgspec.structs.replace(one, input=k) for k, name in enumerate(names)})


def screen_process() -> psutil.Process:
    (found,) = (p for p in psutil.Process().children() if p.status() != psutil.STATUS_ZOMBIE and "isorig.rig.view" in p.cmdline())
    return found


def answering(page: Socket, frames: list[int]) -> None:
    try:
        while True:
            frames.append(page.frame()[0]["frame"])
    except (EOFError, OSError, AssertionError):
        return


@pytest.mark.parametrize("trouble", ["pages that stand still", "a screen that stands still", "a screen that is killed"])
def test_nothing_is_lost_at_the_full_rate(tmp_path: Path, trouble: str) -> None:
    plan, watcher, output = wide_plan(4.0), Watcher(), tmp_path / "c.h5"
    control = SessionControl(planned_by(plan), output, asks=False)
    frames: list[int] = []
    with ramp_instrument(speed=1.0, rows=64, inputs=INPUTS) as (port, instrument):
        with session_screen(control) as address:
            beside = screen_process()
            quick, *still = (Socket(address) for _ in range(6))
            thread = threading.Thread(target=answering, args=(quick, frames), daemon=True)
            thread.start()
            if trouble != "pages that stand still":
                sent = signal.SIGSTOP if trouble == "a screen that stands still" else signal.SIGKILL
                threading.Timer(1.5, beside.send_signal, [sent]).start()
            acquire(plan, port, output, control.operator(watcher.operator), force=True)
            ended = time.monotonic()
            if trouble == "a screen that stands still":
                beside.resume()
        assert time.monotonic() - ended < 60.0
        assert instrument.sent == 204_800
    thread.join(10.0)
    tally = watcher.runs[0].tally
    assert (tally.stored, tally.lost) == (204_800, 0)
    samples = np.asarray(read(output).runs[0].channels["c7"].samples[:])
    np.testing.assert_array_equal(samples, np.arange(204_800) * 4 + 7)
    # Four frames a second at least reached the page that answers while it could be reached.
    assert len(frames) >= (12 if trouble == "pages that stand still" else 4)
    assert not beside.is_running() or beside.status() == psutil.STATUS_ZOMBIE
    del still


@pytest.mark.study
def test_recording_with_the_screen_open_costs_a_tenth_of_a_core_at_most() -> None:
    bench = Path(__file__).parents[3] / "bench" / "view.py"
    call = [sys.executable, str(bench), "--seconds", "60"]
    done = subprocess.run(call, capture_output=True, text=True, timeout=280, check=True)
    for row in done.stdout.splitlines()[2:]:
        _, _, recorder, _, frames, stored, lost = (float(word) for word in row.split())
        assert recorder <= 100.0 * SHARE
        assert frames >= 4.0
        assert (stored, lost) == (60 * RATE, 0)


RUN = {"id": "a", "excitation": "random", "band": [0.5, 20.0]}


def test_a_killed_session_is_reported_and_its_notes_are_recovered(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(plan_text({**RUN, "seconds": 30.0}, channels={"head": 0}, sensitivity=0.2))
    output = tmp_path / "c.h5"
    with virtual_instrument(0, "--speed", "2") as port:
        call = [*RIG, "acquire", str(tmp_path / "plan.toml"), "--port", port, "-o", str(output), "--view", "--yes", "--json"]
        with subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as session:
            assert session.stdout is not None
            page = Socket(json.loads(session.stdout.readline())["address"])
            beside = psutil.Process(session.pid).children()[0]
            while page.frame()[0]["state"]["phase"] != "measures":
                pass
            page.say({"say": "asked", "do": "note", "run": "a", "text": "smell of smoke"})
            while not page.frame()[0]["state"]["notes"]:
                pass
            # A second screen in another terminal looks on, and cannot act.
            watching = subprocess.Popen([*RIG, "view", str(output)], stdout=subprocess.PIPE, text=True)
            assert watching.stdout is not None
            other = Socket(watching.stdout.readline().strip())
            while (state := other.frame()[0]["state"])["phase"] != "measures":
                pass
            assert (state["mode"], state["may"], state["shown"]) == ("watch", [], "a")
            assert [note["text"] for note in state["notes"]] == ["smell of smoke"]
            other.say({"say": "asked", "do": "stop", "run": "a"})
            time.sleep(0.5)
            assert session.poll() is None
            os.kill(session.pid, signal.SIGKILL)
            watching.kill()
            watching.wait()
            while (state := page.frame()[0]["state"])["phase"] != "over":
                pass
            assert "rig recover" in state["text"]
            until(lambda: not beside.is_running() or beside.status() == psutil.STATUS_ZOMBIE)
    assert main(["recover", f"{output}.partial", "-o", str(tmp_path / "saved.h5")]) == 0
    from isorig.rig.acquire.notes import notes_in

    assert [(note.run, note.text) for note in notes_in(tmp_path / "saved.h5")] == [("a", "smell of smoke")]


def test_a_session_that_is_ended_while_it_waits_keeps_its_notes(tmp_path: Path) -> None:
    (tmp_path / "plan.toml").write_text(plan_text({**RUN, "seconds": 1.5}, channels={"head": 0}, sensitivity=0.2))
    output = tmp_path / "c.h5"
    call = [*RIG, "acquire", str(tmp_path / "plan.toml"), "--port", "virtual", "-o", str(output), "--view", "--json", "--force"]
    with subprocess.Popen(call, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as session:
        assert session.stdout is not None
        page = Socket(json.loads(session.stdout.readline())["address"])
        for phase, do, text in (("asks", "next", ""), ("finishes", "note", "it hummed")):
            while page.frame()[0]["state"]["phase"] != phase:
                pass
            page.say({"say": "asked", "do": do, "run": "a", "text": text})
        while not page.frame()[0]["state"]["notes"]:
            pass
        session.send_signal(signal.SIGTERM)
        _, said = session.communicate(timeout=100.0)
        assert session.returncode == 128 + signal.SIGTERM
    assert said == f"the measured data are in {output}; rig acquire --resume continues the plan\n"
    from isorig.rig.acquire.notes import notes_in

    assert [(note.run, note.text) for note in notes_in(output)] == [("a", "it hummed")]
    assert [path.name for path in tmp_path.iterdir() if path.name != "plan.toml"] == ["c.h5"]


def test_what_cannot_be_shown_is_refused_in_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "noise.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(range(256)))
    (tmp_path / "text.h5").write_text("no recording")
    cases = [
        (["nothing.h5"], "no session writes it"), (["nothing.h5", "--replay"], "does not exist"), (["noise.h5"], "damaged"),
        (["text.h5", "--replay"], "is not an HDF5 file"), (["text.h5", "--speed", "0"], "--speed is 0"),
        (["text.h5", "--speed", "nan"], "--speed is nan"), (["text.h5", "--seconds", "-1"], "--seconds is -1"),
        (["text.h5", "--plan", str(tmp_path / "none.toml")], "none.toml"),
    ]  # fmt: skip
    for (name, *options), says in cases:
        assert main(["view", str(tmp_path / name), *options]) == 2, name
        told = capsys.readouterr()
        assert says in told.err, told.err
        assert told.err.count("\n") == 1
        assert told.out == ""
