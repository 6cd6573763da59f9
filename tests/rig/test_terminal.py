"""Terminals that are stopped, closed or interrupted: no command waits for them for ever, and none prints a traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import termios
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "drivers"))
sys.path.insert(0, str(Path(__file__).resolve().parent / "acquire"))

from far import FramedFar
from test_recording import example
from test_sessions_attacked import killed, session, wait_for

from isorig.rig.cli import TERMINAL_GONE
from isorig.rig.files.recording import read, write
from isorig.rig.process.terminal import show_table

RIG = (sys.executable, "-P", "-m", "isorig")


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_a_session_ends_on_a_terminal_that_was_stopped(tmp_path: Path, options: list[str]) -> None:
    own, other = os.openpty()
    pipes = {"stdout": other, "stderr": other}
    with FramedFar(frames=40, speed=1.0) as far, killed(session(tmp_path, far.port, *options, seconds=2.0, **pipes)) as process:
        wait_for(lambda: far.sent > 4)
        # Ctrl-S: from here on nothing that the session writes is taken.
        os.write(own, b"\x13")
        assert process.wait(timeout=40) == 0
    os.close(own)
    os.close(other)
    run = read(tmp_path / "c.h5").runs[0]
    np.testing.assert_array_equal(run.channels["motor"].samples, np.arange(2000))


@pytest.mark.parametrize("asks", [False, True])
def test_a_terminal_that_is_closed_without_a_signal_ends_a_session_in_order(tmp_path: Path, asks: bool) -> None:
    # It is not the terminal that controls the process, so that closing it sends no signal; every access is an error then.
    own, other = os.openpty()
    log = (tmp_path / "log").open("wb")
    with FramedFar(frames=40, speed=1.0) as far:
        options = ["--json"] if asks else []
        pipes = {"stdin": other, "stdout": other, "stderr": log if asks else other}
        with killed(session(tmp_path, far.port, *options, seconds=2.0, **pipes)) as process:
            os.close(other)
            wait_for(lambda: far.sent > 4)
            os.close(own)
            assert process.wait(timeout=40) == 0
    log.close()
    assert (tmp_path / "log").read_bytes() == b""
    assert len(read(tmp_path / "c.h5").runs[0]) == 2000


def test_a_command_on_a_closed_terminal_prints_no_traceback(tmp_path: Path) -> None:
    write(tmp_path / "a.h5", example())
    own, other = os.openpty()
    attributes = termios.tcgetattr(other)
    assert attributes
    with subprocess.Popen([*RIG, "check", str(tmp_path / "a.h5")], stdout=other, stderr=subprocess.PIPE) as process:
        os.close(other)
        os.close(own)
        assert process.stderr is not None
        assert process.stderr.read() == b""
    assert process.returncode == TERMINAL_GONE


#: Modules in whose imports a command is interrupted: of the command line, of the arrays, of the files.
INTERRUPTED = ("cyclopts._convert", "numpy.lib", "h5py._hl.files")


@pytest.mark.parametrize("module", INTERRUPTED)
def test_an_interrupt_during_imports_is_one_line(tmp_path: Path, module: str) -> None:
    write(tmp_path / "a.h5", example())
    call = [sys.executable, "-P", "-X", "importtime", "-m", "isorig", "check", str(tmp_path / "a.h5")]
    with subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if line.split("|")[-1].strip().startswith(module):
                process.send_signal(signal.SIGINT)
                break
        said = [line for line in process.stderr if not line.startswith("import time:")]
    assert said == ["rig: stopped by the operator\n"]
    assert process.returncode == 130


def test_a_program_ends_after_its_threads_and_exit_functions_with_the_status_of_its_command() -> None:
    program = """
import atexit, sys, threading, time
from isorig.rig import cli

def later():
    time.sleep(0.2)
    print("thread")

def command(arguments):
    threading.Thread(target=later).start()
    atexit.register(print, "last")
    print("command", *arguments)
    return 3

cli._status = command
sys.exit(cli.main())
"""
    done = subprocess.run([sys.executable, "-c", program, "a"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (3, "command a\nthread\nlast\n", "")


def test_tables_break_neither_words_nor_numbers(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Seven columns with units are wider than 80 characters."""
    monkeypatch.setenv("COLUMNS", "80")
    values = [f"{k}.32 m/s²" for k in range(7)]
    show_table(
        "rms", ("run", "set-up", *(f"sensor{k}" for k in range(7)), "clip"), [["shot_001", "random noise", *values, "unknown"]]
    )
    said = capsys.readouterr().out
    assert all(value in said for value in (*values, "random", "unknown", "shot_001"))


def test_a_long_first_column_breaks_no_word_of_the_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    bodies, channels = " + ".join(f"wing_{k}" for k in range(9)), "force, acc_tip_r, acc_launcher, acc_payload, acc_tail"
    show_table("equations", ("equation", "springs and contacts", "channels"), [[bodies, "mount", channels]])
    assert {f"{name}," for name in ("force", "acc_tip_r", "acc_launcher", "acc_payload")} <= {*capsys.readouterr().out.split()}
